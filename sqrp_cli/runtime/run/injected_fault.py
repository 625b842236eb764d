"""Faults that a run is to suffer, as the command line writes them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from sqrp_cli.errors import MOST_NAMES, InputError, bad_input, expected_names, nearest
from sqrp_cli.knowledge.text.units import TIME, expected_quantity, read_quantity
from sqrp_cli.program.check import SAME_TIME
from sqrp_cli.program.record import ProgramPrimitive, Step

FaultKind = Literal[
    "slip", "miss-pick", "camera-loss", "frozen", "latency", "perception-crash", "joints-loss", "joints-frozen",
    "joints-latency",
]  # fmt: skip

_FORMS = {
    "slip": "slip@a4+0.4, slip@a4:random or slip@7.2",
    "miss-pick": "miss-pick",
    "camera-loss": "camera-loss:cam2@5.0",
    "frozen": "frozen:cam1@3",
    "latency": "latency:cam3=0.5",
    "perception-crash": "perception-crash:cam1@4",
}
_SERVED_FORMS = {
    **{kind: form for kind, form in _FORMS.items() if kind != "perception-crash"},
    "joints-loss": "joints-loss@5",
    "joints-frozen": "joints-frozen@5",
    "joints-latency": "joints-latency=0.5",
}
"""Of a cell that is served: its joint states can fail, but the processes that look at its images are not its own."""

SWEPT = ("slip",)
"""Faults whose instant can be swept."""

_STEP = re.compile(r"(?P<number>[0-9]{1,9}):(?P<bare>.*)", re.DOTALL)
_SLIP = re.compile(r"(?P<primitive>[A-Za-z_]\w*)(?:\+(?P<offset>.+)|(?P<random>:random))?|(?P<time>[.\d].*)")


class _Timed(NamedTuple):
    """A fault that happens at a time, or makes something late by one: what follows its name."""

    kind: FaultKind
    form: re.Pattern[str]
    expected: str


_CAMERA_AT = re.compile(r":(?P<camera>[^@=]+)@(?P<time>.+)")
_TIMED = (
    _Timed("camera-loss", _CAMERA_AT, "the camera and when it happens"),
    _Timed("frozen", _CAMERA_AT, "the camera and when it happens"),
    _Timed("perception-crash", _CAMERA_AT, "the camera and when it happens"),
    _Timed("latency", re.compile(r":(?P<camera>[^@=]+)=(?P<delay>.+)"), "the camera and by how much it is late"),
    _Timed("joints-loss", re.compile(r"@(?P<time>.*)", re.DOTALL), "when it happens"),
    _Timed("joints-frozen", re.compile(r"@(?P<time>.*)", re.DOTALL), "when it happens"),
    _Timed("joints-latency", re.compile(r"=(?P<delay>.*)", re.DOTALL), "by how much joint states are late"),
)


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
    def holding(self) -> list[ProgramPrimitive]:
        """The primitives in which the tool grasps or holds something."""
        return [primitive for primitive in self.primitives if primitive.held or primitive.action == "Grasp"]

    @property
    def grasps(self) -> bool:
        """Whether something is grasped in it."""
        return any(primitive.action == "Grasp" for primitive in self.primitives)

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


@dataclass(frozen=True)
class _FaultText:
    """A fault as it was written, for messages."""

    option: str
    """Such as `--fault`."""
    text: str
    bare: str
    """The text without the number of a step."""
    forms: Mapping[str, str]
    """How the faults that can happen are written."""

    def refused(self, message: str, mend: str | None = None) -> InputError:
        """mend: by default, the forms of a fault of this kind."""
        form = self.forms.get(_kind(self.bare))
        if form is not None and self.bare != self.text:
            form = f"`{self.text.removesuffix(self.bare)}` and then {form}"
        mend = mend or (f"write {form}" if form else f"give one of: {'; '.join(self.forms.values())}")
        return bad_input("bad-fault", f"{self.option} {self.text}: {message}", mend=mend)


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
    written, places = _read_step(option, text, steps, _SERVED_FORMS if served else _FORMS)
    head = _kind(written.bare)
    if head not in written.forms:
        if any(head == entry.fault for step in steps for entry in step.formulas):
            raise written.refused(f"`{head}` is what monitors look for, and cannot be made to happen as such")
        raise written.refused(f"there is no fault `{head}`; {expected_names(head, written.forms)}")
    rest = written.bare[len(head) :]
    if head == "slip":
        return _slip(written, rest, places, rng)
    if head == "miss-pick":
        if rest:
            raise written.refused(f"expected just `{head}`")
        return InjectedFault("miss-pick", text, step=_grasping(written, places).number)
    return _timed(written, next(one for one in _TIMED if one.kind == head), rest, cameras, places[0].number)


class MeantPrimitive(NamedTuple):
    """The primitive of a step that a text names."""

    place: StepPlace
    primitive: ProgramPrimitive


def parse_sweep(text: str, steps: Sequence[Step], option: str = "--sweep") -> MeantPrimitive:
    """Where a sweep such as `slip@a4` or `2:slip@a4` is. Raises InputError for a fault that cannot be swept."""
    written, places = _read_step(option, text, steps, _FORMS)
    kind, _, name = written.bare.partition("@")
    if kind not in SWEPT:
        raise written.refused("expected `slip@` and a primitive of the program", _slip_instead(places))
    found = _meant(name, places, 0.0)
    if found is None:
        owner = "the program" if len(places) == len(steps) else places[0].label
        message = f"expected `slip@` and a primitive of {owner}; {expected_names(name, _names(places))}"
        raise written.refused(message, _in_another_step(written, name, steps) or _slip_instead(places))
    _check_can_slip(written, found.place, [name])
    return found


def _read_step(
    option: str, text: str, steps: Sequence[Step], forms: Mapping[str, str]
) -> tuple[_FaultText, list[StepPlace]]:
    """The text, and the steps in which the fault may happen: all, or the one given by its number."""
    places = _places(steps)
    found = _STEP.fullmatch(text)
    if found is None:
        return _FaultText(option, text, text, forms), places
    written, number = _FaultText(option, text, found["bare"], forms), int(found["number"])
    if 1 <= number <= len(places):
        return written, [places[number - 1]]
    names = ", ".join(place.named for place in places[:MOST_NAMES])
    more = f" and {len(places) - MOST_NAMES} more" if len(places) > MOST_NAMES else ""
    message = f"there is no step {number}; expected {'one of ' if len(places) > 1 else ''}{names}{more}"
    raise written.refused(message, f"write {len(places) if number else 1}:{written.bare}")


def _places(steps: Sequence[Step]) -> list[StepPlace]:
    return [StepPlace(number, steps) for number in range(1, len(steps) + 1)]


def _timed(written: _FaultText, fault: _Timed, rest: str, cameras: Collection[str], step: int) -> InjectedFault:
    found = fault.form.fullmatch(rest)
    if found is None:
        raise written.refused(f"expected {fault.expected}")
    figures = found.groupdict()
    camera = _camera(written, figures["camera"], cameras) if "camera" in figures else None
    if "delay" in figures:
        return InjectedFault(fault.kind, written.text, 0.0, camera, _time(written, figures["delay"]), step)
    return InjectedFault(fault.kind, written.text, _time(written, figures["time"]), camera, step=step)


def _slip(written: _FaultText, rest: str, places: Sequence[StepPlace], rng: np.random.Generator) -> InjectedFault:
    found = _SLIP.fullmatch(rest.removeprefix("@")) if rest.startswith("@") else None
    if found is None:
        raise written.refused("expected when it slips")
    if found["time"]:
        return _slip_at(written, _time(written, found["time"]), places[0])
    name, offset = found["primitive"], _time(written, found["offset"] or "0")
    meant = _meant(name, places, offset)
    if meant is None:
        owner = "the program" if len(places) == len(places[0].steps) else places[0].label
        message = f"{owner} has no primitive `{name}`; {expected_names(name, _names(places))}"
        raise written.refused(message, _in_another_step(written, name, places[0].steps))
    place, primitive = meant
    _check_can_slip(written, place, [name])
    if found["random"]:
        t = float(rng.uniform(primitive.start, primitive.end))
    else:
        t = primitive.start + offset
        if t > primitive.end:
            owner = f"`{name}`" if len(place.steps) == 1 else f"`{name}` of {place.label}"
            raise written.refused(f"{owner} lasts only {primitive.end - primitive.start:.2f} s")
    return InjectedFault("slip", written.text, t, step=place.number)


def _slip_at(written: _FaultText, t: float, place: StepPlace) -> InjectedFault:
    """A slip at a time of a step [s]."""
    last = place.primitives[-1].end
    if t > last:
        mend = (
            _slip_instead([place]) if len(place.steps) == 1 else "write N:slip@T for T seconds from the start of step N"
        )
        raise written.refused(f"{place.label} lasts only {last:.2f} s", mend)
    during = [one.name for one in place.primitives if one.start - SAME_TIME <= t <= one.end + SAME_TIME]
    _check_can_slip(written, place, during)
    return InjectedFault("slip", written.text, t, step=place.number)


def _meant(name: str, places: Sequence[StepPlace], offset: float) -> MeantPrimitive | None:
    """The first primitive of a name in which something can slip at an offset [s], else the nearest to that."""
    found = [MeantPrimitive(place, one) for place in places for one in place.primitives if one.name == name]
    able = [meant for meant in found if meant.primitive in meant.place.holding]
    long = [meant for meant in able if meant.primitive.start + offset <= meant.primitive.end]
    return next(iter(long or able or found), None)


def _names(places: Sequence[StepPlace]) -> set[str]:
    return {primitive.name for place in places for primitive in place.primitives}


def _in_another_step(written: _FaultText, name: str, steps: Sequence[Step]) -> str | None:
    """What to write instead if a primitive of some name is in another step than the one that was written."""
    found = _meant(name, _places(steps), 0.0)
    return None if found is None else f"write {found.place.prefix}{written.bare}"


def _grasping(written: _FaultText, places: Sequence[StepPlace]) -> StepPlace:
    """The first of some steps in which something is grasped."""
    if (found := next((place for place in places if place.grasps), None)) is not None:
        return found
    steps = places[0].steps
    owner = "this program" if len(places) == len(steps) else places[0].label
    everywhere = _places(steps)
    other = next((f"write {place.prefix}miss-pick" for place in everywhere if place.grasps), None)
    raise written.refused(f"no primitive of {owner} grasps", other or _slip_instead(everywhere))


def _check_can_slip(written: _FaultText, place: StepPlace, during: Sequence[str]) -> None:
    """Raises InputError where the tool holds nothing in any of some primitives, so that nothing can slip.

    during: names of primitives, at least one.
    """
    names, holding = [one.name for one in place.primitives], [one.name for one in place.holding]
    if set(during) & set(holding):
        return
    meant = names.index(during[0])
    closest = min(holding, key=lambda name: abs(names.index(name) - meant), default=None)
    expected = f"expected one of {', '.join(f'`{name}`' for name in holding)}" if holding else "nor in any other"
    where = f"`{during[0]}`" if len(place.steps) == 1 else f"`{during[0]}` of {place.label}"
    everywhere = _places(place.steps)
    mend = f"write {place.prefix}slip@{closest}" if closest is not None else _slip_instead(everywhere)
    raise written.refused(f"the tool grasps or holds nothing in {where}, {expected}", mend)


def _slip_instead(places: Sequence[StepPlace]) -> str:
    """What to write where a fault of the tool cannot happen: the first slip that can, if one can.

    A sweep takes slips alone, so where none can happen another option makes a camera fail.
    """
    able = [f"write {place.prefix}slip@{one.name}" for place in places for one in place.holding]
    return able[0] if able else "let a camera fail instead: --fault camera-loss:CAMERA@1.0"


def _time(written: _FaultText, words: str) -> float:
    """A time [s], read from a plain number or one with a unit."""
    found = read_quantity(words)
    if found is None or found.dimension not in (None, TIME) or found.value < 0:
        raise written.refused(f"expected {expected_quantity(TIME)}, 0 or more, found `{words}`")
    return found.value


def _camera(written: _FaultText, name: str, cameras: Collection[str]) -> str:
    if name not in cameras:
        instead = written.text.replace(name, nearest(name, cameras) or min(cameras, default="CAMERA"))
        raise written.refused(f"there is no camera `{name}`; {expected_names(name, cameras)}", f"write {instead}")
    return name


def _kind(text: str) -> str:
    return re.split(r"[@:=]", text, maxsplit=1)[0]
