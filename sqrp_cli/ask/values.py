"""Kinds of fields of requests: each reads words and values of Python, and says what was expected."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
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


def reads(words: Any) -> Callable[[Callable[[Any, str], Any]], FieldKind]:  # noqa: ANN401 - a type, or a list of one
    """A kind of field, made of the function that reads a value by its name. words: see `FieldKind`."""
    return lambda read: FieldKind(words, read)


def kept(
    words: Any,  # noqa: ANN401 - see `FieldKind`
    expected: str,
    holds: Callable[[Any], bool],
    *,
    make: Callable[[Any], Any] = lambda value: value,
    metavar: str | None = None,
) -> FieldKind:
    """What `holds` of a value, made into the field; any other value is refused with what was expected."""

    def read(value: object, name: str) -> object:
        if not holds(value):
            raise refused(name, value, expected)
        return make(value)

    return FieldKind(words, read, metavar)


def text(expected: str, *, or_none: bool = False) -> FieldKind:
    """Text that is not empty."""

    def read(value: object, name: str) -> str | None:
        if value is None and or_none:
            return None
        if not isinstance(value, str):
            raise refused(name, value, expected)
        if not value.strip():
            raise bad_option(f"{name} is empty, expected {expected}")
        return value

    return FieldKind(str, read)


def texts(expected: str) -> FieldKind:
    """Several texts; a single text is none."""
    return kept(list[str], expected, lambda value: _several(value, str), make=tuple)


def _several(value: object, kind: Any) -> bool:  # noqa: ANN401 - as `isinstance` takes it
    return isinstance(value, Sequence) and not isinstance(value, str) and all(isinstance(one, kind) for one in value)


def one_of(*known: str, **once: str) -> FieldKind:
    """One of some names. once: what stands for words that scripts may still have."""

    def read(value: object, name: str) -> str:
        value = once.get(value, value) if isinstance(value, str) else value
        if not isinstance(value, str):
            raise refused(name, value, f"one of {', '.join(known)}")
        if value not in known:
            raise bad_option(f"{name} is `{value}`; {expected_names(value, known)}")
        return value

    return FieldKind(str, read, "|".join(known))


def number(least: float, most: float = math.inf, *, whole: bool = False) -> FieldKind:
    """A number."""
    upto = "on" if most == math.inf else f"to {most:,}" if whole else f"to {most:g}"
    kind = int if whole else int | float
    return kept(
        int if whole else float,
        f"a {'whole ' * whole}number from {least:g} {upto}",
        lambda value: isinstance(value, kind) and not isinstance(value, bool) and least <= value <= most,
        metavar="N" if whole else None,
    )


count = partial(number, whole=True)  # a whole number
flag = FieldKind(bool, lambda value, _name: value)
progress = kept(None, "a function of a title and a total", callable)
listeners = kept(
    None, "functions of an event, in a list", lambda value: isinstance(value, Sequence) and all(map(callable, value))
)
where_needed = kept(None, "True, False, or None for where it is needed", lambda value: isinstance(value, bool))
_A_PATH = "a path, as text or as a pathlib.Path"
path = kept(Path, _A_PATH, lambda value: isinstance(value, str | Path) and bool(str(value)), make=Path)
paths = kept(
    list[Path],
    "several paths, in a list",
    lambda value: _several(value, str | Path) and "" not in value,
    make=lambda all_: tuple(map(Path, all_)),
)
urdf = kept(str, _A_PATH, lambda value: isinstance(value, str | Path) and bool(str(value)))  # or of a package
choice = text("the name of a candidate, `best`, or None for all", or_none=True)


@reads(str)
def time_limit(value: object, name: str) -> TimeLimit:
    """A limit of time: `20 s`, `1.25x`, or seconds."""
    from sqrp_cli.study.find import TimeLimit

    if isinstance(value, TimeLimit):
        return value
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise refused(name, value, "a time such as `20 s` or `1.25x`, or seconds")
    return TimeLimit.read(str(value), name)


def quantity(dimension: str, least: float, most: float, bounds: str, metavar: str | None = None) -> FieldKind:
    """A value in SI units, or with its unit. dimension: its name in `files.units`; bounds: for messages."""

    def read(value: object, name: str) -> float:
        from sqrp_cli.files import units

        own = getattr(units, dimension)
        found = units.read_quantity(str(value))
        if found is None or found.dimension not in (None, own) or not least <= found.value <= most:
            expected = bounds if dimension == "SHARE" else f"{units.expected_quantity(own)}, {bounds}"
            raise bad_option(f"{name} is `{value}`, expected {expected}")
        return found.value

    return FieldKind(str, read, metavar)


rate = quantity("FREQUENCY", 1.0, 2000.0, "1 to 2000 Hz")
seconds = quantity("TIME", math.ulp(0.0), math.inf, "more than 0")


@reads(None)
def sampling(value: Sampling | Words, name: str) -> Sampling:
    """A sampling, as a value or by its words: `samples`, `dt` or `tolerance`."""
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
            return FixedStep(quantity("TIME", LEAST_STEP, math.inf, f"at least {LEAST_STEP:g} s").read(dt, "--dt"))
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


@reads(None)
def page(value: Path | Words, name: str) -> Path:
    """A page to write: its path, or the words `report` and `open`."""
    if isinstance(value, Words) and "report" not in value:
        raise bad_option("--open is about --report, which is missing")
    return Path(path.read(value["report"] if isinstance(value, Words) else value, name))


@reads(str)
def calibration(value: Calibration | Words, name: str) -> Calibration:
    """Standard deviations of camera poses, as a value or in words such as `5 mm, 0.5 deg` with a seed."""
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


@reads(str)
def planner(value: object, name: str) -> Any:  # noqa: ANN401 - a planner
    """A function that plans, or the name of an engine of unified-planning."""
    if isinstance(value, str):
        from sqrp_cli.logic.unified_planner import engine_planner

        return engine_planner(value)
    return kept(None, "a function such as sqrp_cli.logic.planner.find_plan", callable).read(value, name)


@reads(str)
def kinds(value: object, name: str) -> Any:  # noqa: ANN401 - kinds of changes
    """Kinds of changes, in a list or parted by commas."""
    from sqrp_cli.search.goal import KINDS

    said = value.split(",") if isinstance(value, str) else texts("kinds of changes").read(value, name)
    wanted = [one.strip() for one in said]
    if not any(wanted):
        raise bad_option(f"{name} is empty, expected kinds of changes such as `way,object`")
    for one in wanted:
        if one not in KINDS:
            raise bad_option(f"there is no kind of change `{one}`; {expected_names(one, KINDS)}")
    return tuple(kind for kind in KINDS if kind in wanted)


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


@reads(list[str])
def xacro(value: object, name: str) -> Mapping[str, str] | tuple[str, ...]:
    """Arguments of a xacro, as a mapping or in texts `NAME:=VALUE`."""
    return dict(value) if isinstance(value, Mapping) else texts("texts such as ur_type:=ur5e").read(value, name)
