"""Another way or another path of a candidate that meets a goal: the cell stays as it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from math import inf

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.search.question import Found, ProposedChange, Question, Tried
from sqrp_cli.skill.settings import SEEN, MotionValue, Reference
from sqrp_cli.skill.skill import JointMove
from sqrp_cli.study.assessment import Analysis, study
from sqrp_cli.study.find import TimeLimit, WantedWay, find_way, studied_ways
from sqrp_cli.study.program_update import world_after
from sqrp_cli.study.result import WayFigures
from sqrp_cli.study.whole_study import WholeAnalysis, worst_seen
from sqrp_cli.task.candidate import whole_candidate
from sqrp_cli.task.grips import choice_in_words
from sqrp_cli.task.task import Candidate

MOST_TOGETHER = 12
"""Ways of the first steps that are followed further: a third of them the fastest, the others those seen best."""


def other_way(question: Question) -> Found:
    """The fastest of all ways that meet the goal; of several steps, of combinations of their Pareto-optimal ways."""
    best, cell, goal = question.best, question.cell, question.goal
    if not best.feasible or not (best.ways or best.candidate.steps):
        return [], f"none can be done: {'; '.join(best.reasons[:1])}"
    ways: Iterable[WholeAnalysis]
    if best.candidate.steps:
        ways = sorted(_of_steps(question), key=lambda whole: whole.assessment.time or 0.0)
    else:
        found = studied_ways(
            cell,
            best.candidate,
            question.world,
            question.sampling,
            limit=TimeLimit(inf if goal.time is None else goal.time),
            worth=goal.may_be_met,
            plans=question.plans,
        )
        ways = (WholeAnalysis(one.candidate, (one,)) for one in found)

    def tried(study: WholeAnalysis) -> Tried:
        way, said = study.candidate.parameters, choice_in_words(best.candidate, study.candidate)
        return Tried(ProposedChange(kind="way", target=best.candidate.name, parameters=way, said=said), study)

    near, none = _first_met(question, map(tried, ways), "none meets the goal")
    if not none:
        return near, ""
    if best.ways is None:
        return near, f"none of {len(near)} combinations of the steps' ways meets the goal"
    pareto = [with_way(best.candidate, figures) for figures in best.ways.pareto[1:]]
    named = (question.studied(way) for way in ([best.way, *pareto] if best.ways.pareto else ()))
    near = [*near, *(tried(study) for study in named if isinstance(study, WholeAnalysis))]
    return near, f"none of {best.ways.tried} meets the goal"


def seen_path(question: Question) -> Found:
    """Paths of joint moves that the cameras can follow, in as few steps as that takes."""
    several = bool(question.best.candidate.steps)
    if not several and not _open_paths(question.best.candidate):
        return [], "not tried: the skill or the task says which path"
    near, none = _first_met(question, _in_seen_paths(question), "no path that was found meets the goal")
    if near:
        return near, none
    return (
        [],
        "not tried: the skills or the task say which paths" if several else "it cannot be done, or not in that time",
    )


def _first_met(question: Question, tried: Iterable[Tried], none: str) -> Found:
    """The first that meets the goal; else all of them, and none."""
    near: list[Tried] = []
    for one in tried:
        if question.met_for_sure(None, one.study):
            return [one], ""
        near.append(one)
    return near, none


def with_way(candidate: Candidate, way: WayFigures) -> Candidate:
    """A candidate in a way."""
    values = {name: way.parameters.get(name, value) for name, value in candidate.values.items()}
    branch = {name: value for name, value in way.parameters.items() if name not in {**values, **candidate.binding}}
    vias = {name: np.array(places) for name, places in way.vias.items()}
    return replace(candidate, values=values, branch=branch, vias=vias)


def _in_seen_paths(question: Question) -> Iterator[Tried]:
    """The best way of a candidate of one step with paths that keep sight, then the best within the time of the goal.

    Of several steps: all in their best ways, with seen paths in one step, in one more, and so on; those seen worst
    first.
    """
    candidate, sampling = question.best.candidate, question.sampling

    def change(chosen: Mapping[str, MotionValue], said: str, unwritten: str = "") -> ProposedChange:
        parameters, said = {**candidate.parameters, **chosen}, f"with paths that keep sight{said}"
        return ProposedChange(kind="path", target=candidate.name, parameters=parameters, said=said, unwritten=unwritten)

    if not candidate.steps:
        paths: dict[str, MotionValue] = dict.fromkeys(_open_paths(candidate), SEEN)
        seen = replace(candidate, values={**candidate.values, **paths})
        for limit in (None, *([] if question.goal.time is None else [TimeLimit(question.goal.time)])):
            best = find_way(question.cell, seen, question.world, sampling, WantedWay(limit=limit))
            if not isinstance(best, Infeasible):
                unwritten = "" if limit is None else f"no task says it: use --max-time {limit.seconds:g}"
                yield Tried(change(paths, "", unwritten), WholeAnalysis(best.study.candidate, (best.study,)))
    steps, left = list(candidate.steps), list(range(len(candidate.steps)))
    while left and question.best.feasible:
        index = left.pop(worst_seen([question.best.steps[number] for number in left]))
        names = _open_paths(steps[index])
        if not names:
            continue
        steps[index] = replace(steps[index], values={**steps[index].values, **dict.fromkeys(names, SEEN)})
        world, done = question.world, list[Analysis]()
        for step in steps:
            found = find_way(question.cell, step, world, sampling, WantedWay())
            if isinstance(found, Infeasible):
                break
            done.append(found.study)
            world = world_after(found.study.candidate, found.study.motion, world)
        if len(done) == len(steps):
            asked = whole_candidate(candidate.skill, steps)
            chosen = {name: value for name, value in asked.values.items() if value == SEEN}
            said = " and ".join(dict.fromkeys(name.partition(".")[0] for name in chosen))
            whole = whole_candidate(candidate.skill, [one.candidate for one in done])
            yield Tried(change(chosen, f" in step {said}"), WholeAnalysis(whole, tuple(done)))


def _of_steps(question: Question) -> Iterator[WholeAnalysis]:
    """Combinations of the Pareto-optimal ways of the steps, each in the world that those before it leave.

    Of more than `MOST_TOGETHER` beginnings, the best seen ones and the fastest are followed, in their order.
    """
    candidate, cell, sampling = question.best.candidate, question.cell, question.sampling
    begun: list[tuple[tuple[Analysis, ...], World]] = [
        ((), question.world)
    ]  # the first steps, and the world after them
    for step in candidate.steps:
        longer: list[tuple[tuple[Analysis, ...], World]] = []
        for steps, world in begun:
            found = find_way(cell, step, world, sampling, WantedWay())
            if isinstance(found, Infeasible):
                continue
            for way in (found.study.candidate, *(with_way(step, figures) for figures in found.ways.pareto[1:])):
                done = study(cell, way, world, sampling, full=False)
                if isinstance(done, Analysis):
                    longer.append(((*steps, done), world_after(way, done.motion, world)))
        begun, numbers = longer, range(len(longer))
        if len(longer) > MOST_TOGETHER:
            covered = []  # how long each is seen, time of events of interest counted twice [s]
            for steps, _ in longer:
                each = [step.assessment("") for step in steps]
                covered.append(
                    sum((f.q_avg or 0.0) * (f.t_total or 0.0) + (f.q_eoi or 0.0) * (f.t_eoi or 0.0) for f in each)
                )
            seen = sorted(numbers, key=covered.__getitem__, reverse=True)
            fast = sorted(numbers, key=lambda number: sum(one.motion.time for one in longer[number][0]))
            chosen = dict.fromkeys([*fast[: MOST_TOGETHER // 3], *seen[:MOST_TOGETHER]])
            begun = [longer[number] for number in sorted(list(chosen)[:MOST_TOGETHER])]
    for steps, _ in begun:
        yield WholeAnalysis(whole_candidate(candidate.skill, [step.candidate for step in steps]), steps)


def _open_paths(step: Candidate) -> list[str]:
    """The parameters of a step that choose the paths of joint moves and leave them direct."""
    moves = [move for move in step.skill.primitives if isinstance(move, JointMove)]
    names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
    return [] if step.open_paths else names
