"""Kinds of fields of requests: each reads words and values of Python, and says what was expected."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask.request import FieldKind, Words
from sqrp_cli.errors import InputError, bad_option, expected_names

if TYPE_CHECKING:
    from sqrp_cli.files.units import Dimension
    from sqrp_cli.study.find import TimeLimit
    from sqrp_cli.study.robustness import Calibration
    from sqrp_cli.study.sampling import Sampling

LEAST_TOLERANCE = 1e-5  # smallest tolerance of Q in sampling; below it rounding decides
LEAST_STEP = 1e-4  # smallest time between two samples [s]
MOST_SAMPLES = 20_000  # most samples per primitive action


def refused(name: str, value: object, expected: str) -> InputError:
    """The error that says what an argument was and what was expected."""
    given = f"{value:g}" if isinstance(value, float) else short(value)
    return bad_option(f"{name} is {given}, expected {expected}")


@contextmanager
def silent(_title: str, _total: int | None) -> Iterator[Callable[[int], None]]:
    """Progress that is not shown."""
    yield lambda _count: None


def cores() -> int:
    """How many processes a command uses at most where it is not told."""
    return os.cpu_count() or 1


def reads(words: Any) -> Callable[[Callable[[Any, str], Any]], FieldKind]:  # noqa: ANN401 - a type, or a list of one
    """A kind of field, made of the function that reads a value by its name. words: see `FieldKind`."""
    return lambda read: FieldKind(words, read)


def text(expected: str) -> FieldKind:
    """Text that is not empty."""

    def read(value: object, name: str) -> str:
        if not isinstance(value, str):
            raise refused(name, value, expected)
        if not value.strip():
            raise bad_option(f"{name} is empty, expected {expected}")
        return value

    return FieldKind(str, read)


def texts(expected: str) -> FieldKind:
    """Several texts; a single text is none."""

    def read(value: object, name: str) -> tuple[str, ...]:
        if isinstance(value, str) or not isinstance(value, Sequence) or any(not isinstance(one, str) for one in value):
            raise refused(name, value, expected)
        return tuple(value)

    return FieldKind(list[str], read)


def one_of(*known: str) -> FieldKind:
    """One of some names."""

    def read(value: object, name: str) -> str:
        if not isinstance(value, str):
            raise refused(name, value, f"one of {', '.join(known)}")
        if value not in known:
            raise bad_option(f"{name} is `{value}`; {expected_names(value, known)}")
        return value

    return FieldKind(str, read, "|".join(known))


def count(least: int, most: int | None = None) -> FieldKind:
    """A whole number."""
    upto = "on" if most is None else f"to {most:,}"

    def read(value: object, name: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or value < least or (most and value > most):
            raise refused(name, value, f"a whole number from {least} {upto}")
        return value

    return FieldKind(int, read, "N")


def number(least: float, most: float = math.inf) -> FieldKind:
    """A number."""
    upto = " on" if most == math.inf else f" to {most:g}"

    def read(value: object, name: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= most:
            raise refused(name, value, f"a number from {least:g}{upto}")
        return value

    return FieldKind(float, read)


def share(least: float) -> FieldKind:
    """A share, such as `97%` or 0.97."""

    def read(value: object, name: str) -> float:
        from sqrp_cli.files.units import SHARE, read_quantity

        if isinstance(value, str):
            found = read_quantity(value)
            if found is None or found.dimension not in (None, SHARE) or not least <= found.value <= 1.0:
                raise bad_option(f"{name} is `{value}`, expected {100 * least:g}% to 100%")
            return found.value
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= 1.0:
            raise refused(name, value, f"a number from {least:g} to 1")
        return value

    return FieldKind(str, read, "PERCENT")


def function(expected: str) -> FieldKind:
    """Something that can be called."""

    def read(value: object, name: str) -> object:
        if not callable(value):
            raise refused(name, value, expected)
        return value

    return FieldKind(None, read)


flag = FieldKind(bool, lambda value, _name: value)
progress = function("a function of a title and a total")


@reads(Path)
def path(value: object, name: str) -> Path:
    """A path."""
    if not isinstance(value, str | Path) or not str(value):
        raise refused(name, value, "a path, as text or as a pathlib.Path")
    return Path(value)


@reads(list[Path])
def paths(value: object, name: str) -> tuple[Path, ...]:
    """Several paths; a single one is none."""
    if isinstance(value, str | Path) or not isinstance(value, Sequence):
        raise refused(name, value, "several paths, in a list")
    return tuple(path.read(one, name) for one in value)


@reads(str)
def urdf(value: object, name: str) -> object:
    """A path, or an address of a package as text."""
    return value if isinstance(value, str) and value else path.read(value, name)


@reads(str)
def choice(value: object, name: str) -> object:
    """A candidate, or None for all."""
    return None if value is None else text("the name of a candidate, `best`, or None for all").read(value, name)


@reads(str)
def time_limit(value: object, name: str) -> TimeLimit:
    """A limit of time: `20 s`, `1.25x`, or seconds."""
    from sqrp_cli.study.find import TimeLimit

    if isinstance(value, TimeLimit):
        return value
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise refused(name, value, "a time such as `20 s` or `1.25x`, or seconds")
    return TimeLimit.read(str(value), name)


def _quantity(said: str, name: str, dimension: Dimension, more: str = "", least: float = -math.inf) -> float:
    """A value in SI units, with or without its unit; above `least`, of which `more` tells."""
    from sqrp_cli.files.units import expected_quantity, read_quantity

    found = read_quantity(said)
    if found is None or found.dimension not in (None, dimension) or not least < found.value < math.inf:
        raise bad_option(f"{name} is `{said}`, expected {expected_quantity(dimension)}{more}")
    return found.value


@reads(None)
def sampling(value: Sampling | Words, name: str) -> Sampling:
    """A sampling, as a value or by its words: `samples`, `dt` or `tolerance`."""
    from sqrp_cli.files.units import TIME
    from sqrp_cli.study.sampling import Adaptive, FixedCount, FixedStep

    said = value if isinstance(value, Words) else {}
    if len(said) > 1:
        first, second, *_ = said
        raise bad_option(f"--{first} and --{second} exclude each other; give one of them")
    match said:
        case {"samples": int() as samples}:
            if not 2 <= samples <= MOST_SAMPLES:
                raise bad_option(f"--samples is {samples}, expected 2 to {MOST_SAMPLES:,} per primitive action")
            return FixedCount(samples)
        case {"dt": str() as dt}:
            step = _quantity(dt, "--dt", TIME)
            if step < LEAST_STEP:
                raise bad_option(f"--dt is {step:g} s, expected at least {LEAST_STEP:g} s")
            return FixedStep(step)
        case {"tolerance": float() as points}:
            if not (math.isfinite(points) and 100 * LEAST_TOLERANCE <= points <= 100):
                raise bad_option(f"--tolerance is {points:g}, expected {100 * LEAST_TOLERANCE:g} to 100 points")
            return Adaptive(points / 100)
    match value:
        case FixedCount(int() as samples) if 2 <= samples <= MOST_SAMPLES:
            return value
        case FixedStep(float() | int() as step) if LEAST_STEP <= step < math.inf:
            return value
        case Adaptive(float() | int() as tolerance) if LEAST_TOLERANCE <= tolerance <= 1.0:
            return value
    expected = (
        f"Adaptive(tolerance) with {LEAST_TOLERANCE:g} to 1, FixedCount(samples) with 2 to {MOST_SAMPLES:,} per "
        f"primitive action, or FixedStep(dt) with at least {LEAST_STEP:g} s"
    )
    raise refused(name, value, expected)


@reads(str)
def calibration(value: Calibration | Words, name: str) -> Calibration:
    """Standard deviations of camera poses, as a value or in words such as `5 mm, 0.5 deg` with a seed.

    In words each of length and angle has its unit, and either may be left out.
    """
    from sqrp_cli.files.units import ANGLE, LENGTH, read_quantity
    from sqrp_cli.study.robustness import Calibration

    match value:
        case Calibration(float() | int() as position, float() | int() as rotation, int() as seed) if (
            0 <= position <= 1 and 0 <= rotation <= 1 and seed >= 0
        ):
            return value
        case {"calibration": str() as said, "seed": seed} if isinstance(value, Words):
            pass
        case _:
            raise refused(name, value, "Calibration(position, rotation, seed) with up to 1 m and up to 1 rad")
    found: dict[Dimension, float] = {}
    for part in (one.strip() for one in said.split(",")):
        quantity = read_quantity(part)
        if quantity is None:
            numbers = re.split(r"\s+(?=[-+.\d])", part)
            lacks = len(numbers) == 2 and all(map(read_quantity, numbers))
            wrong = "lacks a comma" if lacks else "is no length or angle"
        elif quantity.dimension is None:
            wrong = "has no unit"
        elif quantity.dimension not in (LENGTH, ANGLE):
            wrong = "is no length or angle"
        elif quantity.dimension in found:
            wrong = f"is {quantity.dimension.name} once more"
        elif not 0 <= quantity.value <= 1:
            unit = "m" if quantity.dimension is LENGTH else "rad"
            wrong = "is negative" if quantity.value < 0 else f"is not up to 1 {unit}"
        else:
            found[quantity.dimension] = quantity.value
            continue
        raise bad_option(f"{name}: `{part}` {wrong}; try `5 mm, 0.5 deg`")
    return Calibration(found.get(LENGTH, 0.0), found.get(ANGLE, 0.0), seed)


@reads(None)
def listeners(value: object, name: str) -> Sequence[Any]:
    """Functions of an event."""
    if not isinstance(value, Sequence) or not all(map(callable, value)):
        raise refused(name, value, "functions of an event, in a list")
    return value


@reads(None)
def where_needed(value: object, name: str) -> bool:
    """Whether to do something; None, which is the default: where it is needed."""
    if not isinstance(value, bool):
        raise refused(name, value, "True, False, or None for where it is needed")
    return value


@reads(str)
def planner(value: object, name: str) -> Any:  # noqa: ANN401 - a planner
    """A function that plans, or the name of an engine of unified-planning."""
    if isinstance(value, str):
        from sqrp_cli.logic.unified_planner import engine_planner

        return engine_planner(value)
    return function("a function such as sqrp_cli.logic.planner.find_plan").read(value, name)


@reads(str)
def kinds(value: object, name: str) -> Any:  # noqa: ANN401 - kinds of changes
    """Kinds of changes, in a list or parted by commas."""
    from sqrp_cli.search.goal import read_kinds

    said = value.split(",") if isinstance(value, str) else texts("kinds of changes").read(value, name)
    kinds = [one.strip() for one in said]
    if not any(kinds):
        raise bad_option(f"{name} is empty, expected kinds of changes such as `way,object`")
    return read_kinds(kinds)


@reads(list[str])
def topics(value: object, name: str) -> dict[str, str]:
    """Topics by camera, as a mapping or in texts `CAMERA=TOPIC`."""
    if isinstance(value, Mapping):
        return dict(value)
    pairs: dict[str, str] = {}
    for said in texts("topics by camera").read(value, name):
        camera, equals, topic = said.partition("=")
        if not (camera and equals and topic):
            raise bad_option(f"{name} is `{said}`, expected CAMERA=TOPIC such as cam1=/left/image_raw/compressed")
        if pairs.get(camera, topic) != topic:
            raise bad_option(f"{name} names both {pairs[camera]} and {topic} for {camera}")
        pairs[camera] = topic
    return pairs


@reads(str)
def rate(value: object, name: str) -> float:
    """A rate of 1 to 2000 Hz, such as `100` or `50 Hz`."""
    from sqrp_cli.files.units import FREQUENCY

    found = _quantity(str(value), name, FREQUENCY)
    if not 1.0 <= found <= 2000.0:
        raise bad_option(f"{name} is {found:g} Hz, expected 1 to 2000 Hz")
    return found


@reads(str)
def seconds(value: object, name: str) -> float:
    """A time above 0, such as `60` or `90 s`, in seconds."""
    from sqrp_cli.files.units import TIME

    return _quantity(str(value), name, TIME, ", more than 0", 0.0)


@reads(list[str])
def xacro(value: object, name: str) -> Mapping[str, str] | tuple[str, ...]:
    """Arguments of a xacro, as a mapping or in texts `NAME:=VALUE`."""
    return dict(value) if isinstance(value, Mapping) else texts("texts such as ur_type:=ur5e").read(value, name)
