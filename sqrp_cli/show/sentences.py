"""Sentences that terminal and pages share: what was ranked, how exactly, and why a run stopped."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import TYPE_CHECKING

from sqrp_cli.figures import LATE
from sqrp_cli.study.result import CandidateResult, Criterion, SamplingDone

if TYPE_CHECKING:
    from sqrp_cli.search.goal import Kind
    from sqrp_cli.sight.limits import HidingPart


_CRITERION_WORDS: dict[Criterion, str] = {
    "q_eoi": "what is seen best first",
    "q_avg": "what is seen longest first",
    "time": "fastest first",
    "delay": "what is noticed soonest first",
    "expected_time": "soonest done after a retry first",
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
MOST_PARTS = 3  # things that a sentence names; the others count together


def summary(candidates: Sequence[CandidateResult], by: Criterion, *, worst: bool = False) -> str:
    """How many candidates can be done, and how they are ordered."""
    feasible = sum(one.feasible for one in candidates)
    order = f", {_CRITERION_WORDS[by]}{', from the end' * worst}" if feasible > 1 else ""
    if any(one.phases for one in candidates):
        return f"{feasible} of {len(candidates)} episodes can be judged{order}"
    return f"{feasible} of {len(candidates)} candidates can be done{order}"


def first_answer(first: CandidateResult, *, worst: bool = False) -> str:
    """What to do, and what that means; of the episodes of a recording, which is seen best, or worst."""
    if first.phases:
        return f"{first.name[0].upper()}{first.name[1:]} is seen {'worst' if worst else 'best'}: {what_it_means(first)}"
    return f"Take {first.name}: {what_it_means(first)}"


def what_it_means(found: CandidateResult) -> str:
    """How soon the worst fault of a candidate is noticed, and how long it takes; without faults, what is seen."""
    said, again = "nothing has to be seen", ""
    worst = found.faults
    if worst:
        fault = max(worst, key=lambda name: (worst[name].unseen, worst[name].delay_worst or 0.0))
        said = noticed(found, fault)
        said += "; of other faults you know sooner" if len(worst) > 1 and not worst[fault].unseen else ""
        if fault in found.retried and (done := worst[fault].expected_time) is not None:
            again = f", and {done:.1f} s when it has to be done again"
    elif found.q_avg is not None:
        said = f"the cameras see what they must for {100 * found.q_avg:.1f} % of the time"
    return f"{said}; it takes {found.time:.1f} s{again}."


def noticed(found: CandidateResult, fault: str) -> str:
    """How soon a fault is noticed: `if it slips, you know after 0.13 s, at the latest after 0.52 s`."""
    cost, said = found.faults[fault], f"if {found.happening(fault)}, "
    if cost.unseen:
        known = "" if cost.delay_mean is None else f", else after {cost.delay_mean:.2f} s"
        return f"{said}you never know{in_cases(cost.unseen)}{known}"
    return f"{said}you know after {cost.delay_mean or 0.0:.2f} s, at the latest after {cost.delay_worst or 0.0:.2f} s"


def in_cases(share: float) -> str:
    """How often something is so: ` in 12 % of cases`; nothing where it always is."""
    return f" in {100 * share:.3g} % of cases" if share < 1.0 else ""


def never_noticed(candidates: Sequence[CandidateResult]) -> list[str]:
    """A sentence for each fault that may never be noticed, and why: `Never noticed if it slips (g3): closed ...`."""
    found: list[str] = []
    for fault in candidates[0].faults if candidates else ():
        lost = [one for one in candidates if one.faults[fault].unseen > 0]
        if lost:
            worst = max(lost, key=lambda one: one.faults[fault].unseen)
            cost, more = worst.faults[fault], f" and {len(lost) - 1} more" if len(lost) > 1 else ""
            said = f"{worst.happening(fault)}{f' ({worst.name}{more})' if len(candidates) > 1 else ''}"
            why = f": {cost.why.words}" if cost.why else ""
            found.append(f"Never noticed{in_cases(cost.unseen)} if {said}{why}.")
    return found


def noticed_late(found: CandidateResult) -> list[str]:
    """A sentence for each fault of a candidate that is noticed late, but surely: when it happens then, and why."""
    late = [(one.delay_worst, one.why) for one in found.faults.values()]
    return [
        f"It takes {worst:.2f} s if it happens at {why.at:.2f} s: {why.words}."
        for worst, why in late
        if worst is not None and worst > LATE and why is not None
    ]


def told(found: CandidateResult) -> list[str]:
    """What a feasible candidate means, and why its faults are noticed late or never: all but where it is not seen."""
    meaning = what_it_means(found)
    return [f"{meaning[0].upper()}{meaning[1:]}", *never_noticed([found]), *noticed_late(found)]


def differing_parameters(candidates: Sequence[CandidateResult]) -> list[str]:
    """Names of the parameters in which candidates differ; the first one if they are all the same."""
    words = [{**one.objects, **one.settings} for one in candidates]
    differing = [name for name in words[0] if len({each[name] for each in words}) > 1]
    return differing or list(words[0])[:1]


def part_shares_in_words(parts: Sequence[HidingPart]) -> str:
    """What each part hides, as `forearm_link 40.2 %, 2 others 0.4 %`; not those below 0.05 %, save the first."""
    parts = [part for number, part in enumerate(parts) if number == 0 or part.share >= LEAST_SHOWN]
    shown, others = parts[:MOST_PARTS], parts[MOST_PARTS:]
    words = [f"{part.name} {100 * part.share:.1f} %" for part in shown]
    if others:
        words.append(f"{len(others)} other{'s' * (len(others) > 1)} {100 * sum(part.share for part in others):.1f} %")
    return ", ".join(words)


def first_few(texts: Sequence[str], then: str = " and") -> str:
    """The first of some texts, and how many more there are; then: what comes before that number."""
    more = len(texts) - MOST_PARTS
    return ", ".join(texts[:MOST_PARTS]) + (f"{then} {more} more" if more > 0 else "")


def what_to_move(found: Sequence[HidingPart]) -> str:
    """A sentence about the object to move first; empty if no move of one object would help."""
    if not found or found[0].alone < LEAST_GAIN:
        return ""
    first = found[0]
    return (
        f"Of the objects in the way, move {first.name} first: of what is hidden meanwhile, "
        f"{100 * first.alone:.1f} % would be seen without it."
    )


def accuracy(done: SamplingDone, feasible: Sequence[CandidateResult], *, short: bool = False) -> str:
    """One sentence about how finely the motions of candidates were sampled, and what that leaves open; or a clause."""
    gap = done.max_gap or 0.0
    within = f"exact to {_two_digits(min(max(100 * (done.error or 0.0), 0.001), 100.0))} points"
    longest_gap = f"{_two_digits(ceil(round(1000 * gap, 3)))} ms"  # rounded up, as it is a bound
    if done.max_motion is not None:  # adaptive
        how = f"Sampled every {1000 * done.max_motion:.0f} mm" + (f" and {longest_gap}" if gap else "")
        if short:
            return f"{how}; {within}; -v says more."
        missed = f", save for what is seen or lost for less than {longest_gap}; nothing longer is missed"
        return f"{how} or closer: shares of time are {within}{missed if gap else ''}."
    if done.dt is None:
        how = f"Sampled {done.samples} times per piece of motion"
    else:
        # There are always samples where something begins or ends; with a long step, no others.
        longest = max(one.time or 0.0 for one in feasible)
        how = f"Sampled every {done.dt:g} s and" if done.dt < longest else "Sampled only"
        how += " where a piece of motion or a formula begins or ends"
    # The bound covers the changes that were found: samples this far apart may miss others.
    apart = f"up to {_two_digits(gap)} s apart" if gap else "and nothing moves between"
    return f"{how}, {apart}: {within} if what is seen changes at most once between two samples."


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
