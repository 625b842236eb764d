"""The least changes that meet a goal, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.search.advice_result import AdviceFound, ChangeFound, KindOutcome, NearestChange, TaskEffect
from sqrp_cli.search.camera_moves import changed_camera, further_camera
from sqrp_cli.search.goal import KINDS, MOTION, Kind
from sqrp_cli.search.motion_search import other_way, seen_path
from sqrp_cli.search.object_moves import moved_object
from sqrp_cli.search.question import (
    NoneMeets,
    ProposedChange,
    Question,
    Start,
    Tried,
    figures_of,
    whole_observed_again,
)
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.verdict import verdict, without_remedy
from sqrp_cli.study.whole_study import WholeAnalysis, reasons_of_step, whole_study, worst_seen
from sqrp_cli.task.feasibility import unready_world

Remembered = Callable[[Kind, Callable[[], KindOutcome]], KindOutcome]
"""What came of a kind in a run before, or what the search finds now, which is kept for runs after this one."""


def outcomes(question: Question, remembered: Remembered = lambda _, search: search()) -> Iterator[KindOutcome]:
    """What comes of each kind of change, in order."""
    start, suffices = Start(question), False
    for kind in KINDS if question.kinds is None else question.kinds:
        if suffices and question.kinds is None:
            yield KindOutcome(kind=kind, why="not tried, because the motion is enough; --kinds names what to try")
            continue
        outcome = remembered(kind, partial(_outcome, start, kind))
        suffices |= kind in MOTION and bool(outcome.found)
        yield outcome


def _outcome(start: Start, kind: Kind) -> KindOutcome:
    question, goal = start.question, start.question.goal
    if why := _why_not(start, kind):
        return KindOutcome(kind=kind, why=why)
    match kind:
        case "way":
            tried = other_way(question)
        case "path":
            tried = seen_path(question)
        case "object":
            tried = moved_object(start)
        case "camera":
            tried = further_camera(start)
        case _:
            tried = changed_camera(start, kind)
    if not isinstance(tried, NoneMeets):
        advice = tuple(_advice(start, one) for one in sorted(tried, key=lambda one: one.change.size))
        return KindOutcome(kind=kind, found=len(advice), advice=advice)
    if not tried.near:
        return KindOutcome(kind=kind, why=tried.why)
    before = question.before if kind in MOTION else figures_of(question.way, start.analysis)
    near = min(tried.near, key=lambda one: goal.shortfall(one.analysis.assessment))
    reached = near.analysis.assessment
    nearest = from_fields(
        NearestChange,
        _change_found(near.change, reached),
        missing=goal.missed(reached),
        limit=_limit(question, near),
        nearer=goal.is_nearer(reached, before),
    )
    return KindOutcome(kind=kind, why=tried.why, nearest=nearest)


def _why_not(start: Start, kind: Kind) -> str:
    """Why a kind of change cannot help, without any search; empty if it may."""
    question, goal = start.question, start.question.goal
    first = (*question.fastest.steps, question.fastest)[0]
    unready = unready_world(question.cell, first, question.world)  # whatever is changed in the cell
    if unready is not None:
        return unready.reasons[0]
    if kind in MOTION or kind == "object":
        return "not tried: the way is fixed" if question.fixed and kind in MOTION else ""
    before = figures_of(question.way, start.analysis)
    if not before.feasible:
        return f"no camera helps: {before.reasons[0]}"
    if goal.time is not None and before.time is not None and before.time > goal.time:
        return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {goal.time:.4g} s"
    response = min((camera.response for camera in question.cell.observer.cameras), default=0.0)
    if goal.delay is not None and before.faults and goal.delay < response:
        return f"a frame and the latency of the fastest camera take {response:.2f} s, not {goal.delay:.4g} s"
    return ""


def _advice(start: Start, met: Tried) -> AdviceFound:
    """A change with its effect on all tasks; another motion is nothing for other candidates or tasks.

    Cameras are changed in the same motion, else it is planned again.
    """
    question, change, reached, effects = start.question, met.change, met.analysis.assessment, list[TaskEffect]()
    found = replace(reached, candidate=question.best.candidate, best_way=reached.candidate)
    if change.kind in MOTION:
        pairs = [(question.before, found) if one is question.best else (one, one) for one in question.assessments]
        effects.append(TaskEffect.of(question.task, pairs))
    else:
        cell, world, sampling = change.in_cell(question.cell), change.in_world(question.world), question.sampling
        for text, ways in start.tasks:
            pairs = []
            for way, before in ways:
                after = before
                if change.camera is None:
                    after = whole_study(question.cell, way, world, sampling, full=False)
                elif isinstance(before, WholeAnalysis):
                    after = whole_observed_again(cell, before, sampling)
                pairs.append((figures_of(way, before), figures_of(way, after)))
            effects.append(TaskEffect.of(text, pairs))
    worse = tuple(one.task for one in effects if any(candidate.worse for candidate in one.candidates))
    said = _change_found(change, found)
    return from_fields(
        AdviceFound, said, margin=met.margin, tasks=tuple(effects), worse=worse, patch="", unwritten=None
    )


def _change_found(change: ProposedChange, found: CandidateResult) -> ChangeFound:
    values = change.values if change.parameters is None else dict(change.parameters)
    return from_fields(ChangeFound, AdvisedFigures.of(found), change, change=values, proposed=change, found=found)


def _limit(question: Question, one: Tried) -> str:
    """Which limit stands in the way of a change that does not meet the goal, in a sentence."""
    steps, reached, goal = one.analysis.steps, one.analysis.assessment, question.goal
    if replace(goal, time=None).met(reached):
        primitives = [primitive for step in steps for primitive in step.motion.primitives]
        longest = max(primitives, key=lambda primitive: primitive.end - primitive.start)
        return f"its motion takes that long, {longest.end - longest.start:.1f} s of it {longest.name}"
    if replace(goal, delay=None).met(reached):
        return reached.why_late
    worst = worst_seen([step.assessment("") for step in steps])
    sentence = verdict(one.change.in_cell(question.cell), steps[worst])
    said = reasons_of_step(one.analysis.candidate, worst + 1, [sentence])[0]
    return reached.why_late if said.endswith(NOTHING_MISSING) else without_remedy(said)
