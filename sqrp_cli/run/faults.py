"""Faults of a run: how they are written, and an account of each, when it happened, was seen, acted on and mended."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple, cast

import numpy as np

from sqrp_cli.errors import MOST_NAMES, InputError, bad_input, expected_names, nearest
from sqrp_cli.files.units import TIME, expected_quantity, read_quantity
from sqrp_cli.program.check import SAME_TIME
from sqrp_cli.program.record import ProgramPrimitive, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.step_monitor import Alarm, Attempt, predicted_delay
from sqrp_cli.run.perception.streams import ImageStreams, Streams
from sqrp_cli.run.record.events import EventPublisher
from sqrp_cli.run.record.report import FaultRecord, Stopped

if TYPE_CHECKING:
    from sqrp_cli.run.cell import RunnableCell
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell

FaultKind = Literal[
    "slip", "miss-pick", "camera-loss", "frozen", "latency", "perception-crash", "joints-loss", "joints-frozen",
    "joints-latency",
]  # fmt: skip


class _Form(NamedTuple):
    """How a kind of fault is written."""

    kind: FaultKind
    written: str
    """Examples, for messages."""
    pattern: re.Pattern[str]
    """Of what follows the name of the kind."""
    expected: str
    """In words."""


_AT, _BY = re.compile(r":(?P<camera>[^@=]+)@(?P<time>.+)"), re.compile(r":(?P<camera>[^@=]+)=(?P<delay>.+)")
_SLIP = r"@(?:(?P<primitive>[A-Za-z_]\w*)(?:\+(?P<offset>.+)|(?P<random>:random))?|(?P<time>[.\d].*))"
_FORMS: Mapping[str, _Form] = {
    form.kind: form
    for form in (
        _Form("slip", "slip@a4+0.4, slip@a4:random or slip@7.2", re.compile(_SLIP), "when it slips"),
        _Form("miss-pick", "miss-pick", re.compile(""), "just `miss-pick`"),
        _Form("camera-loss", "camera-loss:cam2@5.0", _AT, "the camera and when it happens"),
        _Form("frozen", "frozen:cam1@3", _AT, "the camera and when it happens"),
        _Form("latency", "latency:cam3=0.5", _BY, "the camera and by how much it is late"),
        _Form("perception-crash", "perception-crash:cam1@4", _AT, "the camera and when it happens"),
    )
}
_JOINTS_AT, _JOINTS_BY = re.compile(r"@(?P<time>.*)", re.DOTALL), re.compile(r"=(?P<delay>.*)", re.DOTALL)
_SERVED_FORMS: Mapping[str, _Form] = {
    **{kind: form for kind, form in _FORMS.items() if kind != "perception-crash"},
    "joints-loss": _Form("joints-loss", "joints-loss@5", _JOINTS_AT, "when it happens"),
    "joints-frozen": _Form("joints-frozen", "joints-frozen@5", _JOINTS_AT, "when it happens"),
    "joints-latency": _Form("joints-latency", "joints-latency=0.5", _JOINTS_BY, "by how much joint states are late"),
}
"""Of a cell that is served: its joint states can fail, but the processes that look at its images are not its own."""
PHYSICAL = ("slip", "miss-pick")
"""Faults of the step; the others are faults of cameras."""
_STEP = re.compile(r"(?P<number>[0-9]{1,9}):(?P<bare>.*)", re.DOTALL)


@dataclass(frozen=True)
class InjectedFault:
    """A fault that happens to a run."""

    kind: FaultKind
    text: str
    t: float | None = None
    """When [s], from the start of its step's motion; None for one that waits for an event (a grasp, the start)."""
    camera: str | None = None
    """Which one, for faults of cameras."""
    delay: float = 0.0
    """By how much its images are late [s]."""
    step: int = 1
    """Its number, from 1."""


@dataclass(frozen=True, eq=False)
class StepPlace:
    """A step of a program, where a fault may happen."""

    number: int
    """From 1."""
    steps: Sequence[Step]
    """All of the program."""

    @property
    def primitives(self) -> Sequence[ProgramPrimitive]:
        """What is done in it."""
        return self.steps[self.number - 1].primitives

    @property
    def holding(self) -> list[str]:
        """Names of the primitives in which the tool grasps or holds something."""
        return [one.name for one in self.primitives if one.held or one.action == "Grasp"]

    @property
    def named(self) -> str:
        """Its number and task."""
        return f"step {self.number} (`{self.steps[self.number - 1].short_task}`)"

    @property
    def label(self) -> str:
        """What messages call it: by its number only where there are others."""
        return "the step" if len(self.steps) == 1 else self.named

    @property
    def prefix(self) -> str:
        """The prefix of a fault of this step only."""
        return "" if len(self.steps) == 1 else f"{self.number}:"


class MeantPrimitive(NamedTuple):
    """The primitive of a step that a text names."""

    place: StepPlace
    primitive: ProgramPrimitive


class _FaultText:
    """A fault as it was written, and the steps in which it may happen: all, or the one that it gives by number."""

    def __init__(self, option: str, text: str, steps: Sequence[Step], forms: Mapping[str, _Form]) -> None:
        """option: such as `--fault`. forms: how faults that can happen are written. Raises InputError for no step."""
        self.option, self.text, self.forms = option, text, forms
        self.everywhere = self.places = [StepPlace(number, steps) for number in range(1, len(steps) + 1)]
        found = _STEP.fullmatch(text)
        self.bare = text if found is None else found["bare"]
        """The text without the number of a step."""
        self.kind, self.owner = re.split(r"[@:=]", self.bare, maxsplit=1)[0], "the program"
        if found is None:
            return
        number = int(found["number"])
        if not 1 <= number <= len(steps):
            names = ", ".join(place.named for place in self.places[:MOST_NAMES])
            more = f" and {len(steps) - MOST_NAMES} more" if len(steps) > MOST_NAMES else ""
            message = f"there is no step {number}; expected {'one of ' if len(steps) > 1 else ''}{names}{more}"
            raise self.refused(message, f"write {len(steps) if number else 1}:{self.bare}")
        self.places = [self.places[number - 1]]
        self.owner = self.places[0].label if len(steps) > 1 else self.owner  # what messages call them

    def refused(self, message: str, mend: str | None = None) -> InputError:
        """The error that says so. mend: by default, the forms of a fault of this kind."""
        form = self.forms[self.kind].written if self.kind in self.forms else None
        if form is not None and self.bare != self.text:
            form = f"`{self.text.removesuffix(self.bare)}` and then {form}"
        every = "; ".join(one.written for one in self.forms.values())
        mend = mend or (f"write {form}" if form else f"give one of: {every}")
        return bad_input("bad-fault", f"{self.option} {self.text}: {message}", mend=mend)

    def meant(self, name: str, message: str, mend: str | None = None, offset: float = 0.0) -> MeantPrimitive:
        """The first primitive of a name in which something can slip at an offset [s], else the nearest to that.

        Raises InputError where the tool holds nothing in it, and where none has the name: with the message, and with
        another step to write if one has such a primitive, else with `mend`.
        """
        found = [
            MeantPrimitive(place, one) for place in self.everywhere for one in place.primitives if one.name == name
        ]
        here = [meant for meant in found if meant.place in self.places]
        if not here:
            another = f"write {found[0].place.prefix}{self.bare}" if found else mend
            expected = expected_names(name, {one.name for place in self.places for one in place.primitives})
            raise self.refused(f"{message}; {expected}", another)
        able = [meant for meant in here if name in meant.place.holding]
        long = [meant for meant in able if meant.primitive.start + offset <= meant.primitive.end]
        chosen = (long or able or here)[0]
        self.check_can_slip(chosen.place, [name])
        return chosen

    def slip_instead(self, places: Sequence[StepPlace] | None = None) -> str:
        """What to write where a fault of the tool cannot happen: the first slip that can, in some places or in any.

        A sweep takes slips alone, so where none can happen another option makes a camera fail.
        """
        able = [f"write {place.prefix}slip@{name}" for place in places or self.everywhere for name in place.holding]
        return able[0] if able else "let a camera fail instead: --fault camera-loss:CAMERA@1.0"

    def check_can_slip(self, place: StepPlace, during: Sequence[str]) -> None:
        """Raises InputError where the tool holds nothing in any of some primitives, so that nothing can slip.

        during: names of primitives, at least one.
        """
        names, holding = [one.name for one in place.primitives], place.holding
        if set(during) & set(holding):
            return
        meant = names.index(during[0])
        closest = min(holding, key=lambda name: abs(names.index(name) - meant), default=None)
        expected = f"expected one of {', '.join(f'`{name}`' for name in holding)}" if holding else "nor in any other"
        where = f"`{during[0]}`" if len(place.steps) == 1 else f"`{during[0]}` of {place.label}"
        mend = f"write {place.prefix}slip@{closest}" if closest is not None else self.slip_instead()
        raise self.refused(f"the tool grasps or holds nothing in {where}, {expected}", mend)

    def time(self, words: str) -> float:
        """A time [s], read from a plain number or one with a unit."""
        found = read_quantity(words)
        if found is None or found.dimension not in (None, TIME) or found.value < 0:
            raise self.refused(f"expected {expected_quantity(TIME)}, 0 or more, found `{words}`")
        return found.value


def parse_fault(
    text: str,
    steps: Sequence[Step],
    cameras: Collection[str],
    rng: np.random.Generator,
    option: str = "--fault",
    *,
    served: bool = False,
) -> InjectedFault:
    """A fault such as `slip@a4+0.4`, or `2:slip@a4+0.4` in the second step. Raises InputError with what was expected.

    text: with times in seconds or with a unit, from the start of the step. steps: of the program; without a number the
    first is meant, or the first in which it can happen if the text names a primitive or a grasp. rng: of random
    instants. option: that gives it, for messages. served: whether it happens to a cell that is served to others.
    """
    written = _FaultText(option, text, steps, _SERVED_FORMS if served else _FORMS)
    kind, places, refused = written.kind, written.places, written.refused
    if kind not in written.forms:
        if any(kind == entry.fault for step in steps for entry in step.formulas):
            raise refused(f"`{kind}` is what monitors look for, and cannot be made to happen as such")
        raise refused(f"there is no fault `{kind}`; {expected_names(kind, written.forms)}")
    form = written.forms[kind]
    found = form.pattern.fullmatch(written.bare[len(kind) :])
    if found is None:
        raise refused(f"expected {form.expected}")
    if kind == "slip" and found["time"]:
        place, t = places[0], written.time(found["time"])
        if t > (last := place.primitives[-1].end):
            several = "write N:slip@T for T seconds from the start of step N"
            mend = written.slip_instead() if len(steps) == 1 else several
            raise refused(f"{place.label} lasts only {last:.2f} s", mend)
        during = [one.name for one in place.primitives if one.start - SAME_TIME <= t <= one.end + SAME_TIME]
        written.check_can_slip(place, during)
        return InjectedFault("slip", text, t, step=place.number)
    if kind == "slip":
        name, offset = found["primitive"], written.time(found["offset"] or "0")
        place, primitive = written.meant(name, f"{written.owner} has no primitive `{name}`", offset=offset)
        t = primitive.start + offset
        if found["random"]:
            t = float(rng.uniform(primitive.start, primitive.end))
        elif t > primitive.end:
            owner = f"`{name}`" if len(steps) == 1 else f"`{name}` of {place.label}"
            raise refused(f"{owner} lasts only {primitive.end - primitive.start:.2f} s")
        return InjectedFault("slip", text, t, step=place.number)
    if kind == "miss-pick":
        grasping = [place for place in written.everywhere if any(one.action == "Grasp" for one in place.primitives)]
        able = [place for place in grasping if place in places]
        if not able:
            owner = "this program" if len(places) == len(steps) else places[0].label
            mend = f"write {grasping[0].prefix}miss-pick" if grasping else written.slip_instead()
            raise refused(f"no primitive of {owner} grasps", mend)
        return InjectedFault("miss-pick", text, step=able[0].number)
    figures = found.groupdict()
    camera: str | None = figures.get("camera")
    if camera is not None and camera not in cameras:
        instead = text.replace(camera, nearest(camera, cameras) or min(cameras, default="CAMERA"))
        raise refused(f"there is no camera `{camera}`; {expected_names(camera, cameras)}", f"write {instead}")
    t, delay = (written.time(figures[name]) if name in figures else 0.0 for name in ("time", "delay"))
    return InjectedFault(form.kind, text, t, camera, delay, places[0].number)


def parse_sweep(text: str, steps: Sequence[Step], option: str = "--sweep") -> MeantPrimitive:
    """Where a sweep such as `slip@a4` or `2:slip@a4` is. Raises InputError for a fault that cannot be swept."""
    written = _FaultText(option, text, steps, _FORMS)
    kind, _, name = written.bare.partition("@")
    instead = written.slip_instead(written.places)
    if kind != "slip":
        raise written.refused("expected `slip@` and a primitive of the program", instead)
    return written.meant(name, f"expected `slip@` and a primitive of {written.owner}", instead)


class FaultTracker:
    """Injects the faults of a run, and tracks each: when it happened, was seen, was acted on and mended."""

    def __init__(self, cell: RunnableCell, streams: Streams, publisher: EventPublisher) -> None:
        """cell, streams: to which faults are made to happen, in simulation alone."""
        self._cell, self._streams, self._publisher = cell, streams, publisher
        self.records: list[FaultRecord] = []
        """Of all, in the order in which they were injected or seen."""
        self._open: list[FaultRecord] = []

    def inject(self, fault: InjectedFault, t: float, attempt: Attempt) -> None:
        """Inject a fault."""
        assert isinstance(self._streams, ImageStreams), "nobody can make a fault happen to a real cell"  # noqa: S101
        cell, streams, camera = cast("SimulatedCell", self._cell), self._streams, fault.camera or ""
        match fault.kind:
            case "slip":
                cell.slip()
            case "miss-pick":
                cell.miss_next_grasp()
            case "camera-loss" | "frozen" | "latency" | "perception-crash" as kind:
                streams.fail(kind, camera, fault.delay)
        # The skill's own name for what is injected, if it has one.
        names = [entry.fault for entry in attempt.step.formulas if entry.fault is not None]
        name = names[0] if fault.kind in PHYSICAL and len(names) == 1 else fault.kind
        record = FaultRecord(name, injected=t, camera=fault.camera, kind=fault.kind)
        self.records.append(record)
        if fault.kind in PHYSICAL:
            self._open.append(record)
            attempt.undisturbed &= fault.kind == "miss-pick"  # which changes nothing until the grasp
        self._publisher.publish("injected", t, fault=fault.text)

    @property
    def is_open(self) -> bool:
        """Whether a fault of the step has been injected or seen, and not been made good."""
        return bool(self._open)

    @property
    def is_pending(self) -> bool:
        """Whether a fault was injected that has not come true yet."""
        return any(record.injected is not None and record.happened is None for record in self._open)

    def look(self, t: float, tau: float | None, attempt: Attempt, truths: Mapping[str, bool]) -> None:
        """Note if the formula of a fault is true at time tau [s] of the step; truths: of all atoms now."""
        if tau is None:
            return
        for name, operators in attempt.monitor.faults():
            for start, end, literals in operators:
                if start <= tau <= end and all(truths[str(lit.atom)] == lit.positive for lit in literals):
                    if (sight := attempt.step.sights.get(name)) is not None:
                        delay = sight.latest(tau)
                    else:
                        responses = {name: camera.response for name, camera in self._streams.cameras.items()}
                        delay = predicted_delay(attempt.step, [str(one.atom) for one in literals], responses, tau)
                    for record in self._open:
                        if record.happened is None:
                            record.happened, record.predicted_delay = t, delay
                            self._publisher.publish("happened", t, fault=record.name)
                    return

    def seen(self, alarm: Alarm, t: float) -> None:
        """The images showed a fault: the injected ones that are not seen yet, or one that was not injected."""
        unseen = [record for record in self._open if record.detected is None]
        if not unseen:
            unseen = [FaultRecord(alarm.name)]
            self.records += unseen
            self._open += unseen
        for record in unseen:
            record.name, record.detected = alarm.name, t
        self._publisher.publish("fault", t, name=alarm.name, text=alarm.text, response=alarm.response.action)

    def dropped(self) -> None:
        """At the end a part lies where it should not: no formula asks about when it slipped, but it did."""
        for record in self.records:
            if record.kind == "slip" and record.happened is None and record.detected is None:
                record.happened = record.injected

    def suspected(self, t: float) -> None:
        """The images showed that something is wrong, but not what."""
        for record in self._open:
            record.detected = t if record.detected is None else record.detected

    def moved_on(self, seconds: float) -> None:
        """The robot moved on for a time [s], to where the condition of a retry can be seen."""
        for record in self._seen():
            record.moved_on = round(seconds, 6)

    def acted(self, t: float) -> None:
        """The robot responds to the seen fault."""
        for record in self._seen():
            record.acted = t

    def recovered(self, t: float) -> None:
        """The step is finally done."""
        for record in self._seen():
            record.recovered = t
        self._open.clear()

    def stopped(self, t: float, why: Stopped) -> None:
        """The robot stops for good; a fault of a camera is noticed where it is why."""
        for record in self._seen():
            record.acted = t if record.acted is None else record.acted
        for record in self.records:
            if record.camera in why.cameras and record.name == why.fault:
                record.detected = record.acted = t

    def _seen(self) -> list[FaultRecord]:
        return [record for record in self._open if record.detected is not None]
