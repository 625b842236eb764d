"""Lines about candidates that cannot be done: each reason once, with all whom it concerns."""

from __future__ import annotations

import re
from collections.abc import Iterable

from sqrp_cli.programming.candidate import Candidate
from sqrp_cli.terminal.console import joined, say

NAMED = 3
"""Most choices of objects that a line names."""


def print_infeasible(found: Iterable[tuple[Candidate, str]]) -> None:
    """A line for each reason; candidates share one if theirs differ in nothing but their own objects."""
    groups: dict[str, list[tuple[Candidate, str]]] = {}
    for candidate, reason in found:
        groups.setdefault(_in_general(candidate, reason), []).append((candidate, reason))
    for group in groups.values():
        say(joined([("infeasible ", "red"), f"{_who([candidate for candidate, _ in group])}: {group[0][1]}"]), indent=2)


def _in_general(candidate: Candidate, reason: str) -> str:
    """A reason with a candidate's objects replaced by the parameters that they stand for."""
    for parameter, name in candidate.binding.items():
        reason = re.sub(rf"(?<![\w-]){re.escape(name)}(?![\w-])", f"<{parameter}>", reason)
    return reason


def _who(candidates: list[Candidate]) -> str:
    if len(candidates) == 1:
        return candidates[0].name
    objects = list(dict.fromkeys(" ".join(candidate.binding.values()) for candidate in candidates))
    named = ", ".join(objects[:NAMED]) + (f" and {len(objects) - NAMED} more" if len(objects) > NAMED else "")
    return named if len(candidates) == len(objects) else f"{named}, {len(candidates)} candidates"
