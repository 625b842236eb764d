"""The documents of `sqrp score` and `sqrp diff`; their fields are a contract with other programs."""

from __future__ import annotations

from sqrp_cli.cli.documents import SCHEMA, Document, candidate_document
from sqrp_cli.scoring.changes import Change
from sqrp_cli.scoring.comparison import Comparison, Loss, WayChange
from sqrp_cli.scoring.findings import Findings, Result


def score_document(findings: Findings) -> Document:
    """Every result; the same bytes for the same workspaces, however and wherever they were computed."""
    return {
        "schema": SCHEMA,
        "results": [result_document(result) for result in findings.results],
        "changes": {
            name: [_change(change) for change in changes] for name, changes in findings.changes.items() if changes
        },
        "vanished": [{"workspace": workspace, "task": task} for workspace, task in findings.vanished],
        **({"interrupted": True, "unfinished": findings.unfinished} if findings.interrupted else {}),
        "passed": findings.passed,
    }


def result_document(result: Result) -> Document:
    """One task of one workspace."""
    score = result.score
    return {
        "workspace": score.workspace,
        "task": score.task,
        "status": score.status,
        "best": None if score.best is None else candidate_document(score.best),
        "reasons": list(score.reasons),
        "baseline": None if result.comparison is None else _comparison(result.comparison),
    }


def _comparison(comparison: Comparison) -> Document:
    return {
        "verdict": comparison.verdict,
        "ways": [_way(change) for change in comparison.ways],
        "gone": list(comparison.gone),
    }


def _way(change: WayChange) -> Document:
    return {
        "way": change.way,
        "candidate_before": change.before,
        "candidate": change.now,
        "shifts": [
            {"metric": shift.metric, "before": shift.before, "now": shift.now, "worse": shift.worse}
            for shift in change.shifts
        ],
        "lost": [_loss(loss) for loss in change.losses],
    }


def _loss(loss: Loss) -> Document:
    return {
        "literal": loss.literal,
        "camera": loss.camera,
        "start": loss.stretch.start,
        "end": loss.stretch.end,
        "why": loss.why,
    }


def _change(change: Change) -> Document:
    return {"file": change.file, "field": change.field, "before": change.before, "now": change.now}
