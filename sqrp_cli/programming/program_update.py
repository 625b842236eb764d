"""Program update: the chosen candidate becomes a step, and its effect changes the world for the next one.

A failed step is planned again in the same way, from the world after its fault.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.skill.settings import ANY
from sqrp_cli.knowledge.skill.skill import PrimitiveAction, Requirement, RetryEntry
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.conditions import apply_effect
from sqrp_cli.logic.formula import Formula
from sqrp_cli.logic.formula_check import argument_lists, bind
from sqrp_cli.logic.formula_time import with_times
from sqrp_cli.logic.literal import Literal
from sqrp_cli.program import record
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, study
from sqrp_cli.programming.coverage.fault_sights import distinguishing
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.coverage.timeline import Watch, observe
from sqrp_cli.programming.coverage.verdict import verdict
from sqrp_cli.programming.motion.plan_motion import Motion, TimedPrimitive
from sqrp_cli.programming.sensing.observer import Observer, sees_all
from sqrp_cli.programming.targets import Target
from sqrp_cli.programming.task import Candidate


@dataclass(frozen=True, eq=False)
class StepReplanner:
    """A `program.Replanner` for the steps of one cell."""

    cell: Cell

    def replan(self, step: record.Step, world: World) -> record.Step | None:
        """The same skill with the same parameters from `world`; None if that is infeasible.

        Where its branch is, after the object was moved, any other branch that the skill leaves free.
        """
        candidate = candidate_of(step, self.cell)
        if candidate.open_paths:
            from sqrp_cli.programming.seen.seen_ways import way_with_seen_paths

            candidate = way_with_seen_paths(self.cell, candidate, world)
        found = study(self.cell, candidate, world, Adaptive(), full=True)
        if isinstance(found, Infeasible):
            # A way with the words that its skill leaves free.
            free = {
                name
                for name, value in candidate.skill.defaults.items()
                if value == ANY and isinstance(candidate.values[name], str)
            }
            found = study(
                self.cell,
                replace(candidate, values={**candidate.values, **dict.fromkeys(free, ANY)}, branch={}, vias={}),
                world,
                Adaptive(),
                full=True,
            )
        if isinstance(found, Infeasible):
            return None
        cameras = tuple(camera.name for camera in self.cell.observer.cameras)
        return make_step(step.task, found, found.assessment(verdict(self.cell, found)), cameras)


def candidate_of(step: record.Step, cell: Cell) -> Candidate:
    """The way that a step of a program was made from; paths around vias are planned again by who needs them."""
    skill = cell.workspace.skills[step.skill]
    names = [parameter.name for parameter in skill.action.parameters]
    binding = {name: str(step.parameters[name]) for name in names}
    said = {name: value for name, value in step.parameters.items() if name not in binding}
    branch = {name: said.pop(name) for name in [*said] if name not in skill.defaults}
    values = {**skill.defaults, **said}
    return Candidate(skill, binding, values, " ".join(binding.values()) or skill.name, branch=branch)


def make_step(task: str, study: Study, assessment: Assessment, cameras: tuple[str, ...]) -> record.Step:
    """The step of a program from a full study.

    cameras: names in the order of the study's verdicts.
    """
    candidate, motion = study.candidate, study.motion
    return record.Step(
        task=task,
        skill=candidate.skill.name,
        parameters=candidate.parameters,
        time=motion.time,
        q_avg=assessment.q_avg,
        q_eoi=assessment.q_eoi,
        faults=assessment.faults,
        verdict=assessment.verdict,
        primitives=tuple(
            _primitive(timed, action)
            for timed, action in zip(motion.primitives, candidate.skill.primitives, strict=True)
        ),
        formulas=_formulas(study),
        targets={str(target.atom): _target(study, column, cameras) for column, target in enumerate(study.targets)},
        before=study.world,
        after=world_after(candidate, motion, study.world),
        sights={fault: _sight(study, fault) for fault in study.windows},
    )


def _primitive(timed: TimedPrimitive, action: PrimitiveAction) -> record.ProgramPrimitive:
    guard = timed.guard
    return record.ProgramPrimitive(
        name=timed.name,
        does=action.words,
        action=type(action).__name__,
        start=timed.start,
        end=timed.end,
        held=timed.held,
        trajectory=timed.trajectory,
        guard=None if guard is None else record.ProgramGuard(force=guard.force, trajectory=guard.trajectory),
    )


def _sight(study: Study, fault: str) -> record.ProgramSight:
    return record.ProgramSight(
        windows=tuple(record.ProgramWindow(**window._asdict()) for window in study.windows[fault]),
        onsets=tuple(
            record.ProgramOnset(x=tuple(onset.x.tolist()), shown=tuple(onset.shown.tolist()))
            for onset in study.onsets[fault]
        ),
    )


def world_after(candidate: Candidate, motion: Motion, world: World) -> World:
    """The world after a candidate with this motion: facts from its effect, the rest from the motion."""
    return replace(motion.final, facts=apply_effect(candidate.skill.action, candidate.binding, world.facts))


def _formulas(study: Study) -> tuple[record.ProgramFormula, ...]:
    candidate = study.candidate
    lists = argument_lists(candidate.skill.action)
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in study.motion.primitives}

    def bound(formula: Formula) -> Formula:
        return bind(formula, candidate.binding, lists)

    return tuple(
        record.ProgramFormula(
            formula=str(with_times(bound(requirement.formula), spans)),
            fault=requirement.name,
            settle=requirement.stated.settle,
            response=_response(requirement, bound),
        )
        for requirement in candidate.skill.requirements
    )


def _response(requirement: Requirement, bound: Callable[[Formula], Formula]) -> record.ProgramResponse:
    stated, when = requirement.stated.response, requirement.retry_when
    if not isinstance(stated, RetryEntry):
        return record.ProgramResponse(action=stated)
    return record.ProgramResponse(action="retry", retries=stated.retry, when=None if when is None else str(bound(when)))


def _target(study: Study, column: int, cameras: tuple[str, ...]) -> record.ProgramTarget:
    target: Target = study.targets[column]
    observation, t = study.timeline.observation, study.timeline.samples.t
    sees = sees_all(observation.full_matrix[column])
    sees &= observation.required[:, column, None]
    return record.ProgramTarget(
        cameras=target.cameras,
        boxes=target.boxes,
        seen={name: _intervals(t, sees[:, index]) for index, name in enumerate(cameras)},
    )


def with_usual_images(step: record.Step, study: Study, observer: Observer) -> record.Step:
    """The step of a study with the times of usual images, which take as long to find as the study."""
    cameras = [replace(observer, cameras=(camera,)) for camera in observer.cameras]
    names = [camera.name for camera in observer.cameras]
    confirming = [(target,) for target in study.targets]
    refuting = [
        distinguishing(target, Literal(target.atom, positive=False), study.stage.X_WO) for target in study.targets
    ]
    found = [_usually_seen(study, confirming + refuting, camera) for camera in cameras]
    usual = [dict(zip(names, of_cameras, strict=True)) for of_cameras in zip(*found, strict=True)]
    targets = {}
    for column, (atom, target) in enumerate(step.targets.items()):
        refuted = {} if refuting[column] == confirming[column] else usual[len(confirming) + column]
        targets[atom] = target.model_copy(update={"usual": usual[column], "refuted": refuted})
    return step.model_copy(update={"targets": targets})


def _usually_seen(
    study: Study, questions: Sequence[tuple[Target, ...]], camera: Observer
) -> list[tuple[tuple[float, float], ...]]:
    """Intervals in which the images of one camera usually show any of the targets of each question [s]."""
    asked = list(dict.fromkeys(chain(*questions)))
    usual = [replace(target, cameras=1).usual for target in asked]
    found = observe(Watch.of_each(study, study.stage, usual), camera, Adaptive(), full=False)
    sees = found.observation.covered.T
    columns = ([asked.index(target) for target in any_of] for any_of in questions)
    return [_intervals(found.samples.t, np.logical_or.reduce(sees[of])) for of in columns]


def _intervals(t: Array, seen: Mask) -> tuple[tuple[float, float], ...]:
    """Intervals of sight: from the first to the last of neighbouring samples at times t in which it is seen [s]."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], seen, [False]]).astype(np.int8)))
    intervals = [(float(t[first]), float(t[last - 1])) for first, last in edges.reshape(-1, 2)]
    merged: list[tuple[float, float]] = intervals[:1]
    for (_, end), (start, later) in pairwise(intervals):
        if start == end:
            merged[-1] = (merged[-1][0], later)
        else:
            merged.append((start, later))
    return tuple(merged)
