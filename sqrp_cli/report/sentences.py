"""Sentences that terminal and pages share: what was ranked, how exactly, and why a run stopped."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import ceil, degrees, inf
from typing import TYPE_CHECKING

from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.programming.ranking import Criterion, Ranked, criterion_figure
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.grips import choice_in_words

if TYPE_CHECKING:
    from sqrp_cli.programming.advice.change import Kind, ProposedChange
    from sqrp_cli.programming.coverage.in_the_way import ObjectToMove
    from sqrp_cli.programming.sensing.observer import Occluder


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

_SHOWN: dict[Criterion, tuple[str, float, str]] = {
    "q_eoi": ("Q_eoi", 100.0, "{:.1f} %"),
    "q_avg": ("Q_avg", 100.0, "{:.1f} %"),
    "time": ("a time of", 1.0, "{:.2f} s"),
    "delay": ("a mean delay of", 1.0, "{:.2f} s"),
    "expected_time": ("all done at", 1.0, "{:.1f} s"),
}
"""Name, scale and format of each criterion's figure."""

LEAST_GAIN = 0.001
"""Share of what is hidden below which a move of what hides it is not worth a sentence."""

LEAST_SHOWN = 5e-4
"""Least share of a part in a list of several."""

MOST_PARTS = 3
"""Parts that a sentence names; the others count together."""

_INTERVAL = re.compile(r"\b(?:always|eventually)\[[^\]]*\]")

_TIME = re.compile(r"(?<![\w.])\d+(?:\.\d+)?(?:e-?\d+)?(?!\w)")


def summary(ranking: Sequence[Ranked], by: Criterion) -> str:
    """How many candidates can be done, and how they are ordered."""
    feasible = sum(ranked.rank is not None for ranked in ranking)
    order = f", {_CRITERION_WORDS[by]}" if feasible > 1 else ""
    return f"{feasible} of {len(ranking)} candidates can be done{order}"


def why_first(feasible: Sequence[Ranked], by: Criterion) -> str:
    """One sentence about why the first is first."""
    first = feasible[0].assessment
    name = first.candidate.name
    if len(feasible) == 1:
        return f"{name} can be done: {_strengths(first)}."
    second = feasible[1].assessment
    margin = _margin(first, second, by)
    return f"{name} is best: {_strengths(first)}; {margin}."


def _strengths(assessment: Assessment) -> str:
    parts = []
    if assessment.q_eoi is not None:
        parts.append(f"the cameras see {100 * assessment.q_eoi:.1f} % of the events of interest")
    if assessment.q_avg is not None:
        parts.append(f"{100 * assessment.q_avg:.1f} % of all that must be seen")
    seen = " and ".join(parts) or "nothing has to be seen"
    return f"{seen} in {assessment.time:.1f} s"


def _margin(first: Assessment, second: Assessment, by: Criterion) -> str:
    """The first compared with the second, by the criterion or by what broke the tie."""
    rival = second.candidate.name
    for criterion in (by, "q_avg", "time"):
        own, other = criterion_figure(first, criterion), criterion_figure(second, criterion)
        if own is None or other is None:
            continue
        label, scale, pattern = _SHOWN[criterion]
        if own < other == inf:
            return f"next comes {rival}, of which a fault may never be noticed"
        if pattern.format(scale * own) != pattern.format(scale * other):
            return f"next comes {rival} with {label} {pattern.format(scale * other)}"
    return f"{rival} is as good"


def differing_parameters(candidates: Sequence[Candidate]) -> list[str]:
    """Names of the parameters in which candidates differ; the first one if they are all the same."""
    names = list(candidates[0].all_parameters)
    differing = [name for name in names if len({candidate.all_parameters[name] for candidate in candidates}) > 1]
    return differing or names[:1]


def way_of(assessment: Assessment) -> str:
    """The way behind the figures of a candidate, in a few words."""
    return choice_in_words(assessment.candidate, assessment.way)


def reasons_by_doing(assessment: Assessment) -> list[str]:
    """Why a candidate is infeasible; an action is called by what it does, as in `approach (a1) to above: too far`."""
    does = {one.name: f"{one.words} ({one.name})" for one in assessment.candidate.skill.primitives}
    return [re.sub(r"^\w+(?=:| to )", lambda name: does.get(name[0], name[0]), one) for one in assessment.reasons]


def part_shares_in_words(parts: Sequence[Occluder]) -> str:
    """What each of several parts hides, the rest together: `forearm_link 40.2 %, tray 3.1 %, 2 others 0.4 %`.

    Without those that hide less than 0.05 %, save the first.
    """
    parts = [part for number, part in enumerate(parts) if number == 0 or part.share >= LEAST_SHOWN]
    shown, others = parts[:MOST_PARTS], parts[MOST_PARTS:]
    words = [f"{part.name} {100 * part.share:.1f} %" for part in shown]
    if others:
        words.append(f"{len(others)} other{'s' * (len(others) > 1)} {100 * sum(part.share for part in others):.1f} %")
    return ", ".join(words)


def what_to_move(found: Sequence[ObjectToMove]) -> str:
    """A sentence about the object to move first; empty if no move of one object would help."""
    if not found or found[0].alone < LEAST_GAIN:
        return ""
    first = found[0]
    return (
        f"Of the objects in the way, move {first.name} first: of what is hidden meanwhile, "
        f"{100 * first.alone:.1f} % would be seen without it."
    )


def accuracy(sampling: Sampling, feasible: Sequence[Ranked]) -> str:
    """One sentence about how finely motions were sampled, and what that leaves open."""
    error = max(ranked.assessment.error or 0.0 for ranked in feasible)
    gap = max(ranked.assessment.largest_gap or 0.0 for ranked in feasible)
    within = f"Q is within {_two_digits(min(max(100 * error, 0.001), 100.0))} points"
    match sampling:
        case Adaptive():
            # Rounded up, as it is a bound.
            longest_gap = f"{_two_digits(ceil(round(1000 * gap, 3)))} ms"
            missed = f", save for gains and losses of sight shorter than {longest_gap}; no longer one is missed"
            how = f"Sampled every {1000 * MAX_MOTION:.0f} mm" + (f" and {longest_gap}" if gap else "")
            return f"{how} or closer: {within}{missed if gap else ''}."
        case FixedCount(samples):
            how = f"Sampled {samples} times per primitive"
        case FixedStep(dt):
            # There are always samples where something begins or ends; with a long step, no others.
            longest = max(ranked.assessment.time or 0.0 for ranked in feasible)
            how = f"Sampled every {dt:g} s and" if dt < longest else "Sampled only"
            how += " where a primitive or formula begins or ends"
    # The bound covers the changes that were found: samples this far apart may miss others.
    apart = f"up to {_two_digits(gap)} s apart" if gap else "and nothing moves between"
    return f"{how}, {apart}: {within} if coverage changes at most once between two samples."


def short_times(text: str) -> str:
    """A text in which the times of formulas have two decimals."""
    return _INTERVAL.sub(lambda interval: _TIME.sub(lambda t: f"{float(t[0]):.2f}", interval[0]), text)


def change_in_words(change: ProposedChange) -> str:
    """A change as an instruction, such as `move cam1 10.9 cm, mostly -z, and turn it 5.2 deg`."""
    size, values = shown_size(change.size, change.unit), change.values
    match change.kind:
        case "way" | "path":
            return f"do {change.target} {change.said}"
        case "aim":
            return f"turn {change.target} {size}, {_mostly(values, ('right', 'up'), ('left', 'down'))}"
        case "lens":
            return f"{'widen' if values[0] > 0 else 'narrow'} the view of {change.target} by {size}"
        case "camera":
            return f"add {change.target} at {', '.join(f'{value:z.2f}' for value in values)} m"
        case _:
            turn = f", and turn it {shown_size(change.turn, 'rad')}" if change.turn else ""
            return f"move {change.target} {size}, {_mostly(values, ('+x', '+y', '+z'), ('-x', '-y', '-z'))}{turn}"


def shown_size(size: float, unit: str) -> str:
    """A size as people say it: centimetres or degrees."""
    match unit:
        case "m":
            return f"{100 * size:.1f} cm" if size < 1 else f"{size:.2f} m"
        case "rad":
            return f"{degrees(size):.1f} deg"
        case _:
            return ""


def _mostly(values: Sequence[float], forward: Sequence[str], back: Sequence[str]) -> str:
    axis = max(range(len(values)), key=lambda index: abs(values[index]))
    length = sum(value * value for value in values) ** 0.5
    word = (forward if values[axis] > 0 else back)[axis]
    return word if abs(values[axis]) > 0.98 * length else f"mostly {word}"


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
