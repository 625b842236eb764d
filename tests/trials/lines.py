"""What the trials found, each line beside what is asked."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from sqrp_cli.run.record.report import Confusion, SweepDocument, SweptRun
from tests.trials.jobs import Job

Done = tuple[Job, dict[str, Any]]
"""A run with what was kept of it."""

PRECISION, AS_PREDICTED, STANDING = 0.97, 0.9, 0.5
"""Asked: shares of images and of delays, and the time from a failure until the robot stands [s]."""


@dataclass(frozen=True)
class Line:
    """holds: None where nothing is asked, or not all runs are done."""

    what: str
    asked: str
    found: str
    holds: bool | None


def precision_lines(done: Sequence[Done], missing: int) -> Iterable[Line]:
    """What was predicted to be seen, and whether it was."""
    counts = {job.name: Confusion(**kept["counts"]) for job, kept in done if "counts" in kept}
    for name, count in counts.items():
        share = count.precision or 0.0
        found = f"{100 * share:.1f} % of {count.tp + count.fp}, {count.fn} more"
        yield Line(f"{name}: predicted images that showed it", f">= {100 * PRECISION:.0f} %", found, share >= PRECISION)
    because = sum((Counter(kept.get("because", {})) for _, kept in done), Counter())
    yield Line("those that did not, by cause", "", _counted(because), None)
    outcomes = Counter(kept.get("outcome", "crashed") for _, kept in done)
    yield Line("runs that were done", f"{len(done) + missing}", str(outcomes["done"]), outcomes["done"] == len(done))


def sweep_lines(done: Sequence[Done], names: Sequence[str], period: float) -> Iterable[Line]:
    """Delays after slips in the lift of the best and the worst candidate, and what the better choice saves."""
    ends = {}
    for name in (names[0], names[-1]):
        runs = [_sweep_run(job, kept) for job, kept in done if job.name == name and "faults" in kept]
        summary = SweepDocument.of("", "slip", 1, [name], runs, len(runs), period)
        if not summary.seen:
            continue
        pairs = [(run.delay, run.predicted_delay) for run in runs if run.happened is not None]
        seen = [(delay, most) for delay, most in pairs if delay is not None and most is not None]
        delays, lateness = [delay for delay, _ in seen], [delay - most for delay, most in seen]
        share = summary.as_predicted / max(summary.seen, 1)
        within = f"{1000 * summary.tolerance:.0f} ms"
        yield Line(
            f"{name}: slips seen of those that can be",
            str(summary.predictable),
            str(summary.seen),
            summary.seen == summary.predictable,
        )
        yield Line(
            f"{name}: seen as predicted, at most {within} sooner",
            f">= {100 * AS_PREDICTED:.0f} %",
            f"{100 * share:.0f} %, {summary.sooner} sooner, {summary.later} later "
            f"({min(lateness):+.2f} to {max(lateness):+.2f} s)",
            share >= AS_PREDICTED - 1e-9,
        )
        mean = sum(delays) / max(len(delays), 1)
        yield Line(f"{name}: mean delay", "", f"{mean:.2f} s", None)
        done_at = [run.recovered for run in runs if run.recovered is not None]
        if done_at:
            ends[name] = sum(done_at) / len(done_at)
            yield Line(f"{name}: done after a slip", "", f"{ends[name]:.1f} s in {len(done_at)} runs", None)
    if len(ends) == 2:
        saved = ends[names[-1]] - ends[names[0]]
        yield Line(f"{names[0]} saves after a slip", "> 0 s", f"{saved:.1f} s", saved > 0)


def calm_lines(done: Sequence[Done], missing: int) -> Iterable[Line]:
    """Runs in which nothing is wrong."""
    alarms = [f"{job.seed}: {kept.get('reason') or kept.get('crash')}" for job, kept in done if not _is_calm(kept)]
    found = "; ".join(alarms) or f"0 in {len(done)} runs"
    yield Line("false alarms without a fault", f"0 in {len(done) + missing} runs", found, not alarms)


def failure_lines(done: Sequence[Done], missing: int) -> Iterable[Line]:
    """Runs in which those who watch fail."""
    total = len(done) + missing
    kinds = _counted(Counter(job.fault for job, _ in done))
    yield Line("runs with a failure of those who watch", str(total), kinds, None)
    crashed = [job for job, kept in done if "crash" in kept]
    wrong = [job for job, kept in done if kept.get("outcome") == "done"]
    yield Line("that crashed", "0", str(len(crashed)), not crashed)
    yield Line("that were said to be done", "0", str(len(wrong)), not wrong)
    stopped = [kept for _, kept in done if kept.get("outcome") == "stopped"]
    told = max((kept["told"] - kept["faults"][0]["injected"] for kept in stopped), default=0.0)
    standing = max((kept["standing"] - kept["faults"][0]["injected"] for kept in stopped), default=0.0)
    yield Line("told to stop after at most", "", f"{told:.2f} s", None)
    yield Line("standing after at most", f"{STANDING:g} s", f"{standing:.2f} s", standing <= STANDING)


def repeat_lines(done: Sequence[Done]) -> Iterable[Line]:
    """The same run twice."""
    logs = {kept.get("log") for _, kept in done}
    if len(done) == 2:
        same = len(logs) == 1 and None not in logs
        yield Line("two logs of the same seed", "identical", "identical" if same else "different", same)


def _is_calm(kept: dict[str, Any]) -> bool:
    return kept.get("outcome") == "done" and not kept["faults"]


def _sweep_run(job: Job, kept: dict[str, Any]) -> SweptRun:
    return SweptRun(**kept["faults"][0], x=job.t, outcome="done", time=0.0)


def _counted(counter: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counter.items())) or "none"
