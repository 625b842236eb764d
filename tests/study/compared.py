"""A way with seen paths beside the same way with others: direct ones, and those of a planner that knows no cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.fingers import with_fingers
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.way_around import find_way as find_way_around
from sqrp_cli.study.analysis import Analysis, analyse, analysed, planned_motion
from sqrp_cli.study.find import WantedWay, find_way
from sqrp_cli.study.robustness import Calibration, perturbed
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.seen_ways import move_searches
from sqrp_cli.task.task import Candidate, read_task
from sqrp_cli.trajectory import Trajectory

MOST_TRIES = 250
"""Straight pieces that the other planner may check for one move."""


def blind_time(found: Analysis) -> float:
    """How long what is monitored is not covered [s]."""
    quality = found.timeline.qualities.q_avg
    return 0.0 if quality is None else (1.0 - quality) * found.planned.T


@dataclass(frozen=True, eq=False)
class Compared:
    """The best way of a candidate whose paths are open."""

    cell: Cell
    candidate: Candidate
    seen: Analysis

    @classmethod
    def of(cls, workspace: Workspace, task: str, name: str | None = None, wanted: WantedWay | None = None) -> Compared:
        """name: of the candidate; by default the first that can be done. Raises ValueError if there is none."""
        cell = Cell.load(workspace)
        for candidate in read_task(task, workspace).candidates:
            if name is None or candidate.name == name:
                found = find_way(cell, candidate, cell.initial_world, Adaptive(), wanted or WantedWay())
                if not isinstance(found, Infeasible):
                    return cls(cell, candidate, found.analysis)
        raise ValueError(f"{task} has no feasible candidate")

    @cached_property
    def direct(self) -> Analysis:
        """The same way with direct paths."""
        way = replace(self.seen.planned.candidate, vias={})
        found = analyse(self.cell, way, self.cell.initial_world, Adaptive(), full=False)
        assert isinstance(found, Analysis)
        return found

    @cached_property
    def planned(self) -> Analysis:
        """The same way with the shortest paths that the planner finds, simplified and blended as ways around are."""
        direct, cell = self.direct, self.cell
        others: dict[int, Trajectory] = {}
        for space in move_searches(cell, direct.planned, self.candidate.open_paths, np.inf):
            trajectory, _ = find_way_around(
                space.placed, space.q0, space.q1, space.bounds, space.limits, MOST_TRIES, cell.seed
            )
            if trajectory is not None:
                others[space.primitive] = trajectory
        motion = with_trajectories(cell, direct, others)
        scene = planned_motion(cell, direct.planned.candidate, direct.planned.world, motion)
        return analysed(cell, scene, Adaptive(), full=False)

    def off(self, calibration: Calibration, draw: int) -> Compared:
        """The same motions, seen by cameras that are off."""
        cell = replace(self.cell, observer=perturbed(self.cell.observer, calibration, draw))
        moved = Compared(cell, self.candidate, analysed(cell, self.seen.planned, Adaptive(), full=False))
        moved.__dict__["direct"] = analysed(cell, self.direct.planned, Adaptive(), full=False)
        return moved


def with_trajectories(cell: Cell, found: Analysis, others: Mapping[int, Trajectory]) -> Motion:
    """A motion in which some primitives, by index, have other trajectories of the arm."""
    primitives, start, fingers = [], 0.0, len(cell.model.fingers.joints)
    for index, primitive in enumerate(found.planned.motion.primitives):
        trajectory = primitive.trajectory
        if index in others:
            resting = trajectory.path.end[-fingers:] if fingers else np.zeros(0)
            trajectory = with_fingers(cell.model, others[index], None, resting)
        end = start + trajectory.duration
        primitives.append(replace(primitive, trajectory=trajectory, start=start, end=end))
        start = end
    return replace(found.planned.motion, primitives=tuple(primitives))
