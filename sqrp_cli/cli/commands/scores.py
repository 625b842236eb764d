"""Many tasks at once: `score`, which also compares variants of a workspace, and `diff` of two versions of one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.options import answer, check_excluded, check_needed, check_outputs, page_is_written, write_patch
from sqrp_cli.cli.watch import watched
from sqrp_cli.errors import ExitCode, InputError, Problem, bad_option
from sqrp_cli.platform.files import check_not_read

if TYPE_CHECKING:
    from sqrp_cli.score.compute import Computer, Means
    from sqrp_cli.score.result import Scorecard
    from sqrp_cli.score.score import ScoredCell


ALLOW: Any = option(
    "--allow POINTS", "What may get worse: points of Q, percent of times.", values.number(0.0), default=0.5
)


@command("score", requests.ScoreRequest)
def _score(
    ask: requests.ScoreRequest,
    *,
    paths: Sequence[str] = argument(
        "PATH...", "Workspaces, folders of workspaces, or patterns such as 'cells/*'.", values.texts("paths")
    ),
    baseline: Path | None = option("--baseline FILE", "Fail where something is worse than in this file.", values.path),
    save_baseline: Path | None = option(
        "--save-baseline FILE", "Write the scores, to compare later ones with.", values.path
    ),
    allow: float = ALLOW,
    allow_missing: bool = flag("--allow-missing", "Pass though the baseline has workspaces or tasks that are gone."),
    junit: Path | None = option("--junit FILE", "Write a JUnit file for a CI server.", values.path),
    summary: Path | None = option("--summary FILE", "Write a Markdown summary.", values.path),
    resume: bool = flag("--resume", "Say that --out is that of an interrupted run, to go on with it."),
    vary: Sequence[str] = option(
        "--vary PATH=FROM:TO:N",
        "Score variants of a workspace, and name the best.",
        values.texts("values by their paths"),
        default=(),
    ),
    draws: int | None = option("--draws", "With --vary: so many at random, not a grid.", values.count(1, 10_000)),
    patch: Path | None = option(
        "--patch FILE", "With --vary: where the best variant goes; NAME-best.patch by default.", values.path
    ),
    report: Path | None = requests.REPORT,
    cluster: str | None = requests.CLUSTER,
    tls: requests.Certificates | None = requests.TLS,
    watch: bool = requests.WATCH,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    """Score all tasks of many workspaces.

    Each task's best candidate is compared with the thresholds in its workspace, and with a baseline.
    """
    from sqrp_cli.score.cluster import connected
    from sqrp_cli.show.terminal.console import note

    outputs = {"--junit": junit, "--summary": summary, "--save-baseline": save_baseline, "--report": report}
    if watch:
        return watched({"--json": json, "--vary": vary, "--save-baseline": save_baseline})
    if resume and ask.out is None:
        mend = "name the folder of the interrupted run: --out DIR --resume"
        raise bad_option("--resume needs the folder with the results", mend=mend)
    check_needed("--vary", vary, {"--draws": draws, "--patch": patch})
    check_needed("--baseline", baseline, {"--allow-missing": allow_missing})
    check_excluded("--vary", vary, {"--baseline": baseline, **outputs})
    check_outputs(outputs)
    with connected(cluster, note, tls) as workers:
        means = ask.means(seed, workers)
        if vary:
            return _vary(paths, vary, draws, patch, means, as_json=json)
        check_not_read(outputs.values(), [baseline])
        compare = None
        if baseline is not None:
            from sqrp_cli.score.baseline import Baseline
            from sqrp_cli.score.comparison import compare_with

            known = Baseline.load(baseline, means.sampling)
            compare = partial(compare_with, known, allowance=allow, may_vanish=allow_missing)
        return _scored(paths, outputs, compare, means, as_json=json)


def _scored(
    paths: Sequence[str],
    outputs: Mapping[str, Path | None],
    compare: Callable[..., Scorecard] | None,
    means: Means,
    *,
    as_json: bool,
) -> ExitCode:
    """Score all, compare with the baseline if there is one, write the requested files and print."""
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.score.compute import open_computer
    from sqrp_cli.score.kept import Outcome
    from sqrp_cli.score.score import ScoredCell, find_workspaces, read_cell, score_cells, short_names
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    files, report = find_workspaces(paths), outputs["--report"]
    check_not_read(outputs.values(), files)
    findings, cells, doing = None, list[ScoredCell](), "all files were written"
    try:
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for file, name in short_names(files).items():
                    cell = read_cell(file, name)
                    known = {} if cell.workspace is None else cell.workspace.files
                    check_not_read(outputs.values(), [one.path for one in known.values()])
                    cells.append(cell)
                    advance(1)
            for cell in cells:
                print_problems(problem for problem in cell.problems if problem.severity == "warning")
                if cell.workspace is not None and not cell.tasks:
                    note(f"{cell.name} lists no tasks")
            findings = score_cells(cells, computer, progress)
            for cell in cells:
                outcomes = map(computer.outcome, cell.requests)
                print_problems(intervals_outside(one.result for one in outcomes if isinstance(one, Outcome)))
            total, failed = sum(len(cell.requests) for cell in cells), computer.failed
            counted = [f"{computer.computed} of {total} candidates were computed"]
            counted += [f"{failed} could not be"] if failed else []
            if findings.interrupted:
                counted.append("then interrupted")
            elif computer.computed + failed < total:
                counted.append("the others were known")
            note(", ".join(counted))
            if compare is not None and not findings.interrupted:
                doing = "everything was compared with the baseline"
                findings = compare(findings, cells, computer, progress)
                doing = "all files were written"
            if not findings.interrupted:
                _write(findings, cells, computer, outputs)
        if report is not None and findings.results and not findings.interrupted:
            from sqrp_cli.show.pages.candidate_page import write_scores

            if not page_is_written(report, partial(write_scores, cells, findings, means), progress=progress):
                findings = replace(findings, interrupted=True, unfinished=findings.unfinished or 0)
    except KeyboardInterrupt:
        if findings is None:
            raise
        note(f"interrupted before {doing}")
        findings = replace(findings, interrupted=True, unfinished=findings.unfinished or 0)
    except InputError:  # a file that cannot be written takes nothing from what was scored
        if findings is not None and not _why_nothing(findings):
            answer(findings, as_json=as_json)
        raise
    if why := _why_nothing(findings):
        raise InputError(*why)
    answer(findings, as_json=as_json)
    return _exit_code(findings)


def _write(
    findings: Scorecard, cells: Sequence[ScoredCell], computer: Computer, outputs: Mapping[str, Path | None]
) -> None:
    """Write the requested files. Raises InputError for one that cannot be written."""
    from sqrp_cli.score.baseline import Baseline
    from sqrp_cli.score.ci_files import write_junit, write_summary
    from sqrp_cli.score.comparison import look_up
    from sqrp_cli.show.terminal.console import progress

    if (junit := outputs["--junit"]) is not None:
        write_junit(findings, junit)
    if (summary := outputs["--summary"]) is not None:
        write_summary(findings, summary)
    if (file := outputs["--save-baseline"]) is not None:
        scores = findings.results
        look_up(((score, way) for score in scores for way in score.ways.values()), computer, progress)
        Baseline.of(cells, scores, computer).save(file)


def _exit_code(findings: Scorecard) -> ExitCode:
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    if findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE


def _why_nothing(*found: Scorecard) -> list[Problem]:
    """The reasons, each once, where every task or workspace is an error, so that there is nothing to print."""
    scores = [one for findings in found for one in findings.results]
    if any(one.status != "error" for one in scores) or any(findings.interrupted for findings in found):
        return []
    return [Problem("not-scored", why) for why in dict.fromkeys(reason for one in scores for reason in one.reasons)]


def _vary(
    paths: Sequence[str], vary: Sequence[str], draws: int | None, patch: Path | None, means: Means, *, as_json: bool
) -> ExitCode:
    """Score variants, print them and write the best as a patch."""
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.score.compute import open_computer
    from sqrp_cli.score.kept import Outcome
    from sqrp_cli.score.score import find_workspaces, short_names
    from sqrp_cli.score.sweep import read_variants, read_variation, sweep, variants
    from sqrp_cli.show.terminal.console import note, print_problems, progress

    variations = [read_variation(text) for text in vary]
    drawn = variants(variations, draws, means.seed)
    files = find_workspaces(paths)
    if len(files) > 1:
        names = ", ".join(f"`{name}`" for name in short_names(files).values())
        raise bad_option(f"--vary is about one workspace, found {names}")
    name = short_names(files)[files[0]]
    patch = patch or Path(f"{name}-best.patch")
    check_outputs({"--patch": patch})
    with progress("Reading variants", len(drawn) + 1) as advance:
        document, read = read_variants(files[0], drawn, advance)
    with open_computer(means) as computer:
        shape = None if draws is not None else tuple(variation.count or 1 for variation in variations)
        found = sweep(document, read, shape, computer, progress)
        asked = [one for *_, cell in read for one in cell.requests]
        results = [one.result for one in map(computer.outcome, asked) if isinstance(one, Outcome)]
    print_problems(problem for problem in read[0][2].problems if problem.severity == "warning")
    print_problems(intervals_outside(results))
    if found.interrupted:
        what = f"all {len(read)} variants were scored, so none is named the best and no patch is written"
        note(f"interrupted before {what}")
        return ExitCode.INTERRUPTED
    if why := _why_nothing(*(variant.findings for variant in found.variants)):
        raise InputError(*why)
    if content := found.best_patch:
        write_patch(patch, "The best variant that `sqrp score --vary` found", content)
        found = replace(found, patch=str(patch))
    answer(replace(found, workspace=name), as_json=as_json)
    return _exit_code(found.variants[0].findings)


@command("diff", requests.ScoreRequest)
def _diff(
    ask: requests.ScoreRequest,
    *,
    before: Path = argument("A", "A workspace as it was.", values.path),
    after: Path = argument("B", "The workspace as it is now.", values.path),
    allow: float = ALLOW,
    cluster: str | None = requests.CLUSTER,
    tls: requests.Certificates | None = requests.TLS,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    """Compare two versions of a workspace.

    Show what differs, field by field, and which camera therefore no longer sees which fact, and when.
    """
    from sqrp_cli.score.cluster import connected
    from sqrp_cli.show.terminal.console import note

    with connected(cluster, note, tls) as workers:
        from sqrp_cli.score.comparison import compare_versions, read_version
        from sqrp_cli.score.compute import open_computer
        from sqrp_cli.score.result import Scorecard
        from sqrp_cli.show.terminal.console import progress

        means = ask.means(seed, workers)
        old, new = read_version(before), read_version(after)
        content = [
            one.workspace and {role: of.digest for role, of in one.workspace.files.items()} for one in (old, new)
        ]
        if not json and content[0] and content[0] == content[1]:  # nothing can differ, not even what is computed
            findings = Scorecard(document="diff", results=())
        else:
            with open_computer(means) as computer:
                findings = compare_versions(old, new, computer, allow, progress)
        errors = tuple(one for one in findings.results if one.status == "error")
        if why := _why_nothing(replace(findings, results=errors)):
            raise InputError(*why)
        answer(findings, as_json=json)
        return _exit_code(findings)
