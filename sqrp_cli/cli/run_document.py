"""Runs, sweeps and audits as JSON documents; the fields are a contract with other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from sqrp_cli.cli.documents import SCHEMA, Document
from sqrp_cli.runtime.outcome import FaultRecord, Prediction, RunReport

if TYPE_CHECKING:
    from sqrp_cli.runtime.audit import AuditReport
    from sqrp_cli.runtime.simulated_run import SweepRun, SweepSummary


def run_document(workspace: str, report: RunReport) -> Document:
    """How a run went."""
    return {
        "schema": SCHEMA,
        "workspace": workspace,
        "outcome": report.outcome,
        "reason": report.reason,
        "time": report.time,
        "steps": [asdict(step) for step in report.steps],
        "faults": [_fault(fault) for fault in report.faults],
        "prediction": [_counts(step) for step in report.prediction],
        "disagreements": [asdict(entry) for entry in report.disagreements],
        "conflicts": report.conflicts,
        "stop": {"told": report.stop_told, "standing": report.stop_done},
        "tracking": report.tracking,
        "images": report.images,
        "wall": report.wall,
    }


def _counts(step: Prediction) -> Document:
    """The counts of a step, by literal and camera."""
    return {atom: {camera: asdict(found) for camera, found in cameras.items()} for atom, cameras in step.items()}


def _fault(fault: FaultRecord) -> Document:
    return {**asdict(fault), "delay": fault.delay}


def sweep_document(workspace: str, text: str, step: int, runs: Sequence[SweepRun], summary: SweepSummary) -> Document:
    """The runs of a sweep. step: the number of the one that was swept."""
    return {
        "schema": SCHEMA,
        "workspace": workspace,
        "sweep": text,
        "step": step,
        "tolerance": summary.tolerance,
        "predictable": summary.predictable,
        "seen": summary.seen,
        "as_predicted": summary.as_predicted,
        "sooner": summary.sooner,
        "later": summary.later,
        "runs": [
            {"x": run.x, "outcome": run.report.outcome, "time": run.report.time, **_fault(run.fault)} for run in runs
        ],
    }


def audit_document(workspace: str, report: AuditReport, threshold: float) -> Document:
    """What recorded frames say about predictions."""
    precision = report.total.precision
    return {
        "schema": SCHEMA,
        "workspace": workspace,
        "images": report.images,
        "skipped": report.skipped,
        "repeated": report.repeated,
        "precision": precision,
        "threshold": threshold,
        "prediction": [_counts(step) for step in report.prediction],
        "disagreements": [asdict(entry) for entry in report.disagreements],
    }
