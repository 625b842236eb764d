"""Changes of one camera while the motion stays as it is: its aim, its place, its lens, or one more camera."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property, partial
from itertools import count
from math import degrees, radians, tan
from typing import Literal

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, inverse, read_only, transform
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.aiming import Aim, free_for_cameras, looking_at, turned, whole_millimetres
from sqrp_cli.search.bound import CameraBound
from sqrp_cli.search.question import ProposedChange, Question, Search, Tried, analysed_again
from sqrp_cli.search.vectors import Bounds, shells
from sqrp_cli.study.timeline import observe
from sqrp_cli.study.whole_analysis import WholeAnalysis

CameraKind = Literal["aim", "position", "lens", "camera"]
LENS_STEP, LENS_STRIDE = radians(0.1), 10
"""Views are proposed in whole steps [rad]; first so many of them at once are tried."""
WIDEST, NARROWEST = radians(120), radians(2)  # Horizontal fields of view that are proposed [rad]
_COMPARED_POSES = 400  # Poses that are compared where none meets the goal, to name what comes nearest
_ROOM = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)  # Distances by which a further camera may be off [m] that are tried
_DISTANCES = (0.5, 0.75, 1.0, 1.35, 1.8)  # Distances of a further camera from what it must see [m]
_DIRECTIONS = 90  # Directions, over the upper half, in which a further camera may be
_PLACES_DECIDED = 12  # Places of a further camera that are decided, at most
_SHORTER = (0.999, 0.99, 0.97, 0.9)
_WIDER = tuple((LENS_STEP * np.arange(5, 305, 15)).tolist())
_BOUNDS: dict[CameraKind, Bounds] = {
    "aim": Bounds(2, radians(0.5), (radians(30), radians(90)), fine=True, rounds=14, directions=20, shares=_SHORTER),
    "position": Bounds(3, 0.01, (0.3, 1.0), fine=True, rounds=14, directions=20, shares=_SHORTER),
    "lens": Bounds(1, 5 * LENS_STEP, (WIDEST,), fine=False, margins=_WIDER),
    "camera": Bounds(3, 0.01, (), fine=False),
}


class CameraMove:
    """Changes of one camera, see `least.Move`: of its aim, its position, its lens, or where a further one stands."""

    def __init__(
        self, question: Question, kind: CameraKind, camera: Camera, *, middle: bool = False, lens_of: str = ""
    ) -> None:
        """middle: whether it looks at the middle of what it must see. lens_of: see `ProposedChange`."""
        self.question, self.kind, self.camera, self._middle, self._lens_of = question, kind, camera, middle, lens_of
        self.bounds = _BOUNDS[kind]

    @cached_property
    def bound(self) -> CameraBound:
        """What the camera must see; sharper with each change that does not do."""
        question, name = self.question, self.camera.name
        index = next((n for n, known in enumerate(question.cell.workspace.cameras) if known == name), None)
        return CameraBound(question.cell, self.question.goal_steps, question.goal, index)

    @cached_property
    def aim(self) -> Aim:
        """What it looks at: as the workspace says, or the point of its axis nearest to what the goal is about."""
        camera, X_FC = self.camera, self.camera.X_FC
        new = Aim(X_FC[:3, 3], np.array([0.0, 0.0, 1.0]))
        aim = new if self.kind == "camera" else self.question.aims.get(camera.name)
        if aim is None:
            boxes = [box for target in self.bound.targets for box in target.boxes]
            places = [self.bound.states.box_poses(box)[:, :3, 3].mean(axis=0) for box in boxes]
            X_FW = inverse(self.bound.states.X_WF[camera.frame][0])
            aim = Aim.along(camera, transform(X_FW, np.mean(places, axis=0)[None])[0])
        if not self._middle or not len(corners := self.bound.corners):
            return aim
        X_FW = inverse(self.bound.states.X_WF[camera.frame][0])  # at the beginning of the motion
        middle = transform(X_FW, 0.5 * (corners.min(axis=0) + corners.max(axis=0))[None])[0]
        return replace(aim, point=read_only(whole_millimetres(middle)))

    def outward(self, reach: float, coarser: int = 1) -> Iterable[Array]:
        """See `least.Move`; coarser: so many times its steps."""
        if self.kind != "lens":
            return shells(self.bounds.dimension, coarser * self.bounds.step, reach)
        step, present = coarser * LENS_STRIDE, self.camera.field_of_view
        narrowest, widest = ((edge - present) / LENS_STEP / step for edge in (NARROWEST, WIDEST))
        numbers = np.arange(int(narrowest), int(widest) + 1)
        views = LENS_STEP * step * numbers[np.argsort(abs(numbers), kind="stable")][1:, None]
        return np.array_split(views, range(5, len(views), 5))  # few at once: all that pass are decided

    def lenses_and_poses(self, vectors: Array) -> tuple[list[Camera], Array]:
        """Lenses and poses in the frame that carries it, (p, 4, 4), for vectors (p, d); one kind has one only."""
        eye = self.camera.X_FC[:3, 3]
        if self.kind == "lens":
            return [_with_view(self.camera, float(more)) for (more,) in vectors], self.camera.X_FC[None]
        if self.kind == "aim":
            points = turned(self.aim, eye, vectors)
            return [self.camera], looking_at(np.tile(eye, (len(points), 1)), points, self.aim.up)
        eyes = vectors if self.kind == "camera" else eye + vectors
        return [self.camera], looking_at(eyes, np.tile(self.aim.point, (len(vectors), 1)), self.aim.up)

    def passes(self, vectors: Array) -> Mask:
        """See `least.Move`."""
        passes = np.ones(len(vectors), dtype=bool)
        if self.kind == "lens":
            views = self.camera.field_of_view + vectors[:, 0]
            passes = np.array((views >= NARROWEST - 1e-9) & (views <= WIDEST + 1e-9))
        if passes.any():
            lenses, X_FC = self.lenses_and_poses(vectors[passes])
            passes[passes] = self.bound.passes(lenses, X_FC)
            if self.kind != "lens":
                passes[passes] = self._free(X_FC[passes])
        return passes

    def _free(self, X_FC: Array) -> Mask:
        """Whether the camera may be there; one that moves with the robot goes wherever its link does."""
        eyes, present = X_FC[:, :3, 3], None if self.kind == "camera" else self.camera.X_FC[:3, 3]
        if self.camera.frame != WORLD:
            return np.ones(len(eyes), dtype=bool)
        still = np.zeros(len(eyes), dtype=bool) if present is None else np.linalg.norm(eyes - present, axis=1) < 1e-9
        free: Mask = still | free_for_cameras(self.question.cell, self.question.swept, eyes, present)
        return free

    def change(self, vector: Array) -> ProposedChange:
        """See `least.Move`: places in whole millimetres, views in tenths of degrees."""
        camera, aim, eye, values, turn = self.camera, self.aim, self.camera.X_FC[:3, 3], vector, 0.0
        if self.kind == "lens":
            there = _with_view(camera, float(vector[0]))
            values = np.array([there.field_of_view - camera.field_of_view])
            size = float(abs(values[0]))
        else:
            if self.kind == "aim":
                aim = replace(aim, point=read_only(whole_millimetres(turned(aim, eye, vector[None])[0])))
            elif self.kind == "position":
                values = whole_millimetres(vector)
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
            lens_of=self._lens_of,
            camera=there,
            aim=aim,
        )

    def meets(self, change: ProposedChange) -> bool:
        """See `least.Move`: by the exact timeline of what the goal is about; where it is missed, the bound learns."""
        question, cell = self.question, change.in_cell(self.question.cell)
        if change.camera is None or not self._free(change.camera.X_FC[None])[0]:
            return False
        seen = [observe(one.planned, cell.observer, question.sampling, full=False) for one in question.goal_steps]
        if not (met := question.met_by(cell, seen)):
            self.bound = self.bound.sharper(seen)
        return met

    def analysed(self, change: ProposedChange) -> WholeAnalysis:
        """The same motion with the changed camera."""
        question = self.question
        return analysed_again(change.in_cell(question.cell), self.question.feasible_analysis, question.sampling)

    def nearest(self) -> Array | None:
        """See `least.Move`: by the share of some samples that are covered."""
        vectors = np.concatenate(list(self.outward(self.bounds.reaches[-1], 3 if self.kind == "lens" else 4)))
        vectors = vectors[:: max(1, len(vectors) // _COMPARED_POSES)]
        if self.kind != "lens":
            vectors = vectors[self._free(self.lenses_and_poses(vectors)[1])]
        if not len(vectors):
            return None
        nearest: Array = vectors[
            int(np.argmax(self.bound.covered(*self.lenses_and_poses(vectors), every=True).mean(axis=1)))
        ]
        return nearest


def further_camera(question: Question) -> Search:
    """One more camera, with the lens of each of those that there are: the one with the most room around it.

    Of their lenses that with the narrowest, a middle and the widest view are tried.
    """
    cameras = question.cell.workspace.cameras
    fixed = [camera for camera in cameras.values() if camera.frame == WORLD]
    if not fixed:
        return (), "there is none to take the lens of"
    lenses = {(camera.width, camera.height, camera.field_of_view): camera for camera in reversed(fixed)}
    ordered = [camera for _, camera in sorted(lenses.items(), key=lambda entry: entry[0][2])]
    few = [ordered[n] for n in dict.fromkeys([0, len(ordered) // 2, len(ordered) - 1])]
    name = next(name for number in count(len(cameras) + 1) if (name := f"cam{number}") not in cameras)

    def best(known: Camera) -> Tried | None:
        """The place with the most room around it from which a camera with the lens of a known one meets the goal."""
        move = partial(CameraMove, question, "camera", replace(known, name=name), middle=True, lens_of=known.name)
        one = move()
        if not len(one.bound.corners):
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
        sides = np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)], dtype=float) - 1.0
        sides, every = sides / np.linalg.norm(sides, axis=1)[:, None], len(sides) // 6
        for row in rows[np.argsort(-room, kind="stable")][:_PLACES_DECIDED].tolist():
            change = one.change(whole_millimetres(places[row]))
            if one.meets(change) and question.met_for_sure(tried := Tried(change, one.analysed(change))):
                # By how much it may be off to any side, its aim kept [m].
                around, eye, more = move(), np.array(change.values), 0.0
                for off in _ROOM:
                    eyes = eye + off * sides
                    if not (around.passes(eyes).all() and all(map(around.meets, map(around.change, eyes[::every])))):
                        break
                    more = off
                return tried._replace(margin=Margin(less=0.0, more=more))
        return None

    if not CameraMove(question, "camera", replace(fixed[0], name=name)).bound.hopeful:
        return (), "one more is not enough, wherever it is"
    answers = [one for one in in_processes(best, few, question.jobs) if one is not None]
    if not answers:
        return (), "one more is not enough from any free place that was tried"
    return [max(answers, key=lambda one: one.margin.more if one.margin else 0.0)], ""


def _with_view(camera: Camera, more: float) -> Camera:
    """A camera with a wider view, by an angle [rad]: in tenths of degrees."""
    present = camera.field_of_view
    view = radians(round(degrees(present + round(more / LENS_STEP) * LENS_STEP), 2))
    K = camera.matrix.copy()
    K[:2, :2] *= tan(0.5 * present) / tan(0.5 * view)
    return replace(camera, matrix=read_only(K))
