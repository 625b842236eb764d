"""The paper's simulation, computed by the real pipeline: six ways to pick up a green object."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.programming.assessment import Assessment, Study, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.grounding import TargetGrounder, ground_formulas
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.quality import Qualities
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.sampling import Adaptive, FixedCount, Sampling
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.scene import SceneStates, fixed_frame
from sqrp_cli.programming.task import Candidate, read_task

WORKSPACE = Path("workspaces/tabletop")
TASK = "pickup green"
SAMPLINGS: Mapping[str, Sampling] = {
    "5": FixedCount(5),
    "10": FixedCount(10),
    "20": FixedCount(20),
    "40": FixedCount(40),
    "default": Adaptive(),
}


@dataclass(frozen=True)
class Sampled:
    """Q_avg [%] of g1 with one sampling, and the time it took to compute [s]."""

    q_avg: float
    computing: float


@dataclass(frozen=True, eq=False)
class Simulation:
    """What came out.

    first: name of the candidate that is ranked first. assessments: by the object's name, with 10 samples per primitive.
    sampled: of g1, by sampling. hides_g1: cameras that look at g1 throughout the lift past parts of the arm. sees_lift:
    cameras that see all that matters throughout the lift of g5. sees_g6: cameras that see where g6 is.
    """

    first: str
    assessments: Mapping[str, Assessment]
    sampled: Mapping[str, Sampled]
    hides_g1: frozenset[str]
    sees_lift: frozenset[str]
    sees_g6: frozenset[str]


def tabletop() -> Cell:
    """The cell as it is shipped."""
    return Cell.load(load_workspace(WORKSPACE))


def simulate(cell: Cell) -> Simulation:
    """Rank the six candidates, look closer at g1 and g5."""
    workspace, world = cell.workspace, cell.workspace.initial_world
    candidates = {candidate.name: candidate for candidate in read_task(TASK, workspace).candidates}
    ten = Assignment(cell, world, SAMPLINGS["10"])
    assessments = {name: ten.assess(candidate) for name, candidate in candidates.items()}
    g1, g5, g6 = (candidates[name] for name in ("g1", "g5", "g6"))
    looks_at_g1 = _throughout_lift(cell, g1, Cause.NONE, Cause.HIDDEN)
    return Simulation(
        rank(tuple(assessments.values()), "q_eoi")[0].assessment.candidate.name,
        assessments,
        {name: _sampled(cell, g1, sampling) for name, sampling in SAMPLINGS.items()},
        looks_at_g1 - _throughout_lift(cell, g1, Cause.NONE),
        _throughout_lift(cell, g5, Cause.NONE),
        _sees_at_home(cell, g6),
    )


def _sampled(cell: Cell, candidate: Candidate, sampling: Sampling) -> Sampled:
    begin = time.perf_counter()
    quality = Qualities.of(_feasible(cell, candidate, sampling, full=False).timeline).q_avg
    computing = time.perf_counter() - begin
    assert quality is not None
    return Sampled(100 * quality, computing)


def _feasible(cell: Cell, candidate: Candidate, sampling: Sampling, *, full: bool) -> Study:
    found = study(cell, candidate, cell.workspace.initial_world, sampling, full=full)
    assert isinstance(found, Study), found
    return found


def _throughout_lift(cell: Cell, candidate: Candidate, *causes: Cause) -> frozenset[str]:
    """Cameras for which every box of every target has one of the causes in every sample of interest."""
    found = _feasible(cell, candidate, SAMPLINGS["10"], full=True)
    interest = found.timeline.interesting
    boxes = [box.cause[interest] for boxes in found.timeline.observation.full_matrix for box in boxes]
    always = np.isin(boxes, causes).all(axis=(0, 1))
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, always, strict=True) if is_so)


def _sees_at_home(cell: Cell, candidate: Candidate) -> frozenset[str]:
    """Cameras that see all that the first formula of a candidate is about while the arm is at home."""
    workspace, model, world = cell.workspace, cell.model, cell.workspace.initial_world
    spans = {primitive.name: (float(i), i + 1.0) for i, primitive in enumerate(candidate.skill.primitives)}
    grounder = TargetGrounder(candidate, world, workspace.objects, workspace.detectors, workspace.robot, model)
    targets = grounder.targets(ground_formulas(candidate, spans, float(len(spans))))
    objects = {name: fixed_frame(X_WO) for name, X_WO in world.X_WO.items()}
    at_start = {f"{name}@start": X for name, X in objects.items()}
    frames = {"world": fixed_frame(), **model.link_poses(model.home[None]), **objects, **at_start}
    placed = next(target for target in targets if target.atom.predicate == "obj_on_table")
    boxes = cell.observer.verdicts(placed, SceneStates(1, frames))
    sees = np.all([box.cause[0] == Cause.NONE for box in boxes], axis=0)
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, sees, strict=True) if is_so)
