"""`sqrp score`: every task of many workspaces, with thresholds and a baseline; or variants of one of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sqrp_cli.api.results import Scores
from sqrp_cli.cli import options as option
from sqrp_cli.cli.options import Patches, answer, job_count, note_late, read_sampling
from sqrp_cli.cli.watch import Watch, watched
from sqrp_cli.errors import ExitCode, InputError, bad_option
from sqrp_cli.platform.files import check_distinct, check_not_read, check_writable
from sqrp_cli.report.documents.document import as_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.api.scores import ScoreRun
    from sqrp_cli.scoring.scorecard import Expected, Scorecard
    from sqrp_cli.scoring.sweep import Sweep
    from sqrp_cli.scoring.work.compute import Means

NAME = "score"

PATCHES = Patches("# The best variant that `sqrp score --vary` found", "that --vary wrote")


@dataclass(frozen=True)
class Outputs:
    """Files to write."""

    junit: Path | None
    summary: Path | None
    baseline: Path | None
    report: Path | None

    @property
    def paths(self) -> tuple[Path, ...]:
        """All of them."""
        return tuple(path for path in (self.junit, self.summary, self.baseline, self.report) if path is not None)

    def check(self) -> None:
        """Raises InputError before anything is computed if one of them cannot be written, or two are the same."""
        options = ("--junit", "--summary", "--save-baseline", "--report")
        check_distinct(dict(zip(options, (self.junit, self.summary, self.baseline, self.report), strict=True)))
        for path in self.paths:
            check_writable(path)
        if self.report is not None:
            option.check_report(self.report)


def command(
    context: typer.Context,
    paths: option.Paths,
    baseline: option.Baseline = None,
    save_baseline: option.SaveBaseline = None,
    allow: option.Allow = option.DEFAULT_ALLOWANCE,
    allow_missing: option.AllowMissing = False,
    junit: option.Junit = None,
    summary: option.Summary = None,
    report: option.Report = None,
    out: option.Out = None,
    resume: option.Resume = False,
    cluster: option.Cluster = None,
    vary: option.Vary = None,
    draws: option.Draws = None,
    patch: option.Patch = None,
    seed: option.Seed = 0,
    samples: option.SampleCount = None,
    dt: option.SampleStep = None,
    tolerance: option.Tolerance = None,
    jobs: option.Jobs = None,
    watch: Watch = False,
    as_json: option.Json = False,
) -> ExitCode:
    """Score all tasks of many workspaces.

    Each task's best candidate is compared with the thresholds in its workspace, and with a baseline.
    """
    from sqrp_cli.scoring.work.cluster import connected

    if watch:
        return watched(context, {"--json": as_json, "--vary": vary, "--save-baseline": save_baseline})
    if resume and out is None:
        mend = "name the folder of the interrupted run: --out DIR --resume"
        raise bad_option("--resume needs the folder with the results", mend=mend)
    option.check_needed("--vary", vary, {"--draws": draws, "--patch": patch})
    option.check_needed("--baseline", baseline, {"--allow-missing": allow_missing})
    outputs = Outputs(junit, summary, save_baseline, report)
    if vary and (baseline is not None or outputs.paths):
        raise bad_option("--vary goes without baselines and reports")
    outputs.check()
    with connected(cluster, note_late) as workers:
        from sqrp_cli.scoring.work.compute import Means

        means = Means(read_sampling(samples, dt, tolerance), job_count(jobs), workers, out, seed)
        if vary:
            return _vary(paths, vary, draws, patch, means, as_json=as_json)
        from sqrp_cli.scoring.baselines.baseline import load_baseline
        from sqrp_cli.scoring.scorecard import Expected

        check_not_read(outputs.paths, [baseline])
        known = None if baseline is None else load_baseline(baseline, means.sampling)
        expected = None if known is None else Expected(known, allow, may_vanish=allow_missing)
        return _score(paths, expected, outputs, means, context.obj, as_json=as_json)


def _score(
    paths: Sequence[str],
    expected: Expected | None,
    outputs: Outputs,
    means: Means,
    arguments: Sequence[str],
    *,
    as_json: bool,
) -> ExitCode:
    """Score all, compare with the baseline, write the requested files and print; arguments: of the command.

    Raises InputError for unusable paths, folders and files, and if nothing at all can be scored. Otherwise prints what
    could be scored, and the rest as errors.
    """
    from sqrp_cli.api.scores import ScoreRun, nothing_scored, why_not_scored
    from sqrp_cli.terminal.console import note, progress

    findings = None
    try:
        with ScoreRun.open(paths, outputs.paths, means, progress) as run:
            findings = _findings(run)
            if expected is not None and not findings.interrupted:
                findings = run.compare(findings, expected)
                if findings.interrupted:
                    note("interrupted before everything was compared with the baseline")
            if not findings.interrupted:
                run.write(findings, junit=outputs.junit, summary=outputs.summary, baseline=outputs.baseline)
        if outputs.report is not None and findings.results and not findings.interrupted:
            _write_page(run, findings, means, outputs.report, arguments)
    except KeyboardInterrupt:
        if findings is None:
            raise
        note("interrupted before all files were written")
        findings = replace(findings, interrupted=True)
    except InputError:  # a file that cannot be written takes nothing from what was scored
        if findings is not None and not nothing_scored(findings):
            show(Scores(findings), as_json=as_json)
        raise
    if nothing_scored(findings):
        raise InputError(*why_not_scored(findings))
    return show(Scores(findings), as_json=as_json)


def _findings(run: ScoreRun) -> Scorecard:
    """Score; prints warnings on the way."""
    from sqrp_cli.terminal.console import note, print_problems

    for cell in run.cells:
        print_problems(problem for problem in cell.problems if problem.severity == "warning")
        if cell.workspace is not None and not cell.tasks:
            note(f"{cell.name} lists no tasks")
    findings = run.score()
    print_problems(run.doubts)
    note(run.count(interrupted=findings.interrupted))
    return findings


def _write_page(run: ScoreRun, findings: Scorecard, means: Means, page: Path, arguments: Sequence[str]) -> None:
    from sqrp_cli.report.pages.candidate_page import write_scores
    from sqrp_cli.terminal.console import note, progress

    write_scores(run.cells, findings, means, page, arguments=arguments, progress=progress)
    note(f"open {page} in a browser")


def show(scores: Scores, *, as_json: bool) -> ExitCode:
    """Print the findings; returns their exit code."""
    answer(scores, as_json=as_json)
    return _code(scores.findings)


def _code(findings: Scorecard) -> ExitCode:
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    if findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE


def _vary(
    paths: Sequence[str], texts: Sequence[str], draws: int | None, wanted: Path | None, means: Means, *, as_json: bool
) -> ExitCode:
    """Score variants, print them and write the best as a patch. wanted: its file; None: NAME-best.patch."""
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.scoring.score import find_workspaces, short_names, wanted_of
    from sqrp_cli.scoring.sweep import grid_shape, read_variants, read_variation, sweep, variants
    from sqrp_cli.scoring.work.compute import open_computer
    from sqrp_cli.terminal.console import note, print_problems, progress

    variations = [read_variation(text) for text in texts]
    values = variants(variations, draws, means.seed)
    files = find_workspaces(paths)
    if len(files) > 1:
        names = ", ".join(f"`{name}`" for name in short_names(files).values())
        raise bad_option(f"--vary is about one workspace, found {names}")
    name = short_names(files)[files[0]]
    patch = wanted or Path(f"{name}-best.patch")
    PATCHES.check(patch)
    with progress("Reading variants", len(values) + 1) as advance:
        document, read = read_variants(files[0], values, advance)
    with open_computer(means) as computer:
        found = sweep(document, read, grid_shape(variations, draws), computer, progress)
        wants = [want for variant in read for want in wanted_of(variant.cell)]
        assessments = [outcome.assessment for outcome in map(computer.outcome, wants) if outcome is not None]
    print_problems(problem for problem in read[0].cell.problems if problem.severity == "warning")
    print_problems(intervals_outside(assessments))
    if not found.interrupted:
        return _show_sweep(found, name, patch, as_json=as_json)
    count = len(read)
    note(f"interrupted before all {count} variants were scored, so none is named the best and no patch is written")
    return ExitCode.INTERRUPTED


def _show_sweep(found: Sweep, name: str, patch: Path, *, as_json: bool) -> ExitCode:
    """Print the variants of a workspace and write the best as a patch; returns its exit code."""
    from sqrp_cli.api.scores import nothing_scored, why_not_scored
    from sqrp_cli.report.documents.scores import VaryDocument
    from sqrp_cli.terminal.console import say_raw
    from sqrp_cli.terminal.score_table import print_sweep

    each = [variant.findings for variant in found.variants]
    if nothing_scored(*each):
        raise InputError(*why_not_scored(*each))
    if found.patch:
        PATCHES.write(patch, found.patch)
    if as_json:
        say_raw(as_text(VaryDocument.of(found, name, str(patch) if found.patch else None)))
    else:
        print_sweep(found, patch)
    return _code(found.best.findings)
