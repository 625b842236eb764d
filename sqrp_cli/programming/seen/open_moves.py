"""The joint moves of a way that may take other paths: which they are, and what limits them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Rehearsal
from sqrp_cli.programming.feasibility import skill_use
from sqrp_cli.programming.motion.ground_primitives import ground_primitives
from sqrp_cli.programming.motion.paths.position_limits import near_limits
from sqrp_cli.programming.motion.timing import MotionLimits
from sqrp_cli.programming.seen.move_search import MoveSpace, SeenPath
from sqrp_cli.programming.seen.move_watch import WatchedMove
from sqrp_cli.trajectory import JointPath, Trajectory


def open_moves(scene: Rehearsal, names: Collection[str]) -> list[WatchedMove]:
    """Those of the named joint moves of a way during which formulas apply."""
    primitives = enumerate(scene.motion.primitives)
    moves = (WatchedMove(scene, index) for index, primitive in primitives if primitive.name in names)
    return [move for move in moves if move.is_monitored]


def move_spaces(cell: Cell, scene: Rehearsal, moves: Mapping[int, WatchedMove], spare: float) -> Iterator[MoveSpace]:
    """What the paths of moves depend on, by the moves' indices. spare: longest time beyond that of the direct way [s].

    Moves by home have none.
    """
    model = cell.model
    grounded = ground_primitives(skill_use(cell, scene.candidate, scene.world), cell.collision)
    if isinstance(grounded, Infeasible):
        raise ValueError(f"{scene.candidate.name} was feasible a moment ago")
    limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
    for index, move in moves.items():
        primitive, timed = grounded.primitives[index], scene.motion.primitives[index].trajectory
        if primitive.via_home:
            continue
        arm = slice(len(model.arm))
        direct = Trajectory(JointPath(timed.path.breaks, timed.path.coefficients[:, :, arm]), timed.law)
        q0, q1 = direct.path.positions([0.0, 1.0])
        yield MoveSpace(
            move=move,
            q0=q0,
            q1=q1,
            bounds=near_limits(model, np.stack([q0, q1])),
            limits=replace(limits, velocity=primitive.speed * limits.velocity),
            scene=cell.collision.placed(primitive.world, primitive.allowed),
            direct=SeenPath(np.zeros((0, len(q0))), direct, free=True),
            longest=direct.duration + spare,
        )
