"""`run` and `audit`: what happened, and which predictions came true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Literal

from sqrp_cli.report.documents.document import Document, Record
from sqrp_cli.runtime.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord

if TYPE_CHECKING:
    from sqrp_cli.runtime.monitor.frame_audit import AuditReport
    from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary

Counts = Mapping[str, Mapping[str, Confusion]]
"""By literal and camera."""


@dataclass(frozen=True, kw_only=True)
class Fault(Record):
    """A fault with its times on the run's clock [s]; null for what never happened."""

    name: str
    injected: float | None
    happened: float | None
    detected: float | None
    acted: float | None
    recovered: float | None
    predicted_delay: float | None
    moved_on: float | None
    """How long the robot moved on to look, after `detected` [s]."""
    camera: str | None
    """The camera that failed; null for a fault of the step."""
    delay: float | None
    """From `happened` to `detected` [s]."""

    @classmethod
    def of(cls, record: FaultRecord) -> Fault:
        """A fault of a run."""
        return cls(**asdict(record), delay=record.delay)


@dataclass(frozen=True, kw_only=True)
class StopTimes(Record):
    """When the robot was last commanded to stop, and when it stood still [s]."""

    told: float | None
    standing: float | None


@dataclass(frozen=True, kw_only=True)
class RunDocument(Document):
    """How a run went."""

    workspace: str
    outcome: Literal["done", "stopped"]
    reason: str | None
    """Why it stopped."""
    time: float
    """Simulated [s]."""
    steps: list[StepRecord]
    faults: list[Fault]
    prediction: list[Counts]
    """Per step."""
    disagreements: list[Disagreement]
    """Images in which a prediction was wrong."""
    conflicts: int
    """Instants at which cameras contradicted each other."""
    stop: StopTimes
    tracking: float | None
    """Rms distance of the tool from where it should have been [m]."""
    images: int
    wall: Mapping[str, float]
    """Where wall-clock time went [s]."""

    @classmethod
    def of(cls, workspace: str, report: RunReport) -> RunDocument:
        """A run in a workspace."""
        return cls(
            workspace=workspace,
            outcome=report.outcome,
            reason=report.reason,
            time=report.time,
            steps=report.steps,
            faults=[Fault.of(fault) for fault in report.faults],
            prediction=list(report.prediction),
            disagreements=report.disagreements,
            conflicts=report.conflicts,
            stop=StopTimes(told=report.stop_told, standing=report.stop_done),
            tracking=report.tracking,
            images=report.images,
            wall=report.wall,
        )


@dataclass(frozen=True, kw_only=True)
class _SweptBefore(Record):
    x: float
    """When the fault was injected, in seconds of the step."""
    outcome: Literal["done", "stopped"]
    time: float


@dataclass(frozen=True, kw_only=True)
class SweptRun(Fault, _SweptBefore):
    """A run of a sweep."""

    @classmethod
    def of_run(cls, run: SweepRun) -> SweptRun:
        """A run of a sweep."""
        fault = Fault.of(run.fault)
        return cls(x=run.x, outcome=run.report.outcome, time=run.report.time, **asdict(fault))


@dataclass(frozen=True, kw_only=True)
class SweepDocument(Document):
    """What `sqrp run --sweep` finds."""

    workspace: str
    sweep: str
    step: int
    """Number of the step that was swept."""
    tolerance: float
    """How far a delay may be from its prediction [s]."""
    predictable: int
    seen: int
    as_predicted: int
    sooner: int
    later: int
    runs: list[SweptRun]

    @classmethod
    def of(cls, workspace: str, text: str, step: int, runs: Sequence[SweepRun], summary: SweepSummary) -> SweepDocument:
        """The runs of a sweep. step: the number of the one that was swept."""
        return cls(
            workspace=workspace,
            sweep=text,
            step=step,
            tolerance=summary.tolerance,
            predictable=summary.predictable,
            seen=summary.seen,
            as_predicted=summary.as_predicted,
            sooner=summary.sooner,
            later=summary.later,
            runs=[SweptRun.of_run(run) for run in runs],
        )


@dataclass(frozen=True, kw_only=True)
class AuditDocument(Document):
    """What recorded frames say about predictions."""

    workspace: str
    images: int
    skipped: int
    """Images of times at which the step did not go as planned."""
    repeated: int
    """Images identical to the one before them."""
    precision: float | None
    """Share of the predicted images that showed the literal."""
    threshold: float
    prediction: list[Counts]
    disagreements: list[Disagreement]

    @classmethod
    def of(cls, workspace: str, report: AuditReport, threshold: float) -> AuditDocument:
        """An audit of a recording."""
        return cls(
            workspace=workspace,
            images=report.images,
            skipped=report.skipped,
            repeated=report.repeated,
            precision=report.total.precision,
            threshold=threshold,
            prediction=list(report.prediction),
            disagreements=list(report.disagreements),
        )
