"""Program update: the chosen candidate becomes a step, and its effect changes the world for the next one.

A failed step is planned again in the same way, from the world after its fault.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.conditions import apply_effect
from sqrp_cli.logic.formula import Operation, argument_lists, bind
from sqrp_cli.logic.formula_time import TimeInterval, merge, with_times
from sqrp_cli.logic.literal import Literal
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.skill.settings import ANY
from sqrp_cli.skill.skill import RetryEntry
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.fault_sights import distinguishing
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.timeline import observe
from sqrp_cli.study.verdict import stretches, with_verdict
from sqrp_cli.task.task import Candidate

if TYPE_CHECKING:
    from sqrp_cli.program import record


def replanned(cell: Cell, step: record.Step, world: World) -> record.Step | None:
    """The same skill with the same parameters from `world`; None if that is infeasible.

    Where its branch is, after the object was moved, any other branch that the skill leaves free.
    """
    candidate = candidate_of(step, cell)
    if candidate.open_paths:
        from sqrp_cli.study.seen_ways import way_with_seen_paths

        candidate = way_with_seen_paths(cell, candidate, world)
    found = analyse(cell, candidate, world, Adaptive(), full=True)
    if isinstance(found, Infeasible):
        left_free = (name for name, value in candidate.skill.defaults.items() if value == ANY)
        free = {name: ANY for name in left_free if isinstance(candidate.values[name], str)}
        candidate = replace(candidate, values={**candidate.values, **free}, branch={}, vias={})
        found = analyse(cell, candidate, world, Adaptive(), full=True)
    if isinstance(found, Infeasible):
        return None
    cameras = tuple(camera.name for camera in cell.observer.cameras)
    return make_step(step.task, found, with_verdict(cell, found.timeline, found.result), cameras)


def candidate_of(step: record.Step, cell: Cell) -> Candidate:
    """The way that a step of a program was made from; paths around vias are planned again by who needs them."""
    skill = cell.workspace.skills[step.skill]
    names = [parameter.name for parameter in skill.action.parameters]
    binding = {name: str(step.parameters[name]) for name in names}
    said = {name: value for name, value in step.parameters.items() if name not in binding}
    branch = {name: said.pop(name) for name in [*said] if name not in skill.defaults}
    values = {**skill.defaults, **said}
    return Candidate(skill, binding, values, branch=branch, name=" ".join(binding.values()) or skill.name)


def make_step(task: str, analysis: Analysis, result: CandidateResult, cameras: tuple[str, ...]) -> record.Step:
    """The step of a program from a full analysis.

    cameras: names in the order of the analysis's verdicts.
    """
    from sqrp_cli.program import record

    candidate, motion = analysis.planned.candidate, analysis.planned.motion
    lists = argument_lists(candidate.skill.action)
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in motion.primitives}
    formulas, words = list[record.ProgramFormula](), candidate.skill.fault_words
    for requirement in candidate.skill.requirements:
        response, when = requirement.stated.response, requirement.retry_when
        if isinstance(response, RetryEntry):
            seen = None if when is None else str(bind(when, candidate.binding, lists))
            answer = record.ProgramResponse(action="retry", retries=response.retry, when=seen)
        else:
            answer = record.ProgramResponse(action=response)
        timed = with_times(bind(requirement.formula, candidate.binding, lists), spans)
        told = [one.start for one in analysis.planned.formulas if one.fault and one.fault == requirement.name]
        if isinstance(timed, Operation) and (span := timed.interval) is not None and len(told) == 1:
            begin = max(told[0], span.start.offset)  # only from then on can the fault be told
            timed = replace(timed, interval=replace(span, start=replace(span.start, offset=begin)))
        formulas.append(
            record.ProgramFormula(
                formula=str(timed),
                fault=requirement.name,
                settle=requirement.stated.settle,
                response=answer,
                words=words.get(requirement.name or ""),
            )
        )
    observation, t = analysis.timeline.observation, analysis.timeline.samples.t
    targets = dict[str, record.ProgramTarget]()
    for column, target in enumerate(analysis.planned.targets):
        sees = sees_all(observation.full_matrix[column]) & observation.required[:, column, None]
        targets[str(target.atom)] = record.ProgramTarget(
            cameras=target.cameras,
            boxes=target.boxes,
            seen={name: _intervals(t, sees[:, index]) for index, name in enumerate(cameras)},
        )
    sights = {
        fault: record.ProgramSight(windows=tuple(windows), onsets=tuple(analysis.onsets[fault]))
        for fault, windows in analysis.windows.items()
    }
    primitives = tuple(
        record.ProgramPrimitive(
            name=timed.name,
            does=action.words,
            action=type(action).__name__,
            start=timed.start,
            end=timed.end,
            held=timed.held,
            trajectory=timed.trajectory,
            guard=None
            if timed.force is None or timed.unmet is None
            else record.ProgramGuard(force=timed.force, trajectory=timed.unmet),
        )
        for timed, action in zip(motion.primitives, candidate.skill.primitives, strict=True)
    )
    return record.Step(
        task=task,
        skill=candidate.skill.name,
        parameters=candidate.parameters,
        time=motion.time,
        q_avg=result.q_avg,
        q_eoi=result.q_eoi,
        faults=result.faults,
        verdict=result.verdict,
        primitives=primitives,
        formulas=tuple(formulas),
        targets=targets,
        before=analysis.planned.world,
        after=world_after(candidate, motion, analysis.planned.world),
        sights=sights,
    )


def world_after(candidate: Candidate, motion: Motion, world: World) -> World:
    """The world after a candidate with this motion: facts from its effect, the rest from the motion."""
    return replace(motion.final, facts=apply_effect(candidate.skill.action, candidate.binding, world.facts))


def with_usual_images(step: record.Step, analysis: Analysis, observer: Observer) -> record.Step:
    """The step of an analysis with the times of usual images, which take as long to find as the analysis."""
    confirming = [(target,) for target in analysis.planned.targets]
    refuting = [
        distinguishing(target, Literal(target.atom, positive=False), analysis.planned.stage.X_WO)
        for target in analysis.planned.targets
    ]
    asked = list(dict.fromkeys(chain(*confirming, *refuting)))
    request = analysis.planned.for_targets(
        analysis.planned.stage, [replace(target, cameras=1).usual for target in asked]
    )
    usual: list[dict[str, tuple[tuple[float, float], ...]]] = [{} for _ in (*confirming, *refuting)]
    for camera in observer.cameras:
        found = observe(request, replace(observer, cameras=(camera,)), Adaptive(), full=False)
        sees = found.observation.covered.T
        for intervals, any_of in zip(usual, confirming + refuting, strict=True):
            shown = np.logical_or.reduce(sees[[asked.index(target) for target in any_of]])
            intervals[camera.name] = _intervals(found.samples.t, shown)
    targets = {}
    for column, (atom, target) in enumerate(step.targets.items()):
        refuted = {} if refuting[column] == confirming[column] else usual[len(confirming) + column]
        targets[atom] = target.model_copy(update={"usual": usual[column], "refuted": refuted})
    return step.model_copy(update={"targets": targets})


def _intervals(t: Array, seen: Mask) -> tuple[tuple[float, float], ...]:
    """Intervals of sight: from the first to the last of neighbouring samples at times t in which it is seen [s]."""
    runs = merge(TimeInterval(float(t[rows[0]]), float(t[rows[-1]])) for rows in stretches(seen))
    return tuple((one.start, one.end) for one in runs)
