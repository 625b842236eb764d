"""Certificates against drawn camera poses: `python -m tests.certify [DRAWS [POSES [WORKSPACE...]]]`.

By default 10,000 draws for each shipped cell. For each camera, poses within the bounds are drawn, every other one as
far off as it may be; alone from each, the camera observes every target of the best way of each candidate, with the
exact verdicts. A draw takes one pose for each camera, and counts in time which cameras see what. Some draws are
observed once more as a whole, by all cameras together, and must agree. From the worst and the best draw of each figure
a search goes on to worse and better poses. Prints a line for each figure and the summary; exit code 1 where a pose
leaves a certificate, or a draw is not what the cameras see together.

A certificate proves each instant by itself, so it is also compared with the poses *at each instant*: what the worst
pose of each camera at that instant makes of the figure, and what the best one does. Where a figure changes at many
instants, no single draw is the worst at all of them; then draws differ by less, but no hull is decided any later.
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
from sqrp_cli.geometry import Array, Indices, Mask, displacement, ranges
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.programming.coverage.assessment import rehearsal
from sqrp_cli.programming.coverage.certificate import Certificate
from sqrp_cli.programming.coverage.quality import ROUNDING, Qualities
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.coverage.timeline import Rehearsal, Timeline, Watch, observe_all
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.targets import Target

Result = TypeVar("Result")

ROOT = Path(__file__).parents[1]

SHIPPED = ("tabletop", "screws", "tower")

BOUNDS = PoseBounds(0.002, float(np.radians(0.2)))

DRAWS, POSES, SPOTS, STEPS = 10_000, 300, 10, 40
"""Draws for each cell, poses of each camera to choose among, draws observed as a whole, and steps of each search."""

CELL = 5e-4
"""Time for which what is seen is counted at once [s]."""

AGREED = 5e-4
"""By how much the Q of a draw may differ between both ways to observe it: what bisection leaves of each camera, and
cells."""

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

    def moved(self, camera: int, error: Array) -> Camera:
        """A camera off by a displacement and a turn as shares of the bounds, shape (2, 3)."""
        stated = self.observer.cameras[camera]
        return replace(stated, X_FC=stated.X_FC @ displacement(BOUNDS.position * error[0], BOUNDS.rotation * error[1]))

    def qualities(self, errors: Array, some: Sequence[int] | None = None) -> list[Qualities]:
        """Those of the candidates, or of some, for one set of camera poses; errors: of each, see `moved`."""
        cameras = tuple(self.moved(camera, error) for camera, error in enumerate(errors))
        chosen = range(len(self.motions)) if some is None else some
        watches = [self.motions[index] for index in chosen]
        found = observe_all(watches, Observer(cameras, self.observer.solids), Adaptive(), full=False)
        return list(map(Qualities.of, found))

    def search(self, index: int, figure: str, sign: float, errors: Array) -> float:
        """The figure of a candidate after steps from a draw to poses that lower or raise it."""
        random = np.random.default_rng([12, index])
        best = float(getattr(self.qualities(errors, [index])[0], figure))
        for _ in range(STEPS):
            other = within_unit(errors + random.normal(scale=0.4, size=errors.shape))
            value = float(getattr(self.qualities(other, [index])[0], figure))
            if sign * value > sign * best:
                errors, best = other, value
        return best


@dataclass(frozen=True, eq=False)
class Draws:
    """Draws of poses for all cameras, each of which chooses among the poses of each camera."""

    errors: Array
    """Of each camera and pose, see `Trial.moved`, shape (c, p, 2, 3)."""
    chosen: Indices
    """The pose of each camera, shape (draws, c)."""
    found: Sequence[Sequence[Qualities]]
    """The qualities of each candidate in each draw."""
    at_each_instant: Sequence[tuple[Qualities, Qualities]]
    """The qualities of each candidate by the worst and by the best poses at each instant."""

    @classmethod
    def of(cls, trial: Trial, draws: int, poses: int) -> Draws:
        """Observe what each camera sees from each of its poses, and draw."""
        random, cameras = np.random.default_rng(11), len(trial.observer.cameras)
        errors = random.normal(size=(cameras, poses, 2, 3))
        errors /= np.linalg.norm(errors, axis=-1, keepdims=True)
        errors[:, ::2] *= random.uniform(size=(*errors[:, ::2].shape[:3], 1)) ** (1 / 3)
        watches = list(trial.motions)
        alone = [_alone(watch, target) for watch in watches for target in watch.targets]
        seen = [
            observe_all(alone, Observer((trial.moved(camera, error),), trial.observer.solids), Adaptive(), full=False)
            for camera in range(cameras)
            for error in errors[camera]
        ]
        chosen = random.integers(poses, size=(draws, cameras))
        by_target = iter(zip(*seen, strict=True))
        at = chosen + poses * np.arange(cameras)
        views = [Views.of(watch, [next(by_target) for _ in watch.targets]) for watch in watches]
        found = [one.qualities(at) for one in views]
        return cls(errors, chosen, found, [one.at_each_instant(cameras) for one in views])

    def of_draw(self, draw: int) -> Array:
        """The errors of all cameras, shape (c, 2, 3)."""
        found: Array = self.errors[np.arange(len(self.errors)), self.chosen[draw]]
        return found

    def farthest_from_whole(self, trial: Trial) -> float:
        """The largest difference of some draws from what all cameras together see."""
        return max(
            abs(float(getattr(one, figure) or 0.0) - float(getattr(self.found[index][draw], figure) or 0.0))
            for draw in range(min(SPOTS, len(self.chosen)))
            for index, one in enumerate(trial.qualities(self.of_draw(draw)))
            for figure in FIGURES
        )


def _alone(watch: Watch, target: Target) -> Watch:
    """The same motion, with one target that any camera by itself may see."""
    return replace(watch, targets=(replace(target, cameras=1),), faults={})


@dataclass(frozen=True, eq=False)
class Cells:
    """Short times within the pieces of a motion, n of them, with what cameras see by themselves."""

    piece: Indices
    """Shape (n,)."""
    t: Array
    """In the middle of each, shape (n,) [s]."""
    lengths: Array
    """Of each, and of what of it counts for events of interest, shape (2, n) [s]."""

    @classmethod
    def of(cls, watch: Watch) -> Cells:
        """Those in which something must be seen."""
        pieces = watch.stage.pieces
        counts = np.array([int(np.ceil(piece.length / CELL)) if piece.literals else 0 for piece in pieces])
        piece, number = ranges(np.zeros(len(pieces)), counts)
        start, length, of_interest = np.array([(one.start, one.length, one.of_interest) for one in pieces])[piece].T
        length = length / counts[piece]
        return cls(piece, start + (number + 0.5) * length, np.stack([length, length * of_interest]))

    def seen(self, timeline: Timeline) -> Mask:
        """Whether what a timeline is about is seen, shape (n,)."""
        samples, later = timeline.samples, 2.0 * timeline.samples.t.max() + 1.0
        after = np.searchsorted(samples.piece * later + samples.t, self.piece * later + self.t)
        seen: Mask = timeline.covered[after - 1] & timeline.covered[after]
        return seen


@dataclass(frozen=True, eq=False)
class Views:
    """What is seen of r targets in n cells of a motion, from each of p poses of any camera."""

    seen: Mask
    """Whether a pose sees a target in a cell, shape (r, p, n)."""
    required: Mask
    """Whether a target must be seen in a cell, shape (r, n)."""
    needed: Indices
    """How many cameras must see each target, shape (r, 1)."""
    lengths: Array
    """Of the cells, see `Cells`, shape (2, n) [s]."""
    total: Array
    """T and T_eoi of the motion, shape (2,) [s]."""

    @classmethod
    def of(cls, watch: Watch, seen: Sequence[Sequence[Timeline]]) -> Views:
        """By the timeline of each target from each pose."""
        cells = Cells.of(watch)
        return cls(
            seen=np.stack([[cells.seen(timeline) for timeline in one] for one in seen]),
            required=watch.stage.requires(watch.targets, Samples(cells.piece, cells.t)).T,
            needed=np.array([target.cameras for target in watch.targets])[:, None],
            lengths=cells.lengths,
            total=np.array([watch.T, watch.T_eoi]),
        )

    def qualities(self, poses: Indices) -> list[Qualities]:
        """Those in draws; poses: those of each, by index, shape (draws, c)."""
        varies: Mask = np.any(self.seen.any(axis=1) != self.seen.all(axis=1), axis=0)
        always, changing = self._some(~varies), self._some(varies)
        return [
            self._quality(always._times(always.seen[:, poses[0]]) + changing._times(changing.seen[:, draw]))
            for draw in poses
        ]

    def at_each_instant(self, cameras: int) -> tuple[Qualities, Qualities]:
        """The least and the most that poses of c cameras make of the qualities if each instant may have its own."""
        by_camera = self.seen.reshape(len(self.seen), cameras, -1, self.seen.shape[2])
        least, most = by_camera.all(axis=2), by_camera.any(axis=2)
        return self._quality(self._times(least)), self._quality(self._times(most))

    def _some(self, cells: Mask) -> Views:
        chosen = {"seen": self.seen[..., cells].copy(), "required": self.required[:, cells]}
        return replace(self, **chosen, lengths=self.lengths[:, cells])

    def _times(self, seen: Mask) -> Array:
        """How long enough cameras see all that they must; seen: by each of c cameras, shape (r, c, n)."""
        covered: Mask = np.all((seen.sum(axis=1) >= self.needed) | ~self.required, axis=0)
        found: Array = self.lengths[:, covered].sum(axis=1)
        return found

    def _quality(self, times: Array) -> Qualities:
        shares = zip(times / np.maximum(self.total, 1e-9), self.total, strict=True)
        return Qualities(*(float(q) if T else None for q, T in shares))


def within_unit(errors: Array) -> Array:
    """Vectors (..., 3) cut to a length of 1."""
    found: Array = errors / np.maximum(np.linalg.norm(errors, axis=-1, keepdims=True), 1.0)
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


def main(draws: int, poses: int, workspaces: Sequence[Path]) -> int:
    """Run the trials and print what came out; returns the exit code."""
    broken = 0
    for workspace in workspaces:
        trial = Trial.of(workspace)
        drawing, drawn = _timed(lambda trial=trial: Draws.of(trial, draws, poses))  # type: ignore[misc]
        apart = drawn.farthest_from_whole(trial)
        print(
            f"{workspace.name}: rank takes {trial.slower:.1f} times as long with certificates; {draws} draws of {poses}"
        )
        print(
            f"  poses of each camera in {drawing:.0f} s; observed as a whole, up to {100 * apart:.3f} points off",
            flush=True,
        )
        broken += apart > AGREED
        for index in range(len(trial.names)):
            for figure in FIGURES:
                broken += _compare(trial, drawn, index, figure)
    print(f"{broken} figures left their certificates")
    return int(broken > 0)


def _compare(trial: Trial, drawn: Draws, index: int, figure: str) -> bool:
    """Print a line about a figure of a candidate; returns whether any pose leaves the certificate."""
    proven, values = trial.proven[index], [getattr(one, figure) for one in drawn.found[index]]
    least, most = getattr(proven.least, figure), getattr(proven.most, figure)
    if None in values or least is None or most is None:
        return False
    low, high = (
        trial.search(index, figure, sign, drawn.of_draw(int(at)))
        for sign, at in ((-1.0, np.argmin(values)), (1.0, np.argmax(values)))
    )
    # Draws are counted in cells; what is searched is not.
    broken: bool = low < least - ROUNDING or high > most + ROUNDING
    broken |= min(values) < least - AGREED or max(values) > most + AGREED
    worst, best = (getattr(one, figure) for one in drawn.at_each_instant[index])
    width = most - least
    ratio = f"{_times(width, max(values) - min(values))} draws, {_times(width, best - worst)} poses at each instant"
    found = {"proven": (least, most), "drawn": (min(values), max(values)), "searched": (low, high)}
    words = ", ".join(f"{word} {100 * first:6.2f} to {100 * last:6.2f}" for word, (first, last) in found.items())
    print(f"  {trial.names[index]:24s} {figure}: {words}: {ratio}{', BROKEN' if broken else ''}", flush=True)
    return broken


def _times(width: float, of: float) -> str:
    return f"{width / of:.1f} times as wide as" if of > 0 else f"{100 * width:.2f} points wide, against alike"


if __name__ == "__main__":
    given = sys.argv[1:]
    draws, poses = [int(text) for text in given[:2]] + [DRAWS, POSES][len(given[:2]) :]
    sys.exit(main(draws, poses, [Path(path) for path in given[2:]] or [ROOT / "workspaces" / name for name in SHIPPED]))
