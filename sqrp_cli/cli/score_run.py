"""What `sqrp score` and `sqrp diff` have in common: workspaces read, workers hired, files written, findings shown."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from sqrp_cli.checks.outside import intervals_outside
from sqrp_cli.cli.score_outputs import Outputs
from sqrp_cli.errors import ExitCode, InputError, Problem
from sqrp_cli.platform.files import check_not_read
from sqrp_cli.platform.memory import keep_all_so_far
from sqrp_cli.report.documents.document import as_text
from sqrp_cli.report.documents.scores import ScoreDocument
from sqrp_cli.scoring.baselines.baseline import Baseline, baseline_of, load_baseline, save_baseline
from sqrp_cli.scoring.baselines.findings import CoverageLookup, Findings, compare_with, score_cells
from sqrp_cli.scoring.cells import ScoredCell, read_cells
from sqrp_cli.scoring.discovery import find_workspaces
from sqrp_cli.scoring.junit import write_junit
from sqrp_cli.scoring.score import wanted_of
from sqrp_cli.scoring.summary import write_summary
from sqrp_cli.scoring.work.compute import Computer, Means, open_computer
from sqrp_cli.terminal.console import note, print_problems, progress, say_raw
from sqrp_cli.terminal.score_table import print_report


@dataclass(frozen=True)
class ScoreRequest:
    """What the command line asks for. baseline: the file to compare with. allowance: see `comparison.compare`."""

    paths: Sequence[str]
    baseline: Path | None
    allowance: float
    outputs: Outputs


def run_score(request: ScoreRequest, means: Means, arguments: Sequence[str], *, as_json: bool) -> ExitCode:
    """Score all, compare with the baseline, write the files that were asked for and print; arguments: of the command.

    Raises InputError for paths, folders and files of no use, and where nothing at all can be scored; else what could be
    is printed, with the rest in it as errors.
    """
    outputs = request.outputs
    check_not_read(outputs.paths, [request.baseline])
    baseline = None if request.baseline is None else load_baseline(request.baseline, means.sampling)
    findings = None
    try:
        with ScoreRun.open(request.paths, outputs, means) as run:
            findings = run.findings(baseline, request.allowance)
            if not findings.interrupted:
                run.write(findings, outputs)
        if outputs.report is not None and findings.results and not findings.interrupted:
            from sqrp_cli.report.pages.candidate_page import write_scores

            write_scores(run.cells, findings, means, outputs.report, arguments=arguments, progress=progress)
            note(f"open {outputs.report} in a browser")
    except KeyboardInterrupt:
        if findings is None:
            raise
        note("interrupted before all files were written")
        findings = replace(findings, interrupted=True)
    except InputError:  # a file that cannot be written takes nothing from what was scored
        if findings is not None and not nothing_scored(findings):
            show(findings, print_report, as_json=as_json)
        raise
    if nothing_scored(findings):
        raise InputError(*why_not_scored(findings))
    return show(findings, print_report, as_json=as_json)


def nothing_scored(*found: Findings) -> bool:
    """Whether every task or workspace is an error, so that there is no result to print."""
    statuses = {result.score.status for findings in found for result in findings.results}
    return statuses == {"error"} and not any(findings.interrupted for findings in found)


def why_not_scored(*found: Findings) -> list[Problem]:
    """Why what could not be scored could not be, each reason once."""
    scores = (result.score for findings in found for result in findings.results if result.score.status == "error")
    return [Problem("not-scored", why) for why in dict.fromkeys(reason for one in scores for reason in one.reasons)]


def show(findings: Findings, print_findings: Callable[[Findings], None], *, as_json: bool) -> ExitCode:
    """Print what was found, in words or as a document; returns the exit code that it stands for."""
    if as_json:
        say_raw(as_text(ScoreDocument.of(findings)))
    else:
        print_findings(findings)
    if findings.interrupted:
        return ExitCode.INTERRUPTED
    if findings.count("error"):
        return ExitCode.BAD_INPUT
    return ExitCode.OK if findings.passed else ExitCode.NONE_FEASIBLE


@dataclass(frozen=True, eq=False)
class ScoreRun:
    """Workspaces, and what computes their candidates."""

    cells: tuple[ScoredCell, ...]
    computer: Computer

    @classmethod
    @contextmanager
    def open(cls, paths: Sequence[str], outputs: Outputs, means: Means) -> Iterator[ScoreRun]:
        """Hire workers and read the workspaces; workers begin with those that are read.

        Raises InputError for paths and folders of no use, and where an output is a file of a workspace.
        """
        files = find_workspaces(paths)
        check_not_read(outputs.paths, files)
        cells: list[ScoredCell] = []
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for cell in read_cells(files):
                    check_not_read(outputs.paths, _files(cell))
                    computer.begin(wanted_of(cell))
                    cells.append(cell)
                    advance()
            keep_all_so_far()
            for cell in cells:
                print_problems(problem for problem in cell.problems if problem.severity == "warning")
                if cell.workspace is not None and not cell.tasks:
                    note(f"{cell.name} lists no tasks")
            yield cls(tuple(cells), computer)

    def findings(self, baseline: Baseline | None, allowance: float) -> Findings:
        """Score all and compare with a baseline if there is one."""
        findings = score_cells(self.cells, self.computer, progress)
        for cell in self.cells:
            outcomes = filter(None, map(self.computer.outcome, wanted_of(cell)))
            print_problems(intervals_outside(outcome.assessment for outcome in outcomes))
        note(self._count(interrupted=findings.interrupted))
        if findings.interrupted or baseline is None:
            return findings
        try:
            return compare_with(findings, self.cells, baseline, allowance, self._lookup, progress)
        except KeyboardInterrupt:
            note("interrupted before everything was compared with the baseline")
            return replace(findings, interrupted=True)

    def _count(self, *, interrupted: bool) -> str:
        """How many candidates were computed, and what of the others."""
        total = sum(len(wanted_of(cell)) for cell in self.cells)
        computed, failed = self.computer.computed, self.computer.failed
        parts = [f"{computed} of {total} candidates were computed"]
        parts += [f"{failed} could not be"] if failed else []
        parts += ["the others were known"] if not interrupted and computed + failed < total else []
        return ", ".join(parts) + (", then interrupted" if interrupted else "")

    def write(self, findings: Findings, outputs: Outputs) -> None:
        """Write the files that were asked for."""
        if outputs.junit is not None:
            write_junit(findings, outputs.junit)
        if outputs.summary is not None:
            write_summary(findings, outputs.summary)
        if outputs.baseline is not None:
            scores = [result.score for result in findings.results]
            self._lookup.prepare([(score, way) for score in scores for way in score.ways.values()], progress)
            save_baseline(baseline_of(self.cells, scores, self._lookup, self.computer.sampling), outputs.baseline)

    @property
    def _lookup(self) -> CoverageLookup:
        return CoverageLookup(self.cells, self.computer)


def _files(cell: ScoredCell) -> list[Path]:
    return [] if cell.workspace is None else [file.path for file in cell.workspace.files.values()]
