"""Faults that a run is told to suffer, as the command line writes them."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.knowledge.units import TIME, expected_quantity, read_quantity
from sqrp_cli.program import Step
from sqrp_cli.program_check import SAME_TIME

FaultKind = Literal["slip", "miss-pick", "camera-loss", "frozen", "latency", "perception-crash"]

_FORMS = {
    "slip": "slip@a4+0.4, slip@a4:random or slip@7.2",
    "miss-pick": "miss-pick",
    "camera-loss": "camera-loss:cam2@5.0",
    "frozen": "frozen:cam1@3",
    "latency": "latency:cam3=0.5",
    "perception-crash": "perception-crash:cam1@4",
}
_SLIP = re.compile(r"(?P<primitive>[A-Za-z_]\w*)(?:\+(?P<offset>.+)|(?P<random>:random))?|(?P<time>[.\d].*)")
_CAMERA_AT = re.compile(r"(?P<camera>[^@=]+)@(?P<time>.+)")
_CAMERA_BY = re.compile(r"(?P<camera>[^@=]+)=(?P<delay>.+)")


@dataclass(frozen=True)
class InjectedFault:
    """A fault that happens to a run.

    t: when [s], from the start of the program's motion; None for one that waits for an event (a grasp, the start).
    camera: which one, for faults of cameras. delay: by how much its images are late [s].
    """

    kind: FaultKind
    text: str
    t: float | None = None
    camera: str | None = None
    delay: float = 0.0


def parse_fault(text: str, step: Step, cameras: Collection[str], rng: np.random.Generator) -> InjectedFault:
    """A fault such as `slip@a4+0.4`. Raises InputError that says what was expected.

    text: with times in seconds or with a unit. step: whose primitives are meant, with times from its start. rng: of
    random instants.
    """
    head = _kind(text)
    if head not in _FORMS:
        raise _refused(text, f"there is no fault `{head}`; {expected_names(head, _FORMS)}")
    rest = text[len(head) :]
    match head:
        case "slip":
            return _slip(text, rest, step, rng)
        case "miss-pick":
            if rest:
                raise _refused(text, f"expected just `{head}`")
            if not any(primitive.action == "Grasp" for primitive in step.primitives):
                raise _refused(text, "no primitive of this program grasps")
            return InjectedFault("miss-pick", text)
        case "latency":
            found = _CAMERA_BY.fullmatch(rest.removeprefix(":")) if rest.startswith(":") else None
            if found is None:
                raise _refused(text, "expected the camera and by how much it is late")
            camera = _camera(text, found["camera"], cameras)
            return InjectedFault("latency", text, 0.0, camera, _time(text, found["delay"]))
    found = _CAMERA_AT.fullmatch(rest.removeprefix(":")) if rest.startswith(":") else None
    if found is None:
        raise _refused(text, "expected the camera and when it happens")
    kind: FaultKind = "camera-loss" if head == "camera-loss" else "frozen" if head == "frozen" else "perception-crash"
    camera = _camera(text, found["camera"], cameras)
    return InjectedFault(kind, text, _time(text, found["time"]), camera)


def _slip(text: str, rest: str, step: Step, rng: np.random.Generator) -> InjectedFault:
    found = _SLIP.fullmatch(rest.removeprefix("@")) if rest.startswith("@") else None
    if found is None:
        raise _refused(text, "expected when it slips")
    if found["time"]:
        t, last = _time(text, found["time"]), step.primitives[-1].end
        if t > last:
            raise _refused(text, f"the step lasts only {last:.2f} s")
        during = [one.name for one in step.primitives if one.start - SAME_TIME <= t <= one.end + SAME_TIME]
        check_can_slip(f"--fault {text}", step, during)
        return InjectedFault("slip", text, t)
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in step.primitives}
    if found["primitive"] not in spans:
        hint = expected_names(found["primitive"], spans)
        raise _refused(text, f"the program has no primitive `{found['primitive']}`; {hint}")
    check_can_slip(f"--fault {text}", step, [found["primitive"]])
    start, end = spans[found["primitive"]]
    if found["random"]:
        return InjectedFault("slip", text, float(rng.uniform(start, end)))
    offset = _time(text, found["offset"] or "0")
    if start + offset > end:
        raise _refused(text, f"`{found['primitive']}` lasts only {end - start:.2f} s")
    return InjectedFault("slip", text, start + offset)


def check_can_slip(told: str, step: Step, during: Sequence[str]) -> None:
    """Raises InputError where the tool holds nothing in any of some primitives, so that nothing can slip.

    told: the option with its text. during: names of primitives, at least one.
    """
    names = [primitive.name for primitive in step.primitives]
    holding = [primitive.name for primitive in step.primitives if primitive.held or primitive.action == "Grasp"]
    if set(during) & set(holding):
        return
    meant = names.index(during[0])
    closest = min(holding, key=lambda name: abs(names.index(name) - meant), default=None)
    expected = f"expected one of {', '.join(f'`{name}`' for name in holding)}" if holding else "nor in any other"
    message = f"{told}: the tool grasps or holds nothing in `{during[0]}`, {expected}"
    mend = f"write slip@{closest}" if closest is not None else "let a camera fail, such as camera-loss:CAMERA@1.0"
    raise InputError(Problem("bad-fault", message, mend=mend))


def _time(text: str, words: str) -> float:
    """A time [s], read from a plain number or one with a unit."""
    found = read_quantity(words)
    if found is None or found.dimension not in (None, TIME) or found.value < 0:
        raise _refused(text, f"expected {expected_quantity(TIME)}, 0 or more, found `{words}`")
    return found.value


def _camera(text: str, name: str, cameras: Collection[str]) -> str:
    if name not in cameras:
        raise _refused(text, f"there is no camera `{name}`; {expected_names(name, cameras)}")
    return name


def _refused(text: str, message: str) -> InputError:
    form = _FORMS.get(_kind(text))
    mend = f"write {form}" if form else f"give one of: {'; '.join(_FORMS.values())}"
    return InputError(Problem("bad-fault", f"--fault {text}: {message}", mend=mend))


def _kind(text: str) -> str:
    return re.split(r"[@:=]", text, maxsplit=1)[0]
