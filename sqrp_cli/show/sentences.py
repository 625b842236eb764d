"""Sentences that terminal and pages share: what was ranked, how exactly, and why a run stopped."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import ceil, inf
from typing import TYPE_CHECKING

from sqrp_cli.figures import FIGURE_NAMES, shown_figure
from sqrp_cli.study.ranking import criterion_figure
from sqrp_cli.study.result import CandidateResult, Criterion, SamplingDone

if TYPE_CHECKING:
    from sqrp_cli.search.goal import Kind
    from sqrp_cli.sight.limits import HidingPart


_CRITERION_WORDS: dict[Criterion, str] = {
    "q_eoi": "best Q_eoi first",
    "q_avg": "best Q_avg first",
    "time": "fastest first",
    "delay": "soonest noticed fault first",
    "expected_time": "soonest done after a fault first",
}

KIND_WORDS: Mapping[Kind, str] = {
    "way": "another way",
    "path": "another path",
    "object": "moving an object",
    "aim": "turning a camera",
    "position": "moving a camera",
    "lens": "another lens",
    "camera": "another camera",
}
"""What kinds of changes are called."""

LEAST_GAIN = 0.001  # share of what is hidden below which a move of what hides it is not worth a sentence
LEAST_SHOWN = 5e-4  # least share of a part in a list of several
MOST_PARTS = 3  # parts that a sentence names; the others count together

_INTERVAL = re.compile(r"\b(?:always|eventually)\[[^\]]*\]")

_TIME = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")


def summary(candidates: Sequence[CandidateResult], by: Criterion) -> str:
    """How many candidates can be done, and how they are ordered."""
    feasible = sum(one.feasible for one in candidates)
    order = f", {_CRITERION_WORDS[by]}" if feasible > 1 else ""
    return f"{feasible} of {len(candidates)} candidates can be done{order}"


def why_first(feasible: Sequence[CandidateResult], by: Criterion) -> str:
    """One sentence about why the first is first, and by how much: by the criterion, or by what broke the tie."""
    first = feasible[0]
    seen = []
    if first.q_eoi is not None:
        seen.append(f"the cameras see {100 * first.q_eoi:.1f} % of the events of interest")
    if first.q_avg is not None:
        seen.append(f"{100 * first.q_avg:.1f} % of all that must be seen")
    strengths = f"{' and '.join(seen) or 'nothing has to be seen'} in {first.time:.1f} s"
    if len(feasible) == 1:
        return f"{first.name} can be done: {strengths}."
    second = feasible[1]
    margin = f"{second.name} is as good"
    criteria: tuple[Criterion, ...] = (by, "q_avg", "time")
    for criterion in criteria:
        name = "delay_mean" if criterion == "delay" else criterion
        own, other = criterion_figure(first, criterion), criterion_figure(second, criterion)
        if own is None or other is None:
            continue
        if own < other == inf:
            margin = f"next comes {second.name}, of which a fault may never be noticed"
            break
        if shown_figure(name, own) != shown_figure(name, other):
            margin = f"next comes {second.name} with {FIGURE_NAMES[name]} {shown_figure(name, other)}"
            break
    return f"{first.name} is best: {strengths}; {margin}."


def differing_parameters(candidates: Sequence[CandidateResult]) -> list[str]:
    """Names of the parameters in which candidates differ; the first one if they are all the same."""
    words = [{**one.objects, **one.settings} for one in candidates]
    differing = [name for name in words[0] if len({each[name] for each in words}) > 1]
    return differing or list(words[0])[:1]


def part_shares_in_words(parts: Sequence[HidingPart]) -> str:
    """What each of several parts hides, the rest together: `forearm_link 40.2 %, tray 3.1 %, 2 others 0.4 %`.

    Without those that hide less than 0.05 %, save the first.
    """
    parts = [part for number, part in enumerate(parts) if number == 0 or part.share >= LEAST_SHOWN]
    shown, others = parts[:MOST_PARTS], parts[MOST_PARTS:]
    words = [f"{part.name} {100 * part.share:.1f} %" for part in shown]
    if others:
        words.append(f"{len(others)} other{'s' * (len(others) > 1)} {100 * sum(part.share for part in others):.1f} %")
    return ", ".join(words)


def what_to_move(found: Sequence[HidingPart]) -> str:
    """A sentence about the object to move first; empty if no move of one object would help."""
    if not found or found[0].alone < LEAST_GAIN:
        return ""
    first = found[0]
    return (
        f"Of the objects in the way, move {first.name} first: of what is hidden meanwhile, "
        f"{100 * first.alone:.1f} % would be seen without it."
    )


def accuracy(done: SamplingDone, feasible: Sequence[CandidateResult]) -> str:
    """One sentence about how finely the motions of candidates were sampled, and what that leaves open."""
    gap = done.max_gap or 0.0
    within = f"Q is within {_two_digits(min(max(100 * (done.error or 0.0), 0.001), 100.0))} points"
    if done.max_motion is not None:  # adaptive
        longest_gap = f"{_two_digits(ceil(round(1000 * gap, 3)))} ms"  # rounded up, as it is a bound
        missed = f", save for gains and losses of sight shorter than {longest_gap}; no longer one is missed"
        how = f"Sampled every {1000 * done.max_motion:.0f} mm" + (f" and {longest_gap}" if gap else "")
        return f"{how} or closer: {within}{missed if gap else ''}."
    if done.dt is None:
        how = f"Sampled {done.samples} times per primitive"
    else:
        # There are always samples where something begins or ends; with a long step, no others.
        longest = max(one.time or 0.0 for one in feasible)
        how = f"Sampled every {done.dt:g} s and" if done.dt < longest else "Sampled only"
        how += " where a primitive or formula begins or ends"
    # The bound covers the changes that were found: samples this far apart may miss others.
    apart = f"up to {_two_digits(gap)} s apart" if gap else "and nothing moves between"
    return f"{how}, {apart}: {within} if coverage changes at most once between two samples."


def short_times(text: str) -> str:
    """A text in which the times of formulas have two decimals."""
    return _INTERVAL.sub(lambda interval: _TIME.sub(lambda t: f"{float(t[0]):.2f}", interval[0]), text)


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
