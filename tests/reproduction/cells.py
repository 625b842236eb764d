"""The paper's set-ups, computed by the real pipeline: six green cubes and a suction cup, two screws and two fingers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import pose
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.study.timeline import observe
from sqrp_cli.task.task import Candidate, read_task
from tests.cells import ROOT
from tests.reproduction.paper import Figures

TABLETOP, SCREWS = ROOT / "workspaces" / "tabletop", ROOT / "workspaces" / "screws"
GREEN, SCREW = "pickup green", "pickup_two_finger screw"
SAMPLINGS: Mapping[str, Sampling] = {str(n): FixedCount(n) for n in (5, 10, 20, 40)} | {"default": Adaptive()}
"""Samples per primitive in simulation; the paper chooses 10."""
EVERY_SECOND = FixedStep(1.0)


class Outcome(NamedTuple):
    """What came out of a set-up; the rest is of the simulation alone."""

    of: Mapping[str, Figures]
    """The candidates that can be done, by their object."""
    hiding: frozenset[str]
    """Cameras from which the robot hides g1, or red2, all through the lift; of g1 that would see it all otherwise."""
    why_not_g6: str = ""
    first: str = ""
    """The candidate that is ranked first."""
    sampled: Mapping[str, float] = {}
    """Q_avg of g1 with each sampling [%]."""
    see_lift_of_g5: frozenset[str] = frozenset()
    """Cameras that see all of it."""
    see_g6: frozenset[str] = frozenset()
    """Cameras that see it while the robot is at home."""


def shipped(folder: object) -> Cell:
    return Cell.load(load_workspace(folder))


def candidates(cell: Cell, task: str) -> dict[str, Candidate]:
    """By their object."""
    return {candidate.name: candidate for candidate in read_task(task, cell.workspace).candidates}


def feasible(cell: Cell, candidate: Candidate, sampling: Sampling, *, full: bool = False) -> Analysis:
    """The analysis of a candidate that can be done."""
    found = analyse(cell, candidate, cell.initial_world, sampling, full=full)
    assert isinstance(found, Analysis), found
    return found


def figures_of(found: Analysis) -> Figures:
    """Of a analysis that has both qualities."""
    qualities = found.timeline.qualities
    assert qualities.q_avg is not None
    assert qualities.q_eoi is not None
    return Figures(100 * qualities.q_avg, 100 * qualities.q_eoi, found.planned.motion.time)


def pick_screws(cell: Cell) -> Outcome:
    """Both candidates, with a sample every second."""
    both = candidates(cell, SCREW)
    red2 = feasible(cell, both["red2"], EVERY_SECOND, full=True)
    of = {name: figures_of(feasible(cell, candidate, EVERY_SECOND)) for name, candidate in both.items()}
    return Outcome(of, hidden_by_the_robot(cell, red2, "obj_on_table"))


def pick_green(cell: Cell) -> Callable[[Cell], Outcome]:
    """Check and move the six candidates; what comes out in a cell that is the same save for where its cameras are."""
    ten, every = SAMPLINGS["10"], candidates(cell, GREEN)
    found = {name: analyse(cell, one, cell.initial_world, ten, full=False) for name, one in every.items()}
    done = {name: one for name, one in found.items() if isinstance(one, Analysis)}
    not_done = {name: one.reasons for name, one in found.items() if not isinstance(one, Analysis)}
    of_g1 = {name: feasible(cell, every["g1"], sampling) for name, sampling in SAMPLINGS.items()}

    def seen_in(cell: Cell) -> Outcome:
        def again(one: Analysis, sampling: Sampling, *, full: bool = False) -> Analysis:
            return replace(one, timeline=observe(one.planned, cell.observer, sampling, full=full))

        seen = {name: again(one, ten, full=name in ("g1", "g5")) for name, one in done.items()}
        others = [CandidateResult.infeasible(every[name], reasons) for name, reasons in not_done.items()]
        always = partial(always_in_interest, cell)
        return Outcome(
            of={name: figures_of(one) for name, one in seen.items()},
            hiding=always(seen["g1"], Cause.NONE, Cause.HIDDEN) & hidden_by_the_robot(cell, seen["g1"], "hold"),
            why_not_g6=" ".join(not_done["g6"]),
            first=rank([*(one.result for one in seen.values()), *others], "q_eoi")[0].candidate.name,
            sampled={name: figures_of(again(one, SAMPLINGS[name])).q_avg for name, one in of_g1.items()},
            see_lift_of_g5=always(seen["g5"], Cause.NONE),
            see_g6=seeing_at_home(cell, "g6", seen["g1"]),
        )

    return seen_in


def cameras_where(cell: Cell, holds: np.ndarray) -> frozenset[str]:
    return frozenset(camera.name for camera, is_so in zip(cell.observer.cameras, holds, strict=True) if is_so)


def always_in_interest(cell: Cell, found: Analysis, *causes: Cause) -> frozenset[str]:
    """Cameras for which every box has one of the causes in every sample of interest of a full analysis."""
    matrix, interest = found.timeline.observation.full_matrix, found.timeline.of_interest
    return cameras_where(cell, np.isin([box.cause[interest] for own in matrix for box in own], causes).all((0, 1)))


def hidden_by_the_robot(cell: Cell, found: Analysis, predicate: str) -> frozenset[str]:
    """Cameras from which parts of the robot hide the target of a predicate in every sample of interest."""
    column = next(i for i, target in enumerate(found.planned.targets) if target.atom.predicate == predicate)
    of_robot = np.array([solid.part.parent in cell.model.links for solid in cell.observer.solids])
    boxes = found.timeline.observation.full_matrix[column]
    hidden = np.any([(box.cause == Cause.HIDDEN) & of_robot[box.by] for box in boxes], axis=0)
    return cameras_where(cell, hidden[found.timeline.of_interest].all(axis=0))


def seeing_at_home(cell: Cell, name: str, like: Analysis) -> frozenset[str]:
    """Cameras that see where an object stands while the robot is at home, as they have to see that of a analysis."""
    (box,) = next(target.boxes for target in like.planned.targets if target.atom.predicate == "obj_on_table")
    sought = replace(box, frame=name, encloses=(name,), seeks=name)
    objects = {thing: X_WO[None] for thing, X_WO in cell.initial_world.X_WO.items()}
    states = SceneStates(1, {"world": pose()[None], **cell.model.link_poses(cell.model.home[None]), **objects})
    ((seen,),) = cell.observer.verdicts([Target(Atom("obj_on_table", (name,)), 1, (sought,))], states)
    return cameras_where(cell, seen.cause[0] == Cause.NONE)
