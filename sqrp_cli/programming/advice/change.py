"""A change of a cell or of a motion in it, and what comes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sqrp_cli.errors import bad_option, expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.settings import MotionValue
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.result import CandidateResult

Kind = Literal["way", "path", "object", "aim", "position", "lens", "camera"]
Unit = Literal["m", "rad", "camera", ""]
"""Of the size of a change; empty where there is nothing to measure."""

KINDS: tuple[Kind, ...] = ("way", "path", "object", "aim", "position", "lens", "camera")
"""In the order in which they are thought of: the motion first, then what it handles, cameras last."""

MOTION: tuple[Kind, ...] = ("way", "path")
"""Those that change nothing in the cell."""

CAMERAS: tuple[Kind, ...] = ("aim", "position", "lens", "camera")
"""Those that change its cameras."""


def read_kinds(names: Sequence[str] | None) -> tuple[Kind, ...] | None:
    """The kinds of these names, in their own order; None for None. Raises InputError for another name."""
    for name in names or ():
        if name not in KINDS:
            raise bad_option(f"there is no kind of change `{name}`; {expected_names(name, KINDS)}")
    return None if names is None else tuple(kind for kind in KINDS if kind in names)


@dataclass(frozen=True, eq=False, kw_only=True)
class ProposedChange:
    """One change of a cell or a motion."""

    kind: Kind
    target: str
    """The candidate, object or camera that it is about."""
    values: tuple[float, ...] = ()
    """What changes: metres along x, y, z; angles to the right and up in the image, or of the view [rad]."""
    size: float
    """How large it is, in `unit`."""
    unit: Unit
    turn: float = 0.0
    """Angle between the optical axes before and after it [rad], of a camera that is moved or turned."""
    like: str = ""
    """Of a further camera: the one whose lens and sensing it has."""
    camera: Camera | None = None
    """As it then is."""
    aim: Aim | None = None
    """What it then looks at."""
    X_WO: Array | None = None
    """Where the object then is, shape (4, 4)."""
    parameters: Mapping[str, MotionValue] | None = None
    """Of the way."""
    said: str = ""
    """The way in a few words, such as `left, flipped`."""
    unwritten: str = ""
    """Why no workspace file says it; empty if one can."""

    def in_cell(self, cell: Cell) -> Cell:
        """The cell with it, as far as cameras are concerned; motions stay the same."""
        if self.camera is None:
            return cell
        cameras = {**cell.workspace.cameras, self.camera.name: self.camera}
        return cell.seen_by(replace(cell.workspace, cameras=cameras))

    def in_world(self, world: World) -> World:
        """The world with it."""
        return world if self.X_WO is None else replace(world, X_WO={**world.X_WO, self.target: self.X_WO})


@dataclass(frozen=True)
class Margin:
    """How much less, and more, of a change along the same direction still meets the wish, in its unit."""

    less: float
    more: float


@dataclass(frozen=True, eq=False, kw_only=True)
class CandidateEffect:
    """A candidate of a task before and after a change."""

    before: CandidateResult
    after: CandidateResult

    @property
    def worse(self) -> tuple[str, ...]:
        """The figures that get worse by as much as rankings tell apart; `feasible` if it can no longer be done."""
        if self.before.feasible and not self.after.feasible:
            return ("feasible",)
        return tuple(name for name, sign, step in _COMPARED if _worse(self.before, self.after, name, sign, step))

    @property
    def changed(self) -> bool:
        """Whether any figure gets better or worse."""
        return bool(self.worse or CandidateEffect(before=self.after, after=self.before).worse)


@dataclass(frozen=True, eq=False, kw_only=True)
class EffectOnTask:
    """What a change does to a task."""

    task: str
    candidates: tuple[CandidateEffect, ...]
    """In the order of the task."""

    @property
    def first_before(self) -> CandidateResult | None:
        """The first-ranked candidate without the change; None if none can be done."""
        return _first([one.before for one in self.candidates])

    @property
    def first_after(self) -> CandidateResult | None:
        """The same with the change."""
        return _first([one.after for one in self.candidates])

    @property
    def worse(self) -> tuple[CandidateEffect, ...]:
        """The candidates that get worse in a figure."""
        return tuple(one for one in self.candidates if one.worse)


def _first(assessments: Sequence[CandidateResult]) -> CandidateResult | None:
    ranking = rank(assessments, "q_eoi")
    return ranking[0] if ranking and ranking[0].rank is not None else None


_COMPARED = (("q_eoi", 1.0, 1e-3), ("q_avg", 1.0, 1e-3), ("time", -1.0, 0.01), ("delay_worst", -1.0, 0.01))
"""Figures that are compared, whether more is better, and what counts as a difference, as in rankings and sweeps."""


def _worse(before: CandidateResult, after: CandidateResult, name: str, sign: float, step: float) -> bool:
    old, new = (one.latest if name == "delay_worst" else getattr(one, name) for one in (before, after))
    if old is None or new is None:
        return False
    return bool(np.round(sign * new / step) < np.round(sign * old / step))


@dataclass(frozen=True, eq=False, kw_only=True)
class Advice:
    """A change that meets the wish."""

    change: ProposedChange
    found: CandidateResult
    """The candidate with it."""
    margin: Margin | None
    """None where there is nothing to measure."""
    effects: tuple[EffectOnTask, ...] = ()
    """On every task of the workspace."""

    @property
    def worse(self) -> tuple[str, ...]:
        """The tasks in which a candidate gets worse in a figure."""
        return tuple(effect.task for effect in self.effects if effect.worse)


@dataclass(frozen=True, eq=False, kw_only=True)
class Miss:
    """A kind of change that does not meet the wish."""

    kind: Kind
    why: str
    """Why not, or why it was not tried."""
    tried: bool = True
    nearest: ProposedChange | None = None
    """What comes nearest, if anything was tried."""
    found: CandidateResult | None = None
    """The candidate with that."""
    limit: str = ""
    """Which limit then stands in the way, in a sentence."""
    nearer: bool = False
    """Whether that comes nearer to the wish than what it starts from."""
