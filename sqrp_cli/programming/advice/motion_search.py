"""Another way or another path of a candidate that meets a wish: the cell stays as it is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.skill.settings import SEEN, Reference
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.programming.advice.change import Miss, ProposedChange
from sqrp_cli.programming.advice.effects import finely_met
from sqrp_cli.programming.advice.question import Found, Met, Near, Question
from sqrp_cli.programming.coverage.assessment import Study, WayFigures
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way, studied_ways
from sqrp_cli.programming.ways.time_limit import TimeLimit
from sqrp_cli.programming.ways.words import way_in_words
from sqrp_cli.programming.whole_study import WholeStudy, whole_study


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """Looks for other motions of a candidate."""

    question: Question

    def other_way(self) -> Found | Miss:
        """The fastest of all ways that meet the wish."""
        question, best = self.question, self.question.best
        if not best.feasible or best.ways is None:
            return Miss(kind="way", why=f"none can be done: {'; '.join(best.reasons[:1])}")
        near = []
        for study in self._hopeful_ways():
            change, found = self._way_change(study.candidate), WholeStudy(study.candidate, (study,))
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        return question.nearest("way", f"none of {best.ways.tried} meets the wish", [*near, *self._named_ways()])

    def seen_path(self) -> Found | Miss:
        """Paths of joint moves that the cameras can follow."""
        question, candidate = self.question, self.question.best.candidate
        moves = [move for move in candidate.skill.primitives if isinstance(move, JointMove)]
        names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
        if not names or candidate.open_paths:
            return Miss(kind="path", why="not tried: the skill or the task says which path", tried=False)
        seen = replace(candidate, values={**candidate.values, **dict.fromkeys(names, SEEN)})
        near = []
        for limit in (None, TimeLimit(question.wish.time))[: 1 if question.wish.time is None else 2]:
            best = find_way(question.cell, seen, question.world, question.sampling, WantedWay(limit=limit))
            if isinstance(best, Infeasible):
                continue
            found = WholeStudy(best.study.candidate, (best.study,))
            change = ProposedChange(
                kind="path",
                target=candidate.name,
                size=0.0,
                unit="",
                parameters={**candidate.parameters, **dict.fromkeys(names, SEEN)},
                said="with paths that keep sight",
                unwritten="" if limit is None else f"no task says it: use --max-time {limit.seconds:g}",
            )
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        if not near:
            return Miss(kind="path", why="it cannot be done, or not in that time")
        return question.nearest("path", "no path that was found meets the wish", near)

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
                yield Near(self._way_change(way), found)

    def _way_change(self, way: Candidate) -> ProposedChange:
        asked = self.question.best.candidate
        said = way_in_words(asked.skill, asked.parameters, way.parameters)
        return ProposedChange(kind="way", target=asked.name, size=0.0, unit="", parameters=way.parameters, said=said)


def meets(question: Question, found: WholeStudy) -> bool:
    """Whether a motion meets the wish, also if sampled as finely as may be."""
    met = question.wish.met(found.assessment)
    return met and finely_met(question.wish, question.cell, found, question.sampling)


def with_way(candidate: Candidate, way: WayFigures) -> Candidate:
    """A candidate in a way."""
    values = {name: way.parameters.get(name, value) for name, value in candidate.values.items()}
    branch = {name: value for name, value in way.parameters.items() if name not in {**values, **candidate.binding}}
    vias = {name: np.array(places) for name, places in way.vias.items()}
    return replace(candidate, values=values, branch=branch, vias=vias)
