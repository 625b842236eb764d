"""What `sqrp rank --certify` proves, as a table with sentences."""

from __future__ import annotations

from collections.abc import Sequence

from sqrp_cli.programming.coverage.certificate import Certificate
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import bisection_error
from sqrp_cli.programming.ranking import Criterion, Ranked
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.report.proven import between, stays_first, undecided, within
from sqrp_cli.terminal.console import Column, print_table, say


def print_certificate(
    bounds: PoseBounds | None, sampling: Sampling, feasible: Sequence[Ranked], shown: Sequence[Ranked], by: Criterion
) -> None:
    """What is proven of the qualities and of the first place within bounds of the camera poses, if it was asked for.

    shown: those of the feasible candidates, with the first, that have a row.
    """
    proven = [(one, one.assessment.certificate) for one in shown if one.assessment.certificate is not None]
    if bounds is None or not proven:
        return
    say(f"\nProven {within(bounds)}:")
    rows = [
        (
            one.assessment.candidate.name,
            between(found.least.q_eoi, found.most.q_eoi),
            between(found.least.q_avg, found.most.q_avg),
            f"{sum(stretch.length for stretch in found.undecided):.2f}",
        )
        for one, found in proven
    ]
    titles = ("Q_eoi [%]", "Q_avg [%]", "undecided [s]")
    print_table([Column(""), *(Column(title, right=True) for title in titles)], rows)
    error = bisection_error(sampling)
    if error and any(_is_open(one) for _, one in proven):
        say(f"Both ends allow for {100 * error:g} points that bisection may leave.")
    for sentence in (stays_first(feasible, by), undecided(*proven[0])):
        if sentence is not None:
            say(sentence)


def _is_open(certificate: Certificate) -> bool:
    """Whether a quality is neither proven to be all nor nothing."""
    least, most = certificate.least, certificate.most
    return any(one != other for one, other in ((least.q_eoi, most.q_eoi), (least.q_avg, most.q_avg)))
