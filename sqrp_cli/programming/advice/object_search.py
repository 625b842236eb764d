"""The least move of an object on what it stands on that meets a wish; the motion is planned again for each."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, box_corners, read_only, transform
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.advice.camera_moves import whole
from sqrp_cli.programming.advice.change import Margin, Miss, ProposedChange
from sqrp_cli.programming.advice.least import least_beyond
from sqrp_cli.programming.advice.question import Found, Met, Near, Question, finely_met
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study, with_delays
from sqrp_cli.programming.coverage.in_the_way import hidden_views, to_move
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_study import WholeStudy, qualities_of, whole_study, whole_watched

MOST_OBJECTS = 3
"""Objects that are moved: those that are handled, then those that hide most."""

_RADII = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Distances that are tried in all directions [m]."""

_DIRECTIONS = 12
"""Directions that are tried at each distance."""

_RESOLUTION = 2e-3
"""How exactly the least distance in a direction is found [m]."""

_TURNS = np.radians([-40.0, -20.0, 20.0, 40.0])
"""Other directions that are tried where one works."""

_SHORTER = 0.9
"""Share of the least distance so far at which these are tried."""


@dataclass(frozen=True, eq=False)
class ObjectSearch:
    """Moves one object about."""

    question: Question
    way: Candidate
    name: str
    """Of the object."""

    def least(self) -> Met | None:
        """The least move that meets the wish: rings outward, then shorter and to the sides."""
        for radius in _RADII:
            for angle in np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS):
                met = self._decide(radius * _direction(angle))
                if met is not None:
                    return self._confirmed(self._refined(met))
        return None

    def margin(self, change: ProposedChange) -> Margin:
        """How much less and how much more of a move in the same direction meets the wish."""
        unit, more = np.array(change.values[:2]) / change.size, 0.0
        for step in (0.01, 0.02, 0.05, 0.1, 0.2):
            if self._decide((change.size + step) * unit) is None:
                break
            more = step
        return Margin(less=0.0, more=more)

    def nearest(self) -> Near | None:
        """Of moves by some centimetres, the one that misses the wish by least."""
        found: list[Near] = []
        for angle in np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS):
            change = self._change(_RADII[3] * _direction(angle))
            done = self._study(change)
            found += [] if done is None else [Near(change, done)]
        return min(found, key=lambda near: self.question.wish.shortfall(near.study.assessment), default=None)

    def _confirmed(self, met: Met) -> Met | None:
        """The move, or the least longer one that is found, that meets the wish if sampled as finely as may be."""
        question, unit = self.question, np.array(met.change.values[:2]) / met.change.size

        def finely(length: float) -> Met | None:
            change = self._change(length * unit)
            found = self._study(change)
            if found is None or not question.wish.met(found.assessment):
                return None
            fine = finely_met(question.wish, question.cell, found, question.sampling)
            return Met(change, found.assessment) if fine else None

        return least_beyond(finely, met.change.size, _RADII[-1], _RESOLUTION)

    def _refined(self, met: Met) -> Met:
        best = self._shortened(met)
        for _ in range(3):
            length, angle = best.change.size, float(np.arctan2(best.change.values[1], best.change.values[0]))
            turned = (self._decide(_SHORTER * length * _direction(angle + turn)) for turn in _TURNS)
            shorter = next((other for other in turned if other is not None), None)
            if shorter is None:
                return best
            best = self._shortened(shorter)
        return best

    def _shortened(self, met: Met) -> Met:
        """The least move in the same direction, by bisection."""
        unit, low, best = np.array(met.change.values[:2]) / met.change.size, 0.0, met
        while best.change.size - low > _RESOLUTION:
            middle = 0.5 * (low + best.change.size)
            shorter = self._decide(middle * unit)
            if shorter is not None and shorter.change.size < best.change.size:
                best = shorter
            else:
                low = middle
        return best

    def _decide(self, offset: Array) -> Met | None:
        change = self._change(offset)
        if change.size == 0.0 or not self._fits(change):
            return None
        question = self.question
        cell, world = question.cell, change.in_world(question.world)
        seen = whole_watched(cell, self.way, world, question.sampling, full=False)
        if isinstance(seen, Infeasible) or not question.wish.may_be_met(qualities_of(seen)):
            return None
        if question.wish.time is not None and sum(step.motion.time for step in seen) > question.wish.time:
            return None
        found = WholeStudy(self.way, tuple(with_delays(cell, seen, question.sampling))).assessment
        return Met(change, found) if question.wish.met(found) else None

    def _study(self, change: ProposedChange) -> WholeStudy | None:
        """The way with the object elsewhere; None where it does not fit, or cannot be handled."""
        question, world = self.question, change.in_world(self.question.world)
        if not self._fits(change):
            return None
        found = whole_study(question.cell, self.way, world, question.sampling, full=False)
        return None if isinstance(found, Infeasible) else found

    def _change(self, offset: Array) -> ProposedChange:
        moved = whole(np.append(offset, 0.0))
        X_WO = self.question.world.X_WO[self.name].copy()
        X_WO[:3, 3] = np.round(X_WO[:3, 3] + moved, 6)
        return ProposedChange(
            kind="object",
            target=self.name,
            values=(float(moved[0]), float(moved[1]), 0.0),
            size=float(np.linalg.norm(moved)),
            unit="m",
            X_WO=read_only(X_WO),
        )

    def _fits(self, change: ProposedChange) -> bool:
        """Whether the object stays on what it stands on, and clear of all else."""
        assert change.X_WO is not None  # noqa: S101 - it is about an object
        objects = self.question.cell.workspace.objects
        support = _support(self.question.cell, self.question.world, self.name)
        if support is not None and not _stands(objects[self.name], change.X_WO, objects[support], self.question.world):
            return False
        return not any(
            self.question.cell.collision.touch(self.name, change.X_WO, other, self.question.world)
            for other in self.question.world.X_WO
            if other not in (self.name, support)
        )


def moved_objects(question: Question, way: Candidate, found: WholeStudy | Infeasible) -> list[Found] | Miss:
    """The least move of what a way handles, and of what hides most. found: of the way as it is."""
    cell, world = question.cell, question.world
    names = [name for name in way.binding.values() if not cell.workspace.objects[name].fixed]
    hiding = _hiding(cell, found) if isinstance(found, WholeStudy) else ()
    names = [name for name in dict.fromkeys([*names, *hiding]) if _is_free(cell, name, world)][:MOST_OBJECTS]
    if not names:
        return Miss(kind="object", why="no object is handled or hides anything")

    def search(name: str) -> ObjectSearch:
        return ObjectSearch(question, way, name)

    def least(name: str) -> Found | None:
        met = search(name).least()
        return None if met is None else Found(met, search(name).margin(met.change))

    answers = [answer for answer in question.shared(least, names) if answer is not None]
    if answers:
        return answers
    near = [one for one in question.shared(lambda name: search(name).nearest(), names) if one is not None]
    tried = f"of {_DIRECTIONS} directions, up to {100 * _RADII[-1]:.0f} cm"
    if not near:
        why = f"in none {tried}, is a place where {', '.join(names)} can be handled and stand clear of all else"
        return Miss(kind="object", why=why)
    return question.nearest("object", f"in none {tried}, does a place of {', '.join(names)} meet the wish", near)


def _is_free(cell: Cell, name: str, world: World) -> bool:
    """Whether an object stands at a known place and carries nothing."""
    return name in world.X_WO and name != world.held and all(o.on != name for o in cell.workspace.objects.values())


def _hiding(cell: Cell, found: WholeStudy) -> Iterator[str]:
    """Objects that hide targets while too few cameras see them, the one first without which most would be seen."""
    hiding = [one for step in found.steps for one in to_move(cell, step, hidden_views(cell, step))]
    alone, share = defaultdict[str, float](float), defaultdict[str, float](float)
    for one in hiding:
        alone[one.name] += one.alone
        share[one.name] += one.share
    yield from sorted(sorted(alone), key=lambda name: (alone[name], share[name]), reverse=True)
    behind = Counter(name for step in found.steps for name in _alike_behind(cell, step))
    yield from sorted(behind.keys() - set(alone), key=lambda name: (-behind[name], name))


def _alike_behind(cell: Cell, step: Study) -> Iterator[str]:
    """The objects that have the colour of targets behind them in uncovered states, one for each camera and state."""
    lost = ~step.timeline.covered & step.timeline.monitored
    for boxes in step.timeline.observation.full_matrix:
        for box in boxes:
            alike = (box.cause == Cause.SAME_COLOUR) & lost[:, None]
            parents = (cell.observer.solids[index].part.parent for index in box.by[alike].tolist())
            yield from (parent for parent in parents if parent in cell.workspace.objects)


def _support(cell: Cell, world: World, name: str) -> str | None:
    """What an object stands on: as the workspace says, or what it touches from above."""
    stated = cell.workspace.objects[name].on
    if stated is not None and stated in world.X_WO:
        return stated
    return next(iter(sorted(cell.collision.supports(name, world.X_WO[name], world))), None)


def _stands(obj: SceneObject, X_WO: Array, support: SceneObject, world: World) -> bool:
    """Whether the box of an object is above that of its support."""
    X_WS = world.X_WO[support.name]
    corners = transform(X_WO, box_corners(obj.size)) - X_WS[:3, 3]
    within: Array = 0.5 * np.asarray(support.size) + 1e-6
    axes = [axis for axis in range(3) if abs(X_WS[2, axis]) < 0.5]  # those that lie flat
    return all(float(np.abs(corners @ X_WS[:3, axis]).max()) <= within[axis] for axis in axes)


def _direction(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])
