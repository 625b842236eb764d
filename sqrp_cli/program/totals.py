"""What a whole program adds up to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sqrp_cli.program.record import Program


@dataclass(frozen=True)
class WorstDelay:
    """The fault of a program that may be noticed latest: its delay at worst [s], its step (from 1) and its name."""

    seconds: float
    step: int
    fault: str


@dataclass(frozen=True)
class Totals:
    """Totals over the steps of a program.

    time: of all steps [s]. q_avg, q_eoi: in 0..1, the mean over the steps that have the figure, each step weighted with
    its time; None if no step has it. worst: None if no step can have a fault.
    """

    time: float
    q_avg: float | None
    q_eoi: float | None
    worst: WorstDelay | None

    @classmethod
    def of(cls, program: Program) -> Totals:
        """The totals of a program, which may have no steps."""
        steps = program.steps
        delays = [
            WorstDelay(fault.delay_worst, number, name)
            for number, step in enumerate(steps, 1)
            for name, fault in step.faults.items()
        ]
        return cls(
            time=sum(step.time for step in steps),
            q_avg=_weighted([(step.q_avg, step.time) for step in steps]),
            q_eoi=_weighted([(step.q_eoi, step.time) for step in steps]),
            worst=max(delays, key=lambda delay: delay.seconds, default=None),
        )


def _weighted(figures: Sequence[tuple[float | None, float]]) -> float | None:
    known = [(figure, weight) for figure, weight in figures if figure is not None]
    total = sum(weight for _, weight in known)
    return sum(figure * weight for figure, weight in known) / total if total else None
