"""Another way or another path of a candidate that meets a goal: the cell stays as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from math import inf

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.search.question import ProposedChange, Question, Search, Tried
from sqrp_cli.skill.settings import SEEN, Reference
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.find import TimeLimit, WantedWay, analysed_ways, find_way
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.program_update import world_after
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_analysis import WholeAnalysis, whole_analysis, worst_seen
from sqrp_cli.task.candidate import whole_candidate
from sqrp_cli.task.grips import choice_in_words
from sqrp_cli.task.task import Candidate

MOST_BEGINNINGS = 12
"""Ways of the first steps that are followed further: a third of them the fastest, the others those seen best."""


def other_way(question: Question) -> Search:
    """The fastest of all ways that meet the goal; of several steps, of combinations of their Pareto-optimal ways."""
    best, goal = question.best, question.goal
    cell, world, sampling = question.cell, question.world, question.sampling
    if not best.feasible or not (best.ways or best.candidate.steps):
        return (), f"none can be done: {'; '.join(best.reasons[:1])}"
    if best.candidate.steps:
        ways: Iterable[WholeAnalysis] = sorted(_of_steps(question), key=lambda whole: whole.result.time or 0.0)
    else:
        limit = TimeLimit(inf if goal.time is None else goal.time)
        plans = question.plans
        found = analysed_ways(cell, best.candidate, world, sampling, limit=limit, worth=goal.may_be_met, plans=plans)
        ways = (WholeAnalysis(one.planned.candidate, (one,)) for one in found)
    if best.ways is not None and best.ways.pareto:  # to be compared: some may take too long, or be seen too badly
        known = (whole_analysis(cell, way, world, sampling, full=False) for way in pareto_ways(best.candidate, best))
        ways = chain(ways, (one for one in known if isinstance(one, WholeAnalysis)))
    near: list[Tried] = []
    for one in ways:
        way, said = one.candidate.parameters, choice_in_words(best.candidate, one.candidate)
        tried = Tried(ProposedChange(kind="way", target=best.candidate.name, parameters=way, said=said), one)
        if question.met_for_sure(tried):
            return [tried], ""
        near.append(tried)
    of = f"{len(near)} combinations of the steps' ways" if best.ways is None else best.ways.tried
    return near, f"none of {of} is enough"


def seen_path(question: Question) -> Search:
    """Paths of joint moves that the cameras can follow, in as few steps as that takes."""
    candidate, near = question.best.candidate, list[Tried]()
    cell, world, sampling = question.cell, question.world, question.sampling
    if not candidate.steps and not _open_paths(candidate):
        return (), "not tried: the skill or the task says which path"
    for change, asked, wanted in _with_seen_paths(question):
        best = RankJob(sampling, wanted=wanted, cell=cell, world=world, verdicts=False).assess(asked)
        found = whole_analysis(cell, best.way, world, sampling, full=False) if best.feasible else None
        if isinstance(found, WholeAnalysis):
            near.append(Tried(change, found))
            if question.met_for_sure(near[-1]):
                return near[-1:], ""
    if near:
        return near, "none that was found is enough"
    stated = "not tried: the skills or the task say which paths"
    return (), stated if candidate.steps else "it cannot be done, or not in that time"


def pareto_ways(candidate: Candidate, found: CandidateResult) -> list[Candidate]:
    """The way of a candidate that has these figures, then its others that are Pareto-optimal."""
    ways = [found.way]
    for figures in () if found.ways is None else found.ways.pareto[1:]:
        values = {name: figures.parameters.get(name, value) for name, value in candidate.values.items()}
        branch = {k: v for k, v in figures.parameters.items() if k not in {**values, **candidate.binding}}
        vias = {name: np.array(places) for name, places in figures.vias.items()}
        ways.append(replace(candidate, values=values, branch=branch, vias=vias))
    return ways


def _with_seen_paths(question: Question) -> Iterator[tuple[ProposedChange, Candidate, WantedWay]]:
    """A candidate of one step with paths that keep sight, in any time, then within the time of the goal.

    Of several steps: with such paths in one step, in one more, and so on; those seen worst first.
    """
    candidate = question.best.candidate
    change = ProposedChange(kind="path", target=candidate.name, said="with paths that keep sight")
    if not candidate.steps:
        paths = dict.fromkeys(_open_paths(candidate), SEEN)
        change = replace(change, parameters={**candidate.parameters, **paths})
        asked = replace(candidate, values={**candidate.values, **paths})
        yield change, asked, WantedWay()
        if question.goal.time is not None:
            limit = TimeLimit(question.goal.time)
            unwritten = f"no task says it: use --max-time {limit.seconds:g}"
            yield replace(change, unwritten=unwritten), asked, WantedWay(limit=limit)
    steps, left = list(candidate.steps), list(range(len(candidate.steps)))
    while left and question.best.feasible:
        index = left.pop(worst_seen([question.best.steps[number] for number in left]))
        if names := _open_paths(steps[index]):
            steps[index] = replace(steps[index], values={**steps[index].values, **dict.fromkeys(names, SEEN)})
            asked = whole_candidate(candidate.skill, steps)
            chosen = [name for name, value in asked.values.items() if value == SEEN]
            said = f"{change.said} in step {' and '.join(dict.fromkeys(name.partition('.')[0] for name in chosen))}"
            parameters = {**candidate.parameters, **dict.fromkeys(chosen, SEEN)}
            yield replace(change, parameters=parameters, said=said), asked, WantedWay()


def _of_steps(question: Question) -> Iterator[WholeAnalysis]:
    """Combinations of the Pareto-optimal ways of the steps, each in the world that those before it leave.

    Of more than `MOST_BEGINNINGS` beginnings, the best seen ones and the fastest are followed, in their order.
    """
    candidate, cell, sampling = question.best.candidate, question.cell, question.sampling
    begun: list[tuple[tuple[Analysis, ...], World]] = [((), question.world)]  # first steps, and the world after them
    for step in candidate.steps:
        longer: list[tuple[tuple[Analysis, ...], World]] = []
        for steps, world in begun:
            found = find_way(cell, step, world, sampling, WantedWay())
            if isinstance(found, Infeasible):
                continue
            for way in pareto_ways(step, found.result):
                done = analyse(cell, way, world, sampling, full=False)
                if isinstance(done, Analysis):
                    longer.append(((*steps, done), world_after(way, done.planned.motion, world)))
        begun, numbers = longer, range(len(longer))
        if len(longer) > MOST_BEGINNINGS:
            covered = []  # how long each is seen, time of events of interest counted twice [s]
            for steps, _ in longer:
                each = [step.result for step in steps]
                covered.append(
                    sum((f.q_avg or 0.0) * (f.t_total or 0.0) + (f.q_eoi or 0.0) * (f.t_eoi or 0.0) for f in each)
                )
            seen = sorted(numbers, key=covered.__getitem__, reverse=True)
            fast = sorted(numbers, key=lambda number: sum(one.planned.motion.time for one in longer[number][0]))
            chosen = dict.fromkeys([*fast[: MOST_BEGINNINGS // 3], *seen[:MOST_BEGINNINGS]])
            begun = [longer[number] for number in sorted(list(chosen)[:MOST_BEGINNINGS])]
    for steps, _ in begun:
        yield WholeAnalysis(whole_candidate(candidate.skill, [step.planned.candidate for step in steps]), steps)


def _open_paths(step: Candidate) -> list[str]:
    """The parameters of a step that choose the paths of joint moves and leave them direct."""
    moves = [move for move in step.skill.primitives if isinstance(move, JointMove)]
    names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
    return [] if step.open_paths else names
