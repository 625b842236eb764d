"""The paper's simulation, computed by the real pipeline: six ways to pick up a green object."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.files.frames import FrameName
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates, fixed_frame
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.assessment import Analysis, study
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive, FixedCount, Sampling
from sqrp_cli.task.task import Candidate, read_task
from tests.reproduction.summary import Summary, always_in_interest, feasible_study, hidden_by_the_robot, seen_again

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


@dataclass(frozen=True, eq=False)
class Simulation:
    """What came out, with 10 samples per primitive.

    of: the candidates that can be done, by their object. why_not_g6: why that one cannot. first: the one that is ranked
    first. sampled: Q_avg of g1 with each sampling [%]. hide_g1: cameras from which the robot hides g1 all through the
    lift, and that would otherwise see all there is to see. see_lift_of_g5: cameras that see all of it. see_g6: cameras
    that see it while the robot is at home.
    """

    of: Mapping[str, Summary]
    why_not_g6: str
    first: str
    sampled: Mapping[str, float]
    hide_g1: frozenset[str]
    see_lift_of_g5: frozenset[str]
    see_g6: frozenset[str]


def tabletop() -> Cell:
    """The cell as it is shipped."""
    return Cell.load(load_workspace(WORKSPACE))


@dataclass(frozen=True, eq=False)
class Picking:
    """The candidates, checked and moved: what cameras have no part in, so that it is computed once for all of them.

    done: a study of each candidate that can be done, by its object, with 10 samples per primitive. g1: with each
    sampling. not_done: the other candidates.
    """

    done: Mapping[str, Analysis]
    g1: Mapping[str, Analysis]
    not_done: Mapping[str, CandidateResult]

    @classmethod
    def of(cls, cell: Cell) -> Picking:
        """The six candidates of a cell."""
        ten, world = SAMPLINGS["10"], cell.initial_world
        found = {name: study(cell, one, world, ten, full=False) for name, one in _candidates(cell).items()}
        g1 = _candidates(cell)["g1"]
        return cls(
            {name: one for name, one in found.items() if isinstance(one, Analysis)},
            {name: feasible_study(cell, g1, sampling) for name, sampling in SAMPLINGS.items()},
            {
                name: CandidateResult.infeasible(_candidates(cell)[name], one.reasons)
                for name, one in found.items()
                if isinstance(one, Infeasible)
            },
        )

    def seen_in(self, cell: Cell) -> Simulation:
        """What comes out in a cell that is the same, save for where its cameras are."""
        ten = SAMPLINGS["10"]
        done = {name: seen_again(one, cell, ten, full=name in ("g1", "g5")) for name, one in self.done.items()}
        assessments = [*(one.assessment("") for one in done.values()), *self.not_done.values()]
        sampled = {name: seen_again(one, cell, SAMPLINGS[name]) for name, one in self.g1.items()}
        g1, g5 = done["g1"], done["g5"]
        return Simulation(
            of={name: Summary.of(one) for name, one in done.items()},
            why_not_g6=" ".join(self.not_done["g6"].reasons),
            first=rank(assessments, "q_eoi")[0].candidate.name,
            sampled={name: Summary.of(one).q_avg for name, one in sampled.items()},
            hide_g1=always_in_interest(cell, g1, None, Cause.NONE, Cause.HIDDEN)
            & hidden_by_the_robot(cell, g1, "hold"),
            see_lift_of_g5=always_in_interest(cell, g5, None, Cause.NONE),
            see_g6=_seeing_at_home(cell, "g6", g1),
        )


def simulate(cell: Cell) -> Simulation:
    """Rank the six candidates, and look closer at g1, g5 and g6."""
    return Picking.of(cell).seen_in(cell)


def computing_times(cell: Cell) -> Mapping[str, float]:
    """How long Q_avg of g1 takes to compute with each sampling [s], from the check of its preconditions on."""
    return {name: _computing_time(cell, sampling) for name, sampling in SAMPLINGS.items()}


def _computing_time(cell: Cell, sampling: Sampling) -> float:
    begin = time.perf_counter()
    Summary.of(feasible_study(cell, _candidates(cell)["g1"], sampling))
    return time.perf_counter() - begin


def _candidates(cell: Cell) -> Mapping[str, Candidate]:
    """The candidates of the task by their object."""
    return {candidate.name: candidate for candidate in read_task(TASK, cell.workspace).candidates}


def _seeing_at_home(cell: Cell, name: str, like: Analysis) -> frozenset[str]:
    """Cameras that see where an object stands while the robot is at home, as they have to see that of a study."""
    model, world = cell.model, cell.initial_world
    (box,) = next(target.boxes for target in like.targets if target.atom.predicate == "obj_on_table")
    moved = replace(box, frame=FrameName(name), encloses=(name,), seeks=name)
    objects = {thing: fixed_frame(X_WO) for thing, X_WO in world.X_WO.items()}
    states = SceneStates(1, {"world": fixed_frame(), **model.link_poses(model.home[None]), **objects})
    ((seen,),) = cell.observer.verdicts([Target(Atom("obj_on_table", (name,)), 1, (moved,))], states)
    return frozenset(
        camera.name for camera, cause in zip(cell.observer.cameras, seen.cause[0], strict=True) if cause == Cause.NONE
    )


def coverage_of_g1(cell: Cell, sampling: Sampling) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] of the samples of g1 that hold literals, and whether the state is covered, shape (m,) each."""
    timeline = feasible_study(cell, _candidates(cell)["g1"], sampling).timeline
    return timeline.samples.t[timeline.monitored], timeline.covered[timeline.monitored]
