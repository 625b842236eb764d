"""What `sqrp place` finds in words, for terminal and page: a goal that is missed, what was compared, and the proof."""

from __future__ import annotations

from typing import NamedTuple

from sqrp_cli.figures import named_figures
from sqrp_cli.search.placing_result import ROUNDED, PlaceDocument, count_in_words


class PlacementWords(NamedTuple):
    """Sentences about a placement; each is empty where there is nothing to say."""

    put: str  # Where to put cameras, and what is then seen
    unmet: str  # That the goal cannot be met, and what is shown instead; empty, too, if nothing can be chosen at all
    comparison: str  # What was compared, in numbers, without a full stop
    moves: str  # By how much the chosen cameras were moved from their mounts
    other_ways: str  # Which candidates `rank` does in another way in the patched workspace, with other figures
    scope: str  # What the proof is about, or why there is none


def placement_in_words(found: PlaceDocument) -> PlacementWords:
    """The sentences about a placement."""
    goal, put, unmet, scope = found.want, "", "", ""
    if found.met or found.reason or not str(goal):
        places = " and ".join(f"camera `{one.name}` at {one.mount}" for one in found.cameras)
        least, share = found.by == "least", f"{100 * found.objective:.1f} % of the time"
        share = f"at least {share}" if least and found.objective < 1.0 - ROUNDED else share
        what = "what matters is then seen"
        if least and len(found.candidates) > 1:
            what = "whichever candidate you take, what matters is seen"
        seen = f": {what} {share}{'' if least else ' on average'}"
        put = places and f"Put {places}{seen if found.objective > 0.0 else ''}."
    elif goal.delay is not None and goal.delay < found.quickest:
        unmet = (
            f"No choice of these mounts meets the goal ({goal}): a frame and the latency of the fastest camera take "
            f"{found.quickest:.2g} s, and tool and part have to part before. The nearest is below."
        )
    elif found.fewest:
        unmet = f"So many cameras do not meet the goal ({goal}); take {count_in_words(found.fewest)}:"
    elif found.too_slow:
        unmet = f"Not every candidate can be done within {goal.time:.4g} s, whatever the cameras."
    elif not found.proven:
        unmet = f"No choice that meets the goal ({goal}) was found; that none does is not proven. The nearest is below."
    else:
        best = "The best whatever the delay" if goal.delay is not None else "The nearest"
        unmet = f"No choice of these mounts meets the goal ({goal}). {best} is below."

    one = found.compared
    counts = (one.mounts, "mount"), (one.options, "pose"), (one.ways, "way"), (one.samples, "sample")
    mounts, poses, ways, samples = (f"{count:,} {what}{'' if count == 1 else 's'}" for count, what in counts)
    blocked = f" ({one.in_the_way} in the way)" if one.in_the_way else ""
    moved = ", ".join(f"{one.name} {100 * one.moved:.1f} cm" for one in found.cameras if one.moved)
    others = [
        f"{other.candidate} ({', '.join(named_figures(other.ranked, 'q_eoi', 'q_avg'))})"
        for other in found.candidates
        if other.ranked is not None
    ]

    if found.interrupted and found.proven:
        scope = "Interrupted once that was proven: no camera was moved between places, nor was one less looked at."
    elif found.interrupted:
        scope = "Interrupted: the best so far." if found.cameras else "Interrupted: nothing was found yet."
    elif found.proven and not found.reason:
        scope = "The proof is about these mounts and ways; the figures are exact, between the samples, too."
    elif not found.reason:
        scope = "Not proven to be the best: the search ended before its proof."
    moves = f"Cameras were then moved between the places ({moved}); the figures of the candidates are for that."
    rest = f"In the patched workspace, `rank` takes another way of {', '.join(others)}." if others else ""
    comparison = f"{mounts}{blocked}, {poses} with lenses, {ways}, {samples}"
    return PlacementWords(put, unmet, comparison, moves if moved else "", rest, scope)
