"""Scores for CI servers: a JUnit file, shown as test results, and Markdown, for the summary page of a job."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from math import inf
from pathlib import Path
from xml.etree import ElementTree as Xml

from sqrp_cli.document import how_many
from sqrp_cli.figures import named_figures
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
            name = name if told[name] == 1 else f"{name} ({told[name]})"
            case = Xml.SubElement(suite, "testcase", classname=one_line(workspace), name=name)
            if result.status != "passed":
                kind = "failure" if result.status == "failed" else "error"
                element = Xml.SubElement(case, kind, message=one_line(result.reasons[0]), type=result.status)
                element.text = "\n".join(map(one_line, result.reasons))
            if (best := result.best) is not None:
                figures = named_figures(best, "q_eoi", "q_avg", "time", between=": ")
                lines = [f"best: {best.name}", *figures]
                Xml.SubElement(case, "system-out").text = "\n".join(map(one_line, lines))
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
    lines = [f"## SQRP: {'passed' if scorecard.passed else 'not passed'}", ""]
    lines += [f"{how_many(scorecard.results, 'task')}: {counts}", ""]
    for one in scorecard.results:
        lines += (f"- **{one.status}** {_text(one.named)}: {_text(reason)}" for reason in one.reasons)
    lines += (f"- **vanished** {_text(gone.workspace)}, {_text(gone.task)}" for gone in scorecard.vanished)
    lines += (f"- **renamed** {_text(now)} is {_text(was)} of the baseline" for now, was in scorecard.renamed.items())
    for one in scorecard.results:
        if one.baseline is not None:
            lines += [f"- **new** {_text(one.named)}"] if one.baseline.verdict == "new" else []
            better = (way for way in one.baseline.ways if not way.worse)
            lines += (f"- **improved** {_text(one.named)} for {_text(str(way))}" for way in better)
    for name, changes in scorecard.changes.items():
        lines += [f"- changed in {_text(name)}: {_text(listed(changes))}"] if changes else []
    lines += [""] if lines[-1] else []
    lines += [
        "| workspace | task | best | noticed at the latest s | critical time seen % | time seen % | takes s | result |"
    ]
    lines += ["|---|---|---|---:|---:|---:|---:|---|"]
    for one in scorecard.results:
        cells = [one.workspace, one.task or "", "", "", "", "", "", one.status]
        if one.best is not None:
            figures = ("-" if q is None else f"{100 * q:.1f}" for q in (one.best.q_eoi, one.best.q_avg))
            late = one.best.latest
            seen = "-" if late is None else "never" if late == inf else f"{late:.2f}"
            cells[2:7] = [one.best.name, seen, *figures, f"{one.best.time:.2f}"]
        lines.append("| " + " | ".join(map(_text, cells)) + " |")
    write_atomically(path, "\n".join(lines) + "\n")


def _counts(results: Sequence[TaskScore], gone: int = 0) -> dict[str, str]:
    """gone: how many tasks vanished that must not."""
    statuses = [result.status for result in results] + ["failed"] * gone
    counts = {"tests": len(statuses), "failures": statuses.count("failed"), "errors": statuses.count("error")}
    return {name: str(count) for name, count in {**counts, "skipped": 0}.items()}


def _text(text: str) -> str:
    """Text that Markdown shows literally, addresses too; runs of blanks become one."""
    return _SIGNS.sub(r"\\\g<0>", " ".join(one_line(text).split()))
