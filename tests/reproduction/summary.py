"""What the paper reports of a candidate, of one of ours; and which cameras see what."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause
from sqrp_cli.study.assessment import Analysis, study
from sqrp_cli.study.quality import qualities_over
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.timeline import observe
from sqrp_cli.task.task import Candidate


@dataclass(frozen=True)
class Summary:
    """Qualities [%] and duration [s] of a candidate."""

    q_avg: float
    q_eoi: float
    time: float

    @classmethod
    def of(cls, found: Analysis) -> Summary:
        """The summary of a study that has both qualities."""
        qualities = qualities_over(found.timeline)
        assert qualities.q_avg is not None
        assert qualities.q_eoi is not None
        return cls(100 * qualities.q_avg, 100 * qualities.q_eoi, found.motion.time)


def feasible_study(cell: Cell, candidate: Candidate, sampling: Sampling, *, full: bool = False) -> Analysis:
    """The study of a candidate that can be done."""
    found = study(cell, candidate, cell.initial_world, sampling, full=full)
    assert isinstance(found, Analysis), found
    return found


def seen_again(found: Analysis, cell: Cell, sampling: Sampling, *, full: bool = False) -> Analysis:
    """The same candidate and motion, before the cameras of a cell."""
    return replace(found, timeline=observe(found, cell.observer, sampling, full=full))


def always_in_interest(cell: Cell, found: Analysis, predicate: str | None, *causes: Cause) -> frozenset[str]:
    """Cameras for which every box has one of the causes in every sample of interest of a full study.

    predicate: of the only target that is asked about; None for all of them.
    """
    interest = found.timeline.interesting
    boxes = [
        box.cause[interest]
        for target, boxes in zip(found.targets, found.timeline.observation.full_matrix, strict=True)
        for box in boxes
        if predicate in (None, target.atom.predicate)
    ]
    always = np.isin(boxes, causes).all(axis=(0, 1))
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, always, strict=True) if is_so)


def hidden_by_the_robot(cell: Cell, found: Analysis, predicate: str) -> frozenset[str]:
    """Cameras from which parts of the robot hide the target of a predicate in every sample of interest."""
    interest = found.timeline.interesting
    column = next(i for i, target in enumerate(found.targets) if target.atom.predicate == predicate)
    of_robot = np.array([solid.part.parent in cell.model.links for solid in cell.observer.solids])
    boxes = found.timeline.observation.full_matrix[column]
    hidden = np.any([(box.cause == Cause.HIDDEN) & of_robot[box.by] for box in boxes], axis=0)[interest].all(axis=0)
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, hidden, strict=True) if is_so)
