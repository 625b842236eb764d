"""A step of a plan as the search finds it, `--json` prints it and tables read it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sqrp_cli.document import live
from sqrp_cli.figures import Qualities
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import World
    from sqrp_cli.study.result import CandidateResult
else:  # no file has them
    CandidateResult = World = Any


@dataclass(frozen=True, kw_only=True)
class PlannedStep(Qualities):
    """A step of a plan, in its best way."""

    task: str
    """Its text, such as `place g2 tray`."""
    action: str
    """A skill with its objects as planners write it, such as `place(g2, tray)`."""
    feasible: bool
    """Whether it can be done after the steps before it."""
    time: float | None
    """Duration of its motion [s]; null if it is infeasible."""
    reasons: list[str]
    """Why it is infeasible; empty if it is feasible."""

    world: World | None = live()
    """That it starts from; None if a step before it is infeasible."""
    result: CandidateResult | None = live()
    """Of its best candidate, or of the first if none is feasible."""
