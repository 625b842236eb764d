"""A step of a plan, and a candidate that was checked: as they are found, `--json` prints them and tables read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from sqrp_cli.document import Record, live
from sqrp_cli.figures import Qualities
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import World
    from sqrp_cli.study.result import CandidateResult
    from sqrp_cli.task.candidate import Candidate
else:  # no file has them
    Candidate = CandidateResult = World = Any


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


@dataclass(frozen=True, kw_only=True)
class CheckedCandidate(Record):
    """Whether a candidate can be done."""

    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    feasible: bool
    """Whether it can be done at once: its precondition holds, and the robot can make its motion."""
    reasons: list[str]
    """Why it is infeasible, most useful first."""
    time: float | None
    """Duration of its motion, with the first grip that works, in the fastest branch [s]; null if it is infeasible."""
    plan: list[PlannedStep] | None
    """What has to be done first; empty if nothing, null if no plan was found."""
    last: PlannedStep | None
    """The candidate itself, after that; null if nothing has to be done first, or no plan was found. It has no figures
    where more than 20 candidates were asked about."""
    planning: str
    """How planning ended."""
    name: str
    """What sets it apart among the candidates of its task."""
    objects: Mapping[str, str]
    """The object of each parameter that stands for one."""
    remarks: tuple[str, ...]
    """Detours and speeds that are not reached."""
    advice: str
    """What would have to be done first, or why nothing would help, in words; empty if nothing has to be."""

    candidate: Candidate = live()
    outside: tuple[tuple[int, int], ...] = live(())
    """The temporal operators that are never checked, see `grounding.formulas_outside`."""
