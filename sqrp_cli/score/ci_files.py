"""Scores for CI servers: a JUnit file, shown as test results, and Markdown, for the summary page of a job."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from math import inf
from pathlib import Path
from xml.etree import ElementTree as Xml

from sqrp_cli.platform.files import write_atomically
from sqrp_cli.score.result import Scorecard, TaskScore, listed
from sqrp_cli.shown import one_line

_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'

_SIGNS = re.compile(r"[\\`*_|<>\[\]&~$]|:(?=//)|(?<=www)\.", re.IGNORECASE)
"""Characters with a meaning in Markdown within a line, except in addresses, which GitHub would turn into links."""


def write_junit(scorecard: Scorecard, path: Path) -> None:
    """A test suite per workspace, a test case per task. Raises InputError where the file cannot be written.

    A task that is not good enough, or worse than its baseline, is a `failure`; what cannot be scored is an `error`.
    """
    gone = [] if scorecard.may_vanish else scorecard.vanished
    root = Xml.Element("testsuites", {"name": "sqrp score", **_counts(scorecard.results, len(gone))})
    for workspace, group in groupby(scorecard.results, key=lambda result: result.workspace):
        results = list(group)
        suite = Xml.SubElement(root, "testsuite", {"name": one_line(workspace), **_counts(results)})
        told: Counter[str] = Counter()
        for result in results:
            name = one_line(result.task or "workspace")
            told[name] += 1
            # A server of tests takes cases of one name for one case; a task may be listed twice.
            _case(suite, result, name if told[name] == 1 else f"{name} ({told[name]})")
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
    total = len(scorecard.results)
    lines = [f"## SQRP: {'passed' if scorecard.passed else 'not passed'}", ""]
    lines += [f"{total} task{'s' if total != 1 else ''}: {counts}", "", *_findings(scorecard)]
    lines += [""] if lines[-1] else []
    lines += ["| workspace | task | best | Q_eoi % | Q_avg % | time s | seen at worst s | result |"]
    lines += ["|---|---|---|---:|---:|---:|---:|---|"]
    lines += [_row(result) for result in scorecard.results]
    write_atomically(path, "\n".join(lines) + "\n")


def _findings(scorecard: Scorecard) -> Iterator[str]:
    """An item for everything that is wrong, and for what is otherwise than in the baseline."""
    for score in scorecard.results:
        yield from (f"- **{score.status}** {_text(score.named)}: {_text(reason)}" for reason in score.reasons)
    yield from (f"- **vanished** {_text(gone.workspace)}, {_text(gone.task)}" for gone in scorecard.vanished)
    yield from (f"- **renamed** {_text(now)} is {_text(was)} of the baseline" for now, was in scorecard.renamed.items())
    for result in scorecard.results:
        if result.baseline is not None:
            named, ways = _text(result.named), result.baseline.ways
            yield from [f"- **new** {named}"] if result.baseline.verdict == "new" else []
            yield from (f"- **improved** {named} for {_text(str(way))}" for way in ways if not way.worse)
    for name, changes in scorecard.changes.items():
        yield from [f"- changed in {_text(name)}: {_text(listed(changes))}"] if changes else []


def _counts(results: Sequence[TaskScore], gone: int = 0) -> dict[str, str]:
    """gone: how many tasks vanished that must not."""
    statuses = [result.status for result in results] + ["failed"] * gone
    counts = {"tests": len(statuses), "failures": statuses.count("failed"), "errors": statuses.count("error")}
    return {name: str(count) for name, count in {**counts, "skipped": 0}.items()}


def _case(suite: Xml.Element, score: TaskScore, name: str) -> None:
    case = Xml.SubElement(suite, "testcase", classname=one_line(score.workspace), name=name)
    if score.status != "passed":
        kind = "failure" if score.status == "failed" else "error"
        element = Xml.SubElement(case, kind, message=one_line(score.reasons[0]), type=score.status)
        element.text = "\n".join(map(one_line, score.reasons))
    if score.best is not None:
        best = score.best
        qualities = [("Q_eoi", best.q_eoi), ("Q_avg", best.q_avg)]
        lines = [f"{label}: {100 * quality:.1f} %" for label, quality in qualities if quality is not None]
        lines = [f"best: {best.name}", *lines, f"time: {best.time:.2f} s"]
        Xml.SubElement(case, "system-out").text = "\n".join(map(one_line, lines))


def _row(score: TaskScore) -> str:
    cells = [score.workspace, score.task or "", "", "", "", "", "", score.status]
    if score.best is not None:
        best = score.best
        figures = [None if q is None else 100 * q for q in (best.q_eoi, best.q_avg)]
        cells[2:7] = [
            best.name,
            *("-" if figure is None else f"{figure:.1f}" for figure in figures),
            f"{best.time:.2f}",
            "-" if best.latest is None else "never" if best.latest == inf else f"{best.latest:.2f}",
        ]
    return "| " + " | ".join(_text(cell) for cell in cells) + " |"


def _text(text: str) -> str:
    """Text that Markdown shows literally, addresses too; runs of blanks become one."""
    return _SIGNS.sub(r"\\\g<0>", " ".join(one_line(text).split()))
