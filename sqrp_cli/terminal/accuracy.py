"""How exact the figures of a ranking or of an explanation are, in a sentence."""

from __future__ import annotations

from collections.abc import Sequence

from sqrp_cli.programming.coverage.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.programming.ranking import Ranked


def accuracy(sampling: Sampling, feasible: Sequence[Ranked]) -> str:
    """One sentence about how finely motions were sampled, and what that leaves open."""
    error = max(ranked.assessment.error or 0.0 for ranked in feasible)
    gap = max(ranked.assessment.largest_gap or 0.0 for ranked in feasible)
    within = f"Q is within {_two_digits(min(max(100 * error, 0.001), 100.0))} points"
    match sampling:
        case Adaptive():
            missed = f", save for events shorter than {_two_digits(gap)} s" if gap else ""
            return f"Sampled every {1000 * MAX_MOTION:.0f} mm of motion or closer: {within}{missed}."
        case FixedCount(samples):
            how = f"Sampled {samples} times per primitive"
        case FixedStep(dt):
            # Whatever the step, there are samples where something begins or ends; a long one gives no others.
            longest = max(ranked.assessment.time or 0.0 for ranked in feasible)
            how = f"Sampled every {dt:g} s and" if dt < longest else "Sampled only"
            how += " where a primitive or formula begins or ends"
    # The bound is that of the changes that were found: such samples may be so far apart that others are missed.
    return f"{how}, up to {_two_digits(gap)} s apart: {within} if coverage changes at most once between two samples."


def _two_digits(value: float) -> str:
    return f"{value:.2g}" if value < 10 else f"{value:.0f}"
