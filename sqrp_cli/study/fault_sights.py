"""When images show a fault: the windows in which they show all its literals, by what it takes to see them.

A fault says that a literal holds that should not, so an image that *refutes* what should be is enough. For `not hold`
that is any one box without its object, where coverage, which has to confirm `hold`, needs all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import SAME_INSTANT, TimeInterval
from sqrp_cli.logic.image_time import Window
from sqrp_cli.logic.literal import Literal
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.targets import Target
from sqrp_cli.skill.target_box import object_of
from sqrp_cli.study.drop_detection import held_in
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import PlannedMotion, Timeline, observe
from sqrp_cli.task.pieces import Piece, fault_intervals, fault_literals


@dataclass(frozen=True, eq=False)
class FaultWatch:
    """A fault: its literals, and what shows each."""

    name: str
    literals: tuple[Literal, ...]
    intervals: tuple[TimeInterval, ...]  # When it may happen
    columns: tuple[tuple[int, ...], ...]  # Of each literal the targets that show it, each by itself: indices
    until: float = 0.0  # Up to when, after its interval, images show it wherever no formula says anything of it [s]

    def counts_in(self, piece: Piece) -> bool:
        """Whether an image of a piece can show that it has happened."""
        if any(s.start - SAME_INSTANT <= piece.start and piece.end <= s.end + SAME_INSTANT for s in self.intervals):
            return True
        if piece.start < self.intervals[0].end - SAME_INSTANT:
            return False
        return any(literal.negated() in piece.literals for literal in self.literals) or self.is_left_alone_in(piece)

    def is_left_alone_in(self, piece: Piece) -> bool:
        """Whether a piece after its interval requires nothing of it, while all is still as in the interval."""
        after = piece.start >= self.intervals[-1].end - SAME_INSTANT and piece.end <= self.until + SAME_INSTANT
        return after and not any(literal in piece.literals for literal in self.literals)


def fault_windows(
    timeline: Timeline, targets: Sequence[Target], fault: FaultWatch, cameras: Sequence[Camera], end: float
) -> tuple[Window, ...]:
    """The windows in which images show a fault, those of cameras of one rate and latency in order.

    That is in its intervals and, after them, where a formula requires the opposite of one of its literals, or nothing
    of it while the tool holds what it held: between two neighbouring samples that both show it. targets: those of the
    timeline. end: of the motion [s]; a run looks once more then, so that a window that lasts until the end goes on for
    a period.

    Of cameras of several rates or latencies each kind has its windows, by the full matrix. Where only several kinds
    together show all literals, the slowest period and latency of those that see any of it count, in windows as long.
    """
    seen, samples = timeline.observation, timeline.samples
    clocks = np.array([(1.0 / camera.rate, camera.lag) for camera in cameras]).reshape(-1, 2)
    kinds = [(*clock, 0.0, (clocks == clock).all(axis=1)) for clock in sorted({*map(tuple, clocks.tolist())})]
    several = len(kinds) > 1
    counts = np.array([fault.counts_in(piece) for piece in timeline.planned.stage.pieces])[samples.piece]
    if several:
        shown = [sees_all(boxes) & seen.required[:, [n]] & counts[:, None] for n, boxes in enumerate(seen.full_matrix)]
        seeing = np.any([shown[n] for columns in fault.columns for n in columns], axis=(0, 1))
        kinds = [kind for kind in kinds if (kind[-1] & seeing).any()]
        if len(kinds) > 1:
            period, lag = clocks[seeing].max(axis=0).tolist()
            kinds.append((period, lag, period, seeing))
    neighbours = (np.diff(samples.piece) == 0) | (np.diff(samples.t) <= SAME_INSTANT)
    windows = []
    for period, lag, least, own in kinds:
        covered = seen.covered
        if several:
            number = np.stack([sees_all(boxes)[:, own].sum(axis=1) for boxes in seen.full_matrix], axis=1)
            covered = seen.required & (number >= [target.cameras for target in targets])
        shows = counts & np.all([covered[:, list(columns)].any(axis=1) for columns in fault.columns], axis=0)
        edges = np.flatnonzero(np.diff(shows[:-1] & shows[1:] & neighbours, prepend=False, append=False))
        for first, last in samples.t[edges].reshape(-1, 2).tolist():
            until = last + period if last >= end - SAME_INSTANT else last
            windows += [Window(first, until, period, lag)] if until - first > least else []
    return tuple(windows)


def all_fault_windows(timeline: Timeline, observer: Observer, sampling: Sampling) -> dict[str, tuple[Window, ...]]:
    """The windows of every fault of a motion, by its name; timeline: of what formulas ask for.

    What fingers lose is looked for once they are closed on nothing; other faults in the timeline, if it has all that
    images are asked for.
    """
    clocks, planned, stage = {(one.rate, one.lag) for one in observer.cameras}, timeline.planned, timeline.planned.stage
    full = len(clocks) > 1
    targets, faults = watched_faults(planned)
    by_fingers = [fault for fault in faults if is_lost_by_fingers(stage, fault)]
    others = [fault for fault in faults if fault not in by_fingers]
    atoms = {literal.atom for fault in others for literal in fault.literals}
    lacks = targets != planned.targets or (full and not timeline.observation.matrix)
    lacks = lacks or any(
        fault.is_left_alone_in(piece) and not atoms <= {literal.atom for literal in piece.literals}
        for fault in others
        for piece in stage.pieces
    )
    shown: list[tuple[Timeline, list[FaultWatch]]] = []
    if by_fingers:
        asked = _asking(planned, stage.once_lost(), targets, by_fingers)
        shown.append((observe(asked, observer, sampling, full=full), by_fingers))
    if others and lacks:
        timeline = observe(_asking(planned, stage, targets, others), observer, sampling, full=full)
    shown.append((timeline, others))
    return {
        fault.name: fault_windows(seen, targets, fault, observer.cameras, planned.motion.time)
        for seen, some in shown
        for fault in some
    }


def _asking(
    planned: PlannedMotion, stage: Stage, targets: Sequence[Target], faults: Sequence[FaultWatch]
) -> PlannedMotion:
    """The pieces of a motion in which images show faults, with the opposite of their literals where no formula asks."""
    pieces = []
    for piece in stage.pieces:
        more = [lit.negated() for fault in faults if fault.is_left_alone_in(piece) for lit in fault.literals]
        asking = replace(piece, literals=tuple(dict.fromkeys([*piece.literals, *more])))
        pieces += [asking] if any(fault.counts_in(asking) for fault in faults) else []
    return planned.for_targets(Stage(stage.model, stage.motion, pieces, stage.X_WO, stage.carried), targets)


def watched_faults(planned: PlannedMotion) -> tuple[tuple[Target, ...], tuple[FaultWatch, ...]]:
    """What images are asked for to show the faults of a candidate, and by which of it each is shown."""
    by_atom = {target.atom: target for target in planned.targets}
    shown_by = {
        literal: distinguishing(by_atom[literal.atom], literal, planned.stage.X_WO)
        for literals in fault_literals(planned.formulas).values()
        for literal in literals
    }
    more = any(target not in planned.targets for targets in shown_by.values() for target in targets)
    asked = tuple(dict.fromkeys(chain(*shown_by.values()))) if more else planned.targets
    faults: list[FaultWatch] = []
    for name, literals in fault_literals(planned.formulas).items():
        intervals = fault_intervals(planned.formulas, name)
        # When what the tool holds changes first after the last interval, less the time to settle.
        end, primitives = intervals[-1].end, planned.stage.motion.primitives
        settle = planned.candidate.skill.of_fault(name).stated.settle
        at_end = next((p.held for p in reversed(primitives) if p.start < end - SAME_INSTANT), None)
        changes = [p.start for p in primitives if p.start > end - SAME_INSTANT and p.held != at_end]
        faults.append(
            FaultWatch(
                name=name,
                literals=literals,
                intervals=intervals,
                columns=tuple(tuple(map(asked.index, shown_by[literal])) for literal in literals),
                until=changes[0] - settle if changes else planned.stage.motion.time,
            )
        )
    return asked, tuple(faults)


def is_lost_by_fingers(stage: Stage, fault: FaultWatch) -> bool:
    """Whether fingers lose what they hold in all intervals of a fault."""
    held = {held_in(stage, interval) for interval in fault.intervals}
    return bool(stage.model.fingers.joints) and None not in held


def distinguishing(target: Target, literal: Literal, objects: Mapping[str, Array]) -> tuple[Target, ...]:
    """The targets of which each by itself shows a literal.

    One that says that something is not so is shown by any one box of its target: by one with an object, which is then
    not in it, if there are any.
    """
    if literal.positive or len(target.boxes) == 1:
        return (target,)
    with_object = [box for box in target.boxes if object_of(str(target.atom), box, objects) is not None]
    return tuple(replace(target, boxes=(box,)) for box in with_object or target.boxes)
