"""What the process that computes is asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqrp_cli.studio.moves import Move

if TYPE_CHECKING:
    from sqrp_cli.programming.ranking import Criterion


@dataclass(frozen=True, kw_only=True)
class Rank:
    """To rank a task in the cell of a text."""

    content: bytes
    """Of the workspace file."""
    task: str
    by: Criterion
    number: int
    """Of the question; answers carry it."""
    of_saved: bool = False
    """Whether only figures are wanted, to compare others with."""


@dataclass(frozen=True, kw_only=True)
class Choose:
    """To show a candidate over time."""

    name: str


@dataclass(frozen=True, kw_only=True)
class Hold:
    """To sketch the chosen candidate while a hand holds something."""

    move: Move
    number: int


Question = Rank | Choose | Hold
