"""Totals of what keeps the cameras from seeing, per literal, camera and cause."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.sensing.cause import SIDES, Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts


@dataclass(frozen=True)
class Failure:
    """The first limit that fails for a target in one sample and camera; cause NONE where it is seen.

    by: as in `BoxVerdicts`. figure: by how much the limit is missed.
    """

    cause: Cause
    by: int
    figure: float


SEEN = Failure(Cause.NONE, -1, 0.0)

_CAUSES = {int(cause): cause for cause in Cause}


@dataclass(frozen=True)
class CauseTotal:
    """How long [s] a camera does not see the boxes of an atom's target for one cause, while it must be observable.

    by: the occluder, or the side of the image; None otherwise.
    """

    atom: Atom
    camera: str
    cause: Cause
    by: str | None
    duration: float


def cause_totals(cell: Cell, study: Study) -> tuple[CauseTotal, ...]:
    """Totals of every atom, camera and cause, the longest first within each atom.

    Each sample stands for half of the time to its neighbours in its piece.
    """
    weights = sample_weights(study)
    observation = study.timeline.observation
    totals = []
    for column, (target, boxes) in enumerate(zip(study.targets, observation.full_matrix, strict=True)):
        rows = np.flatnonzero(observation.required[:, column])
        sums: dict[tuple[int, Cause, int], float] = defaultdict(float)
        for camera in range(len(cell.observer.cameras)):
            for row, failure in zip(rows.tolist(), first_failures(boxes, rows, camera), strict=True):
                if failure.cause is not Cause.NONE:
                    sums[camera, failure.cause, failure.by] += float(weights[row])
        found = [
            CauseTotal(target.atom, cell.observer.cameras[camera].name, cause, by_name(cell, cause, by), duration)
            for (camera, cause, by), duration in sums.items()
            if duration > 0
        ]
        totals += sorted(found, key=lambda total: -total.duration)
    return tuple(totals)


def first_failures(boxes: tuple[BoxVerdicts, ...], rows: NDArray[np.int64], camera: int) -> list[Failure]:
    """How the first box that a camera does not see fails, for each of the given samples."""
    causes = np.stack([box.cause[rows, camera] for box in boxes])
    first, at = (causes != Cause.NONE).argmax(axis=0), np.arange(len(rows))
    by, figure = (
        np.stack(values)[first, at].tolist()
        for values in zip(*((box.by[rows, camera], box.figure[rows, camera]) for box in boxes), strict=True)
    )
    codes = causes[first, at].tolist()
    return [
        SEEN if code == Cause.NONE else Failure(_CAUSES[code], *rest)
        for code, *rest in zip(codes, by, figure, strict=True)
    ]


def by_name(cell: Cell, cause: Cause, by: int) -> str | None:
    """What output calls the culprit of a cause."""
    match cause:
        case Cause.HIDDEN:
            return cell.solid_name(by)
        case Cause.OUT_OF_IMAGE:
            return SIDES[by]
        case _:
            return None


def sample_weights(study: Study) -> Array:
    """Time that each sample stands for [s], shape (m,); they add up to the duration of the motion."""
    steps = np.nan_to_num(study.timeline.steps)
    weights = np.zeros(len(steps) + 1)
    weights[:-1] += 0.5 * steps
    weights[1:] += 0.5 * steps
    return weights
