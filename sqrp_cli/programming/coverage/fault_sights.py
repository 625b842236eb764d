"""When images show a fault: the windows in which they show all its literals, by what it takes to see them.

A fault says that a literal holds that should not, so an image that *refutes* what should be is enough. For `not hold`
that is any one box without its object, where coverage, which has to confirm `hold`, needs all of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, begins_run
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.target_box import object_of
from sqrp_cli.logic.formula_time import SAME_INSTANT, Stretch
from sqrp_cli.logic.image_time import Onset, Window, Windows, joined, overlaps, shown_until, within
from sqrp_cli.logic.literal import Literal
from sqrp_cli.programming.coverage.parting import held_in, least_delays, onset
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.stage import Stage
from sqrp_cli.programming.coverage.timeline import Rehearsal, Timeline, Watch, observe_all
from sqrp_cli.programming.pieces import Piece, fault_intervals, fault_literals
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.targets import Target


class Clock(NamedTuple):
    """When a camera's images are taken and known."""

    period: float
    """Between two of them [s]."""
    lag: float
    """From an image until what it shows is known [s]."""


def clocks_of(cameras: Sequence[Camera]) -> dict[float, Clock]:
    """The clock behind each response of cameras; of several, the slowest of both."""
    clocks: dict[float, Clock] = {}
    for camera in cameras:
        known = clocks.get(camera.response, Clock(0.0, 0.0))
        clocks[camera.response] = Clock(max(known.period, 1.0 / camera.rate), max(known.lag, camera.latency))
    return clocks


@dataclass(frozen=True, eq=False)
class FaultWatch:
    """A fault: its literals, and what shows each."""

    name: str
    literals: tuple[Literal, ...]
    intervals: tuple[Stretch, ...]
    """When it may happen."""
    columns: tuple[tuple[int, ...], ...]
    """Of each literal the targets that show it, each by itself: indices."""
    until: float = 0.0
    """Up to when, after its interval, images of it tell it wherever no formula says anything of it [s]."""

    def told_in(self, piece: Piece) -> bool:
        """Whether an image of a piece can tell that it has happened."""
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
    timeline: Timeline, fault: FaultWatch, clocks: Mapping[float, Clock], end: float
) -> tuple[Window, ...]:
    """The windows in which images show a fault, in order.

    That is in its intervals and, after them, where a formula requires the opposite of one of its literals, or nothing
    of it while the tool holds what it held. Between two neighbouring samples that both show it the slower of their
    cameras count. end: of the motion [s]; a run looks once more then, so that a window that lasts until the end goes on
    for a period.
    """
    response = _response(timeline, fault)
    counts = np.array([fault.told_in(piece) for piece in timeline.pieces])[timeline.samples.piece]
    response = np.where(counts, response, np.nan)
    t = timeline.samples.t
    together = ~np.isnan(response[:-1]) & ~np.isnan(response[1:])
    together &= ~np.isnan(timeline.steps) | (np.diff(t) <= SAME_INSTANT)
    slower = np.maximum(response[:-1], response[1:])
    begins = together & begins_run(np.where(together, slower, np.nan))
    goes_on = np.append(together[1:] & ~begins[1:], False)
    first, last = np.flatnonzero(begins), np.flatnonzero(together & ~goes_on) + 1
    spans = zip(t[first].tolist(), t[last].tolist(), slower[first].tolist(), strict=True)
    found = (Window(start, until, *clocks[delay]) for start, until, delay in spans if until > start)
    return tuple(one._replace(end=one.end + one.period) if one.end >= end - SAME_INSTANT else one for one in found)


def _response(timeline: Timeline, fault: FaultWatch) -> Array:
    """Of the cameras that show all literals of a fault, NaN where they do not, shape (m,) [s]."""
    covered, response = timeline.observation.covered, timeline.observation.response
    found = np.zeros(len(timeline.samples))
    for columns in fault.columns:
        own = list(columns)
        found = np.maximum(found, np.where(covered[:, own], response[:, own], np.inf).min(axis=1))
    return np.where(np.isfinite(found), found, np.nan)


class Refuting(NamedTuple):
    """What a motion's images are asked to show its faults, and by which of it each is shown."""

    targets: tuple[Target, ...]
    faults: tuple[FaultWatch, ...]
    more: bool
    """Whether these are other targets than those of the formulas."""

    @property
    def usual(self) -> Refuting:
        """The same by what detectors usually see."""
        return self._replace(targets=tuple(target.usual for target in self.targets))


def refuting(scene: Rehearsal) -> Refuting:
    """What shows the faults of a candidate.

    A literal that says that something is not so is shown by any one box of its target: by one with an object, which is
    then not in it, if there are any.
    """
    by_atom = {target.atom: target for target in scene.targets}
    shown_by = {
        literal: telling(by_atom[literal.atom], literal, scene.stage.X_WO)
        for literals in fault_literals(scene.formulas).values()
        for literal in literals
    }
    more = any(target not in scene.targets for targets in shown_by.values() for target in targets)
    asked = list(dict.fromkeys(chain(*shown_by.values()))) if more else list(scene.targets)
    faults = (
        FaultWatch(
            name=name,
            literals=literals,
            intervals=fault_intervals(scene.formulas, name),
            columns=tuple(tuple(map(asked.index, shown_by[literal])) for literal in literals),
            until=_unchanged_until(scene, name),
        )
        for name, literals in fault_literals(scene.formulas).items()
    )
    found = tuple(faults)
    return Refuting(tuple(asked), found, more or any(map(_beyond, found, repeat(scene.stage.pieces))))


def _beyond(fault: FaultWatch, pieces: Sequence[Piece]) -> bool:
    """Whether images tell a fault in pieces that do not require all that shows it."""
    atoms = {literal.atom for literal in fault.literals}
    return any(
        fault.is_left_alone_in(piece) and not atoms <= {literal.atom for literal in piece.literals} for piece in pieces
    )


def _unchanged_until(scene: Rehearsal, fault: str) -> float:
    """When what the tool holds changes first after a fault's last interval, less the time to settle [s]."""
    end = fault_intervals(scene.formulas, fault)[-1].end
    settle = max(one.stated.settle for one in scene.candidate.skill.requirements if one.name == fault)
    primitives = scene.stage.motion.primitives
    at_end = next((p.held for p in reversed(primitives) if p.start < end - SAME_INSTANT), None)
    changes = [p.start for p in primitives if p.start > end - SAME_INSTANT and p.held != at_end]
    return changes[0] - settle if changes else scene.stage.motion.time


def telling(target: Target, literal: Literal, objects: Mapping[str, Array]) -> tuple[Target, ...]:
    """The targets of which each shows a literal by itself."""
    if literal.positive or len(target.boxes) == 1:
        return (target,)
    with_object = [box for box in target.boxes if object_of(str(target.atom), box, objects) is not None]
    return tuple(replace(target, boxes=(box,)) for box in with_object or target.boxes)


class _Look(NamedTuple):
    """What is asked of the images of a motion."""

    scene: Rehearsal
    stage: Stage
    """The motion as planned, or after a loss."""
    asked: Refuting

    def missed(self, windows: _WindowsOf) -> list[FaultWatch]:
        """The faults that images may miss, with windows by name."""
        return [fault for fault in self.asked.faults if not _always_shown(fault, windows[fault.name])]

    def once_lost(self, closed: float = 1.0) -> _Look:
        """The same after a loss; closed: as `Stage.once_lost` has it."""
        return self._replace(stage=self.stage.once_lost(closed))

    def loses(self, fault: FaultWatch) -> bool:
        """Whether fingers may lose what they hold in a fault's intervals."""
        held = {held_in(self.stage, interval) for interval in fault.intervals}
        return bool(self.stage.model.fingers.joints) and None not in held


_WindowsOf = Mapping[str, tuple[Window, ...]]
"""By the names of faults."""


HALF = 0.5
"""By which share of their way fingers have closed behind what they lost when an image usually shows it first."""


class _Viewer(NamedTuple):
    """Cameras that are asked what their images show of motions, by number."""

    observer: Observer
    sampling: Sampling

    def windows(self, timeline: Timeline, faults: Sequence[FaultWatch], end: float) -> _WindowsOf:
        """Those of a timeline; end: of its motion [s]."""
        clocks = clocks_of(self.observer.cameras)
        return {fault.name: fault_windows(timeline, fault, clocks, end) for fault in faults}

    def shown(self, looks: Mapping[int, _Look]) -> dict[int, _WindowsOf]:
        """When images show the faults of looks, with the limits of their targets."""
        timelines = observe_all([_watch(*look) for look in looks.values()], self.observer, self.sampling, full=False)
        seen = zip(looks.items(), timelines, strict=True)
        return {
            number: self.windows(timeline, look.asked.faults, look.scene.motion.time)
            for (number, look), timeline in seen
        }


def all_fault_windows(
    scenes: Sequence[Rehearsal], timelines: Sequence[Timeline], observer: Observer, sampling: Sampling
) -> list[dict[str, Windows]]:
    """The windows of every fault of several motions in one cell, by its name.

    Where fingers may lose a part, images are asked again with the fingers closed on nothing. What they then do not show
    all the time, they are asked for what detectors usually see, and with the fingers half closed.
    """
    viewer = _Viewer(observer, sampling)
    asked = [_enough(refuting(scene), scene, viewer, seen) for scene, seen in zip(scenes, timelines, strict=True)]
    looks = {number: _Look(scene, scene.stage, asked[number]) for number, scene in enumerate(scenes)}
    planned = {
        i: viewer.windows(timelines[i], look.asked.faults, look.scene.motion.time)
        for i, look in looks.items()
        if not look.asked.more
    }
    planned |= viewer.shown({number: look for number, look in looks.items() if look.asked.more})
    closed = {i: look.once_lost() for i, look in looks.items() if any(map(look.loses, look.asked.faults))}
    lost = viewer.shown(closed)
    sure = {number: _sure(look, planned[number], lost.get(number, {})) for number, look in looks.items()}
    late = {number: look for number, look in looks.items() if look.missed(sure[number])}
    more = _usually(viewer, late, planned, lost)
    return [
        {name: Windows(known, joined(known, *more[number][name])) for name, known in of.items()}
        if number in late
        else {name: Windows.always(known) for name, known in of.items()}
        for number, of in sure.items()
    ]


def _sure(look: _Look, planned: _WindowsOf, lost: _WindowsOf) -> _WindowsOf:
    """When images surely show the faults of a look: as planned, and after a loss where fingers may lose a part."""
    return {
        fault.name: after_loss(planned[fault.name], lost[fault.name], fault.intervals)
        if look.loses(fault)
        else planned[fault.name]
        for fault in look.asked.faults
    }


def _usually(
    viewer: _Viewer, looks: Mapping[int, _Look], planned: Mapping[int, _WindowsOf], lost: Mapping[int, _WindowsOf]
) -> dict[int, dict[str, list[Sequence[Window]]]]:
    """When images usually show the faults of looks besides, what comes first counting most.

    planned, lost: when they surely do, as planned and with the fingers closed on nothing.
    """
    emptied = {number: look for number, look in looks.items() if number in lost}
    closed = {number: look.once_lost() for number, look in emptied.items()}
    half = {number: look.once_lost(HALF)._replace(asked=look.asked.usual) for number, look in emptied.items()}
    planned, lost = {**planned, **viewer.shown(_usual(looks))}, {**lost, **viewer.shown(_usual(closed))}
    closing = viewer.shown(half)

    def windows(number: int, fault: FaultWatch) -> list[Sequence[Window]]:
        if not looks[number].loses(fault):
            return [planned[number][fault.name]]
        soon = [within(closing[number][fault.name], interval.start, interval.end) for interval in fault.intervals]
        return [*soon, lost[number][fault.name]]

    return {number: {one.name: windows(number, one) for one in look.asked.faults} for number, look in looks.items()}


def _usual(looks: Mapping[int, _Look]) -> dict[int, _Look]:
    """The looks for what detectors usually see, where that differs from what they surely do."""
    found = {number: look._replace(asked=look.asked.usual) for number, look in looks.items()}
    return {number: look for number, look in found.items() if look.asked.targets != looks[number].asked.targets}


def after_loss(planned: Sequence[Window], lost: Sequence[Window], intervals: Sequence[Stretch]) -> tuple[Window, ...]:
    """The windows of what fingers lose in some intervals.

    From the start of the first on, as it may have been lost long ago, those with the fingers closed; from the start of
    each interval on, as long as images show it as planned, with the slower cameras of both, as the fingers may as well
    still be around the part.
    """
    found: list[Window] = []
    since = intervals[0].start
    for interval in intervals:
        until = min(shown_until(planned, interval.start), interval.end)
        held = overlaps(within(planned, interval.start, until), lost)
        found += [*within(lost, since, interval.start), *held]
        since = until
    return joined([*found, *within(lost, since, np.inf)])


def _enough(asked: Refuting, scene: Rehearsal, viewer: _Viewer, timeline: Timeline) -> Refuting:
    """What shows the faults: the targets of formulas, if images show all faults by them all the time."""
    column = {target.atom: (number,) for number, target in enumerate(scene.targets)}
    whole = [replace(fault, columns=tuple(column[lit.atom] for lit in fault.literals)) for fault in asked.faults]
    shown = Refuting(scene.targets, tuple(whole), more=False)
    is_enough = asked.more and not _Look(scene, scene.stage, shown).missed(
        viewer.windows(timeline, whole, scene.motion.time)
    )
    return shown if is_enough else asked


def _always_shown(fault: FaultWatch, windows: Sequence[Window]) -> bool:
    """Whether windows show a fault all the time, until surely an image has come after each interval."""
    period = max((window.period for window in windows), default=np.inf)
    return all(shown_until(windows, interval.start) >= interval.end + period for interval in fault.intervals)


def _watch(scene: Rehearsal, stage: Stage, asked: Refuting) -> Watch:
    """A look at what shows the faults of a scene, on its stage or another, from when the first may happen."""
    pieces = [_asking(piece, asked.faults) for piece in stage.pieces]
    pieces = [piece for piece in pieces if any(fault.told_in(piece) for fault in asked.faults)]
    return Watch.of_each(scene, stage.with_pieces(pieces), asked.targets)


def _asking(piece: Piece, faults: Sequence[FaultWatch]) -> Piece:
    """A piece with the literals that images of it are asked for beyond those of formulas: the opposite of a fault's."""
    more = [lit.negated() for fault in faults if fault.is_left_alone_in(piece) for lit in fault.literals]
    return replace(piece, literals=tuple(dict.fromkeys([*piece.literals, *more]))) if more else piece


def fault_onsets(scene: Rehearsal, observer: Observer) -> dict[str, tuple[Onset, ...]]:
    """From when on images show each fault, for each interval in which it may happen, by its name."""
    targets = {target.atom: target for target in scene.targets}
    return {
        fault: tuple(
            onset(scene.stage, observer, literals, targets, interval)
            for interval in fault_intervals(scene.formulas, fault)
        )
        for fault, literals in fault_literals(scene.formulas).items()
    }


def least_fault_delays(scene: Rehearsal, observer: Observer, response: float) -> Array:
    """What the longest delay of any fault is at least with each camera, see `parting.least_delays`."""
    targets = {target.atom: target for target in scene.targets}
    found = [
        least_delays(scene.stage, observer, literals, targets, interval, response)
        for fault, literals in fault_literals(scene.formulas).items()
        for interval in fault_intervals(scene.formulas, fault)
    ]
    longest: Array = np.max([np.zeros(len(observer.cameras)), *found], axis=0)
    return longest
