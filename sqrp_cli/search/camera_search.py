"""The least change of one camera that meets a wish while the motion stays as it is: aim, place or lens, or one more.

Each kind of move gives poses, which a look at some samples rules out or lets pass (`look`), the exact timeline decides,
and the samples of `explain` confirm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property, partial
from itertools import count
from typing import Literal

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Mask, inverse, read_only, transform
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.aiming import Aim, CameraRoom, looking_at
from sqrp_cli.search.least import LeastSearch, least_beyond, shells
from sqrp_cli.search.look import CameraLook, WishedSamples
from sqrp_cli.search.moves import (
    LENS_STEP,
    LENS_STRIDE,
    CameraMove,
    ProposedChange,
    displaced,
    field_of_view,
    lens_steps,
    placed,
    turning,
    whole,
    with_view,
)
from sqrp_cli.search.question import Met, Miss, Near, Question, finely_met, seen_by
from sqrp_cli.study.quality import interest_quality
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import Timeline, observe
from sqrp_cli.study.whole_study import WholeStudy, mean_quality

_MARGIN_STEPS = 60
"""Steps in which margins of poses are searched."""

_WIDER = tuple(range(5, 305, 15))
"""By how many more steps of the view a lens is tried for its margin."""

MOST_MORE = {"m": 0.3, "rad": np.radians(30)}
"""A margin is not searched beyond the size itself and this."""

_ROOM = (0.01, 0.02, 0.03, 0.05, 0.08, 0.12, 0.2)
"""Distances by which a further camera may be off [m] that are tried."""

_DISTANCES = (0.5, 0.75, 1.0, 1.35, 1.8)
"""Distances of a further camera from what it must see [m]."""

_DIRECTIONS = 90
"""Directions, over the upper half, in which a further camera may be."""

_PLACES_DECIDED = 12
"""Places of a further camera that are decided, at most."""

_COMPARED_POSES = 400
"""Poses that are compared where none meets the wish, to name what comes nearest."""

NONE_ALONE = Miss("no camera alone can: where one is missing, another is missing too")
"""Why no change of one camera helps."""


@dataclass(eq=False)
class CameraSearch:
    """Looks for changes of one camera; what it learns of one makes the looks at others sharper."""

    base: Cameras
    camera: Camera
    aim: Aim
    index: int | None
    """Of the camera in the cell; None if it would be a further one."""
    like: str = ""
    """Of a further camera: the one whose lens it has."""
    _scene: WishedSamples = field(init=False)
    _look: CameraLook = field(init=False)

    def __post_init__(self) -> None:
        self._sharpen(self.base.scene)

    def _sharpen(self, scene: WishedSamples) -> None:
        self._scene, self._look = scene, CameraLook(scene, self.camera, self.index)

    @property
    def hopeful(self) -> bool:
        """Whether this camera alone may meet the wish from anywhere, however it looks."""
        return self._look.hopeful

    @property
    def middle(self) -> Aim | None:
        """An aim at the middle of what this camera must see, if there is anything."""
        corners = self._look.corners
        if not len(corners):
            return None
        point = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        X_FW = inverse(self.base.scene.states.X_WF[self.camera.frame][0])
        return replace(self.aim, point=read_only(whole(transform(X_FW, point[None])[0])))

    def decide(self, change: ProposedChange) -> Met | None:
        """A change with the candidate's figures if they meet the wish, from the exact timeline; learns where not."""
        if not self._may(change):
            return None
        study = self.base.observed(change)
        if self.base.question.wish.met(study.assessment):
            return Met(change, study.assessment)
        self._learn([step.timeline for step in study.steps])
        return None

    def _may(self, change: ProposedChange) -> bool:
        """Whether a camera may be there, and the events of interest do not show that the wish is missed."""
        if not self._free(change.placed.X_FC[None])[0]:
            return False
        failure = self.base.failure(change)
        if failure is not None:
            self._learn(failure)
        return failure is None

    def _learn(self, timelines: Sequence[Timeline]) -> None:
        sharper = self._scene.with_failures(timelines)
        if sharper.count > self._scene.count:
            self._sharpen(sharper)

    def _free(self, X_FC: Array) -> Mask:
        """Whether the camera may be there; one that moves with the robot goes wherever its link does."""
        if self.camera.frame != WORLD:
            return np.ones(len(X_FC), dtype=bool)
        still = np.linalg.norm(X_FC[:, :3, 3] - self.camera.X_FC[:3, 3], axis=1) < 1e-9
        free = self.base.room.free(X_FC[:, :3, 3], None if self.index is None else self.camera.X_FC[:3, 3])
        stays: Mask = still & (self.index is not None)
        return np.logical_or(free, stays)

    def _passes(self, poses: Array) -> Mask:
        passes = self._look.passes(poses)
        rows = np.flatnonzero(passes)
        passes[rows] = self._free(poses[rows])
        return passes

    def found(self, move: CameraMove, reach: float, *, anywhere: bool) -> Met | None:
        """A change that meets the wish: a small one, `anywhere` as far as `reach`, else any on the grid up to it."""
        only_events = self.base.question.wish.only_events

        def decided(vector: Array) -> bool:
            change = move.change(vector)
            return self._may(change) if only_events else self.decide(change) is not None

        search = LeastSearch(
            test=lambda vectors: self._passes(move.poses(vectors)),
            decide=decided,
            dimension=move.dimension,
            step=move.step,
            reach=reach,
            seed=self.base.question.cell.seed,
        )
        vector = search.anywhere() if anywhere else search.within(reach)
        return None if vector is None else self.decide(move.change(vector))

    def confirmed(self, move: CameraMove, met: Met) -> Met | None:
        """A change, or the least larger one that is found, that meets the wish if sampled as finely as may be."""
        size = met.change.size
        unit = np.array(met.change.values) / size

        def finely(length: float) -> Met | None:
            tried = met if length == size else self.decide(move.change(length * unit))
            return tried if tried is not None and self.base.finely_met(tried.change) else None

        return least_beyond(finely, size, size + MOST_MORE[met.change.unit], 0.1 * move.step)

    def margin(self, move: CameraMove, change: ProposedChange) -> Margin:
        """How much less and how much more of a change along the same direction meets the wish."""
        vector = np.array(change.values)
        size = float(np.linalg.norm(vector))
        lengths = np.linspace(0.0, size + MOST_MORE[change.unit], _MARGIN_STEPS)

        def unbroken(lengths: Array) -> float:
            """The last of some lengths, going away, up to which all pass, and which is confirmed exactly."""
            for patient in (True, True, True, *(False for _ in lengths)):
                passes = self._passes(move.poses(lengths[:, None] * (vector / size)))
                passed = int(np.argmin(np.append(passes, False)))
                if not passed:
                    break
                tried = move.change(lengths[passed - 1] * (vector / size))
                if tried.size and self.decide(tried) is not None:
                    return float(lengths[passed - 1])
                lengths = lengths[: passed - 1 if patient else passed // 2]  # the failure has made the look sharper
            return size

        more, less = unbroken(lengths[lengths > size]), unbroken(lengths[lengths < size][::-1])
        return Margin(less=abs(size - less), more=abs(more - size))

    def nearest(self, move: CameraMove) -> Near | None:
        """The change of a kind with which most of the samples are covered."""
        vectors = np.concatenate(list(shells(move.dimension, 4 * move.step, move.reaches[-1])))
        vectors = vectors[:: max(1, len(vectors) // _COMPARED_POSES)]
        poses = move.poses(vectors)
        vectors, poses = vectors[free := self._free(poses)], poses[free]
        if not len(vectors):
            return None
        change = move.change(vectors[int(np.argmax(self._look.quality(poses)))])
        return Near(change, self.base.observed(change))

    def _lens_passes(self, steps: int) -> bool:
        camera = with_view(self.camera, self.aim, steps).placed
        return bool(CameraLook(self._scene, camera, self.index).passes(camera.X_FC[None])[0])

    def _lens_met(self, steps: int) -> Met | None:
        return self.decide(with_view(self.camera, self.aim, steps)) if steps and self._lens_passes(steps) else None

    def least_lens(self) -> Met | None:
        """The least change of the field of view that meets the wish, from coarse to fine, with its margin."""
        for steps in lens_steps(self.camera, LENS_STRIDE):
            if self._lens_met(steps) is None:
                continue
            toward = 1 if steps > 0 else -1
            tried = map(self._lens_met, range(steps - toward * (LENS_STRIDE - 1), steps + toward, toward))
            found = next((met for met in tried if met is not None and self.base.finely_met(met.change)), None)
            if found is not None:
                return found
        return None

    def lens_margin(self, change: ProposedChange) -> Margin:
        """How much less and how much more of a change of the view meets the wish, in its direction."""
        steps = round(change.values[0] / LENS_STEP)
        toward, allowed, passed = 1 if steps > 0 else -1, set(lens_steps(self.camera)), 0
        for more in _WIDER:
            if steps + toward * more not in allowed or not self._lens_passes(steps + toward * more):
                break
            passed = more
        while passed and self._lens_met(steps + toward * passed) is None:
            passed //= 2
        return Margin(less=0.0, more=passed * LENS_STEP)

    def nearest_lens(self) -> Near:
        """The lens with which most of the samples are covered."""

        def quality(steps: int) -> float:
            look = CameraLook(self._scene, with_view(self.camera, self.aim, steps).placed, self.index)
            return float(look.quality(self.camera.X_FC[None])[0])

        best = max(lens_steps(self.camera, 3 * LENS_STRIDE), key=quality)
        change = with_view(self.camera, self.aim, best)
        return Near(change, self.base.observed(change))

    def further(self) -> Met | None:
        """A place for a further camera from which it meets the wish, with the most room around it."""
        aim = self.middle
        if aim is None:
            return None
        number = np.arange(_DIRECTIONS)  # spirals over upper halves of spheres
        z, turn = 0.02 + 0.96 * (number + 0.5) / _DIRECTIONS, np.pi * (3.0 - np.sqrt(5.0)) * number
        flat = np.sqrt(1.0 - z * z)
        directions = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)
        places = aim.point + np.concatenate([distance * directions for distance in _DISTANCES])
        rows = np.flatnonzero(self._passes(looking_at(places, np.tile(aim.point, (len(places), 1)), aim.up)))
        if not len(rows):
            return None
        apart = np.linalg.norm(places[rows, None] - places[None], axis=2)
        room = np.where(np.isin(np.arange(len(places)), rows), np.inf, apart).min(axis=1)
        for row in rows[np.argsort(-room, kind="stable")][:_PLACES_DECIDED].tolist():
            met = self.decide(self._placed(whole(places[row]), aim))
            if met is not None and self.base.finely_met(met.change):
                return met
        return None

    def room_around(self, change: ProposedChange) -> Margin:
        """By how much a further camera may be off to any side, its aim kept."""
        aim, camera = change.aim or self.aim, change.placed
        sides = np.array([s for s in np.ndindex(3, 3, 3) if s != (1, 1, 1)], dtype=float) - 1.0
        sides /= np.linalg.norm(sides, axis=1)[:, None]
        more = 0.0
        for off in _ROOM:
            eyes = camera.X_FC[:3, 3] + off * sides
            poses = looking_at(eyes, np.tile(aim.point, (len(eyes), 1)), aim.up)
            if not (self._look.passes(poses).all() and self._free(poses).all()):
                break
            if any(self.decide(self._placed(eye, aim)) is None for eye in eyes[:: len(eyes) // 6]):
                break
            more = off
        return Margin(less=0.0, more=more)

    def _placed(self, eye: Array, aim: Aim) -> ProposedChange:
        """A further camera at a place (3,)."""
        return placed(self.camera, eye, aim, kind="camera", values=eye, size=1.0, unit="camera", like=self.like)


@dataclass(frozen=True, eq=False)
class Cameras:
    """Looks for changes of the cameras of a cell, all of which start from a candidate as it is now."""

    question: Question
    study: WholeStudy
    """Of the motion, which stays as it is, with the verdicts of every camera."""

    def moved(self, kind: Literal["aim", "position"]) -> Sequence[Met] | Miss:
        """The least turn, or move, of every camera that helps: from a coarse search, or a fine one below its least."""
        share = self.question.shared
        moves = {index: self._moves(kind, self._search(index)) for index in self._hopeful}
        if not moves:
            return NONE_ALONE
        items = [(index, number) for index, of_one in moves.items() for number in range(len(of_one))]

        def search(item: tuple[int, int], reach: float, *, anywhere: bool) -> Met | None:
            index, number = item
            return self._search(index).found(moves[index][number], reach, anywhere=anywhere)

        found: dict[tuple[int, int], Met] = {}
        for reach in moves[items[0][0]][0].reaches:
            answers = share(partial(search, reach=reach, anywhere=True), items)
            found = {item: met for item, met in zip(items, answers, strict=True) if met is not None}
            if found:
                break
        if found:
            least = 0.95 * min(met.change.size for met in found.values())
            fine = share(partial(search, reach=least, anywhere=False), items)
            found |= {item: met for item, met in zip(items, fine, strict=True) if met is not None}
        best: dict[int, tuple[int, int]] = {}
        for item in sorted(found, key=lambda item: found[item].change.size):
            best.setdefault(item[0], item)

        def answer(item: tuple[int, int]) -> Met | None:
            one, move = self._search(item[0]), moves[item[0]][item[1]]
            met = one.confirmed(move, found[item])
            return None if met is None else met._replace(margin=one.margin(move, met.change))

        if confirmed := [met for met in share(answer, list(best.values())) if met is not None]:
            return confirmed
        searches = [self._search(index) for index in moves]
        near = [best_of for one in searches if (best_of := one.nearest(self._moves(kind, one)[0])) is not None]
        none = f"no {kind} of a single camera meets the wish"
        return Miss(none, near) if near else Miss("there is no free place for a camera")

    def with_other_lens(self) -> Sequence[Met] | Miss:
        """The least change of the lens of every camera that helps."""

        def least(index: int) -> Met | None:
            met = self._search(index).least_lens()
            return None if met is None else met._replace(margin=self._search(index).lens_margin(met.change))

        if not self._hopeful:
            return NONE_ALONE
        if answers := [met for met in self.question.shared(least, self._hopeful) if met is not None]:
            return answers
        near = self.question.shared(lambda index: self._search(index).nearest_lens(), self._hopeful)
        return Miss("no lens of a single camera meets the wish", near)

    def with_further_one(self) -> Sequence[Met] | Miss:
        """One more camera, with the lens of each of those that there are: the one with the most room around it.

        Of their lenses that with the narrowest, a middle and the widest view are tried.
        """
        fixed = [camera for camera in self._cameras if camera.frame == WORLD]
        lenses = {(camera.width, camera.height, field_of_view(camera)): camera for camera in reversed(fixed)}
        ordered = [camera for _, camera in sorted(lenses.items(), key=lambda entry: entry[0][2])]
        few = [ordered[n] for n in dict.fromkeys([0, len(ordered) // 2, len(ordered) - 1])] if ordered else []
        names = {camera.name for camera in self._cameras}
        name = next(name for number in count(len(names) + 1) if (name := f"cam{number}") not in names)

        def search(like: Camera) -> CameraSearch:
            aim = Aim(like.X_FC[:3, 3], np.array([0.0, 0.0, 1.0]), stated=True)
            return CameraSearch(self, replace(like, name=name), aim, None, like.name)

        def best(like: Camera) -> Met | None:
            met = search(like).further()
            return None if met is None else met._replace(margin=search(like).room_around(met.change))

        if not fixed:
            return Miss("there is none to take the lens of")
        if not search(fixed[0]).hopeful:
            return Miss("one more camera is not enough")
        answers = [met for met in self.question.shared(best, few) if met is not None]
        if not answers:
            return Miss("from no free place that was tried does one more camera meet the wish")
        return [max(answers, key=lambda met: met.margin.more if met.margin else 0.0)]

    @cached_property
    def scene(self) -> WishedSamples:
        """The first samples of the candidate."""
        return WishedSamples.of(self.question.cell, self.study, self.question.wish)

    @cached_property
    def room(self) -> CameraRoom:
        """Where cameras may be."""
        states = [step.stage.states(step.timeline.samples) for step in self.study.steps]
        return CameraRoom(self.question.cell, states)

    def observed(self, change: ProposedChange) -> WholeStudy:
        """The same motion with a changed camera."""
        return seen_by(change.in_cell(self.question.cell), self.study, self.question.sampling)

    def finely_met(self, change: ProposedChange) -> bool:
        """Whether the wish is met with a changed camera as every command samples it."""
        question = self.question
        return finely_met(question.wish, change.in_cell(question.cell), self.study, question.sampling)

    def failure(self, change: ProposedChange) -> Sequence[Timeline] | None:
        """The events of interest of each step with a changed camera, if they miss a wish that is about nothing else.

        That takes a fraction of the whole motion's time. None: they do not, or the wish is about more.
        """
        wish = self.question.wish
        if not wish.only_events:
            return None
        observer = change.in_cell(self.question.cell).observer
        timelines = [step.timeline for step in self.study.steps]
        seen: list[tuple[float | None, float | None]] = [(1.0, timeline.T_eoi) for timeline in timelines]  # at most
        for number, (step, events) in enumerate(zip(self.study.steps, self._events, strict=True)):
            if not timelines[number].T_eoi:
                continue
            only = replace(step, stage=events, faults={})
            timeline = observe(only, observer, self.question.sampling, full=False)
            # In terms of all pieces of the step.
            which = np.array([place for place, piece in enumerate(step.stage.pieces) if piece.of_interest])
            samples = Samples(which[timeline.samples.piece], timeline.samples.t)
            timelines[number] = replace(timeline, pieces=step.stage.pieces, samples=samples)
            seen[number] = (interest_quality(timelines[number]), timelines[number].T_eoi)
            if (mean_quality(seen) or 0.0) < (wish.q_eoi or 0.0):
                return timelines
        return None

    @cached_property
    def _events(self) -> list[Stage]:
        """The events of interest of each step."""
        return [
            Stage(step.stage.model, step.motion, [one for one in step.stage.pieces if one.of_interest], step.world.X_WO)
            for step in self.study.steps
        ]

    @cached_property
    def _cameras(self) -> list[Camera]:
        return list(self.question.cell.workspace.cameras.values())

    @cached_property
    def _hopeful(self) -> list[int]:
        """The cameras that may meet the wish alone."""
        return [index for index in range(len(self._cameras)) if self._search(index).hopeful]

    def _search(self, index: int) -> CameraSearch:
        """A new search, which has learned nothing yet: so answers do not depend on what was asked before.

        A camera looks at what the workspace says, or at the point of its axis nearest to what is handled.
        """
        camera = self._cameras[index]
        aim = self.question.aims.get(camera.name)
        if aim is None:
            states = self.scene.states
            boxes = [box for target in self.scene.targets for box in target.boxes]
            places = [states.box_poses(box)[:, :3, 3].mean(axis=0) for box in boxes]
            X_FW = inverse(states.X_WF[camera.frame][0])
            aim = Aim.along(camera, transform(X_FW, np.mean(places, axis=0)[None])[0])
        return CameraSearch(self, camera, aim, index)

    @staticmethod
    def _moves(kind: Literal["aim", "position"], one: CameraSearch) -> list[CameraMove]:
        """Turns; or moves with the aim kept, and with the middle of what must be seen as aim where that is no help."""
        if kind == "aim":
            return [turning(one.camera, one.aim)]
        kept, middle = displaced(one.camera, one.aim), one.middle
        if middle is None:
            return [kept]
        turned = displaced(one.camera, middle)
        return [kept] if one.decide(turned.change(np.zeros(3))) is not None else [kept, turned]
