"""The steps of a suggestion as a table."""

from __future__ import annotations

from collections.abc import Sequence

from sqrp_cli.cli.console import Column, Share, print_table, say
from sqrp_cli.programming.suggestion import SuggestedStep


def print_suggested(suggested: Sequence[SuggestedStep]) -> None:
    """What can be done so that a task gets done: a row per step, all of which are feasible."""
    say("\nIt can be done in these steps, each in its best way:\n")
    columns = [Column("#"), Column("step"), Column("Q_eoi [%]", right=True), Column("Q_avg [%]", right=True)]
    rows = [
        (str(number), step.task, Share(found.q_eoi), Share(found.q_avg), f"{found.time:.2f}")
        for number, step in enumerate(suggested, 1)
        if (found := step.assessment)
    ]
    print_table([*columns, Column("time [s]", right=True)], rows)
