"""The paper's simulation, computed by the real pipeline: six ways to pick up a green object."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.grounding import TargetGrounder, ground_formulas
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.sampling import Adaptive, FixedCount, Sampling
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.scene import SceneStates, fixed_frame
from sqrp_cli.programming.task import Candidate, read_task
from tests.reproduction.summary import Summary, always_in_interest, feasible_study, hidden_by_the_robot

WORKSPACE = Path("workspaces/tabletop")
TASK = "pickup green"
SAMPLINGS: Mapping[str, Sampling] = {
    "5": FixedCount(5),
    "10": FixedCount(10),
    "20": FixedCount(20),
    "40": FixedCount(40),
    "default": Adaptive(),
}
"""Samples per primitive; the paper chooses 10."""


@dataclass(frozen=True)
class Sampled:
    """Q_avg [%] of g1 with one sampling, and the time it took to compute [s]."""

    q_avg: float
    computing: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """What came out, with 10 samples per primitive.

    of: the candidates that can be done, by their object. why_not_g6: why that one cannot. first: the one that is ranked
    first. sampled: g1 with each sampling. hide_g1: cameras from which the robot hides g1 all through the lift, and that
    would otherwise see all there is to see. see_lift_of_g5: cameras that see all of it. see_g6: cameras that see it
    while the robot is at home.
    """

    of: Mapping[str, Summary]
    why_not_g6: str
    first: str
    sampled: Mapping[str, Sampled]
    hide_g1: frozenset[str]
    see_lift_of_g5: frozenset[str]
    see_g6: frozenset[str]


def tabletop() -> Cell:
    """The cell as it is shipped."""
    return Cell.load(load_workspace(WORKSPACE))


def simulate(cell: Cell) -> Simulation:
    """Rank the six candidates, and look closer at g1, g5 and g6."""
    workspace, ten = cell.workspace, SAMPLINGS["10"]
    candidates = {candidate.name: candidate for candidate in read_task(TASK, workspace).candidates}
    assignment = Assignment(cell, workspace.initial_world, ten)
    assessments = {name: assignment.assess(candidate) for name, candidate in candidates.items()}
    feasible = {name: candidates[name] for name, assessment in assessments.items() if assessment.feasible}
    g1, g5 = (feasible_study(cell, candidates[name], ten, full=True) for name in ("g1", "g5"))
    return Simulation(
        of={name: Summary.of(feasible_study(cell, candidate, ten)) for name, candidate in feasible.items()},
        why_not_g6=" ".join(assessments["g6"].reasons),
        first=rank(tuple(assessments.values()), "q_eoi")[0].assessment.candidate.name,
        sampled={name: _sampled(cell, candidates["g1"], sampling) for name, sampling in SAMPLINGS.items()},
        hide_g1=always_in_interest(cell, g1, None, Cause.NONE, Cause.HIDDEN) & hidden_by_the_robot(cell, g1, "hold"),
        see_lift_of_g5=always_in_interest(cell, g5, None, Cause.NONE),
        see_g6=_seeing_at_home(cell, candidates["g6"]),
    )


def _sampled(cell: Cell, candidate: Candidate, sampling: Sampling) -> Sampled:
    begin = time.perf_counter()
    found = Summary.of(feasible_study(cell, candidate, sampling))
    return Sampled(found.q_avg, time.perf_counter() - begin)


def _seeing_at_home(cell: Cell, candidate: Candidate) -> frozenset[str]:
    """Cameras that see where a candidate's object stands while the robot is at home."""
    workspace, model, world = cell.workspace, cell.model, cell.workspace.initial_world
    spans = {primitive.name: (float(i), i + 1.0) for i, primitive in enumerate(candidate.skill.primitives)}
    grounder = TargetGrounder(candidate, world, workspace.objects, workspace.detectors, workspace.robot, model)
    targets = grounder.targets(ground_formulas(candidate, spans, float(len(spans))))
    objects = {name: fixed_frame(X_WO) for name, X_WO in world.X_WO.items()}
    at_start = {f"{name}@start": X_WO for name, X_WO in objects.items()}
    frames = {"world": fixed_frame(), **model.link_poses(model.home[None]), **objects, **at_start}
    placed = next(target for target in targets if target.atom.predicate == "obj_on_table")
    boxes = cell.observer.verdicts(placed, SceneStates(1, frames))
    sees = np.all([box.cause[0] == Cause.NONE for box in boxes], axis=0)
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, sees, strict=True) if is_so)
