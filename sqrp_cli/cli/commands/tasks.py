"""What is asked about a task: `check`, `rank`, `explain`, `advise` and `place`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.cell import OpenCell, advised, checked, explained, placed
from sqrp_cli.ask.api.program import is_program, open_program, start_of
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.completion import example_task
from sqrp_cli.cli.options import (
    answer,
    check_excluded,
    check_needed,
    check_outputs,
    open_to_write,
    open_with_warnings,
    page_is_written,
    write_patch,
)
from sqrp_cli.cli.watch import last_shown, watched
from sqrp_cli.errors import ExitCode, InputError, bad_input, bad_option, first_names

if TYPE_CHECKING:
    from sqrp_cli.ask.api.session import Session
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.search.advice_result import AdviceDocument
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.study.analysis import Analysis
    from sqrp_cli.study.result import CandidateResult, Ranking


@command("check", requests.CheckRequest)
def _check(
    ask: requests.CheckRequest,
    *,
    workspace: Path = requests.START,
    program: Path | None = option(
        "--program PROGRAM", "Append what has to be done, each step in its best way.", values.path
    ),
    watch: bool = requests.WATCH,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.terminal.console import note, print_problems, say_command, say_raw

    if watch:
        return watched({"--json": json, "--program": program})
    check_needed("a task", ask.task, {"--program": program, "--planner": ask.planner})
    try:
        workspace, after = start_of(workspace, ask.after)
        cell = OpenCell.read(workspace, seed)
        if program is None:
            found = checked(cell, ask.but(after=after))
        else:
            from sqrp_cli.ask.api.session import add_steps, chosen_steps, world_before
            from sqrp_cli.study.sampling import Adaptive

            found = checked(cell, ask.but(after=world_before(after, program), plan=True))
            if found.suggested:
                add_steps(cell.cell, chosen_steps(found.suggested), Adaptive(), program)
    except InputError as error:
        if not json:
            raise
        say_raw(Check.of(str(workspace), workspace.name, ask.task, error.problems).to_json())
        return ExitCode.BAD_INPUT
    if not json:
        print_problems(found.findings)
    answer(found, as_json=json)
    if not json and ask.task is not None and found.suggested and program is None:
        words = f"sqrp check {shlex.join([str(workspace), ask.task])} --program FILE"
        say_command("\nTo write these steps as a program:", words)
    if not found.valid:
        return ExitCode.BAD_INPUT
    if program is not None:
        if not found.suggested:
            note(f"there is nothing that could be done, so {program} was left as it was")
            return ExitCode.NONE_FEASIBLE
        note(f"{', then '.join(step.task for step in found.suggested)}: now at the end of {program}")
        return ExitCode.OK
    able = ask.task is None or any(one.feasible for one in found.candidates)
    return ExitCode.OK if able else ExitCode.NONE_FEASIBLE


@command("rank", requests.RankRequest)
def _rank(
    ask: requests.RankRequest,
    *,
    workspace: Path = requests.START,
    program: Path | None = option(
        "--program PROGRAM",
        "Write the chosen candidate as the next step of this program, or in place of its last one of the same task.",
        values.path,
    ),
    choose: str = requests.CHOOSE,
    all_rows: bool = flag("--all", "Show all candidates, also of a long ranking."),
    parquet: Path | None = option(
        "--parquet FILE",
        "Of a recording: a row per frame, camera and target, with the visible share and the cause.",
        values.path,
    ),
    report: Path | None = requests.REPORT,
    watch: bool = requests.WATCH,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.ask.api.session import Session, assess, check_choice
    from sqrp_cli.checks.cell_warnings import cell_warnings, scenes_of, swept_cameras
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.search.suggestion import with_first_steps
    from sqrp_cli.show.terminal.console import note, print_problems, say_command

    if watch:
        return watched({"--json": json, "--program": program})
    workspace, after = start_of(workspace, ask.after)
    check_outputs({"--program": program, "--report": report, "--parquet": parquet})
    if parquet is not None:
        from sqrp_cli.show.documents.frames import check_parquet, write_frames

        check_parquet()
    opened = open_to_write(workspace, seed, [program, after], {"--report": report, "--parquet": parquet})
    session = Session.begin(opened.cell, ask.but(after=after), program)
    # The table has a sentence about the last one alone; documents, pages, programs and `--watch` about others, too.
    if not json and report is None and program is None and last_shown.get() is None:
        session = replace(session, job=replace(session.job, verdicts=False))
    cell, world = session.cell, session.job.world
    print_problems(cell_warnings(cell))
    check_choice(session.task, choose)
    found: list[CandidateResult] = []
    interrupted = False
    try:
        found.extend(assess(session, ask))  # keeps those that came before an exception
    except KeyboardInterrupt:
        note(f"interrupted when {len(found)} of {len(session.task.candidates)} candidates were finished")
        interrupted = True
    if not found:
        return ExitCode.INTERRUPTED
    print_problems(intervals_outside(found))
    ranking = session.ranking(found, ask, interrupted=interrupted)
    if ranking.best is not None:
        best = [one.way for one in ranking.best.steps or (ranking.best,)]
        print_problems(swept_cameras(cell, scenes_of(cell, world, [best])))
    # Written before the output, because its reader may leave early.
    code, message = (ExitCode.INTERRUPTED, "") if interrupted else _write_chosen(session, ranking, choose, program)
    if report is not None and not interrupted:
        from sqrp_cli.show.pages.candidate_page import write_ranking

        if not page_is_written(report, partial(write_ranking, ranking), jobs=ask.jobs, progress=ask.progress):
            code = ExitCode.INTERRUPTED
    if parquet is not None and not interrupted:
        rows = write_frames(cell, world, session.task.candidates, parquet)
        note(f"{parquet} has {rows:,} rows: a frame, camera and target each")
    answer(ranking, as_json=json, all_rows=all_rows)
    if message:
        note(message)
    hopeless = not json and ranking.best is None
    if hopeless and with_first_steps(session.task, cell.workspace, world.facts) is not session.task:
        before = program if program is not None and program.exists() else after
        words = [str(workspace), ask.task, *([] if before is None else ["--after", str(before)])]
        say_command("\nTo see whether something done first helps:", f"sqrp check {shlex.join(words)}")
    return code


def _write_chosen(session: Session, found: Ranking, choose: str, program: Path | None) -> tuple[ExitCode, str]:
    """Write the chosen candidate into a program, if one is named and it can be done; gives code and message."""
    from sqrp_cli.ask.api.session import add_steps, choose_candidate, steps_of

    chosen = choose_candidate(found.candidates, choose)
    if not chosen.feasible:
        if found.best is None and program is None:
            return ExitCode.NONE_FEASIBLE, ""
        consequence = "" if program is None else f", so {program} was not written"
        infeasible = f"{chosen.name} cannot be done ({chosen.reasons[0]})"
        why = "no candidate can be done" if choose == "best" else infeasible
        return ExitCode.NONE_FEASIBLE, f"{why}{consequence}"
    if program is None:
        return ExitCode.OK, "" if choose == "best" else f"{chosen.name} is chosen; --program FILE writes it"
    steps = steps_of(session, chosen)
    add_steps(session.cell, steps, session.job.sampling, program, session.again)
    if session.anew:
        return ExitCode.OK, f"{program} was of the cell before; written anew with {chosen.name}"
    where = f"the last {f'{len(steps)} steps' if len(steps) > 1 else 'step'} of {program}"
    written = f"replaces {where}: the task is the same" if session.again else f"is now {where}"
    return ExitCode.OK, f"{chosen.name} {written}"


@command("explain", requests.ExplainRequest)
def _explain(
    ask: requests.ExplainRequest,
    *,
    workspace: Path = requests.START,
    task: str = argument("TASK", "As for rank; none for a program.", requests.TASK, default="", complete="tasks"),
    compared: bool = flag("--all", "Compare all candidates side by side."),
    images: Path | None = option(
        "--images DIR", "Write pictures of what each camera sees whenever something is not seen.", values.path
    ),
    watch: bool = requests.WATCH,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.show.documents.explanation import Explanation
    from sqrp_cli.show.terminal.console import print_problems
    from sqrp_cli.show.terminal.rank_table import print_ways

    if watch:
        return watched({"--json": json})
    check_excluded("--all", compared, {"--choose": ask.choose if ask.choose != "best" else None})
    if images is not None:
        from sqrp_cli.show.pictures.pictures import check_pictures

        check_pictures(images)
    if not task:  # a program stands where a workspace would
        from sqrp_cli.files.input_file import missing_file

        if not workspace.exists():
            raise InputError(missing_file(workspace))
        if not is_program(workspace):
            message = f"{workspace} is no program, so a task is missing"
            mend = shlex.join(["sqrp", "explain", str(workspace), example_task(workspace) or "TASK"])
            raise bad_input("no-program", message, mend=mend)
        answer(open_program(workspace, seed=seed).explain(ask.step, option=ask.called("step")), as_json=json)
        return ExitCode.OK
    workspace, after = start_of(workspace, ask.after)
    cell = open_with_warnings(workspace, seed)
    found = explained(cell, ask.but(after=after, choose=None if compared else ask.choose))
    print_problems((*cell_warnings(cell.cell), *intervals_outside(found.ranking)))
    answer(found, as_json=json)
    about = [one for one in ([found.explained] if isinstance(found, Explanation) else found.explained) if one]
    if not json:
        if isinstance(found, Explanation):
            _say_more(found, cell, workspace, after, ask)
        if ask.ways == "all":
            print_ways([one.result for one in about])
    analyses = [one.analysis for one in about if one.analysis is not None]
    if images is not None:
        _write_images(cell.cell, analyses, images, several=compared)
    return ExitCode.OK if analyses else ExitCode.NONE_FEASIBLE


def _say_more(
    found: Explanation, cell: OpenCell, workspace: Path, after: Path | None, ask: requests.ExplainRequest
) -> None:
    """The command that says how much of a remedy is enough. ask: whose task the explanation may be about a step of."""
    from sqrp_cli.figures import LATE, falls_short
    from sqrp_cli.search.goal import goal_of
    from sqrp_cli.show.terminal.console import say_command

    if not found.remedy and (found.latest or 0.0) <= LATE:
        return
    lost = "q_eoi 100 %" if found.q_eoi is not None and falls_short(found.q_eoi, 1.0) else "q_avg 100 %"
    lost = lost if found.remedy else f"delay {LATE:g} s"
    listed = next((one for one in cell.workspace.tasks if one.task == ask.task), None)
    words = ["sqrp", "advise", str(workspace), ask.task]
    if listed is None or goal_of(listed).met(found):  # else advice is about the thresholds that are missed
        words += ["--want", lost]
    if found.step is not None:  # it begins where no program ends
        words += ["--choose", str(ask.choose)] if ask.choose != "best" else []
    elif len(found.ranking) > 1:
        words += ["--choose", found.name]
    words += ["--ways", "first"] if ask.ways == "first" else []
    words += ["--after", str(after)] if after is not None else []
    what = "How much of that is enough, and what it costs:" if found.remedy else "What lets faults be noticed sooner:"
    say_command(f"\n{what}", shlex.join(words))


def _write_images(cell: Cell, analyses: Sequence[Analysis], images: Path, *, several: bool) -> None:
    """Take pictures of every blind interval, in a folder per candidate if there may be several."""
    from sqrp_cli.show.pictures.pictures import MOST_PIXELS, SHEET, blind_intervals, file_name, write_pictures
    from sqrp_cli.show.terminal.console import note, progress

    cameras = cell.observer.cameras
    if large := [camera.name for camera in cameras if camera.width * camera.height > MOST_PIXELS]:
        note(f"pictures have at most {MOST_PIXELS:,} pixels; those of {first_names(large)} are smaller than its images")
    count = len(cameras) * sum(len(list(blind_intervals(one))) for one in analyses)
    with progress("Taking pictures", count) as advance:
        for analysis in analyses:
            folder = images / file_name(analysis.planned.candidate.name) if several else images
            blind = write_pictures(cell, analysis, folder, advance)
            counted = f"{blind} blind interval{'s' if blind > 1 else ''}, see {folder / SHEET}"
            note(f"{analysis.planned.candidate.name}: {counted if blind else 'never blind, so there are no pictures'}")


@command("advise", requests.AdviseRequest)
def _advise(
    ask: requests.AdviseRequest,
    *,
    workspace: Path = requests.START,
    apply: int | None = option("--apply", "Write the N-th change into the workspace; comments stay.", values.count(1)),
    patch: Path | None = option(
        "--patch FILE", "Write the first change that has one, or that of --apply, as a patch instead.", values.path
    ),
    report: Path | None = requests.REPORT,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.show.pages.search_pages import write_advice
    from sqrp_cli.show.terminal.console import note, print_problems

    workspace, after = start_of(workspace, ask.after)
    cell = open_to_write(workspace, seed, [after], {"--patch": patch, "--report": report})
    print_problems(cell_warnings(cell.cell))
    found = advised(cell, ask.but(after=after))
    page = partial(write_advice, found)
    interrupted = found.interrupted or not page_is_written(report, page, jobs=ask.jobs, progress=ask.progress)
    message = ""
    try:
        message = "" if interrupted else write_change(found, cell.path, apply, patch)
    finally:  # the search took long, and says which change can be written
        answer(found, as_json=json, written=bool(message))
    if message:
        note(message)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met or found.advice else ExitCode.NONE_FEASIBLE


def write_change(found: AdviceDocument, path: Path, number: int | None, patch: Path | None) -> str:
    """Write a change, by default the first that has a patch, into the workspace at `path`; says what was done."""
    if (number is None and patch is None) or not (found.met or found.advice):
        return ""
    if found.met and number in (None, 1):
        return f"the goal is met already, so {path if patch is None else patch} is not written"
    chosen = next((n for n, one in enumerate(found.advice, 1) if one.patch), 1) if number is None else number
    if found.patched(chosen) == found.file.content:  # refuses a number that none has
        return f"change {chosen} is in {path} already; nothing was written"
    if patch is not None:
        write_patch(patch, "A change that `sqrp advise` found", found.advice[chosen - 1].patch)
        return f"change {chosen} is in {patch}"
    found.apply(chosen)
    return f"change {chosen} is in {path} now"


@command("place", requests.PlaceRequest)
def _place(
    ask: requests.PlaceRequest,
    *,
    workspace: Path = requests.WORKSPACE,
    patches: Sequence[Path] = option(
        "--patch FILE", "Write a patch of the workspace with these cameras.", values.paths, default=()
    ),
    report: Path | None = requests.REPORT,
    cluster: str | None = requests.CLUSTER,
    tls: requests.Certificates | None = requests.TLS,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.score.cluster import connected
    from sqrp_cli.show.pages.search_pages import write_placement
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.search_tables import bounds_reporter

    if len(patches) > 1:
        named = ", ".join(map(str, patches))
        raise bad_option(f"--patch is given {len(patches)} times: {named}", mend="name one file")
    patch = patches[0] if patches else None
    cell = open_to_write(workspace, seed, [ask.mounts], {"--patch": patch, "--report": report})
    with connected(cluster, note, tls) as workers:
        found = placed(cell, ask, workers, bounds_reporter())
    if patch is not None and found.patch:
        write_patch(patch, "Cameras that `sqrp place` found", found.patch)
        note(f"the patch is in {patch}")
    page = partial(write_placement, found)
    interrupted = found.interrupted or not page_is_written(report, page, jobs=ask.jobs, progress=ask.progress)
    answer(found, as_json=json, written=patch is not None)
    if interrupted:
        return ExitCode.INTERRUPTED
    return ExitCode.OK if found.met else ExitCode.NONE_FEASIBLE
