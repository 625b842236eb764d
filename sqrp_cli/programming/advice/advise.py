"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count
from math import inf
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import inverse, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.skill.settings import SEEN, Reference
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.camera_moves import CameraMove, Position, Turn, field_of_view
from sqrp_cli.programming.advice.camera_search import Base, CameraSearch, Met, Near, limit_of
from sqrp_cli.programming.advice.change import (
    KINDS,
    MOTION,
    Advice,
    CandidateEffect,
    Change,
    Effect,
    Kind,
    Margin,
    Miss,
)
from sqrp_cli.programming.advice.effects import Effects, assessed
from sqrp_cli.programming.advice.object_search import ObjectSearch, handled, objects_to_move
from sqrp_cli.programming.advice.room import CameraRoom
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, WayFigures, study
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way, studied_ways
from sqrp_cli.programming.ways.time_limit import TimeLimit
from sqrp_cli.programming.ways.words import way_in_words

Answer = tuple[Advice, ...] | Miss
"""Of a kind: the changes that meet the wish, the least first, or why there is none."""


class Kept(Protocol):
    """Answers of a run before this one."""

    def get(self, kind: Kind) -> Answer | None:
        """The answer of a kind, if it is known."""

    def keep(self, kind: Kind, answer: Answer) -> None:
        """Keep it for runs after this one."""


Moves = Callable[[CameraSearch], Sequence[CameraMove]]
"""The ways to change a camera that count as one kind."""

NONE_ALONE = "no camera alone can: where one is missing, another is missing too"
"""Why no change of one camera helps."""

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """What is to be met, and what may be changed."""

    task: str
    """As it was asked for."""
    cell: Cell
    world: World
    sampling: Sampling
    fastest: Candidate
    """The candidate as `--ways fastest` has it."""
    best: Assessment
    """The candidate by its best way; by the fastest one where the motion is fixed."""
    wish: Wish
    aims: Mapping[str, Aim]
    """What cameras look at, by name, where the workspace says so."""
    effects: Effects
    """Every task of the workspace."""
    kinds: Sequence[Kind] | None = None
    """What may be changed; None: cameras and objects only where no other motion meets the wish."""
    fixed: bool = False
    """Whether the motion stays as it is."""
    jobs: int = 1
    """Processes to use at most; the answers do not depend on it."""


@dataclass(frozen=True, eq=False)
class _Answer:
    """What was found about one camera or object."""

    met: Met
    margin: Margin | None


class _Item(NamedTuple):
    """A way to change a camera, by index."""

    camera: int
    move: int


class Adviser:
    """Answers a question; what all kinds need is computed once."""

    def __init__(self, question: Question) -> None:
        """Nothing is computed yet."""
        self.question = question

    @cached_property
    def before(self) -> Assessment:
        """The candidate without any change, as with `--ways fastest`; in its best way if that misses the wish alone."""
        question = self.question
        found = study(question.cell, question.fastest, question.world, question.sampling, full=False)
        fastest = replace(
            assessed(question.fastest, found), candidate=question.best.candidate, best_way=question.fastest
        )
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
        for kind in KINDS:
            if self.question.kinds is not None and kind not in self.question.kinds:
                continue
            if suffices and self.question.kinds is None:
                yield Miss(
                    kind=kind, why="not tried, because the motion is enough; --kinds names what to try", tried=False
                )
                continue
            answer = None if kept is None else kept.get(kind)
            if answer is None:
                answer = self._answer(kind)
                if kept is not None:
                    kept.keep(kind, answer)
            suffices |= kind in MOTION and not isinstance(answer, Miss)
            yield answer

    def _answer(self, kind: Kind) -> Answer:
        if kind in MOTION and self.question.fixed:
            return Miss(kind=kind, why="not tried: the way is fixed", tried=False)
        why_not = self._why_cameras_cannot if kind in ("aim", "position", "lens", "camera") else ""
        if why_not:
            return Miss(kind=kind, why=why_not, tried=False)
        match kind:
            case "way":
                return self._other_way()
            case "object":
                return self._objects()
            case "aim":
                return self._of_cameras(kind, lambda one: [Turn(one.camera, one.aim)])
            case "position":
                return self._of_cameras(kind, _positions)
            case "lens":
                return self._lenses()
            case "camera":
                return self._further_camera()
            case "path":
                return self._seen_path()

    @cached_property
    def _study(self) -> Study | Infeasible:
        question = self.question
        return study(question.cell, self.way, question.world, question.sampling, full=True)

    @cached_property
    def _start(self) -> Assessment:
        """What changes of objects and cameras start from."""
        return assessed(self.way, self._study)

    def _other_way(self) -> Answer:
        """The fastest of all ways that meet the wish."""
        question, best = self.question, self.question.best
        if not best.feasible or best.ways is None:
            return Miss(kind="way", why=f"none can be done: {'; '.join(best.reasons[:1])}")
        near = []
        for found in self._hopeful_ways():
            after = replace(found.assessment(""), candidate=best.candidate, best_way=found.candidate)
            change = self._way_change(found.candidate)
            if question.wish.met(after):
                effect = Effect(task=question.task, candidates=(CandidateEffect(before=self.before, after=after),))
                return (Advice(change=change, found=after, margin=None, effects=(effect,)),)
            near.append(Near(change, found))
        return self._miss("way", f"none of {best.ways.tried} meets the wish", [*near, *self._named_ways()])

    def _hopeful_ways(self) -> Iterator[Study]:
        """Studies of all ways that may meet the wish, the fastest first."""
        question = self.question
        limit = TimeLimit(inf if question.wish.time is None else question.wish.time)
        candidate, wish = question.best.candidate, question.wish
        return studied_ways(
            question.cell, candidate, question.world, question.sampling, limit=limit, worth=wish.may_be_met
        )

    def _named_ways(self) -> Iterator[Near]:
        """The Pareto-optimal ways."""
        question, best = self.question, self.question.best
        for figures in best.ways.pareto if best.ways else ():
            way = best.way if best.ways and figures == best.ways.pareto[0] else _with(best.candidate, figures)
            found = study(question.cell, way, question.world, question.sampling, full=False)
            if isinstance(found, Study):
                yield Near(self._way_change(way), found)

    def _seen_path(self) -> Answer:
        """Paths of joint moves that the cameras can follow."""
        question, best = self.question, self.question.best
        moves = [move for move in best.candidate.skill.primitives if isinstance(move, JointMove)]
        names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
        if not names or best.candidate.open_paths:
            return Miss(kind="path", why="not tried: the skill or the task says which path", tried=False)
        seen = replace(best.candidate, values={**best.candidate.values, **dict.fromkeys(names, SEEN)})
        near = []
        for limit in (None, TimeLimit(question.wish.time))[: 1 if question.wish.time is None else 2]:
            found = find_way(question.cell, seen, question.world, question.sampling, WantedWay(limit=limit))
            if isinstance(found, Infeasible):
                continue
            after = replace(assessed(seen, found.study), candidate=best.candidate, best_way=found.study.candidate)
            change = Change(
                kind="path",
                target=best.candidate.name,
                size=0.0,
                unit="",
                parameters={**best.candidate.parameters, **dict.fromkeys(names, SEEN)},
                said="with paths that keep sight",
                unwritten="" if limit is None else f"no task says it: use --max-time {limit.seconds:g}",
            )
            if question.wish.met(after):
                effect = Effect(task=question.task, candidates=(CandidateEffect(before=self.before, after=after),))
                return (Advice(change=change, found=after, margin=None, effects=(effect,)),)
            near.append(Near(change, found.study))
        if not near:
            return Miss(kind="path", why="it cannot be done, or not in that time")
        return self._miss("path", "no path that was found meets the wish", near)

    def _way_change(self, way: Candidate) -> Change:
        asked = self.question.best.candidate
        said = way_in_words(asked.skill, asked.parameters, way.parameters)
        return Change(kind="way", target=asked.name, size=0.0, unit="", parameters=way.parameters, said=said)

    @cached_property
    def _base(self) -> Base:
        question, found = self.question, self._study
        assert isinstance(found, Study)  # noqa: S101 - otherwise no camera can help
        room = CameraRoom(question.cell, [found.stage.states(found.timeline.samples)])
        return Base(question.cell, found, question.wish, question.sampling, room, question.cell.seed)

    @cached_property
    def _why_cameras_cannot(self) -> str:
        """Why no change of cameras can help; empty if one may."""
        before, wish = self._start, self.question.wish
        if not before.feasible:
            return f"no camera helps: {before.reasons[0]}"
        if wish.time is not None and before.time is not None and before.time > wish.time:
            return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {wish.time:.4g} s"
        response = min((camera.response for camera in self.question.cell.observer.cameras), default=0.0)
        if wish.delay is not None and before.faults and wish.delay < response:
            return f"a frame and the latency of the fastest camera take {response:.2f} s, not {wish.delay:.4g} s"
        return ""

    def _of_cameras(self, kind: Kind, moves: Moves) -> Answer:
        """The least change of every camera that helps."""
        hopeful = [index for index in range(len(self._cameras)) if self._search(index).hopeful]
        if not hopeful:
            return Miss(kind=kind, why=NONE_ALONE)
        items = [_Item(index, move) for index in hopeful for move in range(len(moves(self._search(index))))]
        found = self._anywhere(items, moves)
        if not found:
            return self._nearest_of(kind, [self._search(index) for index in hopeful], moves)
        least = 0.95 * min(met.change.size for met in found.values())
        nearer = self._shared(lambda item: self._search(item.camera).within(self._move(item, moves), least), items)
        found |= {item: met for item, met in zip(items, nearer, strict=True) if met is not None}
        best = [
            min((item for item in found if item.camera == index), key=lambda item: found[item].change.size)
            for index in dict.fromkeys(item.camera for item in found)
        ]

        def margin(item: _Item) -> Margin:
            return self._search(item.camera).margin(self._move(item, moves), found[item].change)

        margins = self._shared(margin, best)
        return self._advice([_Answer(found[item], room) for item, room in zip(best, margins, strict=True)])

    def _objects(self) -> Answer:
        """The least move of what is handled, and of what hides most."""
        question, found = self.question, self._study
        if isinstance(found, Infeasible):
            names: tuple[str, ...] = handled(question.cell, self.way, question.world)
        else:
            names = objects_to_move(question.cell, found, question.world)
        if not names:
            return Miss(kind="object", why="no object is handled or hides anything")

        def search(name: str) -> ObjectSearch:
            return ObjectSearch(question.cell, question.world, question.sampling, self.way, question.wish, name)

        def least(name: str) -> _Answer | None:
            met = search(name).least()
            return None if met is None else _Answer(met, search(name).margin(met.change))

        answers = [answer for answer in self._shared(least, names) if answer is not None]
        if answers:
            return self._advice(answers)
        near = [one for one in self._shared(lambda name: search(name).nearest(), names) if one is not None]
        tried = ", ".join(names)
        if not near:
            return Miss(
                kind="object", why=f"there is no place where {tried} can be handled and stand clear of all else"
            )
        return self._miss("object", f"no place of {tried} within 32 cm meets the wish", near)

    def _lenses(self) -> Answer:
        """The least change of the lens of every camera that helps."""
        hopeful = [index for index in range(len(self._cameras)) if self._search(index).hopeful]
        if not hopeful:
            return Miss(kind="lens", why=NONE_ALONE)

        def least(index: int) -> _Answer | None:
            met = self._search(index).least_lens()
            return None if met is None else _Answer(met, self._search(index).lens_margin(met.change))

        answers = [answer for answer in self._shared(least, hopeful) if answer is not None]
        if answers:
            return self._advice(answers)
        near = self._shared(lambda index: self._search(index).nearest_lens(), hopeful)
        return self._miss("lens", "no lens of a single camera meets the wish", near)

    def _further_camera(self) -> Answer:
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

        def best(like: Camera) -> _Answer | None:
            met = search(like).further()
            return None if met is None else _Answer(met, search(like).room_around(met.change))

        answers = [answer for answer in self._shared(best, lenses) if answer is not None]
        if not answers:
            return Miss(kind="camera", why="from no free place that was tried does one more camera meet the wish")
        widest = max(answers, key=lambda answer: answer.margin.more if answer.margin else 0.0)
        return self._advice([widest])

    def _miss(self, kind: Kind, why: str, near: Sequence[Near]) -> Miss:
        """What comes nearest of several."""
        best = min(near, key=lambda one: self.question.wish.shortfall(one.study.assessment("")))
        limit = limit_of(best.change.in_cell(self.question.cell), best.study)
        return Miss(kind=kind, why=why, nearest=best.change, found=best.study.assessment(""), limit=limit)

    @cached_property
    def _cameras(self) -> list[Camera]:
        return list(self.question.cell.workspace.cameras.values())

    def _anywhere(self, items: Sequence[_Item], moves: Moves) -> dict[_Item, Met]:
        """What a coarse search finds, as far as it must go to find anything."""
        for reach in self._move(items[0], moves).reaches:

            def anywhere(item: _Item, reach: float = reach) -> Met | None:
                return self._search(item.camera).anywhere(self._move(item, moves), reach)

            answers = self._shared(anywhere, items)
            if any(answers):
                return {item: met for item, met in zip(items, answers, strict=True) if met is not None}
        return {}

    def _search(self, index: int) -> CameraSearch:
        """A new search, which has learned nothing yet: so answers do not depend on what was asked before."""
        camera = self._cameras[index]
        return CameraSearch(self._base, camera, self._aim(camera), index)

    def _move(self, item: _Item, moves: Moves) -> CameraMove:
        return moves(self._search(item.camera))[item.move]

    def _nearest_of(self, kind: Kind, searches: Sequence[CameraSearch], moves: Moves) -> Miss:
        near = [found for one in searches if (found := one.nearest(moves(one)[0])) is not None]
        if not near:
            return Miss(kind=kind, why="there is no free place for a camera")
        return self._miss(kind, f"no {kind} of a single camera meets the wish", near)

    def _aim(self, camera: Camera) -> Aim:
        """What a camera looks at: as the workspace says, or the point of its axis nearest to what is handled."""
        stated = self.question.aims.get(camera.name)
        if stated is not None:
            return stated
        scene = self._base.scene
        boxes = [box for target in scene.study.targets for box in target.boxes]
        places = [scene.states.box_poses(box)[:, :3, 3].mean(axis=0) for box in boxes]
        X_FW = inverse(scene.states.X_WF[camera.frame][0])
        return Aim.along(camera, transform(X_FW, np.mean(places, axis=0)[None])[0])

    def _advice(self, answers: Sequence[_Answer]) -> tuple[Advice, ...]:
        """With effects, the least change first."""
        ordered = sorted(answers, key=lambda answer: answer.met.change.size)
        return tuple(
            Advice(
                change=answer.met.change,
                found=replace(answer.met.found, candidate=self.question.best.candidate, best_way=self.way),
                margin=answer.margin,
                effects=self.question.effects.of(answer.met.change),
            )
            for answer in ordered
        )

    def _shared(self, work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
        """The results of some work, in order, by as many processes as may be used."""
        return list(in_processes(work, items, min(self.question.jobs, len(items))))


def _with(candidate: Candidate, way: WayFigures) -> Candidate:
    """A candidate in a way."""
    values = {name: way.parameters.get(name, value) for name, value in candidate.values.items()}
    branch = {name: value for name, value in way.parameters.items() if name not in {**values, **candidate.binding}}
    vias = {name: np.array(places) for name, places in way.vias.items()}
    return replace(candidate, values=values, branch=branch, vias=vias)


def _few(lenses: Mapping[tuple[int, int, float], Camera]) -> list[Camera]:
    """Of cameras by their lenses: that with the narrowest, a middle and the widest view."""
    ordered = sorted(lenses.items(), key=lambda entry: entry[0][2])
    chosen = dict.fromkeys([0, len(ordered) // 2, len(ordered) - 1])
    return [ordered[number][1] for number in chosen]


def _positions(one: CameraSearch) -> list[CameraMove]:
    """Aim kept on what the camera looks at, or turned to the middle of what it must see where that alone is no help."""
    kept, middle = Position(one.camera, one.aim), one.middle
    if middle is None:
        return [kept]
    turned = Position(one.camera, middle)
    alone = one.decide(turned.change(np.zeros(3)))
    return [kept] if alone is not None else [kept, turned]
