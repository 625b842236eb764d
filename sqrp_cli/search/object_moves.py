"""Moves of an object on what it stands on; the motion is planned again for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask, box_corners, read_only, transform
from sqrp_cli.records import dataclass
from sqrp_cli.search.aiming import whole_millimetres
from sqrp_cli.search.question import ProposedChange, Question
from sqrp_cli.search.vectors import Bounds
from sqrp_cli.study.whole_analysis import WholeAnalysis, whole_analysis, whole_observed

DIRECTIONS = 12  # Directions that are tried at each distance

BOUNDS = Bounds(
    2, 0.02, (0.32,), fine=False, rounds=4, directions=4, shares=(0.9,), margins=(0.01, 0.02, 0.05, 0.1, 0.2)
)


@dataclass(eq=False)
class ObjectMove:
    """Moves of one object, see `least.Move`: its vectors are looked at exactly, so nothing has to be learned."""

    question: Question
    name: str  # of the object; the way of the question starts from where it then is
    bounds: Bounds = BOUNDS
    _known: dict[tuple[float, ...], bool] = field(default_factory=dict)
    """Which changes meet the goal, by their values, as far as they were looked at."""

    def outward(self, reach: float) -> Iterator[Array]:
        """Rings of vectors, from 1 cm on each with twice the radius of the one before."""
        angles = np.arange(DIRECTIONS) * (2 * np.pi / DIRECTIONS)
        ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        yield from (0.01 * 2**number * ring for number in range(1 + round(np.log2(reach / 0.01))))

    def passes(self, vectors: Array) -> Mask:
        """See `least.Move`."""
        return np.array([self.meets(self.change(vector)) for vector in vectors], dtype=bool)

    def change(self, vector: Array) -> ProposedChange:
        """See `least.Move`: in whole millimetres."""
        moved = whole_millimetres(np.append(vector, 0.0))
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

    def meets(self, change: ProposedChange) -> bool:
        """See `least.Move`."""
        if change.values not in self._known:
            question, met = self.question, False
            if change.size and self._fits(change):
                cell, world = question.cell, change.in_world(question.world)
                seen = whole_observed(cell, question.way, world, question.sampling, full=False)
                met = not isinstance(seen, Infeasible) and question.met_by(cell, seen)
            self._known[change.values] = met
        return self._known[change.values]

    def analysed(self, change: ProposedChange) -> WholeAnalysis | None:
        """See `least.Move`; None where the object does not fit, or cannot be handled."""
        question = self.question
        if not self._fits(change):
            return None
        world = change.in_world(question.world)
        found = whole_analysis(question.cell, question.way, world, question.sampling, full=False)
        return None if isinstance(found, Infeasible) else found

    def nearest(self) -> Array | None:
        """See `least.Move`: of moves by some centimetres."""
        *_, vectors = self.outward(0.08)
        tried = [self.analysed(self.change(vector)) for vector in vectors]
        missing = [self.question.goal.shortfall(None if one is None else one.result) for one in tried]
        return None if min(missing) == np.inf else vectors[int(np.argmin(missing))]

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
