"""Arguments, checked before anything is computed: one message says what was expected."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING

from sqrp_cli.errors import InputError, Problem

if TYPE_CHECKING:
    from sqrp_cli.programming.coverage.robustness import Calibration
    from sqrp_cli.programming.coverage.sampling import Sampling

LEAST_TOLERANCE = 1e-5
"""Smallest tolerance of Q in sampling; below it rounding decides."""

LEAST_STEP = 1e-4
"""Smallest time between two samples [s]."""

MOST_SAMPLES = 20_000
"""Most samples per primitive action."""


def refused(name: str, value: object, expected: str) -> InputError:
    """The error that says what an argument was and what was expected."""
    return InputError(Problem("bad-option", f"{name} is {short(value)}, expected {expected}"))


def checked_path(value: object, name: str = "path") -> Path:
    """A path that may be given as text. Raises InputError for anything else."""
    if not isinstance(value, str | Path) or not str(value):
        raise refused(name, value, "a path, as text or as a pathlib.Path")
    return Path(value)


def optional_path(value: object, name: str) -> Path | None:
    """A path, or None where it is left out. Raises InputError for anything else."""
    return None if value is None else checked_path(value, name)


def check_text(value: object, name: str, expected: str) -> None:
    """Raises InputError for anything but text."""
    if not isinstance(value, str):
        raise refused(name, value, expected)


def check_texts(value: object, name: str, expected: str) -> None:
    """Raises InputError for anything but a sequence of texts; a single text is none."""
    if isinstance(value, str) or not isinstance(value, Sequence) or any(not isinstance(one, str) for one in value):
        raise refused(name, value, expected)


def check_count(value: object, name: str, least: int) -> None:
    """Raises InputError for anything but a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise refused(name, value, f"a whole number from {least} on")


def check_share(value: object, name: str) -> None:
    """Raises InputError for anything but a number in 0..1."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
        raise refused(name, value, "a number from 0 to 1")


def check_sampling(value: Sampling | None) -> None:
    """Raises InputError for anything but a sampling that is coarse enough to be computed."""
    from sqrp_cli.programming.coverage.sampling import Adaptive, FixedCount, FixedStep

    match value:
        case None:
            return
        case FixedCount(int() as samples) if 2 <= samples <= MOST_SAMPLES:
            return
        case FixedStep(float() | int() as step) if LEAST_STEP <= step < math.inf:
            return
        case Adaptive(float() | int() as tolerance) if LEAST_TOLERANCE <= tolerance <= 1.0:
            return
    expected = (
        f"Adaptive(tolerance) with {LEAST_TOLERANCE:g} to 1, FixedCount(samples) with 2 to {MOST_SAMPLES:,} per "
        f"primitive action, or FixedStep(dt) with at least {LEAST_STEP:g} s"
    )
    raise refused("sampling", value, expected)


def check_calibration(value: Calibration | None) -> None:
    """Raises InputError for anything but a calibration with plausible deviations."""
    from sqrp_cli.programming.coverage.robustness import Calibration

    match value:
        case None:
            return
        case Calibration(float() | int() as position, float() | int() as rotation, int() as seed) if (
            0 <= position <= 1 and 0 <= rotation <= 1 and seed >= 0
        ):
            return
    raise refused("calibration", value, "Calibration(position, rotation, seed) with up to 1 m and up to 1 rad")
