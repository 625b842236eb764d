"""Arguments, checked before anything is computed: one message says what was expected."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from reprlib import repr as short
from typing import TYPE_CHECKING, Literal, get_args

from sqrp_cli.errors import InputError, bad_option

if TYPE_CHECKING:
    from sqrp_cli.programming.coverage.robustness import Calibration
    from sqrp_cli.programming.coverage.sampling import Sampling
    from sqrp_cli.programming.ranking import Criterion
    from sqrp_cli.programming.ways.find import WantedWay

WaysOption = Literal["best", "fastest"]
WAYS: tuple[WaysOption, ...] = get_args(WaysOption)
"""Which way of each candidate: the one that is seen best, or the fastest."""

LEAST_TOLERANCE = 1e-5
"""Smallest tolerance of Q in sampling; below it rounding decides."""

LEAST_STEP = 1e-4
"""Smallest time between two samples [s]."""

MOST_SAMPLES = 20_000
"""Most samples per primitive action."""


@dataclass(frozen=True, kw_only=True)
class RunOutputs:
    """Files and folders that a run writes; None: not wanted."""

    film: Path | None = None
    """A film, or a recording for ROS tools, by its suffix."""
    log: Path | None = None
    frames: Path | None = None
    """A folder."""
    page: Path | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    """What messages call a field whose option has another name, such as `--record` for `film`."""

    @property
    def named(self) -> dict[str, Path | None]:
        """Each by what messages call it."""
        paths = {"film": self.film, "log": self.log, "frames": self.frames, "page": self.page}
        return {self.options.get(name, name): path for name, path in paths.items()}

    def check_names(self) -> None:
        """Raises InputError for a name that no film can have, and where two outputs have the same."""
        from sqrp_cli.platform.files import check_distinct

        if self.film is not None:
            _check_film(self.film, self.options.get("film", "film"))
        check_distinct(self.named)

    def check_not_read(self, inputs: Iterable[Path]) -> None:
        """Raises InputError where an output file is also an input file; a folder of frames is new or empty."""
        from sqrp_cli.platform.files import check_not_read

        check_not_read([self.film, self.log, self.page], inputs)


def is_recording(path: Path | None) -> bool:
    """Whether a film's name is that of a recording for ROS tools."""
    from sqrp_cli.ros.bag import SUFFIXES

    return path is not None and path.suffix.lower() in SUFFIXES


def _check_film(path: Path, name: str) -> None:
    """Raises InputError for a name that neither a recording nor an MP4 film of OpenCV can have."""
    if is_recording(path):
        return
    if path.suffix.lower() != ".mp4":
        expected = "expected a name that ends in .mp4 (film), .mcap (recording) or .bag (recording of ROS 1)"
        raise bad_option(f"{name} is `{path}`; {expected}")
    if str(path) != str(path).encode(errors="ignore").decode():
        raise bad_option(f"{name} is `{path}`, which is not UTF-8 text; films are written by a library that needs it")


def refused(name: str, value: object, expected: str) -> InputError:
    """The error that says what an argument was and what was expected."""
    return bad_option(f"{name} is {short(value)}, expected {expected}")


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


def check_callable(value: object, name: str, expected: str) -> None:
    """Raises InputError for anything that cannot be called."""
    if not callable(value):
        raise refused(name, value, expected)


def check_means(jobs: object, progress: object) -> None:
    """Raises InputError for anything but a number of processes, and what can show progress."""
    check_count(jobs, "jobs", 1)
    check_progress(progress)


def check_progress(value: object) -> None:
    """Raises InputError for anything that cannot show progress."""
    check_callable(value, "progress", "a function of a title and a total")


def check_by(value: object) -> Criterion:
    """What a ranking is by. Raises InputError for anything else."""
    from sqrp_cli.programming.ranking import CRITERIA, read_criterion

    check_text(value, "by", f"one of {', '.join(CRITERIA)}")
    return read_criterion(str(value), "by")


def check_ways(value: object) -> WaysOption:
    """Which ways count. Raises InputError for anything else."""
    for ways in WAYS:
        if value == ways:
            return ways
    raise refused("ways", value, f"one of {', '.join(f'`{way}`' for way in WAYS)}")


def check_wanted(by: object, ways: object, max_time: object) -> WantedWay:
    """Which way of each candidate is wanted. Raises InputError for values that say nothing sensible."""
    from sqrp_cli.programming.ways.find import TimeLimit, WantedWay

    check_ways(ways)
    if max_time is not None and (isinstance(max_time, bool) or not isinstance(max_time, str | int | float)):
        raise refused("max_time", max_time, "a time such as `20 s` or `1.25x`, or seconds")
    limit = None if max_time is None else TimeLimit.read(str(max_time), "max_time")
    return WantedWay(check_by(by), ways == "fastest", limit)


def check_threshold(value: object) -> None:
    """Raises InputError for anything but a number in 0..1."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
        raise refused("threshold", value, "a number from 0 to 1")


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
