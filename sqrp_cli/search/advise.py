"""The least changes that meet a goal, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.search.advice_result import AdviceFound, ChangeFound, KindOutcome, NearestChange, TaskEffect
from sqrp_cli.search.camera_moves import CameraMove, further_camera
from sqrp_cli.search.goal import KINDS, MOTION, Kind
from sqrp_cli.search.least import Move, least_changes
from sqrp_cli.search.motion_search import other_way, seen_path
from sqrp_cli.search.object_moves import BOUNDS, DIRECTIONS, ObjectMove
from sqrp_cli.search.question import (
    ProposedChange,
    Question,
    Search,
    Tried,
    analysed_again,
    figures_of,
)
from sqrp_cli.sight.limits import Cause
from sqrp_cli.study.in_the_way import hidden_views, to_move
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.verdict import longest_blind_spot
from sqrp_cli.study.whole_analysis import WholeAnalysis, reasons_of_step, whole_analysis, worst_seen
from sqrp_cli.task.feasibility import impossible_start

MOST_OBJECTS = 3  # Objects that are moved: those that are handled, then those that hide most
Remembered = Callable[[Kind, Callable[[], KindOutcome]], KindOutcome]
"""What came of a kind in a run before, or what the search finds now, which is kept for runs after this one."""


def outcomes(question: Question, remembered: Remembered = lambda _, search: search()) -> Iterator[KindOutcome]:
    """What comes of each kind of change, in order."""
    suffices = False
    for kind in KINDS if question.kinds is None else question.kinds:
        if suffices and question.kinds is None:
            yield KindOutcome(kind=kind, why="not tried, as the motion is enough; --kinds tries them")
            continue
        outcome = remembered(kind, partial(_outcome, question, kind))
        suffices |= kind in MOTION and bool(outcome.found)
        yield outcome


def _outcome(question: Question, kind: Kind) -> KindOutcome:
    goal = question.goal
    if why := _why_not(question, kind):
        return KindOutcome(kind=kind, why=why)
    match kind:
        case "way":
            tried, none = other_way(question)
        case "path":
            tried, none = seen_path(question)
        case "object":
            tried, none = moved_object(question)
        case "camera":
            tried, none = further_camera(question)
        case _:
            tried, none = changed_camera(question, kind)
    if not none:
        advice = tuple(_advice(question, one) for one in sorted(tried, key=lambda one: one.change.size))
        return KindOutcome(kind=kind, found=len(advice), advice=advice)
    if not tried:
        return KindOutcome(kind=kind, why=none)
    # What comes nearest, and which limit stands in its way, in a sentence.
    before = question.before if kind in MOTION else figures_of(question.way, question.analysis)
    near = min(tried, key=lambda one: goal.shortfall(one.analysis.result))
    steps, reached = near.analysis.steps, near.analysis.result
    if replace(goal, time=None).met(reached):
        timed = [(one, step.planned.candidate.skill) for step in steps for one in step.planned.motion.primitives]
        longest, skill = max(timed, key=lambda pair: pair[0].end - pair[0].start)
        limit = f"its motion takes that long, {longest.end - longest.start:.1f} s of it {skill.pieces[longest.name]}"
    elif replace(goal, delay=None).met(reached):
        limit = reached.why_late
    else:
        worst = worst_seen([step.result for step in steps])
        stretch = longest_blind_spot(near.change.in_cell(question.cell), steps[worst].timeline)
        said = reached.why_late if stretch is None else str(stretch)
        limit = said if stretch is None else reasons_of_step(near.analysis.candidate, worst + 1, [said])[0]
    limit = f"{limit[:1].lower()}{limit[1:]}"
    missing, nearer = goal.missed(reached), goal.is_nearer(reached, before)
    found = _change_found(near.change, reached)
    nearest = from_fields(NearestChange, found, missing=missing, limit=limit, nearer=nearer)
    return KindOutcome(kind=kind, why=none, nearest=nearest)


def _why_not(question: Question, kind: Kind) -> str:
    """Why a kind of change cannot help, without any search; empty if it may."""
    goal = question.goal
    first = (*question.fastest.steps, question.fastest)[0]
    unready = impossible_start(question.cell, first, question.world, contacts=False)  # whatever is changed in it
    if unready is not None:
        return first.skill.in_pieces(unready.reasons[0])
    if kind in MOTION and question.way.skill.recorded is not None:
        return "not tried, as a recorded motion is what it was"
    if kind in MOTION or kind == "object":
        return "not tried, as the way is fixed" if question.fixed and kind in MOTION else ""
    before = figures_of(question.way, question.analysis)
    if not before.feasible:
        return f"no camera helps: {question.way.skill.in_pieces(before.reasons[0])}"
    if goal.time is not None and before.time is not None and before.time > goal.time:
        return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {goal.time:.4g} s"
    response = min((camera.response for camera in question.cell.observer.cameras), default=0.0)
    if goal.delay is not None and before.faults and goal.delay < response:
        return f"a frame and the latency of the fastest camera take {response:.2f} s, not {goal.delay:.4g} s"
    return ""


def changed_camera(question: Question, kind: Literal["aim", "position", "lens"]) -> Search:
    """The least turn, move or change of lens of every camera that helps."""
    moves, aside = list[Callable[[], Move]](), list[Callable[[], Move]]()
    for camera in question.cell.workspace.cameras.values():
        if not CameraMove(question, kind, camera).bound.hopeful:
            continue
        moves.append(partial(CameraMove, question, kind, camera))
        # Moved with the aim kept, and with the middle of what must be seen as aim where that is no help by itself.
        centred = CameraMove(question, kind, camera, middle=True)
        if kind == "position" and len(centred.bound.corners) and not centred.meets(centred.change(np.zeros(3))):
            aside.append(partial(CameraMove, question, kind, camera, middle=True))
    if not moves:
        return (), "none of a single camera can be: where one is missing, another is, too"
    return least_changes(question, [*moves, *aside], "none is enough", "there is no free place for a camera")


def moved_object(question: Question) -> Search:
    """The least move of what the way of a question handles, and of what hides most."""
    cell, world = question.cell, question.world
    names = [name for name in question.way.binding.values() if not cell.workspace.objects[name].fixed]
    if isinstance(question.analysis, WholeAnalysis):
        # Then what hides targets while too few cameras see them, the one first without which most would be seen.
        alone, share, behind = defaultdict[str, float](float), defaultdict[str, float](float), Counter[str]()
        for step in question.analysis.steps:
            for one in to_move(cell, step, hidden_views(cell, step)):
                alone[one.name] += one.alone
                share[one.name] += one.share
            # And what has the colour of targets before it in uncovered states.
            lost = step.timeline.observation.blind
            for box in (box for boxes in step.timeline.observation.full_matrix for box in boxes):
                same_colour = box.by[(box.cause == Cause.SAME_COLOUR) & lost[:, None]].tolist()
                behind.update(cell.observer.solids[index].part.parent for index in same_colour)
        names += sorted(sorted(alone), key=lambda name: (alone[name], share[name]), reverse=True)
        others = (behind.keys() & cell.workspace.objects.keys()) - set(alone)
        names += sorted(others, key=lambda name: (-behind[name], name))
    # Only what stands at a known place and carries nothing.
    carriers = {world.held, *(one.on for one in cell.workspace.objects.values())}
    names = [name for name in dict.fromkeys(names) if name in world.X_WO and name not in carriers][:MOST_OBJECTS]
    if not names:
        return (), "no object is handled or hides anything"
    moves: list[Callable[[], Move]] = [partial(ObjectMove, question, name) for name in names]
    tried = f"for {', '.join(names)}, in {DIRECTIONS} directions up to {100 * BOUNDS.reaches[-1]:.0f} cm"
    none, nowhere = f"none is enough {tried}", f"there is no free place within reach {tried}"
    return least_changes(question, moves, none, nowhere)


def _advice(question: Question, met: Tried) -> AdviceFound:
    """A change with its effect on all tasks; another motion is nothing for other candidates or tasks.

    Cameras are changed in the same motion, else it is planned again.
    """
    change, reached, effects = met.change, met.analysis.result, list[TaskEffect]()
    found = replace(reached, candidate=question.best.candidate, best_way=reached.candidate)
    if change.kind in MOTION:
        pairs = [(question.before, found) if one is question.best else (one, one) for one in question.results]
        effects.append(TaskEffect.of(question.task, pairs))
    else:
        cell, world, sampling = change.in_cell(question.cell), change.in_world(question.world), question.sampling
        for text, ways in question.affected_ways:
            pairs = []
            for way, before in ways:
                after = before
                if change.camera is None:
                    after = whole_analysis(question.cell, way, world, sampling, full=False)
                elif isinstance(before, WholeAnalysis):
                    after = analysed_again(cell, before, sampling)
                pairs.append((figures_of(way, before), figures_of(way, after)))
            effects.append(TaskEffect.of(text, pairs))
    worse = tuple(one.task for one in effects if any(candidate.worse for candidate in one.candidates))
    return from_fields(AdviceFound, _change_found(change, found), margin=met.margin, tasks=tuple(effects), worse=worse)


def _change_found(change: ProposedChange, found: CandidateResult) -> ChangeFound:
    values = change.values if change.parameters is None else dict(change.parameters)
    return from_fields(
        ChangeFound, from_fields(AdvisedFigures, found), change, change=values, proposed=change, found=found
    )
