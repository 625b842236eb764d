"""Whether the best candidate of a task reaches what the workspace expects of it."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.knowledge.workspace.workspace import ExpectedTask
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.verdict import HELP


def shortcomings(best: Assessment | None, expected: ExpectedTask, why_none: str) -> tuple[str, ...]:
    """One sentence for each expectation that is not met; none if all are.

    best: the first in the ranking; None if no candidate is feasible, and then `why_none` says why. A task is expected
    to be feasible unless `expected` says otherwise.
    """
    if best is None:
        return () if expected.feasible is False else (f"no candidate can be done: {why_none}",)
    return tuple(_shortcomings(best, expected))


def _shortcomings(best: Assessment, expected: ExpectedTask) -> Iterator[str]:
    name = best.candidate.name
    lost = best.verdict.split(HELP)[0]
    if expected.feasible is False:
        yield f"{name} can be done, but no candidate was expected to be"
    qualities = (("Q_eoi", best.q_eoi, expected.min_q_eoi), ("Q_avg", best.q_avg, expected.min_q_avg))
    for label, quality, least in qualities:
        if least is None:
            continue
        if quality is None:
            yield f"{label} of {name} is undefined, expected at least {100 * least:g} %"
        elif quality < least:
            yield f"{label} of {name} is {100 * quality:.1f} %, expected at least {100 * least:g} %: {lost}"
    if expected.max_time is not None and best.time is not None and best.time > expected.max_time:
        yield f"{name} takes {best.time:.2f} s, expected at most {expected.max_time:g} s"
    delay = best.delay_worst
    if expected.max_delay is not None and delay is not None and delay > expected.max_delay:
        fault = max(best.faults, key=lambda fault: best.faults[fault].delay_worst)
        most = f"expected at most {expected.max_delay:g} s"
        blind = best.faults[fault].blind_longest
        why = lost if blind else "so long take a frame and the latency of the camera that sees it"
        yield f"the fault {fault} of {name} may be noticed only after {delay:.2f} s, {most}: {why}"
    if expected.winner is not None and expected.winner not in best.candidate.binding.values():
        yield f"{name} is best, expected one with {expected.winner}"
