"""Another way or other paths of a task of several steps that meet a wish: the cell stays as it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.skill.settings import SEEN, MotionValue, Reference
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.advice.change import Miss, ProposedChange
from sqrp_cli.programming.advice.motion_search import meets, with_way
from sqrp_cli.programming.advice.question import Found, Met, Near, Question
from sqrp_cli.programming.coverage.assessment import Study, study
from sqrp_cli.programming.program_update import world_after
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way
from sqrp_cli.programming.ways.words import choice_in_words
from sqrp_cli.programming.whole_assessment import worst_seen
from sqrp_cli.programming.whole_study import WholeStudy
from sqrp_cli.programming.whole_task import whole_candidate

MOST_TOGETHER = 12
"""Ways of the first steps that are followed further: a third of them the fastest, the others those seen best."""


class _Begun(NamedTuple):
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
        near = []
        for found in sorted(self._wholes(), key=lambda whole: whole.assessment.time or 0.0):
            change = self._way_change(found.candidate)
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        return question.nearest("way", f"none of {len(near)} combinations of the steps' ways meets the wish", near)

    def seen_path(self) -> Found | Miss:
        """Paths that cameras can follow, in as few steps as that takes, those first that are seen worst."""
        question, near = self.question, []
        for candidate in self._with_seen_paths():
            found = self._in_best_ways(candidate)
            if found is None:
                continue
            chosen = {name: value for name, value in candidate.values.items() if value == SEEN}
            parameters = {**question.best.candidate.parameters, **chosen}
            steps = " and ".join(dict.fromkeys(name.partition(".")[0] for name in chosen))
            said = f"with paths that keep sight in step {steps}"
            change = ProposedChange(
                kind="path", target=candidate.name, size=0.0, unit="", parameters=parameters, said=said
            )
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        if not near:
            return Miss(kind="path", why="not tried: the skills or the task say which paths", tried=False)
        return question.nearest("path", "no path that was found meets the wish", near)

    def _wholes(self) -> Iterator[WholeStudy]:
        """Combinations of the steps' ways, each in the world that those before it leave."""
        candidate = self.question.best.candidate
        begun = [_Begun((), self.question.world)]
        for step in candidate.steps:
            begun = _promising([longer for one in begun for longer in self._longer(one, step)])
        for one in begun:
            yield WholeStudy(whole_candidate(candidate.skill, [step.candidate for step in one.steps]), one.steps)

    def _longer(self, begun: _Begun, step: Candidate) -> Iterator[_Begun]:
        """With one more step in each of its Pareto-optimal ways."""
        cell, sampling = self.question.cell, self.question.sampling
        found = find_way(cell, step, begun.after, sampling, WantedWay())
        if isinstance(found, Infeasible):
            return
        others = [with_way(step, figures) for figures in found.ways.pareto[1:]]
        for way in (found.study.candidate, *others):
            done = study(cell, way, begun.after, sampling, full=False)
            if isinstance(done, Study):
                yield _Begun((*begun.steps, done), world_after(way, done.motion, begun.after))

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

    def _way_change(self, way: Candidate) -> ProposedChange:
        asked = self.question.best.candidate
        said = choice_in_words(asked, way)
        return ProposedChange(kind="way", target=asked.name, size=0.0, unit="", parameters=way.parameters, said=said)


def _open_paths(step: Candidate) -> list[str]:
    """The parameters of a step that choose the paths of joint moves and leave them direct."""
    moves = [move for move in step.skill.primitives if isinstance(move, JointMove)]
    names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
    return [] if step.open_paths else names


def _promising(begun: Sequence[_Begun]) -> list[_Begun]:
    """At most `MOST_TOGETHER` of several beginnings, in their order: the best seen ones, and the fastest."""
    if len(begun) <= MOST_TOGETHER:
        return list(begun)
    seen = sorted(range(len(begun)), key=lambda index: -_covered(begun[index]))
    fast = sorted(range(len(begun)), key=lambda index: begun[index].time)
    third = MOST_TOGETHER // 3
    chosen = dict.fromkeys([*fast[:third], *seen[:MOST_TOGETHER]])
    return [begun[index] for index in sorted(list(chosen)[:MOST_TOGETHER])]


def _covered(begun: _Begun) -> float:
    """How well the first steps are seen: their covered time, that of events of interest twice [s]."""
    figures = [step.assessment("") for step in begun.steps]
    return sum((one.q_avg or 0.0) * (one.t_total or 0.0) + (one.q_eoi or 0.0) * (one.t_eoi or 0.0) for one in figures)
