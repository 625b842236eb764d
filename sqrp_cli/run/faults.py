"""Faults of a run: how they are written, and an account of each, when it happened, was seen, acted on and mended."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias, cast

import numpy as np

from sqrp_cli.errors import MOST_NAMES, InputError, bad_input, expected_names, nearest
from sqrp_cli.files.units import TIME, expected_quantity, read_quantity
from sqrp_cli.program.record import ProgramPrimitive, Step
from sqrp_cli.records import dataclass
from sqrp_cli.run.monitor.step_monitor import Alarm, Attempt
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


SAME_TIME = 1e-6  # Tolerance of times [s]
Form: TypeAlias = tuple[str, str, str]
"""How a kind of fault is written: examples, for messages; a pattern of what follows the name; and that in words."""
_SLIP = r"@(?:(?P<primitive>[A-Za-z_][\w -]*)(?:\+(?P<offset>.+)|(?P<random>:random))?|(?P<time>[.\d].*))"
_CAMERA, _AT, _BY = r":(?P<camera>[^@=]+)", r"(?s:@(?P<time>.+))", r"(?s:=(?P<delay>.+))"
_WHEN = "the camera and when it happens"
_FORMS: Mapping[FaultKind, Form] = {
    "slip": ("slip@lift+0.4, slip@lift:random or slip@7.2", _SLIP, "when it slips"),
    "miss-pick": ("miss-pick", "", "just `miss-pick`"),
    "camera-loss": ("camera-loss:cam2@5.0", _CAMERA + _AT, _WHEN),
    "frozen": ("frozen:cam1@3", _CAMERA + _AT, _WHEN),
    "latency": ("latency:cam3=0.5", _CAMERA + _BY, "the camera and by how much it is late"),
    "perception-crash": ("perception-crash:cam1@4", _CAMERA + _AT, _WHEN),
}
_SERVED_FORMS: Mapping[FaultKind, Form] = {
    **{kind: form for kind, form in _FORMS.items() if kind != "perception-crash"},
    "joints-loss": ("joints-loss@5", _AT, "when it happens"),
    "joints-frozen": ("joints-frozen@5", _AT, "when it happens"),
    "joints-latency": ("joints-latency=0.5", _BY, "by how much joint states are late"),
}
"""Of a cell that is served: its joint states can fail, but the processes that look at its images are not its own."""
PHYSICAL = ("slip", "miss-pick")  # Faults of the step; the others are faults of cameras
_STEP = re.compile(r"(?P<number>[0-9]{1,9}):(?P<bare>.*)", re.DOTALL)
Piece: TypeAlias = tuple[int, ProgramPrimitive]
"""A piece of motion of a program: the number of its step, from 1, and the primitive."""


@dataclass(frozen=True)
class InjectedFault:
    """A fault that happens to a run."""

    kind: FaultKind
    text: str
    t: float | None = None
    """When [s], from the start of its step's motion; None for one that waits for an event (a grasp, the start)."""
    camera: str | None = None  # Which one, for faults of cameras
    delay: float = 0.0  # By how much its images are late [s]
    step: int = 1  # Its number, from 1


class _FaultText:
    """A fault as it was written, and the steps in which it may happen: all, or the one that it gives by number."""

    def __init__(self, option: str, text: str, steps: Sequence[Step], forms: Mapping[FaultKind, Form]) -> None:
        """option: such as `--fault`. forms: how faults that can happen are written. Raises InputError for no step."""
        self.option, self.text, self.forms, self.several = option, text, forms, len(steps) > 1
        self.numbers = self.all_numbers = range(1, len(steps) + 1)
        """Of the steps in which it may happen, from 1."""
        named = [f"step {n} (`{step.short_task}`)" for n, step in enumerate(steps, 1)]
        self.labels = named if self.several else ["the step"]
        """What messages call each step: by its number only where there are others."""
        self.pieces: list[Piece] = [(n, one) for n, step in enumerate(steps, 1) for one in step.primitives]
        self.often = Counter((n, one.does) for n, one in self.pieces)
        found = _STEP.fullmatch(text)
        self.bare = text if found is None else found["bare"]
        """The text without the number of a step."""
        self.kind, self.owner = re.split(r"[@:=]", self.bare, maxsplit=1)[0], "the program"
        if found is None:
            return
        if (number := int(found["number"])) not in self.numbers:
            more = f" and {len(steps) - MOST_NAMES} more" if len(steps) > MOST_NAMES else ""
            names = f"{'one of ' if self.several else ''}{', '.join(named[:MOST_NAMES])}{more}"
            message = f"there is no step {number}; expected {names}"
            raise self.refused(message, f"write {len(steps) if number else 1}:{self.bare}")
        self.numbers = range(number, number + 1)
        self.owner = self.labels[number - 1] if self.several else self.owner  # what messages call them

    def refused(self, message: str, mend: str | None = None) -> InputError:
        """The error that says so. mend: by default, the forms of a fault of this kind."""
        form = next((written for kind, (written, *_) in self.forms.items() if kind == self.kind), None)
        if form is not None and self.bare != self.text:
            form = f"`{self.text.removesuffix(self.bare)}` and then {form}"
        every = "; ".join(written for written, *_ in self.forms.values())
        mend = mend or (f"write {form}" if form else f"give one of: {every}")
        return bad_input("bad-fault", f"{self.option} {self.text}: {message}", mend=mend)

    def called(self, piece: Piece) -> str:
        """What a piece does as a fault says it, such as `go-home`; its name where another of its step does the same."""
        number, one = piece
        return one.name if one.does is None or self.often[number, one.does] > 1 else one.does.replace(" ", "-")

    def write(self, number: int, bare: str) -> str:
        """What to write for a fault of a step."""
        return f"write {f'{number}:' if self.several else ''}{bare}"

    def able(self, numbers: Iterable[int]) -> list[Piece]:
        """The pieces of some steps in which the tool grasps or holds something, so that it can slip."""
        return [(n, one) for n, one in self.pieces if n in numbers and (one.held or one.action == "Grasp")]

    def meant(self, name: str, message: str, mend: str | None = None, offset: float = 0.0) -> Piece:
        """The first primitive of a name in which something can slip at an offset [s], else the nearest to that.

        name: also what it does, such as `go-home`. Raises InputError where the tool holds nothing in it, where none has
        the name, and where several of a step do that: with the message, and with another step to write if one has such
        a primitive, else with `mend`.
        """
        words, able = name.replace("-", " "), self.able(self.numbers)
        found = [piece for piece in self.pieces if name == piece[1].name]
        found = found or [piece for piece in self.pieces if words == piece[1].does]
        here = [piece for piece in found if piece[0] in self.numbers]
        if not here:
            another = self.write(found[0][0], self.bare) if found else mend
            known = dict.fromkeys(self.called(piece) for piece in self.pieces if piece[0] in self.numbers)
            raise self.refused(f"{message}; {expected_names(name, known)}", another)
        alike = [one.name for number, one in here if number == here[0][0]]
        if len(alike) > 1:
            several = f"`{name}` may mean {' or '.join(f'`{one}`' for one in alike)}, which both do that"
            raise self.refused(several, f"write {self.bare.replace(name, alike[-1])}")
        slips = [piece for piece in here if piece in able]
        long = [piece for piece in slips if piece[1].start + offset <= piece[1].end]
        chosen = (long or slips or here)[0]
        self.check_can_slip([chosen])
        return chosen

    def slip_instead(self, numbers: Iterable[int]) -> str:
        """What to write where a fault of the tool cannot happen: the first slip that can, in some steps; grasps last.

        A sweep takes slips alone, so where none can happen another option makes a camera fail.
        """
        able = min(self.able(numbers), key=lambda piece: (piece[0], not piece[1].held), default=None)
        if able is None:
            return "let a camera fail instead: --fault camera-loss:CAMERA@1.0"
        return self.write(able[0], f"slip@{self.called(able)}")

    def check_can_slip(self, during: Sequence[Piece]) -> None:
        """Raises InputError where the tool holds nothing in any of some pieces of a step, at least one."""
        first, number = self.pieces.index(during[0]), during[0][0]
        able = self.able([number])
        if any(piece in able for piece in during):
            return
        closest = min(able, key=lambda piece: abs(self.pieces.index(piece) - first), default=None)
        names = ", ".join(f"`{self.called(piece)}`" for piece in able)
        where = f"`{self.called(during[0])}`" + (f" of {self.labels[number - 1]}" if self.several else "")
        expected = f"expected one of {names}" if able else "nor in any other"
        mend = self.write(number, f"slip@{self.called(closest)}") if closest else self.slip_instead(self.all_numbers)
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
    """A fault such as `slip@lift+0.4`, or `2:slip@a4+0.4` in the second step. Raises InputError with what was expected.

    text: with times in seconds or with a unit, from the start of the step. steps: of the program; without a number the
    first is meant, or the first in which it can happen if the text names a primitive or a grasp. rng: of random
    instants. option: that gives it, for messages. served: whether it happens to a cell that is served to others.
    """
    written = _FaultText(option, text, steps, _SERVED_FORMS if served else _FORMS)
    refused, number = written.refused, written.numbers[0]
    kind = next((one for one in written.forms if one == written.kind), None)
    if kind is None:
        if any(written.kind == entry.fault for step in steps for entry in step.formulas):
            raise refused(f"`{written.kind}` is what monitors look for, and cannot be made to happen as such")
        raise refused(f"there is no fault `{written.kind}`; {expected_names(written.kind, written.forms)}")
    _, pattern, expected = written.forms[kind]
    found = re.fullmatch(pattern, written.bare[len(kind) :])
    if found is None:
        raise refused(f"expected {expected}")
    figures = found.groupdict()
    t, delay = (written.time(figures.get(name) or "0") for name in ("time", "delay"))
    camera: str | None = figures.get("camera")
    if camera is not None and camera not in cameras:
        instead = text.replace(camera, nearest(camera, cameras) or min(cameras, default="CAMERA"))
        raise refused(f"there is no camera `{camera}`; {expected_names(camera, cameras)}", f"write {instead}")
    if kind == "slip" and figures["time"]:
        label, last = written.labels[number - 1], steps[number - 1].primitives[-1].end
        if t > last:
            mend = "write N:slip@T for T seconds from the start of step N"
            mend = mend if written.several else written.slip_instead(written.all_numbers)
            raise refused(f"{label} lasts only {last:.2f} s", mend)
        here = [piece for piece in written.pieces if piece[0] == number]
        written.check_can_slip([one for one in here if one[1].start - SAME_TIME <= t <= one[1].end + SAME_TIME])
    elif kind == "slip":
        name, offset = figures["primitive"], written.time(figures["offset"] or "0")
        number, primitive = written.meant(name, f"{written.owner} has no piece of motion `{name}`", offset=offset)
        t = primitive.start + offset
        if figures["random"]:
            t = float(rng.uniform(primitive.start, primitive.end))
        elif t > primitive.end:
            owner = f"`{name}` of {written.labels[number - 1]}" if written.several else f"`{name}`"
            raise refused(f"{owner} lasts only {primitive.end - primitive.start:.2f} s")
    elif kind == "miss-pick":
        grasping = [n for n, one in written.pieces if one.action == "Grasp"]
        able = [n for n in grasping if n in written.numbers]
        if not able:
            owner = "this program" if written.numbers == written.all_numbers else written.labels[number - 1]
            last_resort = written.slip_instead(written.all_numbers)
            first = written.write(grasping[0], "miss-pick") if grasping else last_resort
            raise refused(f"no piece of motion of {owner} grasps", first)
        return InjectedFault("miss-pick", text, step=able[0])
    return InjectedFault(kind, text, t, camera, delay, number)


def parse_sweep(text: str, steps: Sequence[Step], option: str = "--sweep") -> Piece:
    """Where a sweep such as `slip@a4` or `2:slip@a4` is.

    Raises InputError for a fault that cannot be swept.
    """
    written = _FaultText(option, text, steps, _FORMS)
    kind, _, name = written.bare.partition("@")
    instead = written.slip_instead(written.numbers)
    if kind != "slip":
        raise written.refused("expected `slip@` and a piece of motion of the program", instead)
    return written.meant(name, f"expected `slip@` and a piece of motion of {written.owner}", instead)


class FaultTracker:
    """Injects the faults of a run, and tracks each: when it happened, was seen, was acted on and mended."""

    def __init__(self, cell: RunnableCell, streams: Streams, publisher: EventPublisher) -> None:
        """cell, streams: to which faults are made to happen, in simulation alone."""
        self._cell, self._streams, self._publisher = cell, streams, publisher
        self.records: list[FaultRecord] = []
        """Of all, in the order in which they were injected or seen."""
        self.open: list[FaultRecord] = []
        """Those of the step that have been injected or seen, and not been made good."""

    def inject(self, fault: InjectedFault, t: float, attempt: Attempt) -> None:
        """Inject a fault."""
        assert isinstance(self._streams, ImageStreams), "nobody can make a fault happen to a real cell"  # noqa: S101
        cell, streams, camera = cast("SimulatedCell", self._cell), self._streams, fault.camera or ""
        match fault.kind:
            case "slip":
                cell.slip()
            case "miss-pick":
                cell.misses_next_grasp = True
            case "camera-loss" | "frozen" | "latency" | "perception-crash" as kind:
                streams.fail(kind, camera, fault.delay)
        # The skill's own name for what is injected, if it has one.
        names = [entry.fault for entry in attempt.step.formulas if entry.fault is not None]
        name = names[0] if fault.kind in PHYSICAL and len(names) == 1 else fault.kind
        record = FaultRecord(name, injected=t, camera=fault.camera, kind=fault.kind)
        self.records.append(record)
        if fault.kind in PHYSICAL:
            self.open.append(record)
            attempt.undisturbed &= fault.kind == "miss-pick"  # which changes nothing until the grasp
        self._publisher.publish("injected", t, fault=fault.text)

    def look(self, t: float, tau: float | None, attempt: Attempt, truths: Mapping[str, bool]) -> None:
        """Note if the formula of a fault is true at time tau [s] of the step; truths: of all atoms now."""
        if tau is None:
            return
        watched = [
            (watch.entry.fault, one) for watch in attempt.watches if watch.entry.fault for one in watch.operators
        ]
        for name, one in watched:
            holds = all(truths[str(literal.atom)] == literal.positive for literal in one.literals)
            if one.start <= tau <= one.end and holds:
                for record in (record for record in self.open if record.happened is None):
                    record.happened, record.predicted_delay = t, attempt.step.sights[name].latest(tau)
                    self._publisher.publish("happened", t, fault=record.name)
                return

    def seen(self, alarm: Alarm, t: float) -> None:
        """The images showed a fault: the injected ones that are not seen yet, or one that was not injected."""
        unseen = [record for record in self.open if record.detected is None]
        if not unseen:
            unseen = [FaultRecord(alarm.name)]
            self.records += unseen
            self.open += unseen
        for record in unseen:
            record.name, record.detected = alarm.name, t
        self._publisher.publish("fault", t, name=alarm.name, text=alarm.text, response=alarm.response.action)

    def note(self, **times: float) -> None:
        """Note what becomes of the seen faults: when the robot `acted`, how long it `moved_on`, when it `recovered`."""
        for record in self.open:
            if record.detected is not None:
                for name, t in times.items():
                    setattr(record, name, t)

    def stopped(self, t: float, why: Stopped) -> None:
        """The robot stops for good; a fault of a camera is noticed where it is why."""
        for record in self.open:
            if record.detected is not None and record.acted is None:
                record.acted = t
        for record in self.records:
            if record.camera in why.cameras and record.name == why.fault:
                record.detected = record.acted = t
