"""The paper's simulation, computed by the real pipeline: six ways to pick up a green object."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.assessment import Study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.sampling import Adaptive, FixedCount, Sampling
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.scene import SceneStates, fixed_frame
from sqrp_cli.programming.targets import Target
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
        see_g6=_seeing_at_home(cell, "g6", g1),
    )


def _sampled(cell: Cell, candidate: Candidate, sampling: Sampling) -> Sampled:
    begin = time.perf_counter()
    found = Summary.of(feasible_study(cell, candidate, sampling))
    return Sampled(found.q_avg, time.perf_counter() - begin)


def _seeing_at_home(cell: Cell, name: str, like: Study) -> frozenset[str]:
    """Cameras that see where an object stands while the robot is at home, as they have to see that of a study."""
    model, world = cell.model, cell.workspace.initial_world
    (box,) = next(target.boxes for target in like.targets if target.atom.predicate == "obj_on_table")
    moved = replace(box, frame=name, encloses=frozenset({name}))
    objects = {thing: fixed_frame(X_WO) for thing, X_WO in world.X_WO.items()}
    states = SceneStates(1, {"world": fixed_frame(), **model.link_poses(model.home[None]), **objects})
    (seen,) = cell.observer.verdicts(Target(Atom("obj_on_table", (name,)), 1, (moved,)), states)
    return frozenset(
        camera.name for camera, cause in zip(cell.observer.cameras, seen.cause[0], strict=True) if cause == Cause.NONE
    )


def coverage_of_g1(cell: Cell, sampling: Sampling) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of the samples of g1 that hold literals, and whether the state is covered, shape (m,) each."""
    candidate = next(c for c in read_task(TASK, cell.workspace).candidates if c.name == "g1")
    timeline = feasible_study(cell, candidate, sampling).timeline
    return timeline.samples.t[timeline.monitored], timeline.covered[timeline.monitored]
