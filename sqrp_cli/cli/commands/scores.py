"""Many tasks at once: `score`, which also compares variants of a workspace, and `diff` of two versions of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import Command, argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.options import Patches, answer, check_needed, check_own, check_report, note_late, page_is_written
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode, InputError, Problem, bad_option
from sqrp_cli.platform.files import check_distinct, check_not_read, check_writable
from sqrp_cli.platform.memory import keep_all_so_far

if TYPE_CHECKING:
    from sqrp_cli.score.baseline import Baseline
    from sqrp_cli.score.compute import Computer, Means
    from sqrp_cli.score.result import Scorecard
    from sqrp_cli.score.score import ScoredCell

PATCHES = Patches("# The best variant that `sqrp score --vary` found", "that --vary wrote")

_OURS = {
    "--save-baseline": ('{\n "format": "sqrp baseline 1"', "baseline"),
    "--junit": ('<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name="sqrp score"', "JUnit file of `sqrp score`"),
    "--summary": ("## SQRP: ", "summary of `sqrp score`"),
}
"""How each file that is written begins, and what it is called: no other one is overwritten."""

ALLOW = "What may get worse: points of Q, percent of times."
ALLOWANCE = 0.5  # changes for the worse that are no regression yet: points of Q, percent of times


class _Score(
    requests.ScoreRequest,
    requests.Paged,
    requests.Clustered,
    requests.Watchable,
    requests.Seeded,
    requests.Printed,
    Command,
):
    """Score all tasks of many workspaces.

    Each task's best candidate is compared with the thresholds in its workspace, and with a baseline.
    """

    paths: Sequence[str] = argument(
        "PATH...", "Workspaces, folders of workspaces, or patterns such as 'cells/*'.", values.texts("paths")
    )
    baseline: Path | None = option(
        "--baseline FILE", "Fail where something is worse than in this file.", values.path, default=None
    )
    save_baseline: Path | None = option(
        "--save-baseline FILE", "Write the scores, to compare later ones with.", values.path, default=None
    )
    allow: float = option("--allow POINTS", ALLOW, values.number(0.0), default=ALLOWANCE)
    allow_missing: bool = flag("--allow-missing", "Pass though the baseline has workspaces or tasks that are gone.")
    junit: Path | None = option("--junit FILE", "Write a JUnit file for a CI server.", values.path, default=None)
    summary: Path | None = option("--summary FILE", "Write a Markdown summary.", values.path, default=None)
    resume: bool = flag("--resume", "Say that --out is that of an interrupted run, to go on with it.")
    vary: Sequence[str] = option(
        "--vary PATH=FROM:TO:N",
        "Score variants of a workspace, and name the best.",
        values.texts("values by their paths"),
        default=(),
    )
    draws: int | None = option(
        "--draws", "With --vary: so many at random, not a grid.", values.count(1, 10_000), default=None
    )
    patch: Path | None = option(
        "--patch FILE",
        "With --vary: where the best variant goes; NAME-best.patch by default.",
        values.path,
        default=None,
    )

    @property
    def outputs(self) -> dict[str, Path]:
        """The files to write, by their options."""
        named = {"--junit": self.junit, "--summary": self.summary, "--save-baseline": self.save_baseline}
        return {name: path for name, path in (named | {"--report": self.report}).items() if path is not None}


@command("score", _Score)
def score(ask: _Score) -> ExitCode:
    """Score all, or variants of one, once the options agree and the outputs can be written."""
    from sqrp_cli.score.cluster import connected

    if ask.watch:
        return watched({"--json": ask.json, "--vary": ask.vary, "--save-baseline": ask.save_baseline})
    if ask.resume and ask.out is None:
        mend = "name the folder of the interrupted run: --out DIR --resume"
        raise bad_option("--resume needs the folder with the results", mend=mend)
    check_needed("--vary", ask.vary, {"--draws": ask.draws, "--patch": ask.patch})
    check_needed("--baseline", ask.baseline, {"--allow-missing": ask.allow_missing})
    if ask.vary and (ask.baseline is not None or ask.outputs):
        raise bad_option("--vary goes without baselines and reports")
    check_distinct(ask.outputs)
    for name, path in ask.outputs.items():
        check_writable(path)
        if name in _OURS and not (path.is_file() and not path.stat().st_size):  # a CI server makes empty ones
            check_own(path, *_OURS[name], f"choose another name: {name} FILE")
    if ask.report is not None:
        check_report(ask.report)
    with connected(ask.cluster, note_late, ask.tls) as workers:
        means = ask.means(ask.seed, workers)
        if ask.vary:
            return _vary(ask, means)
        check_not_read(ask.outputs.values(), [ask.baseline])
        known = None
        if ask.baseline is not None:
            from sqrp_cli.score.baseline import Baseline

            known = Baseline.load(ask.baseline, means.sampling)
        return _score(ask, known, means)


def _score(ask: _Score, baseline: Baseline | None, means: Means) -> ExitCode:
    """Score all, compare with the baseline, write the requested files and print.

    Raises InputError for unusable paths, folders and files, and if nothing at all can be scored. Otherwise prints what
    could be scored, and the rest as errors.
    """
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.score.compute import open_computer
    from sqrp_cli.score.score import ScoredCell, find_workspaces, read_cells, score_cells
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    outputs, files = list(ask.outputs.values()), find_workspaces(ask.paths)
    check_not_read(outputs, files)
    findings, cells = None, list[ScoredCell]()
    try:
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for cell in read_cells(files):
                    known = {} if cell.workspace is None else cell.workspace.files
                    check_not_read(outputs, [file.path for file in known.values()])
                    cells.append(cell)
                    advance(1)
            keep_all_so_far()
            for cell in cells:
                print_problems(problem for problem in cell.problems if problem.severity == "warning")
                if cell.workspace is not None and not cell.tasks:
                    note(f"{cell.name} lists no tasks")
            findings = score_cells(cells, computer, progress)
            for cell in cells:
                outcomes = filter(None, map(computer.outcome, cell.wanted))
                print_problems(intervals_outside(outcome.assessment for outcome in outcomes))
            total, failed = sum(len(cell.wanted) for cell in cells), computer.failed
            counted = [f"{computer.computed} of {total} candidates were computed"]
            counted += [f"{failed} could not be"] if failed else []
            if findings.interrupted:
                counted.append("then interrupted")
            elif computer.computed + failed < total:
                counted.append("the others were known")
            note(", ".join(counted))
            if baseline is not None and not findings.interrupted:
                from sqrp_cli.score.comparison import compare_with

                may_vanish, about = ask.allow_missing, (cells, computer, progress)
                try:
                    findings = compare_with(baseline, findings, *about, allowance=ask.allow, may_vanish=may_vanish)
                except KeyboardInterrupt:
                    findings = replace(findings, interrupted=True, unfinished=0)
                    note("interrupted before everything was compared with the baseline")
            if not findings.interrupted:
                _write(findings, cells, computer, ask)
        if ask.report is not None and findings.results and not findings.interrupted:
            from sqrp_cli.show.pages.candidate_page import write_scores

            if not page_is_written(ask.report, partial(write_scores, cells, findings, means), progress=progress):
                findings = replace(findings, interrupted=True, unfinished=findings.unfinished or 0)
    except KeyboardInterrupt:
        if findings is None:
            raise
        note("interrupted before all files were written")
        findings = replace(findings, interrupted=True, unfinished=findings.unfinished or 0)
    except InputError:  # a file that cannot be written takes nothing from what was scored
        if findings is not None and not _nothing_scored(findings):
            answer(findings, as_json=ask.json)
        raise
    if _nothing_scored(findings):
        raise InputError(*_why_not_scored(findings))
    answer(findings, as_json=ask.json)
    return _exit_code(findings)


def _write(findings: Scorecard, cells: Sequence[ScoredCell], computer: Computer, ask: _Score) -> None:
    """Write the requested files. Raises InputError for one that cannot be written."""
    from sqrp_cli.score.baseline import Baseline
    from sqrp_cli.score.ci_files import write_junit, write_summary
    from sqrp_cli.score.comparison import look_up
    from sqrp_cli.show.terminal.console import progress

    if ask.junit is not None:
        write_junit(findings, ask.junit)
    if ask.summary is not None:
        write_summary(findings, ask.summary)
    if ask.save_baseline is not None:
        scores = findings.results
        look_up(((score, way) for score in scores for way in score.ways.values()), computer, progress)
        Baseline.of(cells, scores, computer).save(ask.save_baseline)


def _exit_code(findings: Scorecard) -> ExitCode:
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    if findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE


def _nothing_scored(*found: Scorecard) -> bool:
    """Whether every task or workspace is an error, so that there is nothing to print."""
    statuses = {result.status for findings in found for result in findings.results}
    return statuses == {"error"} and not any(findings.interrupted for findings in found)


def _why_not_scored(*found: Scorecard) -> list[Problem]:
    """The reasons for tasks that could not be scored, each once."""
    scores = (one for findings in found for one in findings.results if one.status == "error")
    return [Problem("not-scored", why) for why in dict.fromkeys(reason for one in scores for reason in one.reasons)]


def _vary(ask: _Score, means: Means) -> ExitCode:
    """Score variants, print them and write the best as a patch."""
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.score.compute import open_computer
    from sqrp_cli.score.score import find_workspaces, short_names
    from sqrp_cli.score.sweep import read_variants, read_variation, sweep, variants
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    variations = [read_variation(text) for text in ask.vary]
    drawn = variants(variations, ask.draws, means.seed)
    files = find_workspaces(ask.paths)
    if len(files) > 1:
        names = ", ".join(f"`{name}`" for name in short_names(files).values())
        raise bad_option(f"--vary is about one workspace, found {names}")
    name = short_names(files)[files[0]]
    patch = ask.patch or Path(f"{name}-best.patch")
    PATCHES.check(patch)
    with progress("Reading variants", len(drawn) + 1) as advance:
        document, read = read_variants(files[0], drawn, advance)
    with open_computer(means) as computer:
        shape = None if ask.draws is not None else tuple(variation.count or 1 for variation in variations)
        found = sweep(document, read, shape, computer, progress)
        wants = [want for variant in read for want in variant.cell.wanted]
        assessments = [outcome.assessment for outcome in map(computer.outcome, wants) if outcome is not None]
    print_problems(problem for problem in read[0].cell.problems if problem.severity == "warning")
    print_problems(intervals_outside(assessments))
    if found.interrupted:
        what = f"all {len(read)} variants were scored, so none is named the best and no patch is written"
        note(f"interrupted before {what}")
        return ExitCode.INTERRUPTED
    each = [variant.findings for variant in found.variants]
    if _nothing_scored(*each):
        raise InputError(*_why_not_scored(*each))
    if content := found.best_patch:
        PATCHES.write(patch, content)
        found = replace(found, patch=str(patch))
    answer(replace(found, workspace=name), as_json=ask.json)
    return _exit_code(found.variants[0].findings)


class _Diff(requests.ScoreRequest, requests.Clustered, requests.Seeded, requests.Printed, Command):
    """Compare two versions of a workspace.

    Show what differs, field by field, and which camera therefore no longer sees which literal, and when.
    """

    before: Path = argument("A", "A workspace as it was.", values.path)
    after: Path = argument("B", "The workspace as it is now.", values.path)
    allow: float = option("--allow POINTS", ALLOW, values.number(0.0), default=ALLOWANCE)


@command("diff", _Diff)
def diff(ask: _Diff) -> ExitCode:
    """Compare, and print what differs."""
    from sqrp_cli.score.cluster import connected

    with connected(ask.cluster, note_late, ask.tls) as workers:
        from sqrp_cli.score.comparison import compare_versions, read_version
        from sqrp_cli.score.compute import open_computer
        from sqrp_cli.score.result import Scorecard
        from sqrp_cli.show.terminal.console import progress

        means = ask.means(ask.seed, workers)
        old, new = read_version(ask.before), read_version(ask.after)
        same = old.workspace and new.workspace and old.workspace.file_digest == new.workspace.file_digest
        if not ask.json and same:  # nothing can differ, not even what is computed
            findings = Scorecard(document="diff", results=())
        else:
            with open_computer(means) as computer:
                findings = compare_versions(old, new, computer, ask.allow, progress)
        if findings.count("error"):
            raise InputError(*_why_not_scored(findings))
        answer(findings, as_json=ask.json)
        return _exit_code(findings)
