"""The joint moves of a way that may take other paths: which they are, what limits them, and ends that no path helps."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Indices
from sqrp_cli.knowledge.skill.skill import HOME
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import BlindEnd, Study
from sqrp_cli.programming.coverage.timeline import Rehearsal
from sqrp_cli.programming.feasibility import skill_use
from sqrp_cli.programming.motion.ground_primitives import ground_primitives
from sqrp_cli.programming.motion.paths.position_limits import near_limits
from sqrp_cli.programming.motion.timing import MotionLimits
from sqrp_cli.programming.seen.move_search import MoveSpace, SeenPath, WatchedMove
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


def blind_ends(study: Study, names: Collection[str]) -> tuple[BlindEnd, ...]:
    """The ends of the named joint moves at which the state itself is not covered, in the order of time."""
    return tuple(end for move in open_moves(study, names) for end in _ends_of(study, move.primitive))


def _ends_of(study: Study, primitive: int) -> Iterator[BlindEnd]:
    timeline = study.timeline
    within = np.array([piece.primitive == primitive for piece in timeline.pieces])[timeline.samples.piece]
    rows = np.flatnonzero(within)
    move = study.candidate.skill.primitives[primitive]
    stops = [getattr(action, "to", None) for action in study.candidate.skill.primitives[:primitive]]
    begin = next((stop for stop in reversed(stops) if stop is not None), HOME)
    whole = float(timeline.samples.t[rows[-1]] - timeline.samples.t[rows[0]])
    for at, in_order in ((begin, rows), (str(getattr(move, "to", "")), rows[::-1])):
        if seconds := _blind_from(study, in_order):
            yield BlindEnd(primitive=move.name, at=at, seconds=seconds)
        if seconds == whole:
            break  # It is not covered anywhere: once is enough.


def _blind_from(study: Study, rows: Indices) -> float:
    """How long the state is not covered from the first of some samples in a row to the first that is covered [s]."""
    timeline = study.timeline
    blind = timeline.monitored[rows] & ~timeline.covered[rows]
    seen = np.flatnonzero(~blind)
    last = int(seen[0]) if len(seen) else len(rows) - 1
    return float(abs(timeline.samples.t[rows[last]] - timeline.samples.t[rows[0]])) if blind[0] else 0.0
