"""Scoring many workspaces: read them, compute, compare with a baseline, and write files for a CI server.

These are a JUnit file, shown as test results, and Markdown, for the summary page of a job.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree as Xml

from sqrp_cli.checks.formulas import intervals_outside
from sqrp_cli.errors import Problem
from sqrp_cli.platform.files import check_not_read, write_atomically
from sqrp_cli.platform.memory import keep_all_so_far
from sqrp_cli.scoring.baselines.baseline import baseline_of, save_baseline
from sqrp_cli.scoring.score import ScoredCell, find_workspaces, read_cells, wanted_of
from sqrp_cli.scoring.scorecard import (
    ComparedScore,
    CoverageLookup,
    Expected,
    Progress,
    Scorecard,
    compare_with,
    listed,
    score_cells,
)
from sqrp_cli.scoring.work.compute import Computer, Means, open_computer
from sqrp_cli.shown import one_line


@dataclass(frozen=True, eq=False)
class ScoreRun:
    """Workspaces, and what computes their candidates. `progress` shows the progress of each part."""

    cells: tuple[ScoredCell, ...]
    computer: Computer
    progress: Progress

    @classmethod
    @contextmanager
    def open(
        cls, paths: Sequence[str], outputs: Sequence[Path], means: Means, progress: Progress
    ) -> Iterator[ScoreRun]:
        """Start workers and read the workspaces; workers begin with the first while others are read.

        Raises InputError for unusable paths and folders, and if an output is a file of a workspace.
        """
        files = find_workspaces(paths)
        check_not_read(outputs, files)
        cells: list[ScoredCell] = []
        with open_computer(means) as computer:
            with progress("Reading workspaces", len(files)) as advance:
                for cell in read_cells(files):
                    check_not_read(outputs, _files(cell))
                    computer.begin(wanted_of(cell))
                    cells.append(cell)
                    advance(1)
            keep_all_so_far()
            yield cls(tuple(cells), computer, progress)

    def score(self) -> Scorecard:
        """Score all, at Ctrl-C only the finished ones. Raises InputError if results cannot be kept."""
        return score_cells(self.cells, self.computer, self.progress)

    @property
    def doubts(self) -> Iterator[Problem]:
        """Warnings about formulas with intervals outside the motion; valid after `score`."""
        for cell in self.cells:
            outcomes = filter(None, map(self.computer.outcome, wanted_of(cell)))
            yield from intervals_outside(outcome.assessment for outcome in outcomes)

    def count(self, *, interrupted: bool) -> str:
        """How many candidates were computed, failed, or were known."""
        total = sum(len(wanted_of(cell)) for cell in self.cells)
        computed, failed = self.computer.computed, self.computer.failed
        parts = [f"{computed} of {total} candidates were computed"]
        parts += [f"{failed} could not be"] if failed else []
        parts += ["the others were known"] if not interrupted and computed + failed < total else []
        return ", ".join(parts) + (", then interrupted" if interrupted else "")

    def compare(self, findings: Scorecard, expected: Expected) -> Scorecard:
        """The findings compared with a baseline; at Ctrl-C without."""
        try:
            return compare_with(findings, self.cells, expected, self._lookup, self.progress)
        except KeyboardInterrupt:
            return replace(findings, interrupted=True)

    def write(self, findings: Scorecard, *, junit: Path | None, summary: Path | None, baseline: Path | None) -> None:
        """Write the requested files. Raises InputError for one that cannot be written."""
        if junit is not None:
            write_junit(findings, junit)
        if summary is not None:
            write_summary(findings, summary)
        if baseline is not None:
            scores = [result.score for result in findings.results]
            self._lookup.prepare([(score, way) for score in scores for way in score.ways.values()], self.progress)
            save_baseline(baseline_of(self.cells, scores, self._lookup, self.computer.sampling), baseline)

    @property
    def _lookup(self) -> CoverageLookup:
        return CoverageLookup(self.cells, self.computer)


def nothing_scored(*found: Scorecard) -> bool:
    """Whether every task or workspace is an error, so that there is nothing to print."""
    statuses = {result.score.status for findings in found for result in findings.results}
    return statuses == {"error"} and not any(findings.interrupted for findings in found)


def why_not_scored(*found: Scorecard) -> list[Problem]:
    """The reasons for tasks that could not be scored, each once."""
    scores = (result.score for findings in found for result in findings.results if result.score.status == "error")
    return [Problem("not-scored", why) for why in dict.fromkeys(reason for one in scores for reason in one.reasons)]


def _files(cell: ScoredCell) -> list[Path]:
    return [] if cell.workspace is None else [file.path for file in cell.workspace.files.values()]


_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'

_SIGNS = re.compile(r"[\\`*_|<>\[\]&~$]|:(?=//)|(?<=www)\.", re.IGNORECASE)
"""Characters with a meaning in Markdown within a line, except in addresses, which GitHub would turn into links."""


def write_junit(scorecard: Scorecard, path: Path) -> None:
    """A test suite per workspace, a test case per task. Raises InputError where the file cannot be written.

    A task that is not good enough, or worse than its baseline, is a `failure`; what cannot be scored is an `error`.
    """
    gone = [] if scorecard.may_vanish else scorecard.vanished
    root = Xml.Element("testsuites", {"name": "sqrp score", **_counts(scorecard.results, len(gone))})
    for workspace, group in groupby(scorecard.results, key=lambda result: result.score.workspace):
        results = list(group)
        suite = Xml.SubElement(root, "testsuite", {"name": one_line(workspace), **_counts(results)})
        for result in results:
            _case(suite, result)
    for workspace, tasks in groupby(gone, key=lambda task: task.workspace):
        names = [one_line(task.task) for task in tasks]
        suite = Xml.SubElement(root, "testsuite", {"name": one_line(workspace), **_counts([], len(names))})
        for name in names:
            case = Xml.SubElement(suite, "testcase", classname=one_line(workspace), name=name)
            Xml.SubElement(case, "failure", message="it is only in the baseline", type="vanished")
    Xml.indent(root)
    write_atomically(path, Xml.tostring(root, encoding="unicode", xml_declaration=False).join((_HEAD, "\n")))


def write_summary(scorecard: Scorecard, path: Path) -> None:
    """Failures first, then the table of all tasks. Raises InputError if the file cannot be written."""
    named = (("passed", "passed"), ("failed", "failed"), ("error", "could not be scored"))
    counts = ", ".join(f"{scorecard.count(status)} {words}" for status, words in named if scorecard.count(status))
    lines = [
        f"## SQRP: {'passed' if scorecard.passed else 'not passed'}",
        "",
        f"{len(scorecard.results)} task{'s' if len(scorecard.results) != 1 else ''}: {counts}",
        "",
    ]
    for result in scorecard.results:
        lines += [
            f"- **{result.score.status}** {_text(result.score.named)}: {_text(reason)}"
            for reason in result.score.reasons
        ]
    lines += [f"- **vanished** {_text(gone.workspace)}, {_text(gone.task)}" for gone in scorecard.vanished]
    lines += [f"- **renamed** {_text(name)} is {_text(was)} of the baseline" for name, was in scorecard.renamed.items()]
    for result in scorecard.results:
        comparison = result.comparison
        if comparison is not None and comparison.verdict == "new":
            lines.append(f"- **new** {_text(result.score.named)}")
        ways = comparison.ways if comparison is not None else ()
        lines += [f"- **improved** {_text(result.score.named)} for {_text(str(way))}" for way in ways if not way.worse]
    lines += [
        f"- changed in {_text(name)}: {_text(listed(changes))}"
        for name, changes in scorecard.changes.items()
        if changes
    ]
    lines += [""] if lines[-1] else []
    lines += ["| workspace | task | best | Q_eoi % | Q_avg % | time s | seen after s | result |"]
    lines += ["|---|---|---|---:|---:|---:|---:|---|"]
    lines += [_row(result) for result in scorecard.results]
    write_atomically(path, "\n".join(lines) + "\n")


def _counts(results: Sequence[ComparedScore], gone: int = 0) -> dict[str, str]:
    """gone: how many tasks vanished that must not."""
    statuses = [result.score.status for result in results] + ["failed"] * gone
    counts = {"tests": len(statuses), "failures": statuses.count("failed"), "errors": statuses.count("error")}
    return {name: str(count) for name, count in {**counts, "skipped": 0}.items()}


def _case(suite: Xml.Element, result: ComparedScore) -> None:
    score = result.score
    case = Xml.SubElement(
        suite, "testcase", classname=one_line(score.workspace), name=one_line(score.task or "workspace")
    )
    if score.status != "passed":
        kind = "failure" if score.status == "failed" else "error"
        element = Xml.SubElement(case, kind, message=one_line(score.reasons[0]), type=score.status)
        element.text = "\n".join(map(one_line, score.reasons))
    if score.best is not None:
        best = score.best.assessment
        qualities = [("Q_eoi", best.q_eoi), ("Q_avg", best.q_avg)]
        lines = [f"{label}: {100 * quality:.1f} %" for label, quality in qualities if quality is not None]
        lines = [f"best: {best.candidate.name}", *lines, f"time: {best.time:.2f} s"]
        Xml.SubElement(case, "system-out").text = "\n".join(map(one_line, lines))


def _row(result: ComparedScore) -> str:
    from sqrp_cli.terminal.console import percent, seconds

    score = result.score
    cells = [score.workspace, score.task or "", "", "", "", "", "", score.status]
    if score.best is not None:
        best = score.best.assessment
        figures = [percent(best.q_eoi), percent(best.q_avg), seconds(best.time), seconds(best.delay_worst)]
        cells[2:7] = [best.candidate.name, *figures]
    return "| " + " | ".join(_text(cell) for cell in cells) + " |"


def _text(text: str) -> str:
    """Text that Markdown shows literally, addresses too; runs of blanks become one."""
    return _SIGNS.sub(r"\\\g<0>", " ".join(one_line(text).split()))
