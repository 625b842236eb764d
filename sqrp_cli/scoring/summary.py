"""Scores as Markdown, for the summary page of a CI job."""

from __future__ import annotations

import re
from pathlib import Path

from sqrp_cli.platform.files import write_atomically
from sqrp_cli.scoring.baselines.findings import Findings, Result, listed
from sqrp_cli.shown import one_line


def write_summary(findings: Findings, path: Path) -> None:
    """What needs attention first, then the table of all tasks. Raises InputError where the file cannot be written."""
    named = (("passed", "passed"), ("failed", "failed"), ("error", "could not be scored"))
    counts = ", ".join(f"{findings.count(status)} {words}" for status, words in named if findings.count(status))
    lines = [
        f"## SQRP: {'passed' if findings.passed else 'not passed'}",
        "",
        f"{len(findings.results)} task{'s' if len(findings.results) != 1 else ''}: {counts}",
        "",
    ]
    for result in findings.results:
        lines += [f"- **{result.score.status}** {_name(result)}: {_text(reason)}" for reason in result.score.reasons]
    lines += [f"- **vanished** {_text(workspace)}, {_text(task)}" for workspace, task in findings.vanished]
    for result in findings.results:
        comparison = result.comparison
        if comparison is not None and comparison.verdict == "new":
            lines.append(f"- **new** {_name(result)}")
        ways = comparison.ways if comparison is not None else ()
        lines += [f"- **improved** {_name(result)} for {_text(str(way))}" for way in ways if not way.worse]
    lines += [
        f"- changed in {_text(name)}: {_text(listed(changes))}" for name, changes in findings.changes.items() if changes
    ]
    lines += [""] if lines[-1] else []
    lines += ["| workspace | task | best | Q_eoi % | Q_avg % | time s | seen after s | result |"]
    lines += ["|---|---|---|---:|---:|---:|---:|---|"]
    lines += [_row(result) for result in findings.results]
    write_atomically(path, "\n".join(lines) + "\n")


def _row(result: Result) -> str:
    score = result.score
    cells = [score.workspace, score.task or "", "", "", "", "", "", score.status]
    if score.best is not None:
        best = score.best.assessment
        delay = best.delay_worst
        figures = [None if q is None else 100 * q for q in (best.q_eoi, best.q_avg)]
        cells[2:7] = [
            best.candidate.name,
            *("-" if figure is None else f"{figure:.1f}" for figure in figures),
            f"{best.time:.2f}",
            "-" if delay is None else f"{delay:.2f}",
        ]
    return "| " + " | ".join(_text(cell) for cell in cells) + " |"


def _name(result: Result) -> str:
    score = result.score
    return _text(score.workspace if score.task is None else f"{score.workspace}, {score.task}")


def _text(text: str) -> str:
    """Text that Markdown shows as it is, addresses too; runs of blanks are one."""
    return _SIGNS.sub(r"\\\g<0>", " ".join(one_line(text).split()))


_SIGNS = re.compile(r"[\\`*_|<>\[\]&~$]|:(?=//)|(?<=www)\.", re.IGNORECASE)
"""What means something in Markdown within a line, besides in addresses that GitHub would make links of."""
