"""Gains of sight through slits, as rays tell them at every millisecond, and whether sampling knows of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sqrp_cli.geometry import look_at
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.study.sampling import MAX_STEP, Adaptive
from sqrp_cli.study.stage import Stage
from sqrp_cli.task.pieces import cut_into_pieces
from sqrp_cli.trajectory import Trajectory
from tests.sight.views import box_part, make_camera
from tests.task.studies import HOLD, Literal, WatchedMotion, always, watched_motion
from tests.trials.slit_rays import Rays, seen
from tests.trials.slits import events_of, every_step, slit_before

SLOWER = 5.0
"""How much longer the move takes, so that movement alone asks for few samples."""


def through_a_slit(seed: int, model: RobotModel) -> list[tuple[bool, float, bool]]:
    """The events of a random motion whose only camera looks past plates at what the tool carries."""
    rng, motion = np.random.default_rng([seed, 50]), watched_motion(seed, model)
    to, grasp, carry = motion.stage.motion.primitives
    slowly = Trajectory(carry.trajectory.path, carry.trajectory.law.stretched(SLOWER))
    carry = replace(carry, trajectory=slowly, end=carry.start + slowly.duration)
    formulas = (always(carry.start, carry.end, Literal(HOLD)),)
    moved = replace(motion.stage.motion, primitives=(to, grasp, carry))
    spans = [(primitive.start, primitive.end) for primitive in moved.primitives]
    stage = Stage(model, moved, cut_into_pieces(spans, formulas), motion.stage.X_WO)
    target = motion.targets[0]
    samples, box = every_step(stage), target.boxes[0]
    states = stage.states(samples)
    eye, aim, placed = slit_before(rng, samples, states.box_poses(box), box)
    plates = [box_part(f"plate{n}", tuple(size), X) for n, (X, size) in enumerate(placed)]
    camera = make_camera(look_at(eye, aim), size=(1280, 960), rate=10.0)
    solids = [solid for solid in motion.observer.solids if solid.part.parent != "world"] + list(load_solids(plates))
    watched = WatchedMotion(stage, Observer((camera,), tuple(solids)), (target,), formulas, {})
    judge = Rays([solid for solid in solids if solid.name not in box.encloses], states.X_WF)
    covered = seen(camera, camera.X_FC, box, states.box_poses(box), judge, least=1.0)
    return list(events_of(watched.timeline(Adaptive()), samples, covered))


def test_no_gain_of_sight_of_50_ms_is_missed(ur5: RobotModel) -> None:
    events = [event for seed in (0, 1) for event in through_a_slit(seed, ur5)]
    assert sum(gained for gained, _, _ in events) >= 2
    assert [length for _, length, found in events if length >= MAX_STEP and not found] == []
