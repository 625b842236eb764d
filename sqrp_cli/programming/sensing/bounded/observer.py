"""What the cameras of a cell see surely, from every pose within bounds, or possibly, from some pose at least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sqrp_cli.geometry import Array, Indices
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.hulls import AnyHullTester, common_hulls
from sqrp_cli.programming.sensing.bounded.limits import BoundedBoxes
from sqrp_cli.programming.sensing.bounded.shares import visible_enough
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.sensing.sight_lines import Pairs, SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.visibility.backdrop import backdrop_bounds
from sqrp_cli.programming.sensing.visibility.lighting import light_bounds
from sqrp_cli.programming.sensing.visibility.occlusion import near_pairs
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.targets import SoughtBox


@dataclass(frozen=True, eq=False, kw_only=True)
class BoundedObserver(Observer):
    """The cameras of a cell, of which each may be anywhere within bounds, with all its solids.

    Covered is, of each target, what enough cameras see surely, whatever their poses; or possibly, where not even the
    best pose of each helps the others. The response is that of the slowest or fastest of them.
    """

    bounds: PoseBounds
    surely: bool
    _any_tester: AnyHullTester = field(init=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "_any_tester", AnyHullTester(self.bounds))

    def _watched(self, boxes: Sequence[SoughtBox], states: SceneStates, cameras: Indices | None = None) -> WatchedBoxes:
        some = self._some(cameras)
        return BoundedBoxes(boxes, some, self._solids, states, bounds=self.bounds, surely=self.surely)

    def _near(self, watched: WatchedBoxes, lines: SightLines) -> Pairs:
        return near_pairs(lines, watched.solid_poses, watched.opaque, self.bounds.reach)

    @classmethod
    def of(cls, observer: Observer, bounds: PoseBounds, *, surely: bool) -> BoundedObserver:
        """The same cell, with its cameras within bounds."""
        return cls(observer.cameras, observer.solids, observer.lights, bounds=bounds, surely=surely)

    def _needed(self, watched: WatchedBoxes, lines: SightLines, gain: Array) -> Array:
        bounds = backdrop_bounds(lines, watched.boxes, watched.solid_poses, watched.alike, self.bounds.reach)
        lost = light_bounds(lines, watched, gain, tuple(self.lights.values())) if self.lights else None
        needed = bounds.needed(watched.least_of(lines), lost)
        return needed.high if self.surely else needed.low

    def _unseen(self, watched: WatchedBoxes, lines: SightLines, near: Pairs, needed: Array) -> Indices:
        poses, finite, every = watched.solid_poses, lines.finite[lines.hull], watched.least_of(lines) >= 1
        partly, whole = near.of_lines(~every), near.of_lines(every)
        seen = visible_shares(lines, poses, partly, enough=needed)
        enough = np.ones(len(needed), dtype=bool)
        enough[seen.line[seen.share < needed[seen.line]]] = False
        if self.surely:
            enough &= visible_enough(lines, poses, partly.of_lines(enough), needed, self.bounds, surely=True)
            met = self._any_tester.met(lines, poses, whole, first_only=True)
        else:
            enough |= visible_enough(lines, poses, partly.of_lines(~enough & finite), needed, self.bounds, surely=False)
            met = self._met_by_all(lines, watched, whole)
        return np.concatenate([np.flatnonzero(~enough), met.line])

    def _met_by_all(self, lines: SightLines, watched: WatchedBoxes, pairs: Pairs) -> Pairs:
        """Pairs of the lines whose view hulls surely meet something, first those of the middle poses."""
        poses, hidden = watched.solid_poses, np.zeros(len(lines.state), dtype=bool)
        hidden[self._tester.met(lines, poses, pairs, first_only=True).line] = True
        wanted = np.zeros(len(lines.box), dtype=bool)
        wanted[lines.hull[hidden]] = True
        common = common_hulls(lines, self.bounds, wanted)
        known = hidden & (common.known | ~lines.finite)[lines.hull]
        return self._tester.met(common.lines, poses, pairs.of_lines(known), first_only=True)
