"""What `sqrp rank --certify` proves, as a table with sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.programming.coverage.certificate import Certificate
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import bisection_error
from sqrp_cli.programming.ranking import Criterion, Ranked, may_overtake
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.terminal.console import Column, print_table, say

_LISTED = 6
"""Most undecided times of a candidate, and candidates that may be first, that are listed."""


def print_certificate(
    bounds: PoseBounds | None, sampling: Sampling, feasible: Sequence[Ranked], shown: Sequence[Ranked], by: Criterion
) -> None:
    """What is proven of the qualities and of the first place within bounds of the camera poses, if it was asked for.

    shown: those of the feasible candidates, with the first, that have a row.
    """
    proven = [(one, one.assessment.certificate) for one in shown if one.assessment.certificate is not None]
    if bounds is None or not proven:
        return
    within = f"{1000 * bounds.position:g} mm and {np.degrees(bounds.rotation):g} deg"
    say(f"\nProven wherever each camera is within {within} of where it should be:")
    rows = [
        (
            one.assessment.candidate.name,
            _between(found.least.q_eoi, found.most.q_eoi),
            _between(found.least.q_avg, found.most.q_avg),
            f"{sum(stretch.length for stretch in found.undecided):.2f}",
        )
        for one, found in proven
    ]
    titles = ("Q_eoi [%]", "Q_avg [%]", "undecided [s]")
    print_table([Column(""), *(Column(title, right=True) for title in titles)], rows)
    error = bisection_error(sampling)
    if error and any(_is_open(one) for _, one in proven):
        say(f"Both ends allow for {100 * error:g} points that bisection may leave.")
    first, certificate = proven[0]
    name, rivals = first.assessment.candidate.name, may_overtake(feasible, by)
    if rivals:
        others = ", ".join(other.candidate.name for other in rivals[:_LISTED])
        more = f" and {len(rivals) - _LISTED} more" if len(rivals) > _LISTED else ""
        say(f"Not proven: that {name} stays before {others}{more}.")
    elif len(feasible) > 1:
        say(f"{name} stays the first, whatever the poses.")
    undecided = [one for one in certificate.undecided if f"{one.start:.2f}" != f"{one.end:.2f}"]
    if undecided:
        say(f"{name} is undecided {_times(undecided)}.")


def _is_open(certificate: Certificate) -> bool:
    """Whether a quality is neither proven to be all nor nothing."""
    least, most = certificate.least, certificate.most
    return any(one != other for one, other in ((least.q_eoi, most.q_eoi), (least.q_avg, most.q_avg)))


def _between(least: float | None, most: float | None) -> str:
    return "-" if least is None or most is None else f"{100 * least:.1f} to {100 * most:.1f}"


def _times(stretches: Sequence[Stretch]) -> str:
    """The longest of them, in the order of time."""
    longest = sorted(sorted(stretches, key=lambda stretch: -stretch.length)[:_LISTED])
    shown = ", ".join(f"{stretch.start:.2f} to {stretch.end:.2f} s" for stretch in longest)
    left = len(stretches) - len(longest)
    return f"from {shown}" + (f", and {left} times more" if left else "")
