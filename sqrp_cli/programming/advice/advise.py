"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from typing import NamedTuple, Protocol

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import inverse, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.programming.advice.aiming import Aim, CameraRoom
from sqrp_cli.programming.advice.camera_moves import CameraMove, Displacement, Turn, field_of_view
from sqrp_cli.programming.advice.camera_search import Base, CameraSearch
from sqrp_cli.programming.advice.change import (
    CAMERAS,
    KINDS,
    MOTION,
    Advice,
    CandidateEffect,
    EffectOnTask,
    Kind,
    Miss,
    ProposedChange,
)
from sqrp_cli.programming.advice.motion_search import MotionSearch, MotionsOfSteps
from sqrp_cli.programming.advice.object_search import moved_objects
from sqrp_cli.programming.advice.question import Found, Met, Question, assessed
from sqrp_cli.programming.feasibility import unready_world
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_study import WholeStudy, whole_study

Moves = Callable[[CameraSearch], Sequence[CameraMove]]
"""The ways to change a camera that count as one kind."""

Findings = Sequence[Found] | Miss

NONE_ALONE = "no camera alone can: where one is missing, another is missing too"
"""Why no change of one camera helps."""


class _Item(NamedTuple):
    """A way to change a camera, by index."""

    camera: int
    move: int


@dataclass(frozen=True, eq=False)
class Cameras:
    """Looks for changes of the cameras of a cell."""

    question: Question
    study: WholeStudy
    """Of the motion, which stays as it is."""

    def turned(self) -> Findings:
        """The least turn of every camera that helps."""
        return self._moved("aim", lambda one: [Turn(one.camera, one.aim)])

    def shifted(self) -> Findings:
        """The least move of every camera that helps."""
        return self._moved("position", _positions)

    def with_other_lens(self) -> Findings:
        """The least change of the lens of every camera that helps."""
        hopeful = self._hopeful
        if not hopeful:
            return Miss(kind="lens", why=NONE_ALONE)

        def least(index: int) -> Found | None:
            met = self._search(index).least_lens()
            return None if met is None else Found(met, self._search(index).lens_margin(met.change))

        answers = [answer for answer in self.question.shared(least, hopeful) if answer is not None]
        if answers:
            return answers
        near = self.question.shared(lambda index: self._search(index).nearest_lens(), hopeful)
        return self.question.nearest("lens", "no lens of a single camera meets the wish", near)

    def with_further_one(self) -> Findings:
        """One more camera, with the lens of each of those that there are: the one with the most room around it."""
        fixed = [camera for camera in self._cameras if camera.frame == WORLD]
        lenses = _few({(camera.width, camera.height, field_of_view(camera)): camera for camera in reversed(fixed)})
        names = {camera.name for camera in self._cameras}
        name = next(name for number in count(len(names) + 1) if (name := f"cam{number}") not in names)

        def search(like: Camera) -> CameraSearch:
            aim = Aim(like.X_FC[:3, 3], np.array([0.0, 0.0, 1.0]), stated=True)
            return CameraSearch(self._base, replace(like, name=name), aim, None, like.name)

        if not fixed:
            return Miss(kind="camera", why="there is none to take the lens of")
        if not search(fixed[0]).hopeful:
            return Miss(kind="camera", why="one more camera is not enough")

        def best(like: Camera) -> Found | None:
            met = search(like).further()
            return None if met is None else Found(met, search(like).room_around(met.change))

        answers = [answer for answer in self.question.shared(best, lenses) if answer is not None]
        if not answers:
            return Miss(kind="camera", why="from no free place that was tried does one more camera meet the wish")
        return [max(answers, key=lambda answer: answer.margin.more if answer.margin else 0.0)]

    def _moved(self, kind: Kind, moves: Moves) -> Findings:
        """The least change of every camera that helps, by moves of one kind."""
        if not self._hopeful:
            return Miss(kind=kind, why=NONE_ALONE)
        items = [_Item(index, move) for index in self._hopeful for move in range(len(moves(self._search(index))))]
        answers = self._answers(self._least(items, moves), moves)
        if answers:
            return answers
        searches = [self._search(index) for index in self._hopeful]
        near = [found for one in searches if (found := one.nearest(moves(one)[0])) is not None]
        if not near:
            return Miss(kind=kind, why="there is no free place for a camera")
        return self.question.nearest(kind, f"no {kind} of a single camera meets the wish", near)

    def _least(self, items: Sequence[_Item], moves: Moves) -> dict[_Item, Met]:
        """The least change of every item that a coarse search finds, or a fine one below the least of all."""
        found = self._anywhere(items, moves)
        if not found:
            return found
        least = 0.95 * min(met.change.size for met in found.values())

        def nearer(item: _Item) -> Met | None:
            return self._search(item.camera).within(self._move(item, moves), least)

        fine = zip(items, self.question.shared(nearer, items), strict=True)
        return found | {item: met for item, met in fine if met is not None}

    def _anywhere(self, items: Sequence[_Item], moves: Moves) -> dict[_Item, Met]:
        """What a coarse search finds, as far as it must go to find anything."""
        for reach in self._move(items[0], moves).reaches:

            def anywhere(item: _Item, reach: float = reach) -> Met | None:
                return self._search(item.camera).anywhere(self._move(item, moves), reach)

            answers = self.question.shared(anywhere, items)
            if any(answers):
                return {item: met for item, met in zip(items, answers, strict=True) if met is not None}
        return {}

    def _answers(self, found: Mapping[_Item, Met], moves: Moves) -> list[Found]:
        """The least change of each camera, if it is confirmed, with its margin."""
        best: dict[int, _Item] = {}
        for item in sorted(found, key=lambda item: found[item].change.size):
            best.setdefault(item.camera, item)

        def answer(item: _Item) -> Found | None:
            search, move = self._search(item.camera), self._move(item, moves)
            met = search.confirmed(move, found[item])
            return None if met is None else Found(met, search.margin(move, met.change))

        return [one for one in self.question.shared(answer, list(best.values())) if one is not None]

    @cached_property
    def _base(self) -> Base:
        question, found = self.question, self.study
        room = CameraRoom(question.cell, [step.stage.states(step.timeline.samples) for step in found.steps])
        return Base(question.cell, found, question.wish, question.sampling, room, question.cell.seed)

    @cached_property
    def _cameras(self) -> list[Camera]:
        return list(self.question.cell.workspace.cameras.values())

    @cached_property
    def _hopeful(self) -> list[int]:
        """The cameras that may meet the wish alone."""
        return [index for index in range(len(self._cameras)) if self._search(index).hopeful]

    def _search(self, index: int) -> CameraSearch:
        """A new search, which has learned nothing yet: so answers do not depend on what was asked before."""
        camera = self._cameras[index]
        return CameraSearch(self._base, camera, self._aim(camera), index)

    def _move(self, item: _Item, moves: Moves) -> CameraMove:
        return moves(self._search(item.camera))[item.move]

    def _aim(self, camera: Camera) -> Aim:
        """What a camera looks at: as the workspace says, or the point of its axis nearest to what is handled."""
        stated = self.question.aims.get(camera.name)
        if stated is not None:
            return stated
        scene = self._base.scene
        boxes = [box for target in scene.targets for box in target.boxes]
        places = [scene.states.box_poses(box)[:, :3, 3].mean(axis=0) for box in boxes]
        X_FW = inverse(scene.states.X_WF[camera.frame][0])
        return Aim.along(camera, transform(X_FW, np.mean(places, axis=0)[None])[0])


def _few(lenses: Mapping[tuple[int, int, float], Camera]) -> list[Camera]:
    """Of cameras by their lenses: that with the narrowest, a middle and the widest view."""
    ordered = sorted(lenses.items(), key=lambda entry: entry[0][2])
    chosen = dict.fromkeys([0, len(ordered) // 2, len(ordered) - 1])
    return [ordered[number][1] for number in chosen]


def _positions(one: CameraSearch) -> list[CameraMove]:
    """Aim kept on what the camera looks at, or turned to the middle of what it must see where that alone is no help."""
    kept, middle = Displacement(one.camera, one.aim), one.middle
    if middle is None:
        return [kept]
    turned = Displacement(one.camera, middle)
    alone = one.decide(turned.change(np.zeros(3)))
    return [kept] if alone is not None else [kept, turned]


Answer = tuple[Advice, ...] | Miss
"""Of a kind: the changes that meet the wish, the least first, or why there is none."""


class Kept(Protocol):
    """Answers of a run before this one."""

    def get(self, kind: Kind) -> Answer | None:
        """The answer of a kind, if it is known."""

    def keep(self, kind: Kind, answer: Answer) -> None:
        """Keep it for runs after this one."""


@dataclass(frozen=True, eq=False)
class Adviser:
    """Answers a question; what all kinds need is computed once."""

    question: Question

    @cached_property
    def before(self) -> CandidateResult:
        """The candidate without any change, as with `--ways fastest`; in its best way if that misses the wish alone."""
        question = self.question
        found = whole_study(question.cell, question.fastest, question.world, question.sampling, full=False)
        fastest = self._of_candidate(assessed(question.fastest, found))
        alone = question.wish.met(fastest) and not question.wish.met(question.best)
        return question.best if alone else fastest

    @cached_property
    def way(self) -> Candidate:
        """The way that changes of objects and cameras start from: the best, unless that meets the wish by itself."""
        question = self.question
        return question.fastest if question.fixed or question.wish.met(question.best) else question.best.way

    def answers(self, kept: Kept | None = None) -> Iterator[Answer]:
        """For each kind in order its answer; one that is kept is not searched for again."""
        suffices = False
        for kind in KINDS if self.question.kinds is None else self.question.kinds:
            if suffices and self.question.kinds is None:
                why = "not tried, because the motion is enough; --kinds names what to try"
                yield Miss(kind=kind, why=why, tried=False)
                continue
            answer = None if kept is None else kept.get(kind)
            if answer is None:
                answer = self._answer(kind)
                if kept is not None:
                    kept.keep(kind, answer)
            suffices |= kind in MOTION and not isinstance(answer, Miss)
            yield answer

    def _answer(self, kind: Kind) -> Answer:
        why_not = self._why_not(kind)
        if why_not:
            return Miss(kind=kind, why=why_not, tried=False)
        found = self._found(kind)
        if not isinstance(found, Miss):
            return self._advice(found)
        start = self.before if kind in MOTION else assessed(self.way, self._study)
        return replace(found, nearer=self.question.wish.is_nearer(found.found, start))

    def _found(self, kind: Kind) -> Sequence[Found] | Miss:
        match kind:
            case "way" | "path":
                several = bool(self.question.fastest.steps)
                motions = MotionsOfSteps(self.question) if several else MotionSearch(self.question)
                found = motions.other_way() if kind == "way" else motions.seen_path()
                return found if isinstance(found, Miss) else [found]
            case "object":
                return moved_objects(self.question, self.way, self._study)
            case "aim":
                return self._cameras.turned()
            case "position":
                return self._cameras.shifted()
            case "lens":
                return self._cameras.with_other_lens()
            case "camera":
                return self._cameras.with_further_one()

    def _why_not(self, kind: Kind) -> str:
        """Why a kind of change cannot help, without any search; empty if it may."""
        if self._unready is not None:
            return self._unready.reasons[0]
        if kind in MOTION:
            return "not tried: the way is fixed" if self.question.fixed else ""
        return self._why_cameras_cannot if kind in CAMERAS else ""

    @cached_property
    def _unready(self) -> Infeasible | None:
        """What the world lacks, whatever is changed in the cell."""
        first = (*self.question.fastest.steps, self.question.fastest)[0]
        return unready_world(self.question.cell, first, self.question.world)

    @cached_property
    def _why_cameras_cannot(self) -> str:
        before, wish = assessed(self.way, self._study), self.question.wish
        if not before.feasible:
            return f"no camera helps: {before.reasons[0]}"
        if wish.time is not None and before.time is not None and before.time > wish.time:
            return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {wish.time:.4g} s"
        response = min((camera.response for camera in self.question.cell.observer.cameras), default=0.0)
        if wish.delay is not None and before.faults and wish.delay < response:
            return f"a frame and the latency of the fastest camera take {response:.2f} s, not {wish.delay:.4g} s"
        return ""

    @cached_property
    def _study(self) -> WholeStudy | Infeasible:
        """What changes of objects and cameras start from."""
        question = self.question
        return whole_study(question.cell, self.way, question.world, question.sampling, full=True)

    @cached_property
    def _cameras(self) -> Cameras:
        assert isinstance(self._study, WholeStudy)  # noqa: S101 - otherwise no camera can help
        return Cameras(self.question, self._study)

    def _advice(self, answers: Sequence[Found]) -> tuple[Advice, ...]:
        """With effects, the least change first."""
        advice = []
        for met, margin in sorted(answers, key=lambda answer: answer.met.change.size):
            found = self._of_candidate(met.found)
            effects = self._effects(met.change, found)
            advice.append(Advice(change=met.change, found=found, margin=margin, effects=effects))
        return tuple(advice)

    def _effects(self, change: ProposedChange, found: CandidateResult) -> tuple[EffectOnTask, ...]:
        """On all tasks; another motion of the candidate is nothing for others, nor for other tasks."""
        question = self.question
        if change.kind not in MOTION:
            return question.effects.of(change)
        pairs = ((self.before, found) if one is question.best else (one, one) for one in question.assessments)
        candidates = tuple(CandidateEffect(before=before, after=after) for before, after in pairs)
        return (EffectOnTask(task=question.task, candidates=candidates),)

    def _of_candidate(self, found: CandidateResult) -> CandidateResult:
        """The figures of a way as those of the candidate."""
        return replace(found, candidate=self.question.best.candidate, best_way=found.candidate)
