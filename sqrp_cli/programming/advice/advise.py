"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import inverse, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.settings import MotionValue
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.camera_moves import CameraMove, Position, Turn
from sqrp_cli.programming.advice.camera_search import Base, CameraSearch, Met, Near
from sqrp_cli.programming.advice.change import (
    KINDS,
    Advice,
    CandidateEffect,
    Change,
    Effect,
    Kind,
    Margin,
    Miss,
)
from sqrp_cli.programming.advice.effects import Effects, assessed
from sqrp_cli.programming.advice.room import CameraRoom
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, study
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.words import way_in_words

Moves = Callable[[CameraSearch], Sequence[CameraMove]]
"""The ways to change a camera that count as one kind."""

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
    """The candidate in its fastest way."""
    best: Assessment
    """The candidate by its best way; by the fastest one where the motion is fixed."""
    wish: Wish
    aims: Mapping[str, Aim]
    """What cameras look at, by name, where the workspace says so."""
    effects: Effects
    """Every task of the workspace."""
    kinds: Sequence[Kind] = KINDS
    """What may be changed."""
    fixed: bool = False
    """Whether the motion stays as it is."""
    jobs: int = 1
    """Processes to use at most; the answers do not depend on it."""


@dataclass(frozen=True, eq=False)
class _CameraAnswer:
    """What was found about one camera."""

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
        """The candidate in its fastest way, without any change."""
        question = self.question
        found = study(question.cell, question.fastest, question.world, question.sampling, full=False)
        return assessed(question.fastest, found)

    @cached_property
    def way(self) -> Candidate:
        """The way that changes of objects and cameras start from: the best, unless that meets the wish by itself."""
        question = self.question
        return question.fastest if question.fixed or question.wish.met(question.best) else question.best.way

    def answers(self) -> Iterator[tuple[Advice, ...] | Miss]:
        """For each kind in order the changes that meet the wish, the least first, or why there is none."""
        for kind in KINDS:
            if kind in self.question.kinds:
                yield self._answer(kind)

    def _answer(self, kind: Kind) -> tuple[Advice, ...] | Miss:
        if kind in ("way", "path") and self.question.fixed:
            return Miss(kind=kind, why="not tried: the way is fixed", tried=False)
        why_not = self._why_cameras_cannot if kind in ("aim", "position", "lens", "camera") else ""
        if why_not:
            return Miss(kind=kind, why=why_not, tried=False)
        match kind:
            case "way":
                return self._other_way()
            case "aim":
                return self._of_cameras(kind, lambda one: [Turn(one.camera, one.aim)])
            case "position":
                return self._of_cameras(kind, _positions)
            case _:
                return Miss(kind=kind, why="not tried", tried=False)

    @cached_property
    def _study(self) -> Study | Infeasible:
        question = self.question
        return study(question.cell, self.way, question.world, question.sampling, full=True)

    @cached_property
    def _start(self) -> Assessment:
        """What changes of objects and cameras start from."""
        return assessed(self.way, self._study)

    def _other_way(self) -> tuple[Advice, ...] | Miss:
        """The fastest of the ways that meet the wish."""
        question, best = self.question, self.question.best
        if not best.feasible or best.ways is None:
            return Miss(kind="way", why=f"none can be done: {'; '.join(best.reasons[:1])}")
        for figures in sorted(best.ways.pareto, key=lambda figures: figures.time):
            way = best.way if figures == best.ways.pareto[0] else _with(best.candidate, figures.parameters)
            found = study(question.cell, way, question.world, question.sampling, full=False)
            if question.wish.met(assessed(way, found)):
                after = replace(assessed(way, found), candidate=best.candidate, best_way=way)
                change = self._way_change(way)
                before = replace(self.before, candidate=best.candidate)
                effect = Effect(task=question.task, candidates=(CandidateEffect(before=before, after=after),))
                return (Advice(change=change, found=after, margin=None, effects=(effect,)),)
        nearest = self._way_change(best.way)
        limit = self._base.limit(nearest, self._base.study)
        why = f"none of {best.ways.tried} meets the wish"
        return Miss(kind="way", why=why, nearest=nearest, found=best, limit=limit)

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

    def _of_cameras(self, kind: Kind, moves: Moves) -> tuple[Advice, ...] | Miss:
        """The least change of every camera that helps."""
        cameras = list(self.question.cell.workspace.cameras.values())
        hopeful = [index for index in range(len(cameras)) if self._search(index).hopeful]
        if not hopeful:
            return Miss(kind=kind, why="no camera alone can: where one is missing, another is missing too")
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
        return self._advice([_CameraAnswer(found[item], room) for item, room in zip(best, margins, strict=True)])

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
        camera = list(self.question.cell.workspace.cameras.values())[index]
        return CameraSearch(self._base, camera, self._aim(camera), index)

    def _move(self, item: _Item, moves: Moves) -> CameraMove:
        return moves(self._search(item.camera))[item.move]

    def _nearest_of(self, kind: Kind, searches: Sequence[CameraSearch], moves: Moves) -> Miss:
        near: list[tuple[float, int, Near]] = []
        for number, one in enumerate(searches):
            found = one.nearest(moves(one)[0])
            if found is not None:
                near.append((self.question.wish.shortfall(found.study.assessment("")), number, found))
        if not near:
            return Miss(kind=kind, why="there is no free place for a camera")
        best = min(near, key=lambda entry: entry[:2])[2]
        return Miss(
            kind=kind,
            why=f"no {kind} of a single camera meets the wish",
            nearest=best.change,
            found=best.study.assessment(""),
            limit=self._base.limit(best.change, best.study),
        )

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

    def _advice(self, answers: Sequence[_CameraAnswer]) -> tuple[Advice, ...]:
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


def _with(candidate: Candidate, parameters: Mapping[str, MotionValue]) -> Candidate:
    """A candidate in the way of these parameters."""
    values = {name: parameters.get(name, value) for name, value in candidate.values.items()}
    branch = {name: value for name, value in parameters.items() if name not in {**values, **candidate.binding}}
    return replace(candidate, values=values, branch=branch)


def _positions(one: CameraSearch) -> list[CameraMove]:
    """Aim kept on what the camera looks at, or turned to the middle of what it must see where that alone is no help."""
    kept, middle = Position(one.camera, one.aim), one.middle
    if middle is None:
        return [kept]
    turned = Position(one.camera, middle)
    alone = one.decide(turned.change(np.zeros(3)))
    return [kept] if alone is not None else [kept, turned]
