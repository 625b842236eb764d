"""Another way or another path of a candidate that meets a wish: the cell stays as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import NamedTuple

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.skill.settings import SEEN, MotionValue, Reference
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.advice.change import Miss, ProposedChange
from sqrp_cli.programming.advice.question import Found, Met, Near, Question, finely_met
from sqrp_cli.programming.candidate import whole_candidate
from sqrp_cli.programming.coverage.assessment import Study, study
from sqrp_cli.programming.program_update import world_after
from sqrp_cli.programming.result import WayFigures
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import TimeLimit, WantedWay, find_way, studied_ways
from sqrp_cli.programming.ways.grips import choice_in_words
from sqrp_cli.programming.whole_study import WholeStudy, whole_study, worst_seen

NO_PATH = "no path that was found meets the wish"
"""Why no change of paths helps."""

MOST_TOGETHER = 12
"""Ways of the first steps that are followed further: a third of them the fastest, the others those seen best."""


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """Looks for other motions of a candidate."""

    question: Question

    def other_way(self) -> Found | Miss:
        """The fastest of all ways that meet the wish."""
        question, best = self.question, self.question.best
        if not best.feasible or best.ways is None:
            return Miss(kind="way", why=f"none can be done: {'; '.join(best.reasons[:1])}")
        hopeful = (WholeStudy(one.candidate, (one,)) for one in self._hopeful_ways())
        tried = (Near(_way_change(best.candidate, one.candidate), one) for one in hopeful)
        met, near = _first_met(question, tried)
        why = f"none of {best.ways.tried} meets the wish"
        return met or question.nearest("way", why, [*near, *self._named_ways()])

    def seen_path(self) -> Found | Miss:
        """Paths of joint moves that the cameras can follow."""
        question, candidate = self.question, self.question.best.candidate
        chosen: dict[str, MotionValue] = dict.fromkeys(_open_paths(candidate), SEEN)
        if not chosen:
            return Miss(kind="path", why="not tried: the skill or the task says which path", tried=False)
        seen = replace(candidate, values={**candidate.values, **chosen})

        def tried() -> Iterator[Near]:
            for limit in (None, TimeLimit(question.wish.time))[: 1 if question.wish.time is None else 2]:
                best = find_way(question.cell, seen, question.world, question.sampling, WantedWay(limit=limit))
                if not isinstance(best, Infeasible):
                    unwritten = "" if limit is None else f"no task says it: use --max-time {limit.seconds:g}"
                    change = _path_change(candidate, chosen, "with paths that keep sight", unwritten)
                    yield Near(change, WholeStudy(best.study.candidate, (best.study,)))

        met, near = _first_met(question, tried())
        if met is None and not near:
            return Miss(kind="path", why="it cannot be done, or not in that time")
        return met or question.nearest("path", NO_PATH, near)

    def _hopeful_ways(self) -> Iterator[Study]:
        """Studies of all ways that may meet the wish, the fastest first."""
        question, wish = self.question, self.question.wish
        limit = TimeLimit(inf if wish.time is None else wish.time)
        cell, candidate = question.cell, question.best.candidate
        return studied_ways(cell, candidate, question.world, question.sampling, limit=limit, worth=wish.may_be_met)

    def _named_ways(self) -> Iterator[Near]:
        """The Pareto-optimal ways."""
        question, best = self.question, self.question.best
        for figures in best.ways.pareto if best.ways else ():
            way = best.way if best.ways and figures == best.ways.pareto[0] else with_way(best.candidate, figures)
            found = whole_study(question.cell, way, question.world, question.sampling, full=False)
            if isinstance(found, WholeStudy):
                yield Near(_way_change(best.candidate, way), found)


def meets(question: Question, found: WholeStudy) -> bool:
    """Whether a motion meets the wish, also if sampled as finely as may be."""
    met = question.wish.met(found.assessment)
    return met and finely_met(question.wish, question.cell, found, question.sampling)


class _Tried(NamedTuple):
    """What came of changes that were tried one after the other."""

    met: Found | None
    """The first that meets the wish."""
    near: list[Near]
    """Those before it."""


def _first_met(question: Question, tried: Iterable[Near]) -> _Tried:
    near: list[Near] = []
    for one in tried:
        if meets(question, one.study):
            return _Tried(Found(Met(one.change, one.study.assessment)), near)
        near.append(one)
    return _Tried(None, near)


def with_way(candidate: Candidate, way: WayFigures) -> Candidate:
    """A candidate in a way."""
    values = {name: way.parameters.get(name, value) for name, value in candidate.values.items()}
    branch = {name: value for name, value in way.parameters.items() if name not in {**values, **candidate.binding}}
    vias = {name: np.array(places) for name, places in way.vias.items()}
    return replace(candidate, values=values, branch=branch, vias=vias)


class _FirstSteps(NamedTuple):
    """The first steps, each in a way."""

    steps: tuple[Study, ...]
    after: World

    @property
    def time(self) -> float:
        """Of these steps [s]."""
        return sum(step.motion.time for step in self.steps)


@dataclass(frozen=True, eq=False)
class MotionsOfSteps:
    """Looks for other motions of a candidate of several steps."""

    question: Question

    def other_way(self) -> Found | Miss:
        """The fastest whole that meets the wish, of the Pareto-optimal ways of each step after those before it."""
        question = self.question
        if not question.best.feasible:
            return Miss(kind="way", why=f"none can be done: {'; '.join(question.best.reasons[:1])}")
        wholes = sorted(self._wholes(), key=lambda whole: whole.assessment.time or 0.0)
        tried = (Near(_way_change(question.best.candidate, found.candidate), found) for found in wholes)
        met, near = _first_met(question, tried)
        why = f"none of {len(near)} combinations of the steps' ways meets the wish"
        return met or question.nearest("way", why, near)

    def seen_path(self) -> Found | Miss:
        """Paths that cameras can follow, in as few steps as that takes, those first that are seen worst."""
        met, near = _first_met(self.question, self._in_seen_paths())
        if met is None and not near:
            return Miss(kind="path", why="not tried: the skills or the task say which paths", tried=False)
        return met or self.question.nearest("path", NO_PATH, near)

    def _in_seen_paths(self) -> Iterator[Near]:
        for candidate in self._with_seen_paths():
            found = self._in_best_ways(candidate)
            if found is not None:
                chosen = {name: value for name, value in candidate.values.items() if value == SEEN}
                steps = " and ".join(dict.fromkeys(name.partition(".")[0] for name in chosen))
                said = f"with paths that keep sight in step {steps}"
                yield Near(_path_change(self.question.best.candidate, chosen, said), found)

    def _wholes(self) -> Iterator[WholeStudy]:
        """Combinations of the steps' ways, each in the world that those before it leave."""
        candidate = self.question.best.candidate
        begun = [_FirstSteps((), self.question.world)]
        for step in candidate.steps:
            begun = _promising([longer for one in begun for longer in self._longer(one, step)])
        for one in begun:
            yield WholeStudy(whole_candidate(candidate.skill, [step.candidate for step in one.steps]), one.steps)

    def _longer(self, begun: _FirstSteps, step: Candidate) -> Iterator[_FirstSteps]:
        """With one more step in each of its Pareto-optimal ways."""
        cell, sampling = self.question.cell, self.question.sampling
        found = find_way(cell, step, begun.after, sampling, WantedWay())
        if isinstance(found, Infeasible):
            return
        others = [with_way(step, figures) for figures in found.ways.pareto[1:]]
        for way in (found.study.candidate, *others):
            done = study(cell, way, begun.after, sampling, full=False)
            if isinstance(done, Study):
                yield _FirstSteps((*begun.steps, done), world_after(way, done.motion, begun.after))

    def _with_seen_paths(self) -> Iterator[Candidate]:
        """The candidate with seen paths in one step, in one more, and so on; the steps that are seen worst first."""
        candidate = self.question.best.candidate
        steps, left = list(candidate.steps), list(range(len(candidate.steps)))
        while left and self.question.best.feasible:
            index = left.pop(worst_seen([self.question.best.steps[number] for number in left]))
            names = _open_paths(steps[index])
            if names:
                values: dict[str, MotionValue] = {**steps[index].values, **dict.fromkeys(names, SEEN)}
                steps[index] = replace(steps[index], values=values)
                yield replace(whole_candidate(candidate.skill, steps), name=candidate.name)

    def _in_best_ways(self, candidate: Candidate) -> WholeStudy | None:
        """Each step in its best way, after those before it; None if one cannot be done."""
        world, done = self.question.world, []
        for step in candidate.steps:
            found = find_way(self.question.cell, step, world, self.question.sampling, WantedWay())
            if isinstance(found, Infeasible):
                return None
            done.append(found.study)
            world = world_after(found.study.candidate, found.study.motion, world)
        return WholeStudy(whole_candidate(candidate.skill, [one.candidate for one in done]), tuple(done))


def _way_change(asked: Candidate, way: Candidate) -> ProposedChange:
    said = choice_in_words(asked, way)
    return ProposedChange(kind="way", target=asked.name, size=0.0, unit="", parameters=way.parameters, said=said)


def _path_change(asked: Candidate, chosen: Mapping[str, MotionValue], said: str, unwritten: str = "") -> ProposedChange:
    return ProposedChange(
        kind="path",
        target=asked.name,
        size=0.0,
        unit="",
        parameters={**asked.parameters, **chosen},
        said=said,
        unwritten=unwritten,
    )


def _open_paths(step: Candidate) -> list[str]:
    """The parameters of a step that choose the paths of joint moves and leave them direct."""
    moves = [move for move in step.skill.primitives if isinstance(move, JointMove)]
    names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
    return [] if step.open_paths else names


def _promising(begun: Sequence[_FirstSteps]) -> list[_FirstSteps]:
    """At most `MOST_TOGETHER` of several beginnings, in their order: the best seen ones, and the fastest."""
    if len(begun) <= MOST_TOGETHER:
        return list(begun)
    seen = sorted(range(len(begun)), key=lambda index: -_covered(begun[index]))
    fast = sorted(range(len(begun)), key=lambda index: begun[index].time)
    third = MOST_TOGETHER // 3
    chosen = dict.fromkeys([*fast[:third], *seen[:MOST_TOGETHER]])
    return [begun[index] for index in sorted(list(chosen)[:MOST_TOGETHER])]


def _covered(begun: _FirstSteps) -> float:
    """How well the first steps are seen: their covered time, that of events of interest twice [s]."""
    figures = [step.assessment("") for step in begun.steps]
    return sum((one.q_avg or 0.0) * (one.t_total or 0.0) + (one.q_eoi or 0.0) * (one.t_eoi or 0.0) for one in figures)
