"""Which candidate `--choose` means."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqrp_cli.errors import InputError, Problem, expected_names

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sqrp_cli.programming.ranking import Ranked
    from sqrp_cli.programming.task import Task


def check_choice(task: Task, choice: str) -> None:
    """Raises InputError for a name that no candidate has, before any of them is computed."""
    names = [candidate.name for candidate in task.candidates]
    if choice != "best" and not any(_is_meant(name, choice) for name in names):
        message = f"there is no candidate `{choice}`; {expected_names(choice, names)}"
        raise InputError(Problem("unknown-candidate", message))


def choose_candidate(ranking: Sequence[Ranked], choice: str) -> Ranked:
    """The candidate that `best` or a name stands for: the first in the ranking whose name has all its words."""
    if choice == "best":
        return ranking[0]
    return next(ranked for ranked in ranking if _is_meant(ranked.assessment.candidate.name, choice))


def _is_meant(name: str, choice: str) -> bool:
    words = set(choice.split())
    return bool(words) and words <= set(name.split())
