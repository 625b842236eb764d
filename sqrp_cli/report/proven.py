"""What `sqrp rank --certify` proves, in words that terminal and pages share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.programming.coverage.certificate import Certificate
from sqrp_cli.programming.ranking import Criterion, Ranked, may_overtake
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds

LISTED = 6
"""Most undecided times of a candidate, and candidates, that are listed."""


def within(bounds: PoseBounds) -> str:
    """Where the proof holds."""
    reach = f"{1000 * bounds.position:g} mm and {np.degrees(bounds.rotation):g} deg"
    return f"wherever each camera is within {reach} of where it should be"


def between(least: float | None, most: float | None) -> str:
    """An interval of a quality, in per cent."""
    return "-" if least is None or most is None else f"{100 * least:.1f} to {100 * most:.1f}"


def stays_first(feasible: Sequence[Ranked], by: Criterion) -> str | None:
    """Whether the first place is proven; None if there is no other candidate."""
    name, rivals = feasible[0].assessment.candidate.name, may_overtake(feasible, by)
    if rivals:
        others = ", ".join(other.candidate.name for other in rivals[:LISTED])
        more = f" and {len(rivals) - LISTED} more" if len(rivals) > LISTED else ""
        return f"Not proven: that {name} stays before {others}{more}."
    return f"{name} stays the first, whatever the poses." if len(feasible) > 1 else None


def undecided(first: Ranked, certificate: Certificate) -> str | None:
    """When a candidate is undecided for so long that it shows; None if never."""
    long = [one for one in certificate.undecided if f"{one.start:.2f}" != f"{one.end:.2f}"]
    return f"{first.assessment.candidate.name} is undecided {_times(long)}." if long else None


def proven(bounds: PoseBounds, feasible: Sequence[Ranked], by: Criterion) -> str:
    """All of it, of the first candidates."""
    known = [(one, one.assessment.certificate) for one in feasible if one.assessment.certificate is not None]
    figures = "; ".join(
        f"{one.assessment.candidate.name}: Q_eoi {between(found.least.q_eoi, found.most.q_eoi)} %, "
        f"Q_avg {between(found.least.q_avg, found.most.q_avg)} %"
        for one, found in known[:LISTED]
    )
    words = [f"{figures}, {within(bounds)}.", stays_first(feasible, by), *(undecided(*one) for one in known[:1])]
    return " ".join(filter(None, words))


def _times(stretches: Sequence[Stretch]) -> str:
    """The longest of them, in the order of time."""
    longest = sorted(sorted(stretches, key=lambda stretch: -stretch.length)[:LISTED])
    shown = ", ".join(f"{stretch.start:.2f} to {stretch.end:.2f} s" for stretch in longest)
    left = len(stretches) - len(longest)
    return f"from {shown}" + (f", and {left} times more" if left else "")
