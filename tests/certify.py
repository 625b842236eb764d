"""Certificates against drawn camera poses: `python -m tests.certify [DRAWS [WORKSPACE...]]`.

By default 10,000 draws for each shipped cell. Every draw moves all cameras of a cell within the bounds, in every other
one as far as they may be, and observes the best way of each candidate again, with the exact verdicts. From the worst
and the best draw of each figure a search goes on to worse and better poses. Prints a line for each figure and the
summary; exit code 1 where a pose leaves a certificate.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.api.session import Session
from sqrp_cli.geometry import Array, displacement
from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.programming.coverage.assessment import Rehearsal, rehearsal
from sqrp_cli.programming.coverage.certificate import Certificate
from sqrp_cli.programming.coverage.quality import Qualities
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.coverage.timeline import observe_all
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.observer import Observer

Result = TypeVar("Result")

ROOT = Path(__file__).parents[1]

SHIPPED = ("tabletop", "screws", "tower")

BOUNDS = PoseBounds(0.002, float(np.radians(0.2)))

DRAWS, STEPS = 10_000, 40
"""Draws for each cell, and steps of each search."""

FIGURES = ("q_eoi", "q_avg")


@dataclass(frozen=True, eq=False)
class Trial:
    """The candidates of a cell, with what is proven of them."""

    observer: Observer
    names: Sequence[str]
    motions: Sequence[Rehearsal]
    proven: Sequence[Certificate]
    slower: float
    """Time of `rank` with certificates over that without."""

    @classmethod
    def of(cls, workspace: Path) -> Trial:
        """The first task of a workspace."""
        cell = open_cell(workspace)
        task = cell.workspace.tasks[0].task
        cell.rank(task)  # what is read once
        plain, _ = _timed(lambda: open_cell(workspace).rank(task))
        certified, ranking = _timed(lambda: open_cell(workspace).rank(task, certify=BOUNDS))
        found = [one.assessment for one in ranking.ranked if one.rank is not None]
        return cls(
            observer=ranking.session.cell.observer,
            names=[one.candidate.name for one in found],
            motions=[_motion(ranking.session, one.way) for one in found],
            proven=[one.certificate for one in found if one.certificate is not None],
            slower=certified / plain,
        )

    def qualities(self, errors: Array, some: Sequence[int] | None = None) -> list[Qualities]:
        """Those of the candidates, or of some, for one set of camera poses; errors: see `drawn`."""
        cameras = (
            replace(camera, X_FC=camera.X_FC @ displacement(BOUNDS.position * moved, BOUNDS.rotation * turned))
            for camera, (moved, turned) in zip(self.observer.cameras, errors, strict=True)
        )
        observer = Observer(tuple(cameras), self.observer.solids)
        chosen = range(len(self.motions)) if some is None else some
        watches = [self.motions[index].watch for index in chosen]
        return list(map(Qualities.of, observe_all(watches, observer, Adaptive(), full=False)))

    def drawn(self, draw: int) -> Array:
        """Displacement and turn of each camera as shares of the bounds, shape (c, 2, 3)."""
        random = np.random.default_rng([11, draw])
        errors = within_unit(random.normal(size=(len(self.observer.cameras), 2, 3)), farthest=True)
        return errors if draw % 2 else errors * random.uniform(size=(*errors.shape[:2], 1)) ** (1 / 3)

    def search(self, index: int, figure: str, sign: float, errors: Array, best: float) -> float:
        """The figure of a candidate after steps from a draw to poses that lower or raise it."""
        random = np.random.default_rng([12, index])
        for _ in range(STEPS):
            other = within_unit(errors + random.normal(scale=0.4, size=errors.shape))
            value = getattr(self.qualities(other, [index])[0], figure)
            if sign * value > sign * best:
                errors, best = other, value
        return best


def within_unit(errors: Array, *, farthest: bool = False) -> Array:
    """Vectors (..., 3) cut to a length of 1, or all as long."""
    length = np.linalg.norm(errors, axis=-1, keepdims=True)
    found: Array = errors / (length if farthest else np.maximum(length, 1.0))
    return found


def _timed(work: Callable[[], Result]) -> tuple[float, Result]:
    start = time.process_time()
    found = work()
    return time.process_time() - start, found


def _motion(session: Session, way: Candidate) -> Rehearsal:
    assignment = session.assignment
    motion = feasible_motion(assignment.cell, way, assignment.world)
    assert isinstance(motion, Motion)
    return rehearsal(assignment.cell, way, assignment.world, motion)


def main(draws: int, workspaces: Sequence[Path]) -> int:
    """Run the trials and print what came out; returns the exit code."""
    broken = 0
    for workspace in workspaces:
        trial = Trial.of(workspace)
        found = [trial.qualities(trial.drawn(draw)) for draw in range(draws)]
        print(
            f"{workspace.name}: {draws} draws; rank takes {trial.slower:.1f} times as long with certificates",
            flush=True,
        )
        for index, (name, proven) in enumerate(zip(trial.names, trial.proven, strict=True)):
            for figure in FIGURES:
                broken += _compare(trial, index, figure, [getattr(one[index], figure) for one in found], name, proven)
    print(f"{broken} figures left their certificates")
    return int(broken > 0)


def _compare(
    trial: Trial, index: int, figure: str, values: Sequence[float | None], name: str, proven: Certificate
) -> bool:
    """Print a line about a figure of a candidate; returns whether any pose leaves the certificate."""
    known = [value for value in values if value is not None]
    least, most = getattr(proven.least, figure), getattr(proven.most, figure)
    if not known or least is None or most is None:
        return False
    low, high = (
        trial.search(index, figure, sign, trial.drawn(int(at)), known[int(at)])
        for sign, at in ((-1.0, np.argmin(known)), (1.0, np.argmax(known)))
    )
    broken: bool = low < least or high > most
    spread, width = max(known) - min(known), most - least
    ratio = f"{width / spread:.1f} times as wide" if spread > 0 else f"{100 * width:.2f} points wide, all draws alike"
    ranges = {"proven": (least, most), "drawn": (min(known), max(known)), "searched": (low, high)}
    words = ", ".join(f"{word} {100 * first:6.2f} to {100 * last:6.2f}" for word, (first, last) in ranges.items())
    print(f"  {name:24s} {figure}: {words}: {ratio}{', BROKEN' if broken else ''}", flush=True)
    return broken


if __name__ == "__main__":
    count, *paths = [*sys.argv[1:], str(DRAWS)][: max(1, len(sys.argv) - 1)]
    sys.exit(main(int(count), [Path(path) for path in paths] or [ROOT / "workspaces" / name for name in SHIPPED]))
