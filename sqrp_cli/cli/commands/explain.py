"""`sqrp explain`: the coverage of a candidate over time, with the cause of every blind stretch."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.program import open_program
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import ParsedCommand, UsageError, command_of
from sqrp_cli.cli.completion import example_task
from sqrp_cli.cli.options import answer, check_excluded, open_with_warnings
from sqrp_cli.cli.start import Start
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode, InputError, Problem, first_names, nearest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.study.assessment import Study

NAME = "explain"

_WAYS = ("best", "all", "fastest")


class Parser(ParsedCommand):
    """Takes `--ways` with and without a value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # its type has no public name
        """Read the words of the command."""
        try:
            return super().parse_args(ctx, list(_with_ways(args)))
        except UsageError:
            after = args[args.index("--ways") + 1 :] if "--ways" in args else []
            if after and not after[0].startswith("-"):  # it may be a misspelt value rather than a word too much
                values.one_of(*_WAYS).read(after[0], "--ways")
            raise


def _with_ways(words: Sequence[str]) -> Iterator[str]:
    """The words of a command, with `all` after a `--ways` that no value follows, not even a misspelled one."""
    for number, word in enumerate(words, 1):
        yield word
        following = words[number] if number < len(words) else ""
        is_value = following in _WAYS or (nearest(following, _WAYS) is not None and not Path(following).exists())
        if word == "--ways" and not is_value:
            yield "all"


class ExplainCommand(
    requests.ExplainRequest, requests.Watchable, requests.Seeded, requests.Printed, requests.StartCommand
):
    """Explain how well the cameras see a way of doing a task.

    Shows when each camera sees each literal, and what is in the way when it does not.
    """

    task: str = argument("TASK", "As for rank; none for a program.", requests.TASK, default="", complete="tasks")
    ways: requests.Ways = option(
        "--ways",
        "Show the other Pareto-optimal ways, too (all; also without a value), or explain that with the fastest branch "
        "and the first yaw and side.",
        values.one_of(*_WAYS),
        default="best",
        metavar="[best|all|fastest]",
    )
    all: bool = flag("--all", "Compare all candidates side by side.")
    images: Path | None = option(
        "--images", "Write what each camera sees in each blind interval as pictures.", PATH, default=None, metavar="DIR"
    )


def explain(context: Any, ask: ExplainCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Explain a candidate, or a step of a program."""
    from sqrp_cli.ask.api.cell import explained as explain_candidates
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.show.terminal.console import print_problems, progress
    from sqrp_cli.show.terminal.rank_table import print_ways

    if ask.watch:
        return watched(context, {"--json": ask.json})
    # Raises InputError for options that exclude each other, and where no pictures can be written.
    if ask.all:
        check_excluded("--all", {"--choose": ask.choose if ask.choose != "best" else None})
    if ask.images is not None:
        from sqrp_cli.show.pictures.pictures import check_pictures

        check_pictures(ask.images)
    if not ask.task:
        return _explain_program(ask)
    workspace, after = Start.of(ask.workspace, ask.after)
    cell = open_with_warnings(workspace, ask.seed)
    found = explain_candidates(cell, ask.but(after=after, choose=None if ask.all else ask.choose, progress=progress))
    print_problems((*cell_warnings(cell.cell), *intervals_outside(found.ranking)))
    answer(found, as_json=ask.json)
    explained = [one for one in ([found.explained] if isinstance(found, Explanation) else found.explained) if one]
    if not ask.json:
        if isinstance(found, Explanation):
            _say_more(found, cell.workspace, workspace, after, ask)
        if ask.ways == "all":
            print_ways([one.result for one in explained])
    studies = [one.study for one in explained if one.study is not None]
    if ask.images is not None:
        _write_images(cell.cell, studies, ask.images, several=ask.all)
    return ExitCode.OK if studies else ExitCode.NONE_FEASIBLE


def _explain_program(ask: ExplainCommand) -> ExitCode:
    """Explain a step of a program, which stands where a workspace would."""
    from sqrp_cli.files.input_file import missing_file
    from sqrp_cli.program.file import is_program

    file = ask.workspace
    if not file.exists():
        raise InputError(missing_file(file))
    if not is_program(file):
        message = f"{file} is no program, so a task is missing"
        mend = shlex.join(["sqrp", "explain", str(file), example_task(file) or "TASK"])
        raise InputError(Problem("no-program", message, mend=mend))
    answer(open_program(file, seed=ask.seed).explain(ask.step, option=ask.called("step")), as_json=ask.json)
    return ExitCode.OK


def _say_more(found: Explanation, cell: Workspace, workspace: Path, after: Path | None, ask: ExplainCommand) -> None:
    """The command that says how much of a remedy is enough. ask: whose task the explanation may be about a step of."""
    from sqrp_cli.search.goal import goal_of
    from sqrp_cli.show.terminal.console import say_command
    from sqrp_cli.study.quality import falls_short
    from sqrp_cli.study.verdict import HELP

    if HELP not in found.verdict:
        return
    lost = "q_eoi" if found.q_eoi is not None and falls_short(found.q_eoi, 1.0) else "q_avg"
    listed = next((one for one in cell.tasks if one.task == ask.task), None)
    words = ["sqrp", "advise", str(workspace), ask.task]
    if listed is None or goal_of(listed).met(found):  # else advice is about the thresholds that are missed
        words += ["--want", f"{lost} 100 %"]
    if found.step is not None:  # it begins where no program ends
        words += ["--choose", str(ask.choose)] if ask.choose != "best" else []
    elif len(found.ranking) > 1:
        words += ["--choose", found.name]
    words += ["--ways", "fastest"] if ask.ways == "fastest" else []
    words += ["--after", str(after)] if after is not None else []
    say_command("\nHow much of that is enough, and what it costs:", shlex.join(words))


def _write_images(cell: Cell, studies: Sequence[Study], images: Path, *, several: bool) -> None:
    """Take pictures of every blind interval, in a folder per candidate if there may be several."""
    from sqrp_cli.show.pictures.pictures import MOST_PIXELS, SHEET, blind_intervals, folder_of, write_pictures
    from sqrp_cli.show.terminal.console import note, progress

    cameras = cell.observer.cameras
    if large := [camera.name for camera in cameras if camera.width * camera.height > MOST_PIXELS]:
        note(f"pictures have at most {MOST_PIXELS:,} pixels; those of {first_names(large)} are smaller than its images")
    with progress("Taking pictures", len(cameras) * sum(len(list(blind_intervals(one))) for one in studies)) as advance:
        for study in studies:
            folder = folder_of(study, images) if several else images
            blind = write_pictures(cell, study, folder, advance)
            counted = f"{blind} blind interval{'s' if blind > 1 else ''}, see {folder / SHEET}"
            note(f"{study.candidate.name}: {counted if blind else 'never blind, so there are no pictures'}")


command = command_of(ExplainCommand, explain)
