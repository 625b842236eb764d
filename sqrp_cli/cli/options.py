"""Arguments and options that several commands share, and what they mean."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from sqrp_cli.api.arguments import LEAST_STEP, LEAST_TOLERANCE, MOST_SAMPLES, WAYS
from sqrp_cli.api.cell import OpenCell
from sqrp_cli.api.program import OpenProgram
from sqrp_cli.cli import completion
from sqrp_cli.errors import InputError, Place, Problem, bad_option, expected_names
from sqrp_cli.platform.memory import keep_all_so_far

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from sqrp_cli.api.arguments import WaysOption
    from sqrp_cli.api.results import Answer, AnyDocument
    from sqrp_cli.knowledge.text.units import Dimension, Quantity
    from sqrp_cli.programming.coverage.robustness import Calibration
    from sqrp_cli.programming.coverage.sampling import Sampling

WorkspacePath = Annotated[Path, typer.Argument(metavar="WORKSPACE", help="Folder of a workspace, or its YAML file.")]
StartPath = Annotated[
    Path,
    typer.Argument(metavar="WORKSPACE", help="Folder of a workspace, its YAML file, or a PROGRAM: to go on after it."),
]
ProgramPath = Annotated[
    Path, typer.Argument(metavar="PROGRAM", help="A program file, as `sqrp rank --program` writes.")
]
TaskText = Annotated[
    str,
    typer.Argument(
        metavar="TASK",
        autocompletion=completion.tasks,
        help='A skill and what to do it with, such as "pickup red screw".',
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON document and nothing else.")]
SampleCount = Annotated[
    int | None,
    typer.Option("--samples", metavar="N", help="N samples per primitive action, instead of as many as needed."),
]
SampleStep = Annotated[
    str | None, typer.Option("--dt", metavar="S", help="A sample every S seconds, instead of as many as needed.")
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        "--tolerance", metavar="POINTS", help="Error of Q that sampling may leave, in points; 0.1 by default."
    ),
]
Jobs = Annotated[
    int | None, typer.Option("--jobs", metavar="N", min=1, help="Processes at most; by default one per core.")
]
Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="Seed of everything that is drawn at random.")]
Ways = Annotated[
    str,
    typer.Option(
        "--ways",
        metavar="best|all|fastest",
        help="Show each candidate by its best way, all that are Pareto-optimal, or take the fastest branch with the "
        "first yaw and side, seen or not; other yaws and sides may be faster.",
    ),
]
MaxTime = Annotated[
    str | None,
    typer.Option(
        "--max-time", metavar="T", help="How long a way may take: 20 s, or 1.25x the time of the fastest of all."
    ),
]
After = Annotated[
    Path | None,
    typer.Option("--after", metavar="PROGRAM", help="Start from the world that this program leaves behind."),
]
Choose = Annotated[
    str | None,
    typer.Option(
        "--choose",
        metavar="best|N|NAME",
        autocompletion=completion.candidates,
        help="Which candidate: best, its place in the ranking, or its name; best by default.",
    ),
]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE", help="Write a page with charts and 3D playback, for any browser."),
]
Images = Annotated[
    Path | None,
    typer.Option("--images", metavar="DIR", help="Write what each camera sees in each blind interval as pictures."),
]

DEFAULT_ALLOWANCE = 0.5
"""Changes for the worse that are no regression yet: points of Q, percent of times."""

Paths = Annotated[
    list[str],
    typer.Argument(metavar="PATH...", help="Workspaces, folders of workspaces, or patterns such as 'cells/*'."),
]
Baseline = Annotated[
    Path | None, typer.Option("--baseline", metavar="FILE", help="Fail where something is worse than in this file.")
]
SaveBaseline = Annotated[
    Path | None, typer.Option("--save-baseline", metavar="FILE", help="Write the scores, to compare later ones with.")
]
Allow = Annotated[
    float, typer.Option("--allow", metavar="POINTS", min=0.0, help="What may get worse: points of Q, percent of times.")
]
AllowMissing = Annotated[
    bool, typer.Option("--allow-missing", help="Pass though the baseline has workspaces or tasks that are gone.")
]
Junit = Annotated[Path | None, typer.Option("--junit", metavar="FILE", help="Write a JUnit file for a CI server.")]
Summary = Annotated[Path | None, typer.Option("--summary", metavar="FILE", help="Write a Markdown summary.")]
Out = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Keep results here as they finish; those there are used.")
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Say that --out is that of an interrupted run, to go on with it.")
]
Cluster = Annotated[
    str | None,
    typer.Option(
        "--cluster", metavar="ADDRESS", help="Compute on this Dask cluster: tcp://HOST:PORT or scheduler file."
    ),
]
Vary = Annotated[
    list[str] | None,
    typer.Option("--vary", metavar="PATH=FROM:TO:N", help="Score variants of a workspace, and name the best."),
]
Draws = Annotated[
    int | None,
    typer.Option("--draws", metavar="N", min=1, max=10_000, help="With --vary: so many at random, not a grid."),
]
Patch = Annotated[
    Path | None,
    typer.Option(
        "--patch", metavar="FILE", help="With --vary: where the best variant goes; NAME-best.patch by default."
    ),
]


class Patches(NamedTuple):
    """The patches that a command writes."""

    mark: str
    """How they begin; `patch` and `git apply` skip it. Only files that begin so are overwritten."""
    whose: str
    """As messages call them."""

    def check(self, path: Path) -> None:
        """Raises InputError for a file that cannot be written, or that exists and is no such patch."""
        from sqrp_cli.platform.files import check_writable

        check_writable(path)
        check_own(path, self.mark, f"patch {self.whose}", "choose another name: --patch FILE")

    def write(self, path: Path, patch: str) -> None:
        """Write one."""
        from sqrp_cli.platform.files import write_atomically

        write_atomically(path, f"{self.mark}\n{patch}")


def check_own(path: Path, mark: str, what: str, mend: str = "choose another name") -> None:
    """Raises InputError for a file that exists and does not begin with a mark, so that it is no `what` of ours."""
    if path.is_file():
        with path.open("rb") as file:
            own = file.read(len(mark)) == mark.encode()
        if not own:
            message = f"this file is there already and is no {what}; it was left as it is"
            raise InputError(Problem("would-overwrite", message, Place(path), mend=mend))


def open_with_warnings(path: Path, seed: int = 0) -> OpenCell:
    """Open a workspace and print its warnings. Raises InputError where `sqrp check` finds errors in it."""
    cell = OpenCell.read(path, seed)
    keep_all_so_far()
    _print_warnings(cell)
    return cell


def open_to_write(
    workspace: Path,
    seed: int,
    read: Iterable[Path | None],
    *,
    report: Path | None,
    patch: Path | None = None,
    patches: Patches | None = None,
) -> OpenCell:
    """As `open_with_warnings`; raises InputError, before anything is computed, for files that cannot be written, too.

    read: other files that the command reads. report, patch: the files that it writes. patches: what the patch is.
    """
    from sqrp_cli.platform.files import check_distinct, check_not_read

    check_distinct({"--patch": patch, "--report": report})
    if patch is not None and patches is not None:
        patches.check(patch)
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([patch, report], [*read, *(file.path for file in cell.workspace.files.values())])
    return cell


def read_program(path: Path, seed: int = 0) -> OpenProgram:
    """Read a program that may no longer fit its workspace, and print the warnings about that."""
    program = OpenProgram.read(path, seed)
    keep_all_so_far()
    _print_warnings(program.cell)
    return program


def program_with_warnings(path: Path, seed: int = 0) -> OpenProgram:
    """Open a program and print the warnings about its workspace. Raises InputError where it cannot be run."""
    program = read_program(path, seed)
    program.check()
    return program


def check_needed(what: str, there: object, about: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that are about something which is not there, such as `--vary`."""
    for name, value in about.items():
        if _is_given(value) and not _is_given(there):
            raise bad_option(f"{name} is about {what}, which is missing")


def check_excluded(option: str, others: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that exclude one which is given."""
    for name, value in others.items():
        if _is_given(value):
            raise bad_option(f"{option} and {name} exclude each other; give one of them")


def _is_given(value: object) -> bool:
    return value is not None and value is not False and value not in ("", [], {})


def check_report(path: Path) -> None:
    """Raises InputError, before anything is computed, where a page cannot be written or a library is missing."""
    from sqrp_cli.platform.files import check_writable
    from sqrp_cli.report.pages.assembly import check_libraries

    check_writable(path)
    check_libraries()


def answer(result: Answer[AnyDocument], *, as_json: bool) -> None:
    """Print a result, for people or as a document."""
    from sqrp_cli.cli.watch import is_shown_again
    from sqrp_cli.terminal.console import say_raw

    if as_json:
        say_raw(result.to_json())
    elif not is_shown_again(result):
        result.show()


def _print_warnings(cell: OpenCell) -> None:
    """Raises InputError with the errors, if there are any."""
    from sqrp_cli.terminal.console import print_problems

    print_problems(problem for problem in cell.findings if problem.severity != "error")
    if cell.errors:
        raise InputError(*cell.errors)


def read_sampling(samples: int | None, dt: str | None, tolerance: float | None) -> Sampling:
    """The sampling of the options. Raises InputError for contradictory or senseless values."""
    from sqrp_cli.knowledge.text.units import TIME, expected_quantity, read_quantity
    from sqrp_cli.programming.coverage.sampling import Adaptive, FixedCount, FixedStep

    if samples is not None:
        check_excluded("--samples", {"--dt": dt, "--tolerance": tolerance})
    if dt is not None:
        check_excluded("--dt", {"--tolerance": tolerance})
    if samples is not None:
        if not 2 <= samples <= MOST_SAMPLES:
            raise bad_option(f"--samples is {samples}, expected 2 to {MOST_SAMPLES:,} per primitive action")
        return FixedCount(samples)
    if dt is not None:
        quantity = read_quantity(dt)
        if quantity is None or quantity.dimension not in (None, TIME):
            raise bad_option(f"--dt is `{dt}`, expected {expected_quantity(TIME)}")
        if quantity.value < LEAST_STEP:
            raise bad_option(f"--dt is {quantity.value:g} s, expected at least {LEAST_STEP:g} s")
        return FixedStep(quantity.value)
    if tolerance is not None:
        if not (math.isfinite(tolerance) and 100 * LEAST_TOLERANCE <= tolerance <= 100):
            raise bad_option(f"--tolerance is {tolerance:g}, expected {100 * LEAST_TOLERANCE:g} to 100 points")
        return Adaptive(tolerance / 100)
    return Adaptive()


def read_share(text: str, option: str, least: float) -> float:
    """A share, such as `97%` or `0.97`. Raises InputError for less than the least one, more than 1, and no share."""
    from sqrp_cli.knowledge.text.units import SHARE, read_quantity

    found = read_quantity(text)
    if found is None or found.dimension not in (None, SHARE) or not least <= found.value <= 1.0:
        raise bad_option(f"{option} is `{text}`, expected {100 * least:g}% to 100%")
    return found.value


def read_calibration(text: str | None, seed: int) -> Calibration | None:
    """Standard deviations of camera poses, such as `5 mm, 0.5 deg`; either may be left out."""
    from sqrp_cli.programming.coverage.robustness import Calibration

    return None if text is None else Calibration(*_pose_errors(text, "--calibration", "5 mm, 0.5 deg"), seed)


def _pose_errors(text: str, option: str, example: str) -> tuple[float, float]:
    """A length [m] and an angle [rad], each with its unit; either may be left out."""
    from sqrp_cli.knowledge.text.units import ANGLE, LENGTH, read_quantity

    found: dict[Dimension, float] = {}
    for part in (one.strip() for one in text.split(",")):
        quantity = read_quantity(part)
        wrong = _wrong_error(part, quantity, found)
        if wrong or quantity is None or quantity.dimension is None:
            raise bad_option(f"{option}: `{part}` {wrong}; try `{example}`")
        found[quantity.dimension] = quantity.value
    return found.get(LENGTH, 0.0), found.get(ANGLE, 0.0)


def _wrong_error(part: str, quantity: Quantity | None, before: Collection[Dimension]) -> str:
    """What is wrong with one of the numbers of `_pose_errors`, after those before it; empty if nothing is."""
    from sqrp_cli.knowledge.text.units import ANGLE, LENGTH, read_quantity

    if quantity is None:
        numbers = re.split(r"\s+(?=[-+.\d])", part)
        return "lacks a comma" if len(numbers) == 2 and all(map(read_quantity, numbers)) else "is no length or angle"
    if quantity.dimension is None:
        return "has no unit"
    if quantity.dimension not in (LENGTH, ANGLE):
        return "is no length or angle"
    if quantity.dimension in before:
        return f"is {quantity.dimension.name} once more"
    if quantity.value < 0:
        return "is negative"
    return f"is not up to 1 {'m' if quantity.dimension is LENGTH else 'rad'}" if quantity.value > 1 else ""


class WaysRead(NamedTuple):
    """What `--ways` says."""

    wanted: WaysOption
    """By which way each candidate counts."""
    all_shown: bool
    """Whether the other Pareto-optimal ways are shown, too."""


def read_ways(text: str, known: Sequence[str] = ("best", "all", "fastest")) -> WaysRead:
    """The value of `--ways`. known: the values that the command has. Raises InputError for another one."""
    if text not in known:
        raise bad_option(f"--ways is `{text}`; {expected_names(text, known)}")
    return WaysRead(next((way for way in WAYS if way == text), "best"), text == "all")


def page_is_written(file: Path, write: Callable[..., None], arguments: Sequence[str], jobs: int) -> bool:
    """Write a page, and say where it is; returns False if Ctrl-C came first.

    write: takes the file; arguments: of the command, which the page shows; jobs: processes to use at most.
    """
    from sqrp_cli.terminal.console import note, progress

    try:
        write(file, arguments=arguments, jobs=jobs, progress=progress)
    except KeyboardInterrupt:
        note(f"interrupted before {file} was written")
        return False
    note(f"open {file} in a browser")
    return True


def check_max_time(text: str | None) -> None:
    """Raises InputError for a text that is no limit of time."""
    from sqrp_cli.programming.ways.find import TimeLimit

    if text is not None:
        TimeLimit.read(text)


def note_late(text: str) -> None:
    """Print a line about what a run waits for; loads the console only then."""
    from sqrp_cli.terminal.console import note

    note(text)


def job_count(jobs: int | None) -> int:
    """Processes to use at most."""
    return jobs or os.cpu_count() or 1
