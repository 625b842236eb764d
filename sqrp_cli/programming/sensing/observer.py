"""Coverage of targets by cameras over a batch of states.

The full verdict matrix, or only the coverage, as fast as possible.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask, begins_run
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.light import Light
from sqrp_cli.programming.sensing.limits import Cause, LimitVerdicts
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.sensing.sight_lines import BoxViews, Pairs, SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.sight_memory import SEEN, UNKNOWN, UNSEEN, SightMemory, Sights
from sqrp_cli.programming.sensing.visibility.backdrop import backdrop_of
from sqrp_cli.programming.sensing.visibility.culprit import find_hidden, find_largest
from sqrp_cli.programming.sensing.visibility.lighting import lighting_of
from sqrp_cli.programming.sensing.visibility.occlusion import HullTester, near_pairs
from sqrp_cli.programming.sensing.visibility.part_shares import part_shares
from sqrp_cli.programming.sensing.visibility.visible_share import cut_shares, shares_within, visible_shares
from sqrp_cli.programming.solids import Solid, Solids
from sqrp_cli.programming.targets import SoughtBox, Target

Scalar = TypeVar("Scalar", bound=np.generic)

_TOGETHER = 200
"""Least number of views to test at once, even if fewer might be enough: below it the call overhead dominates."""

_BOXES_TOGETHER = 2000
"""Boxes to test together, counted in every state, to bound the memory."""


@dataclass(frozen=True, eq=False)
class BoxVerdicts:
    """Verdicts of one box over m states and c cameras."""

    cause: NDArray[np.int8]
    """Codes of `Cause`, shape (m, c)."""
    by: Indices
    """Index of the solid that hides it, has its colour behind it or shades it, of the light in which it is too bright,
    of the image side where it is out of the image, else -1.

    Shape (m, c).
    """
    figure: Array
    """Amount by which the first failing limit is missed (see `LimitVerdicts`), shape (m, c)."""
    visible: Array
    """Visible share of the silhouette, NaN where an earlier limit failed, shape (m, c)."""


class Occluder(NamedTuple):
    """A part that hides something of a box, or of several on average."""

    name: str
    """In output; all pieces of a link are one part."""
    share: float
    """Share of the box's silhouette that it hides as the first part on the ray from the camera, in 0..1."""
    alone: float
    """Share that only it hides, which would be seen without it, in 0..1."""


def sees_all(boxes: Sequence[BoxVerdicts]) -> Mask:
    """Whether each camera sees all boxes of a target, shape (m, c)."""
    sees: Mask = np.all([box.cause == Cause.NONE for box in boxes], axis=0)
    return sees


@dataclass(frozen=True, eq=False)
class CoveredStates:
    """Whether a target is covered in m states, and the response of the cameras."""

    covered: Mask
    """Shape (m,)."""
    response: Array
    """The k-th smallest response among the cameras that cover it, NaN if uncovered, shape (m,) [s]."""

    def split(self, counts: Sequence[int]) -> list[CoveredStates]:
        """Consecutive parts of so many states each."""
        ends = np.cumsum(counts)[:-1]
        return list(map(CoveredStates, np.split(self.covered, ends), np.split(self.response, ends)))


@dataclass(frozen=True, eq=False)
class Observer:
    """The cameras of a cell with all its solids."""

    cameras: tuple[Camera, ...]
    solids: tuple[Solid, ...]
    lights: Mapping[str, Light] = field(default_factory=dict)
    """By name; if there are none, cameras see everything brightly enough."""
    memory: SightMemory | None = None
    """What was seen before of the same solids, if that is to be kept."""
    _projections: tuple[Projection, ...] = field(init=False)
    _solids: Solids = field(init=False)
    _parts: Indices = field(init=False)
    _tester: HullTester = field(init=False, default_factory=HullTester)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_projections", tuple(Projection.of(camera) for camera in self.cameras))
        object.__setattr__(self, "_solids", Solids(self.solids))
        _, parts = np.unique([solid.name for solid in self.solids], return_inverse=True)
        object.__setattr__(self, "_parts", parts)

    def verdicts(
        self,
        targets: Sequence[Target],
        states: SceneStates,
        *,
        rows: Sequence[Indices] | None = None,
        shares: bool = True,
    ) -> tuple[tuple[BoxVerdicts, ...], ...]:
        """The full matrix of targets: every box, state and camera, with causes.

        What is usually seen is asked of `coverage`: here, what the image's edge cuts does not add to what is hidden.

        rows: the states of each target, m of them, by index; all by default. shares: whether to measure the visible
        shares; without, `visible` stays NaN, and only the verdicts are valid.
        """
        everywhere = np.arange(states.count)
        asked = [
            (box, everywhere if rows is None else rows[index])
            for index, target in enumerate(targets)
            for box in target.boxes
        ]
        found: list[BoxVerdicts] = []
        group = np.cumsum([0, *(len(at) for _, at in asked)]) // _BOXES_TOGETHER
        for number in sorted(set(group[:-1].tolist())):
            some = [one for one, of_group in zip(asked, group, strict=False) if of_group == number]
            found += self._box_verdicts([box for box, _ in some], states, [at for _, at in some], shares=shares)
        boxes = iter(found)
        return tuple(tuple(next(boxes) for _ in target.boxes) for target in targets)

    def coverage(
        self, targets: Sequence[Target], states: SceneStates, rows: Sequence[Indices]
    ) -> tuple[CoveredStates, ...]:
        """Whether each target is covered in its states `rows`, testing no more cameras than needed.

        Cameras with the fastest response come first, so the result is the response of the best k cameras.
        """
        questions = _Questions.of(targets, rows)
        sights = np.full((len(self.cameras), len(questions.state)), UNKNOWN, dtype=np.int8)
        if self.memory is None:
            self._look(targets, states, questions, sights)
        else:
            keys = self.memory.questions(targets, states, rows, self._frames)
            sights = self.memory.recalled(self.cameras, keys)
            asked = np.flatnonzero(self._open(sights, questions.needed))
            if len(asked):
                found = sights[:, asked]
                self._look(targets, states, questions.some(asked), found)
                self.memory.note(self.cameras, [keys[index] for index in asked], found)
                sights[:, asked] = found
        response = self._response(sights, questions.needed)
        return tuple(CoveredStates(~np.isnan(response), response).split([len(of_target) for of_target in rows]))

    def _open(self, sights: Sights, needed: Indices) -> Mask:
        """Whether a camera that is not known to see the target of a question may matter, shape (q,)."""
        seen, matters = np.zeros(len(needed), dtype=np.int64), np.zeros(len(needed), dtype=bool)
        for tier in self._tiers():
            seen += (sights[tier] == SEEN).sum(axis=0)
            matters |= (seen < needed) & (sights[tier] == UNKNOWN).any(axis=0)
        matters &= (sights != UNSEEN).sum(axis=0) >= needed
        return matters

    def _response(self, sights: Sights, needed: Indices) -> Array:
        """The k-th smallest response among the cameras that see the target of a question, NaN if fewer do, (q,) [s]."""
        seen, response = np.zeros(len(needed), dtype=np.int64), np.full(len(needed), np.nan)
        for tier in self._tiers():
            seen += (sights[tier] == SEEN).sum(axis=0)
            response[(seen >= needed) & np.isnan(response)] = self.cameras[tier[0]].response
        return response

    def _look(self, targets: Sequence[Target], states: SceneStates, questions: _Questions, sights: Sights) -> None:
        """Replace what is unknown in the `sights` of questions, as far as it matters."""
        camera = np.flatnonzero((sights == UNKNOWN).any(axis=1))
        if not len(camera):
            return
        watched = self._watched([box for target in targets for box in target.boxes], states, camera)
        within = questions.within_limits(watched)
        known = sights[camera]
        known[(known == UNKNOWN) & ~within] = UNSEEN
        sights[camera] = known
        possible = (sights != UNSEEN).sum(axis=0) >= questions.needed
        count = np.zeros(len(questions.state), dtype=np.int64)
        place = np.empty(len(self.cameras), dtype=np.int64)
        place[camera] = np.arange(len(camera))
        for tier in self._tiers():
            count += (sights[tier] == SEEN).sum(axis=0)
            order, asked = np.nonzero((sights[tier] == UNKNOWN) & possible & (count < questions.needed))
            if len(asked):
                sights[tier[order], asked] = self._seeing(watched, questions, place[tier[order]], asked, count)

    def occluders(self, boxes: Sequence[SoughtBox], states: SceneStates, views: BoxViews) -> list[tuple[Occluder, ...]]:
        """Which parts hide how much of the boxes in views, largest share first, ties by name; for each view.

        All corners of the boxes must lie in front of the cameras. The shares of a view add up to what is not visible.
        """
        watched = self._watched(boxes, states)
        lines, poses = watched.sight_lines(views), watched.solid_poses
        found = part_shares(lines, poses, near_pairs(lines, poses, watched.opaque), self._parts)
        names = sorted({solid.name for solid in self.solids})
        occluders: list[list[Occluder]] = [[] for _ in views.box]
        for line, part, share, alone in zip(*(values.tolist() for values in found), strict=True):
            occluders[line].append(Occluder(name=names[part], share=share, alone=alone))
        return [tuple(sorted(some, key=lambda one: (-one.share, one.name))) for some in occluders]

    def _tiers(self) -> list[NDArray[np.int64]]:
        """Indices of cameras grouped by response, fastest first."""
        responses = np.array([camera.response for camera in self.cameras])
        return [np.flatnonzero(responses == response) for response in np.unique(responses)]

    def _watched(self, boxes: Sequence[SoughtBox], states: SceneStates, cameras: Indices | None = None) -> WatchedBoxes:
        """Boxes watched by some cameras, by index; by all of them by default."""
        return WatchedBoxes(boxes, self._some(cameras), self._solids, states)

    def _some(self, cameras: Indices | None) -> Sequence[Projection]:
        return self._projections if cameras is None else [self._projections[index] for index in cameras]

    @cached_property
    def _frames(self) -> list[str]:
        """Those that carry solids or cameras."""
        return sorted({*self._solids.parents, *(camera.frame for camera in self.cameras)})

    def limits(self, boxes: Sequence[SoughtBox], states: SceneStates, rows: Indices) -> LimitVerdicts:
        """Limits of every camera for boxes in the states `rows`: all rows of the first box, then of the next.

        Each array has shape (c, boxes * rows).
        """
        box, state = np.repeat(np.arange(len(boxes)), len(rows)), np.tile(rows, len(boxes))
        return self._watched(boxes, states).limits(box, state)

    def _seeing(
        self, watched: WatchedBoxes, questions: _Questions, camera: Indices, asked: Indices, count: Indices
    ) -> NDArray[np.int8]:
        """Whether views see their targets, shape (v,); `UNKNOWN` where enough others do. Those that do add to `count`.

        camera, asked: views by index of camera and question, shape (v,). count: of each question, how many cameras see
        its target. Views with no solid near their hulls see it without further tests. The other views of a question are
        tested one after the other, those with the fewest near solids first, until enough of them see it.
        """
        boxes = questions.boxes_of(asked)
        view = boxes.asked
        views = BoxViews(boxes.box, camera[view], questions.state[asked][view])
        lines = watched.sight_lines(views)
        # Along a line without any, the box is seen.
        near = near_pairs(lines, watched.solid_poses, watched.opaque)
        needed = needed_shares(watched, lines, watched.gains[views.camera], tuple(self.lights.values()))
        cut = cut_shares(watched, lines, views.camera)
        pending = np.bincount(view[near.line], minlength=len(asked))
        possible = np.ones(len(asked), dtype=bool)
        possible[view[needed + cut > 1.0]] = False
        free = possible & (pending == 0)
        found = np.where(free, SEEN, np.where(possible, UNKNOWN, UNSEEN)).astype(np.int8)
        np.add.at(count, asked[free], 1)
        unsettled = np.flatnonzero(possible & (pending > 0))
        order = unsettled[np.lexsort((pending[unsettled], asked[unsettled]))]
        for tested in _one_per_question(order, asked, count, questions.needed):
            sees = np.zeros(len(asked), dtype=bool)
            sees[tested] = True
            for turn in range(int(boxes.number.max()) + 1):
                wanted = near.of_lines(sees[view] & (boxes.number == turn))
                within = unseen(watched, lines, wanted.of_lines(cut == 0), needed, self._tester)
                sees[view[within]] = False
                rest = shares_within(watched, lines, wanted.of_lines(cut > 0), views.camera)
                sees[view[rest.line[rest.share < needed[rest.line]]]] = False
            found[tested] = sees[tested]
            np.add.at(count, asked[sees], 1)
        return found

    def _box_verdicts(
        self, boxes: Sequence[SoughtBox], states: SceneStates, rows: Sequence[Indices], *, shares: bool
    ) -> list[BoxVerdicts]:
        """The verdicts of each box in its states `rows`."""
        watched, counts = self._watched(boxes, states), [len(at) for at in rows]
        box, state = np.repeat(np.arange(len(boxes)), counts), np.concatenate(rows)
        limits = watched.limits(box, state)
        cause, by = limits.cause.copy(), limits.side.astype(np.int64)
        visible = np.full(cause.shape, np.nan)
        camera, at = np.nonzero(cause == Cause.NONE)
        found = self._view_verdicts(watched, BoxViews(box[at], camera, state[at]), shares=shares)
        cause[camera, at], by[camera, at] = found.cause, found.by
        if shares:
            visible[camera, at] = found.visible

        def of_boxes(values: NDArray[Scalar]) -> list[NDArray[Scalar]]:
            return np.split(values.T, np.cumsum(counts)[:-1])

        return list(map(BoxVerdicts, of_boxes(cause), of_boxes(by), of_boxes(limits.figure), of_boxes(visible)))

    def _view_verdicts(self, watched: WatchedBoxes, views: BoxViews, *, shares: bool) -> _ViewVerdicts:
        """What of the scene is wrong with views within all limits; shares: whether all visible shares are measured."""
        lines, poses = watched.sight_lines(views), watched.solid_poses
        least, near = watched.least_of(lines), near_pairs(lines, poses, watched.opaque)
        whole = least >= 1
        partly = near.of_lines(~whole)
        blocked = find_hidden(lines, poses, near.of_lines(whole), self._tester)
        seen = visible_shares(lines, poses, partly.joined(blocked.pairs) if shares else partly)
        visible = np.ones(len(least))
        visible[seen.line] = seen.share
        share = np.where(whole, 1.0, visible)
        hidden = np.where(whole, blocked.culprit >= 0, share < least)
        largest = find_largest(lines, poses, partly.of_lines(hidden), self._parts)
        cause = np.where(hidden, Cause.HIDDEN, Cause.NONE)
        by = np.where(hidden, np.where(whole, blocked.culprit, largest), -1)
        backdrop = backdrop_of(lines, watched.boxes, poses, watched.alike)
        same = ~hidden & (share < backdrop.needed(least))
        cause[same], by[same] = Cause.SAME_COLOUR, backdrop.by[same]
        if self.lights:
            lighting = lighting_of(lines, watched, watched.gains[views.camera], tuple(self.lights.values()))
            badly = np.flatnonzero((cause == Cause.NONE) & (share < backdrop.needed(least, lighting.lost)))
            is_bright = lighting.bright[badly] > lighting.dark[badly]
            bright, dark = badly[is_bright], badly[~is_bright]
            cause[bright], by[bright] = Cause.TOO_BRIGHT, lighting.brightest[bright]
            cause[dark], by[dark] = Cause.TOO_DARK, lighting.shading(dark, self._parts)
        return _ViewVerdicts(cause, by, visible)


def needed_shares(watched: WatchedBoxes, lines: SightLines, gain: Array, lights: Sequence[Light]) -> Array:
    """The share of the box of each of v sight lines that must be visible to be seen; above 1 if none is enough.

    gain: of the camera of each, shape (v,).
    """
    lost = lighting_of(lines, watched, gain, lights).lost if lights else 0.0
    backdrop = backdrop_of(lines, watched.boxes, watched.solid_poses, watched.alike)
    return backdrop.needed(watched.least_of(lines), lost)


def unseen(watched: WatchedBoxes, lines: SightLines, near: Pairs, needed: Array, tester: HullTester) -> Indices:
    """Those of the sight lines in the pairs along which too little is visible of the box, by index.

    needed: the share that must be visible along each of v lines, shape (v,).
    """
    whole = watched.least_of(lines) >= 1
    # Shares also detect free hulls, and faster.
    seen = visible_shares(lines, watched.solid_poses, near.of_lines(~whole), enough=needed)
    met = tester.met(lines, watched.solid_poses, near.of_lines(whole), first_only=True)
    return np.concatenate([seen.line[seen.share < needed[seen.line]], met.line])


class _ViewVerdicts(NamedTuple):
    """Verdicts of v views, as `BoxVerdicts` has them; shape (v,) each."""

    cause: Indices
    by: Indices
    visible: Array


class _AskedBoxes(NamedTuple):
    """The boxes of questions, n in all: first boxes of all questions, then second ones and so on."""

    asked: Indices
    """Index of the question, shape (n,)."""
    box: Indices
    """Index among all boxes, shape (n,)."""
    number: Indices
    """Index among its target's boxes, shape (n,)."""


@dataclass(frozen=True, eq=False)
class _Questions:
    """Whether each of several targets is covered in some states: q questions, ordered by target."""

    target: Indices
    """By index, shape (q,)."""
    state: Indices
    """By index, shape (q,)."""
    needed: Indices
    """Number of cameras that must see the target, shape (q,)."""
    first_box: Indices
    """The first box of each target among those of all, shape (targets,)."""
    box_count: Indices
    """Number of boxes of each target, shape (targets,)."""

    @classmethod
    def of(cls, targets: Sequence[Target], rows: Sequence[Indices]) -> _Questions:
        """Questions about each target in its states `rows`."""
        target = np.repeat(np.arange(len(targets)), [len(states) for states in rows])
        count = np.array([len(entry.boxes) for entry in targets])
        needed = np.array([entry.cameras for entry in targets])
        return cls(
            target=target,
            state=np.concatenate(rows),
            needed=needed[target],
            first_box=np.cumsum(count) - count,
            box_count=count,
        )

    def some(self, which: Indices) -> _Questions:
        """Some of the questions, by index."""
        return replace(self, target=self.target[which], state=self.state[which], needed=self.needed[which])

    def within_limits(self, watched: WatchedBoxes) -> Mask:
        """Whether each camera has all boxes of a question's target within its limits, shape (c, q)."""
        question, box, turn = self.boxes_of(np.arange(len(self.target)))
        order = np.argsort(box, kind="stable")
        within = np.ones((len(watched.projections), len(self.target)), dtype=bool)
        good = watched.limits(box[order], self.state[question[order]]).cause == Cause.NONE
        for number in range(self.box_count.max()):
            here = turn[order] == number
            within[:, question[order][here]] &= good[:, here]
        return within

    def boxes_of(self, questions: Indices) -> _AskedBoxes:
        """The boxes of some of the questions, by index, shape (v,)."""
        target = self.target[questions]
        number, asked = np.nonzero(np.arange(self.box_count[target].max(initial=0))[:, None] < self.box_count[target])
        return _AskedBoxes(asked=asked, box=self.first_box[target[asked]] + number, number=number)


def _one_per_question(order: Indices, question: Indices, count: Indices, needed: Indices) -> Iterator[Indices]:
    """Rounds over views ordered by question: in each, the next view of every question that needs more cameras.

    As soon as few views are left, they make one round.
    """
    left = order
    while len(left := left[count[question[left]] < needed[question[left]]]):
        now = begins_run(question[left]) | (len(left) <= _TOGETHER)
        yield left[now]
        left = left[~now]
