"""What is asked about a task: `check`, `rank`, `explain`, `advise` and `place`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.cell import OpenCell, advised, checked, explained, placed
from sqrp_cli.ask.api.program import Start, open_program
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import ParsedCommand, UsageError, command
from sqrp_cli.cli.completion import example_task
from sqrp_cli.cli.options import (
    Patches,
    answer,
    check_excluded,
    check_needed,
    open_to_write,
    open_with_warnings,
    page_is_written,
)
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode, InputError, Problem, bad_option, first_names, nearest

if TYPE_CHECKING:
    from sqrp_cli.ask.api.session import Session
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.search.advice_result import AdviceDocument
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.study.assessment import Analysis
    from sqrp_cli.study.result import CandidateResult, Ranking


class _Check(requests.CheckRequest, requests.Watchable, requests.Seeded, requests.Printed, requests.StartCommand):
    program: Path | None = option(
        "--program PROGRAM", "Append what has to be done, each step in its best way.", values.path, default=None
    )


@command("check", _Check)
def check(ask: _Check) -> ExitCode:
    """Check everything, and write the program if one is requested and there is something to do."""
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.terminal.console import note, print_problems, say_command, say_raw

    if ask.watch:
        return watched({"--json": ask.json, "--program": ask.program})
    check_needed("a task", ask.task, {"--program": ask.program, "--planner": ask.planner})
    workspace = ask.workspace
    try:
        workspace, after = Start.of(workspace, ask.after, ask.program)
        found = _checked(OpenCell.read(workspace, ask.seed), ask.but(after=after))
    except InputError as error:
        if not ask.json:
            raise
        say_raw(Check.of(str(workspace), workspace.name, ask.task, error.problems).to_json())
        return ExitCode.BAD_INPUT
    if not ask.json:
        print_problems(found.findings)
    answer(found, as_json=ask.json)
    if not ask.json and ask.task is not None and found.suggested and ask.program is None:
        words = f"sqrp check {shlex.join([str(workspace), ask.task])} --program FILE"
        say_command("\nTo write these steps as a program:", words)
    if not found.valid:
        return ExitCode.BAD_INPUT
    if ask.program is not None:
        if not found.suggested:
            note(f"there is nothing that could be done, so {ask.program} was left as it was")
            return ExitCode.NONE_FEASIBLE
        note(f"{', then '.join(step.task for step in found.suggested)}: now at the end of {ask.program}")
        return ExitCode.OK
    able = ask.task is None or any(one.feasible for one in found.candidates)
    return ExitCode.OK if able else ExitCode.NONE_FEASIBLE


def _checked(cell: OpenCell, ask: _Check) -> Check:
    """What is found of a task, and its steps in the program that is to have them."""
    if cell.errors or ask.task is None:
        return cell.check(ask.task)
    from sqrp_cli.ask.api.session import add_steps, chosen_steps, world_before
    from sqrp_cli.show.terminal.console import progress
    from sqrp_cli.study.sampling import Adaptive

    plan = None if ask.program is None else True
    found = checked(cell, ask.but(after=world_before(ask.after, ask.program), plan=plan, progress=progress))
    if ask.program is not None and found.suggested:
        add_steps(cell.cell, chosen_steps(found.steps), Adaptive(), ask.program)
    return found


class _Rank(
    requests.RankRequest,
    requests.Chosen,
    requests.Paged,
    requests.Watchable,
    requests.Seeded,
    requests.Printed,
    requests.StartCommand,
):
    program: Path | None = option(
        "--program PROGRAM", "Append the chosen candidate to this program file.", values.path, default=None
    )
    all: bool = flag("--all", "Show all candidates, also of a long ranking.")


@command("rank", _Rank)
def rank(ask: _Rank) -> ExitCode:
    """Assess, rank, write what is to be written, and print."""
    from sqrp_cli.ask.api.session import Session, assess, check_choice, world_before
    from sqrp_cli.checks.cell_warnings import cell_warnings, swept_cameras
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.platform.files import check_distinct
    from sqrp_cli.show.terminal.console import note, print_problems, progress, say_command
    from sqrp_cli.task.feasibility import unmet_preconditions

    if ask.watch:
        return watched({"--json": ask.json, "--program": ask.program})
    workspace, after = Start.of(ask.workspace, ask.after, ask.program)
    check_distinct({"--program": ask.program, "--report": ask.report})
    before = world_before(after, ask.program)
    opened = open_to_write(workspace, ask.seed, [ask.program, after], report=ask.report)
    session = Session.begin(opened.cell, ask.but(after=before))
    cell, world = session.cell, session.assignment.world
    print_problems(cell_warnings(cell))
    check_choice(session.task, ask.choose)
    found: list[CandidateResult] = []
    interrupted = False
    try:
        found.extend(assess(session, ask.jobs, progress))  # keeps those that came before an exception
    except KeyboardInterrupt:
        note(f"interrupted when {len(found)} of {len(session.task.candidates)} candidates were finished")
        interrupted = True
    if not found:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(found))
    ranking = session.ranking(found, ask, interrupted=interrupted)
    if ranking.best is not None:
        print_problems(swept_cameras(cell, world, (one.way for one in ranking.best.steps or (ranking.best,))))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(session, ranking, ask)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.candidate_page import write_ranking

        write = partial(write_ranking, ranking, session.assignment)
        if not page_is_written(ask.report, write, jobs=ask.jobs, progress=progress):
            code = ExitCode.INTERRUPTED
    answer(ranking, as_json=ask.json, all_rows=ask.all)
    if message:
        note(message)
    if not ask.json and ranking.best is None:
        # A candidate of one step may only wait for what other skills establish.
        alone = (one for one in session.task.candidates if not one.steps)
        if any(unmet_preconditions(cell, one, world) for one in alone):
            words = [str(workspace), ask.task, *([] if before is None else ["--after", str(before)])]
            say_command("\nTo see whether something done first helps:", f"sqrp check {shlex.join(words)}")
    return code


def _write_chosen(session: Session, found: Ranking, ask: _Rank) -> tuple[ExitCode, str]:
    """Append the chosen candidate to a program, if one was named, unless it is infeasible.

    Returns the exit code and a message.
    """
    from sqrp_cli.ask.api.session import add_steps, choose_candidate, steps_of

    chosen, program = choose_candidate(found.candidates, ask.choose), ask.program
    if not chosen.feasible:
        if found.best is None and program is None:
            return ExitCode.NONE_FEASIBLE, ""
        consequence = "" if program is None else f", so {program} was not written"
        infeasible = f"{chosen.name} is infeasible ({chosen.reasons[0]})"
        why = "no candidate can be done" if ask.choose == "best" else infeasible
        return ExitCode.NONE_FEASIBLE, f"{why}{consequence}"
    if program is None:
        return ExitCode.OK, "" if ask.choose == "best" else f"{chosen.name} is chosen; --program FILE writes it"
    steps = steps_of(session, chosen)
    add_steps(session.cell, steps, session.assignment.sampling, program)
    where = "the last step" if len(steps) == 1 else f"the last {len(steps)} steps"
    return ExitCode.OK, f"{chosen.name} is now {where} of {program}"


_WAYS = ("best", "all", "fastest")


class _WaysParser(ParsedCommand):
    """Takes `--ways` with and without a value."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # its type has no public name
        """Read the words of the command, with `all` after a `--ways` that no value follows, not even a misspelt one."""
        words: list[str] = []
        for word, following in zip(args, [*args[1:], ""], strict=False):
            words.append(word)
            is_value = following in _WAYS or (nearest(following, _WAYS) is not None and not Path(following).exists())
            if word == "--ways" and not is_value:
                words.append("all")
        try:
            return super().parse_args(ctx, words)
        except UsageError:
            after = args[args.index("--ways") + 1 :] if "--ways" in args else []
            if after and not after[0].startswith("-"):  # it may be a misspelt value rather than a word too much
                values.one_of(*_WAYS).read(after[0], "--ways")
            raise


class _Explain(requests.ExplainRequest, requests.Watchable, requests.Seeded, requests.Printed, requests.StartCommand):
    task: str = argument("TASK", "As for rank; none for a program.", requests.TASK, default="", complete="tasks")
    ways: requests.Ways = option(
        "--ways [best|all|fastest]",
        "Show the other Pareto-optimal ways, too (all; also without a value), or explain that with the fastest branch "
        "and the first yaw and side.",
        values.one_of(*_WAYS),
        default="best",
    )
    all: bool = flag("--all", "Compare all candidates side by side.")
    images: Path | None = option(
        "--images DIR", "Write what each camera sees in each blind interval as pictures.", values.path, default=None
    )


@command("explain", _Explain, _WaysParser)
def explain(ask: _Explain) -> ExitCode:
    """Explain a candidate, or a step of a program."""
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.show.terminal.console import print_problems, progress
    from sqrp_cli.show.terminal.rank_table import print_ways

    if ask.watch:
        return watched({"--json": ask.json})
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
    found = explained(cell, ask.but(after=after, choose=None if ask.all else ask.choose, progress=progress))
    print_problems((*cell_warnings(cell.cell), *intervals_outside(found.ranking)))
    answer(found, as_json=ask.json)
    about = [one for one in ([found.explained] if isinstance(found, Explanation) else found.explained) if one]
    if not ask.json:
        if isinstance(found, Explanation):
            _say_more(found, cell, workspace, after, ask)
        if ask.ways == "all":
            print_ways([one.result for one in about])
    studies = [one.study for one in about if one.study is not None]
    if ask.images is not None:
        _write_images(cell.cell, studies, ask.images, several=ask.all)
    return ExitCode.OK if studies else ExitCode.NONE_FEASIBLE


def _explain_program(ask: _Explain) -> ExitCode:
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


def _say_more(found: Explanation, cell: OpenCell, workspace: Path, after: Path | None, ask: _Explain) -> None:
    """The command that says how much of a remedy is enough. ask: whose task the explanation may be about a step of."""
    from sqrp_cli.figures import falls_short
    from sqrp_cli.search.goal import goal_of
    from sqrp_cli.show.terminal.console import say_command
    from sqrp_cli.study.verdict import without_remedy

    if without_remedy(found.verdict) == found.verdict:
        return
    lost = "q_eoi" if found.q_eoi is not None and falls_short(found.q_eoi, 1.0) else "q_avg"
    listed = next((one for one in cell.workspace.tasks if one.task == ask.task), None)
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


def _write_images(cell: Cell, studies: Sequence[Analysis], images: Path, *, several: bool) -> None:
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


ADVICE = Patches("# A change that `sqrp advise` found", "of `sqrp advise`")


class _Advise(requests.AdviseRequest, requests.Paged, requests.Seeded, requests.Printed, requests.StartCommand):
    apply: int | None = option(
        "--apply", "Write the N-th change into the workspace; comments stay.", values.count(1), default=None
    )
    patch: Path | None = option(
        "--patch FILE",
        "Write the first change that has one, or that of --apply, as a patch instead.",
        values.path,
        default=None,
    )


@command("advise", _Advise)
def advise(ask: _Advise) -> ExitCode:
    """Search, write what is to be written, and print."""
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    workspace, after = Start.of(ask.workspace, ask.after)
    cell = open_to_write(workspace, ask.seed, [after], report=ask.report, patch=ask.patch, patches=ADVICE)
    print_problems(cell_warnings(cell.cell))
    found = advised(cell, ask.but(after=after, progress=progress))
    interrupted = bool(found.interrupted)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.search_pages import write_advice

        write = partial(write_advice, found)
        interrupted = not page_is_written(ask.report, write, jobs=ask.jobs, progress=progress)
    message = ""
    try:
        message = "" if interrupted else write_change(found, cell.path, ask.apply, ask.patch)
    finally:  # the search took long, and says which change can be written
        answer(found, as_json=ask.json, written=bool(message))
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.found else ExitCode.NONE_FEASIBLE


def write_change(found: AdviceDocument, path: Path, number: int | None, patch: Path | None) -> str:
    """Write a change as it was asked for, by default the first that has a patch; returns what was done.

    path: of the workspace, as it was given.
    """
    if (number is None and patch is None) or not found.found:
        return ""
    if found.met and number in (None, 1):
        return f"the goal is met already, so {path if patch is None else patch} is not written"
    chosen = next((n for n, one in enumerate(found.advice, 1) if one.patch), 1) if number is None else number
    if found.patched(chosen) == found.session.file.content:  # refuses a number that none has
        return f"change {chosen} is in {path} already; nothing was written"
    if patch is not None:
        ADVICE.write(patch, found.advice[chosen - 1].patch)
        return f"change {chosen} is in {patch}"
    found.apply(chosen)
    return f"change {chosen} is in {path} now"


PLACEMENT = Patches("# Cameras that `sqrp place` found", "of `sqrp place`")


class _Place(
    requests.PlaceRequest, requests.Paged, requests.Clustered, requests.Seeded, requests.Printed, requests.CellCommand
):
    patch: Sequence[Path] = option(
        "--patch FILE", "Write a patch of the workspace with these cameras.", values.paths, default=()
    )


@command("place", _Place)
def place(ask: _Place) -> ExitCode:
    """Search, write what is to be written, and print."""
    from sqrp_cli.score.cluster import connected
    from sqrp_cli.show.terminal.console import note, progress
    from sqrp_cli.show.terminal.search_tables import bounds_told

    if len(ask.patch) > 1:
        named = ", ".join(map(str, ask.patch))
        raise bad_option(f"--patch is given {len(ask.patch)} times: {named}", mend="name one file")
    patch = ask.patch[0] if ask.patch else None
    cell = open_to_write(ask.workspace, ask.seed, [ask.mounts], report=ask.report, patch=patch, patches=PLACEMENT)
    with connected(ask.cluster, note, ask.tls) as workers:
        found = placed(cell, ask.but(progress=progress), workers, bounds_told())
    if patch is not None and found.patch:
        PLACEMENT.write(patch, found.patch)
        note(f"the patch is in {patch}")
    interrupted = bool(found.interrupted)
    if ask.report is not None and not interrupted:
        from sqrp_cli.show.pages.search_pages import write_placement

        write = partial(write_placement, found)
        interrupted = not page_is_written(ask.report, write, jobs=ask.jobs, progress=progress)
    answer(found, as_json=ask.json, written=patch is not None)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met else ExitCode.NONE_FEASIBLE
