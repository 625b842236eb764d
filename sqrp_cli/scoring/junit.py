"""Scores as a JUnit file, which CI servers show as test results."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from xml.etree import ElementTree as Xml

from sqrp_cli.platform.files import write_atomically
from sqrp_cli.scoring.baselines.findings import Findings, Result
from sqrp_cli.shown import one_line


def write_junit(findings: Findings, path: Path) -> None:
    """A test suite per workspace, a test case per task. Raises InputError where the file cannot be written.

    A task that is not good enough, or worse than its baseline, is a `failure`; what cannot be scored is an `error`.
    """
    root = Xml.Element("testsuites", {"name": "sqrp score", **_counts(findings.results)})
    for workspace, group in groupby(findings.results, key=lambda result: result.score.workspace):
        results = list(group)
        suite = Xml.SubElement(root, "testsuite", {"name": one_line(workspace), **_counts(results)})
        for result in results:
            _case(suite, result)
    Xml.indent(root)
    write_atomically(path, Xml.tostring(root, encoding="unicode", xml_declaration=False).join((_HEAD, "\n")))


_HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'


def _counts(results: Sequence[Result]) -> dict[str, str]:
    statuses = [result.score.status for result in results]
    counts = {"tests": len(statuses), "failures": statuses.count("failed"), "errors": statuses.count("error")}
    return {name: str(count) for name, count in {**counts, "skipped": 0}.items()}


def _case(suite: Xml.Element, result: Result) -> None:
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
