"""The least move of an object on what it stands on that meets a wish; the motion is planned again for each."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, box_corners, read_only, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.least import least_beyond
from sqrp_cli.search.moves import ProposedChange, whole
from sqrp_cli.search.question import Met, Miss, Near, Question, finely_met
from sqrp_cli.sight.limits import Cause
from sqrp_cli.study.assessment import with_delays
from sqrp_cli.study.in_the_way import hidden_views, to_move
from sqrp_cli.study.whole_study import WholeStudy, qualities_of, whole_study, whole_watched
from sqrp_cli.task.task import Candidate

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
        """The least move that meets the wish, with its margin: rings outward, then shorter and to the sides."""
        angles = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
        tried = (self._decide(radius * _direction(angle)) for radius in _RADII for angle in angles)
        met = next((one for one in tried if one is not None), None)
        met = None if met is None else self._confirmed(self._refined(met))
        if met is None:
            return None
        unit, more = np.array(met.change.values[:2]) / met.change.size, 0.0
        for step in (0.01, 0.02, 0.05, 0.1, 0.2):
            if self._decide((met.change.size + step) * unit) is None:
                break
            more = step
        return met._replace(margin=Margin(less=0.0, more=more))

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
        """The least move in the same direction, then in others to its sides where a shorter one works."""
        for rounds in range(4):
            unit, low = np.array(met.change.values[:2]) / met.change.size, 0.0
            while met.change.size - low > _RESOLUTION:
                middle = 0.5 * (low + met.change.size)
                shorter = self._decide(middle * unit)
                if shorter is not None and shorter.change.size < met.change.size:
                    met = shorter
                else:
                    low = middle
            length, angle = met.change.size, float(np.arctan2(met.change.values[1], met.change.values[0]))
            turned = (self._decide(_SHORTER * length * _direction(angle + turn)) for turn in _TURNS)
            aside = None if rounds == 3 else next((other for other in turned if other is not None), None)
            if aside is None:
                break
            met = aside
        return met

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
        """Whether the object stays on what it stands on, its box above that of its support, and clear of all else."""
        cell, world = self.question.cell, self.question.world
        X_WO = change.in_world(world).X_WO[self.name]
        stated = cell.workspace.objects[self.name].on
        support = stated if stated is not None and stated in world.X_WO else None
        if support is None:  # what it touches from above
            support = next(iter(sorted(cell.collision.supports(self.name, world.X_WO[self.name], world))), None)
        if support is not None:
            X_WS, base = world.X_WO[support], cell.workspace.objects[support]
            corners = transform(X_WO, box_corners(cell.workspace.objects[self.name].size)) - X_WS[:3, 3]
            within: Array = 0.5 * np.asarray(base.size) + 1e-6
            flat = [axis for axis in range(3) if abs(X_WS[2, axis]) < 0.5]
            if any(float(np.abs(corners @ X_WS[:3, axis]).max()) > within[axis] for axis in flat):
                return False
        others = (other for other in world.X_WO if other not in (self.name, support))
        return not any(cell.collision.touch(self.name, X_WO, other, world) for other in others)


def moved_objects(question: Question, way: Candidate, found: WholeStudy | Infeasible) -> Sequence[Met] | Miss:
    """The least move of what a way handles, and of what hides most. found: of the way as it is."""
    cell, world = question.cell, question.world
    names = [name for name in way.binding.values() if not cell.workspace.objects[name].fixed]
    hiding = _hiding(cell, found) if isinstance(found, WholeStudy) else ()
    # Only what stands at a known place and carries nothing.
    carriers = {world.held, *(one.on for one in cell.workspace.objects.values())}
    names = [name for name in dict.fromkeys([*names, *hiding]) if name in world.X_WO and name not in carriers]
    searches = [ObjectSearch(question, way, name) for name in names[:MOST_OBJECTS]]
    if not searches:
        return Miss("no object is handled or hides anything")
    answers = [met for met in question.shared(ObjectSearch.least, searches) if met is not None]
    if answers:
        return answers
    near = [one for one in question.shared(ObjectSearch.nearest, searches) if one is not None]
    named = ", ".join(one.name for one in searches)
    tried = f"of {_DIRECTIONS} directions, up to {100 * _RADII[-1]:.0f} cm"
    if not near:
        return Miss(f"in none {tried}, is a place where {named} can be handled and stand clear of all else")
    return Miss(f"in none {tried}, does a place of {named} meet the wish", near)


def _hiding(cell: Cell, found: WholeStudy) -> Iterator[str]:
    """Objects that hide targets while too few cameras see them, the one first without which most would be seen."""
    hiding = [one for step in found.steps for one in to_move(cell, step, hidden_views(cell, step))]
    alone, share = defaultdict[str, float](float), defaultdict[str, float](float)
    for one in hiding:
        alone[one.name] += one.alone
        share[one.name] += one.share
    yield from sorted(sorted(alone), key=lambda name: (alone[name], share[name]), reverse=True)
    behind = Counter[str]()  # those of the colour of targets before them in uncovered states
    for step in found.steps:
        lost = ~step.timeline.covered & step.timeline.monitored
        for box in (box for boxes in step.timeline.observation.full_matrix for box in boxes):
            alike = box.by[(box.cause == Cause.SAME_COLOUR) & lost[:, None]].tolist()
            behind.update(cell.observer.solids[index].part.parent for index in alike)
    others = (behind.keys() & cell.workspace.objects.keys()) - set(alone)
    yield from sorted(others, key=lambda name: (-behind[name], name))


def _direction(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])
