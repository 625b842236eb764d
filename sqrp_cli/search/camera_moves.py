"""Changes of one camera while the motion stays as it is: its aim, its place, its lens, or one more camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property, partial
from itertools import count
from math import atan, degrees, radians, tan
from typing import Literal

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.figures import falls_short
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, inverse, read_only, transform
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.aiming import Aim, CameraRoom, looking_at, turned, whole
from sqrp_cli.search.bound import CameraBound
from sqrp_cli.search.least import MOST_MORE, Bounds, Move, least_changes, shells
from sqrp_cli.search.moves import ProposedChange
from sqrp_cli.search.question import Found, Question, Tried, seen_by
from sqrp_cli.study.assessment import Analysis
from sqrp_cli.study.quality import qualities_over
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import observe
from sqrp_cli.study.whole_study import WholeAnalysis, mean_quality

CameraKind = Literal["aim", "position", "lens", "camera"]

LENS_STEP, LENS_STRIDE = radians(0.1), 10
"""Views are proposed in whole steps [rad]; first so many of them at once are tried."""

WIDEST, NARROWEST = radians(120), radians(2)
"""Horizontal fields of view that are proposed [rad]."""

_WIDER = LENS_STEP * np.arange(5, 305, 15)
"""By how much more the view of a lens is changed for its margin [rad]."""

_MARGIN_STEPS = 60
"""Steps in which margins of poses are searched."""

_COMPARED_POSES = 400
"""Poses that are compared where none meets the goal, to name what comes nearest."""

_ROOM = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""Distances by which a further camera may be off [m] that are tried."""

_DISTANCES = (0.5, 0.75, 1.0, 1.35, 1.8)
"""Distances of a further camera from what it must see [m]."""

_DIRECTIONS = 90
"""Directions, over the upper half, in which a further camera may be."""

_PLACES_DECIDED = 12
"""Places of a further camera that are decided, at most."""

_SHORTER = (0.999, 0.99, 0.97, 0.9)
_BOUNDS: dict[CameraKind, Bounds] = {
    "aim": Bounds(2, radians(0.5), (radians(30), radians(90)), fine=True, rounds=14, directions=20, shares=_SHORTER),
    "position": Bounds(3, 0.01, (0.3, 1.0), fine=True, rounds=14, directions=20, shares=_SHORTER),
    "lens": Bounds(1, 5 * LENS_STEP, (WIDEST,), fine=False),
    "camera": Bounds(3, 0.01, (), fine=False),
}


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """The motion that stays as it is while cameras change."""

    question: Question
    study: WholeAnalysis
    """Of it, with the verdicts of every camera."""

    @cached_property
    def about(self) -> tuple[Analysis, ...]:
        """The parts of its steps that the goal is about: the events of interest where that is all, else the whole.

        Those take a fraction of the whole motion's time.
        """
        question = self.question
        if not question.goal.only_events:
            return self.study.steps
        found = []
        for step in (step for step in self.study.steps if step.timeline.T_eoi):
            pieces = [piece for piece in step.stage.pieces if piece.of_interest]
            only = replace(step, stage=Stage(step.stage.model, step.motion, pieces, step.world.X_WO), faults={})
            seen = observe(only, question.cell.observer, question.sampling, full=False)
            found.append(replace(only, timeline=seen))
        return tuple(found)

    @cached_property
    def room(self) -> CameraRoom:
        """Where cameras may be during it."""
        states = [step.stage.states(step.timeline.samples) for step in self.study.steps]
        return CameraRoom(self.question.cell, states)

    @cached_property
    def cameras(self) -> list[Camera]:
        """Those of the cell, in order."""
        return list(self.question.cell.workspace.cameras.values())

    @cached_property
    def hopeful(self) -> list[int]:
        """The cameras, by index, that may meet the goal alone."""
        return [index for index in range(len(self.cameras)) if self.move("aim", index).bound.hopeful]

    def move(self, kind: CameraKind, index: int, *, middle: bool = False) -> CameraMove:
        """Changes of a camera, of which nothing is learned yet. middle: of what it must see, as another aim.

        A camera looks at what the workspace says, or at the point of its axis nearest to what the goal is about.
        """
        camera = self.cameras[index]
        aim = self.question.aims.get(camera.name)
        found = CameraMove(self, kind, camera, aim or Aim.along(camera, camera.X_FC[:3, 3]), index)
        if aim is None:
            states = found.bound.states
            boxes = [box for target in found.bound.targets for box in target.boxes]
            places = [states.box_poses(box)[:, :3, 3].mean(axis=0) for box in boxes]
            X_FW = inverse(states.X_WF[camera.frame][0])
            found.aim = Aim.along(camera, transform(X_FW, np.mean(places, axis=0)[None])[0])
        if middle and (there := found.middle) is not None:
            found.aim = there
        return found


class CameraMove:
    """Changes of one camera, see `least.Move`: of its aim, its position, its lens, or where a further one stands."""

    def __init__(
        self, base: SeenMotion, kind: CameraKind, camera: Camera, aim: Aim, index: int | None, like: str = ""
    ) -> None:
        """index: of the camera in the cell; None for a further one, which has the lens of the one called `like`."""
        self.base, self.kind, self.camera, self.aim, self.index, self.like = base, kind, camera, aim, index, like
        self.bounds = _BOUNDS[kind]

    @cached_property
    def bound(self) -> CameraBound:
        """What the camera must see; sharper with each change that does not do."""
        question = self.base.question
        return CameraBound(question.cell, self.base.about, question.goal, self.camera, self.index)

    @property
    def middle(self) -> Aim | None:
        """An aim at the middle of what the camera must see, if there is anything."""
        corners = self.bound.corners
        if not len(corners):
            return None
        X_FW = inverse(self.bound.states.X_WF[self.camera.frame][0])
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        return replace(self.aim, point=read_only(whole(transform(X_FW, middle[None])[0])))

    def outward(self, reach: float) -> Iterator[Array]:
        """See `least.Move`."""
        if self.kind != "lens":
            return shells(self.bounds.dimension, self.bounds.step, reach)
        steps = self._views(LENS_STRIDE)
        return iter(np.array_split(steps, range(5, len(steps), 5)))  # few at once: all that pass are decided

    def _views(self, stride: int) -> Array:
        """By how much the view may differ, in so many steps at once, the least first, shape (n, 1) [rad]."""
        present = field_of_view(self.camera)
        least, most = ((edge - present) / LENS_STEP / stride for edge in (NARROWEST, WIDEST))
        steps = np.arange(int(least), int(most) + 1)
        found: Array = np.asarray(LENS_STEP * stride * steps[np.argsort(abs(steps), kind="stable")][1:, None])
        return found

    def poses(self, vectors: Array) -> Array:
        """The optical frame in the frame that carries it, for vectors (p, d) of poses, shape (p, 4, 4)."""
        eye = self.camera.X_FC[:3, 3]
        if self.kind == "aim":
            points = turned(self.aim, eye, vectors)
            return looking_at(np.tile(eye, (len(points), 1)), points, self.aim.up)
        eyes = vectors if self.kind == "camera" else eye + vectors
        return looking_at(eyes, np.tile(self.aim.point, (len(vectors), 1)), self.aim.up)

    def passes(self, vectors: Array) -> Mask:
        """See `least.Move`."""
        if self.kind == "lens":
            views = field_of_view(self.camera) + vectors[:, 0]
            passes: Mask = np.array((views >= NARROWEST - 1e-9) & (views <= WIDEST + 1e-9))
            rows = np.flatnonzero(passes)
            passes[rows] = self.bound.passes(*self._lenses(vectors[rows])) if len(rows) else True
            return passes
        poses = self.poses(vectors)
        passes = self.bound.passes([self.camera], poses)
        rows = np.flatnonzero(passes)
        passes[rows] = self._free(poses[rows])
        return passes

    def _lenses(self, vectors: Array) -> tuple[list[Camera], Array]:
        return [self.change(vector).placed for vector in vectors], self.camera.X_FC[None]

    def _free(self, X_FC: Array) -> Mask:
        """Whether the camera may be there; one that moves with the robot goes wherever its link does."""
        if self.camera.frame != WORLD:
            return np.ones(len(X_FC), dtype=bool)
        if self.index is None:
            return self.base.room.free(X_FC[:, :3, 3])
        present = self.camera.X_FC[:3, 3]
        still: Mask = np.linalg.norm(X_FC[:, :3, 3] - present, axis=1) < 1e-9
        return still | self.base.room.free(X_FC[:, :3, 3], present)

    def change(self, vector: Array) -> ProposedChange:
        """See `least.Move`: places in whole millimetres, views in tenths of degrees."""
        camera, aim, eye, values, turn = self.camera, self.aim, self.camera.X_FC[:3, 3], vector, 0.0
        if self.kind == "lens":
            present = field_of_view(camera)
            view = radians(round(degrees(present + round(float(vector[0]) / LENS_STEP) * LENS_STEP), 2))
            K = camera.matrix.copy()
            K[:2, :2] *= tan(0.5 * present) / tan(0.5 * view)
            there, values, size = replace(camera, matrix=read_only(K)), np.array([view - present]), abs(view - present)
        else:
            if self.kind == "aim":
                aim = replace(aim, point=read_only(whole(turned(aim, eye, vector[None])[0])))
            elif self.kind == "position":
                values = whole(vector)
                eye = np.round(eye + values, 6)
            else:
                eye = vector
            there = replace(camera, X_FC=read_only(looking_at(eye[None], aim.point[None], aim.up)[0]))
            apart = float(np.linalg.norm(there.X_FC[:3, 2] - camera.X_FC[:3, 2]))
            turn = 0.0 if self.kind == "camera" else float(2 * np.arcsin(min(1.0, 0.5 * apart)))
            size = float(np.linalg.norm(values)) if self.kind == "position" else 1.0
            if self.kind == "aim":
                values, size = vector * (turn / max(float(np.linalg.norm(vector)), 1e-12)), turn
        return ProposedChange(
            kind=self.kind,
            target=camera.name,
            values=tuple(values.tolist()),
            size=size,
            unit="m" if self.kind == "position" else "camera" if self.kind == "camera" else "rad",
            turn=turn,
            like=self.like,
            camera=there,
            aim=aim,
        )

    def meets(self, change: ProposedChange) -> bool:
        """See `least.Move`: by the exact timeline of what the goal is about; where it is missed, the bound learns."""
        question = self.base.question
        if not self._free(change.placed.X_FC[None])[0]:
            return False
        if question.goal.only_events:
            observer = change.in_cell(question.cell).observer
            timelines = [observe(step, observer, question.sampling, full=False) for step in self.base.about]
            quality = mean_quality([(qualities_over(timeline).q_eoi, timeline.T_eoi) for timeline in timelines])
            met = not falls_short(quality or 0.0, question.goal.q_eoi or 0.0)
        else:
            study = self.study(change)
            timelines, met = [step.timeline for step in study.steps], question.goal.met(study.assessment)
        if not met:
            self.bound = self.bound.sharper(timelines)
        return met

    def study(self, change: ProposedChange) -> WholeAnalysis:
        """The same motion with the changed camera."""
        question = self.base.question
        return seen_by(change.in_cell(question.cell), self.base.study, question.sampling)

    def lengths(self, size: float) -> Array:
        """See `least.Move`."""
        most = MOST_MORE["m" if self.kind == "position" else "rad"]
        found = size + _WIDER if self.kind == "lens" else np.linspace(0.0, size + most, _MARGIN_STEPS)
        return np.asarray(found, dtype=float)

    def compared(self) -> Array:
        """See `least.Move`."""
        if self.kind == "lens":
            return self._views(3 * LENS_STRIDE)
        vectors: Array = np.concatenate(
            list(shells(self.bounds.dimension, 4 * self.bounds.step, self.bounds.reaches[-1]))
        )
        return vectors[:: max(1, len(vectors) // _COMPARED_POSES)]

    def worth(self, vectors: Array) -> Array:
        """See `least.Move`: the share of some samples that are covered."""
        if self.kind == "lens":
            return self.bound.quality(*self._lenses(vectors))
        poses = self.poses(vectors)
        worth = np.full(len(vectors), -np.inf)
        rows = np.flatnonzero(self._free(poses))
        worth[rows] = self.bound.quality([self.camera], poses[rows])
        return worth


def changed_camera(base: SeenMotion, kind: Literal["aim", "position", "lens"]) -> Found:
    """The least turn, move or change of lens of every camera that helps."""
    if not base.hopeful:
        return Found(why="no camera alone can: where one is missing, another is missing too")
    moves: list[Callable[[], Move]] = [partial(base.move, kind, index) for index in base.hopeful]
    if kind == "position":  # with the aim kept, and with the middle of what must be seen as aim where that is no help
        for index in base.hopeful:
            aside = base.move(kind, index, middle=True)
            if aside.middle is not None and not aside.meets(aside.change(np.zeros(3))):
                moves.append(partial(base.move, kind, index, middle=True))
    none = f"no {kind} of a single camera meets the wish"
    return least_changes(base.question, moves, none, "there is no free place for a camera")


def further_camera(base: SeenMotion) -> Found:
    """One more camera, with the lens of each of those that there are: the one with the most room around it.

    Of their lenses that with the narrowest, a middle and the widest view are tried.
    """
    fixed = [camera for camera in base.cameras if camera.frame == WORLD]
    if not fixed:
        return Found(why="there is none to take the lens of")
    lenses = {(camera.width, camera.height, field_of_view(camera)): camera for camera in reversed(fixed)}
    ordered = [camera for _, camera in sorted(lenses.items(), key=lambda entry: entry[0][2])]
    few = [ordered[n] for n in dict.fromkeys([0, len(ordered) // 2, len(ordered) - 1])]
    names = {camera.name for camera in base.cameras}
    name = next(name for number in count(len(names) + 1) if (name := f"cam{number}") not in names)

    def move(like: Camera) -> CameraMove:
        aim = Aim(like.X_FC[:3, 3], np.array([0.0, 0.0, 1.0]))
        found = CameraMove(base, "camera", replace(like, name=name), aim, None, like.name)
        found.aim = found.middle or aim
        return found

    def best(like: Camera) -> Tried | None:
        """The place with the most room around it from which such a camera meets the goal."""
        one = move(like)
        if one.middle is None:
            return None
        number = np.arange(_DIRECTIONS)  # spirals over upper halves of spheres
        z, turn = 0.02 + 0.96 * (number + 0.5) / _DIRECTIONS, np.pi * (3.0 - np.sqrt(5.0)) * number
        flat = np.sqrt(1.0 - z * z)
        directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
        places = one.aim.point + np.concatenate([distance * directions for distance in _DISTANCES])
        rows = np.flatnonzero(one.passes(places))
        if not len(rows):
            return None
        apart = np.linalg.norm(places[rows, None] - places[None], axis=2)
        room = np.where(np.isin(np.arange(len(places)), rows), np.inf, apart).min(axis=1)
        for row in rows[np.argsort(-room, kind="stable")][:_PLACES_DECIDED].tolist():
            change = one.change(whole(places[row]))
            if one.meets(change) and base.question.met_for_sure(change, study := one.study(change)):
                return Tried(change, study, Margin(less=0.0, more=around(move(like), np.array(change.values))))
        return None

    def around(one: CameraMove, eye: Array) -> float:
        """By how much it may be off to any side, its aim kept [m]."""
        sides = np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)], dtype=float) - 1.0
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        more = 0.0
        for off in _ROOM:
            eyes = eye + off * sides
            if not (one.passes(eyes).all() and all(one.meets(one.change(at)) for at in eyes[:: len(eyes) // 6])):
                break
            more = off
        return more

    if not move(fixed[0]).bound.hopeful:
        return Found(why="one more camera is not enough")
    answers = [one for one in base.question.shared(best, few) if one is not None]
    if not answers:
        return Found(why="from no free place that was tried does one more camera meet the wish")
    return Found([max(answers, key=lambda one: one.margin.more if one.margin else 0.0)])


def field_of_view(camera: Camera) -> float:
    """The horizontal angle of a camera's image without distortion [rad]."""
    return 2.0 * atan(0.5 * camera.width / float(camera.matrix[0, 0]))
