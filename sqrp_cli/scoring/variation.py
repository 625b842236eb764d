"""Which variants of a workspace to score: values on a grid, or drawn at random."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from sqrp_cli.errors import bad_option
from sqrp_cli.geometry import Array

MAX_VARIANTS = 10_000
"""Most variants of a sweep."""

_END = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D*?)\s*")
_INDEX = re.compile(r"\[(\d+)\]")

Values = tuple[tuple[str, str], ...]
"""The values of a variant, as YAML text, by dotted path."""


@dataclass(frozen=True)
class Variation:
    """A value of a workspace file and where it goes: from `start` to `end`."""

    path: str
    """Dotted, such as `cameras.cam1.pose.position.0`."""
    start: float
    end: float
    unit: str
    """The unit of both ends; empty for SI units."""
    count: int | None
    """Steps of a grid; None where values are drawn."""

    def text(self, value: float) -> str:
        """A value as YAML text; 0 if it is negligible beside the ends."""
        value = 0.0 if abs(value) <= 1e-9 * max(abs(self.start), abs(self.end)) else value
        return f"{value:.6g}{f' {self.unit}' if self.unit else ''}"


def read_variation(text: str) -> Variation:
    """`PATH=FROM:TO:N`, or `PATH=FROM:TO` where values are drawn; `position[0]` is the same as `position.0`.

    Raises InputError for anything else.
    """
    path, equals, ends = text.partition("=")
    start, *others = ends.split(":")
    matches = [_END.fullmatch(end) for end in (start, *others[:1])]
    count = others[1] if len(others) == 2 else None
    good = equals and path.strip() and len(others) in (1, 2) and (count is None or count.strip().isdecimal())
    if not good or len(matches) != 2 or None in matches:
        message = f"--vary is `{text}`, expected PATH=FROM:TO:N, such as `cameras.cam1.pose.position[0]=0.8:1.2:9`"
        raise bad_option(message)
    (low, unit), (high, other_unit) = (match.groups() for match in matches if match is not None)
    if not math.isfinite(float(high) - float(low)):
        raise bad_option(f"--vary is `{text}`: expected ends that are not so far apart")
    if unit != other_unit:
        raise bad_option(f"--vary is `{text}`: expected the same unit at both ends, such as `80 cm:120 cm:9`")
    if count is not None and int(count) < 1:
        raise bad_option(f"--vary is `{text}`: expected at least one value")
    dotted = _INDEX.sub(r".\1", path.strip())
    return Variation(dotted, float(low), float(high), unit, None if count is None else int(count))


def variants(variations: Sequence[Variation], draws: int | None, seed: int) -> tuple[Values, ...]:
    """The values of every variant: all combinations, or random draws, uniform between the ends.

    Raises InputError for a path that is varied twice, a grid without numbers of steps, or too many variants.
    """
    paths = [variation.path for variation in variations]
    twice = [path for path in paths if paths.count(path) > 1]
    if twice:
        raise bad_option(f"`{twice[0]}` is varied twice")
    if draws is not None:
        rng = np.random.default_rng(seed)
        points = [[float(rng.uniform(v.start, v.end)) for v in variations] for _ in range(draws)]
        return tuple(_values(variations, point) for point in points)
    open_ended = [variation.path for variation in variations if variation.count is None]
    if open_ended:
        message = f"`{open_ended[0]}` has no number of steps"
        raise bad_option(message, mend="write FROM:TO:N, or give a number of random --draws")
    counts = [variation.count or 1 for variation in variations]
    total = int(np.prod(counts, dtype=object))
    if total > MAX_VARIANTS:
        raise bad_option(f"{total:,} variants are requested, the limit is {MAX_VARIANTS:,}")
    grids = [np.linspace(v.start, v.end, count).tolist() for v, count in zip(variations, counts, strict=True)]
    return tuple(_values(variations, point) for point in product(*grids))


def grid_shape(variations: Sequence[Variation], draws: int | None) -> tuple[int, ...] | None:
    """How many values of each path `variants` combines, in row-major order; None if they are drawn."""
    return None if draws is not None else tuple(variation.count or 1 for variation in variations)


def shares(values: Sequence[Values]) -> Array:
    """The values of each variant, scaled to 0..1 between the least and the greatest per path; shape (n, paths)."""
    numbers = np.array([[float(text.split()[0]) for _, text in chosen] for chosen in values])
    low, high = numbers.min(axis=0), numbers.max(axis=0)
    found: Array = (numbers - low) / np.where(high > low, high - low, 1.0)
    return found


def _values(variations: Sequence[Variation], point: Sequence[float]) -> Values:
    return tuple((v.path, v.text(value)) for v, value in zip(variations, point, strict=True))
