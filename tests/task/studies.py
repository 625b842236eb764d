"""Random motions of an arm past cameras, without inverse kinematics: for tests of time lines and quality."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, look_at, pose
from sqrp_cli.logic.formula_time import GroundOperator
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.motion.plan_motion import Motion, TimedPrimitive
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Cylinder, Part
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import ObservationRequest, Timeline, observe
from sqrp_cli.task.pieces import cut_into_pieces, monitored_times
from sqrp_cli.trajectory import Trajectory
from tests.sight.views import box_part, camera_pose_around, make_box, make_camera, make_detector, random_pose

HOLD, PLACED = Atom("hold", ("cube",)), Atom("placed", ("cube",))
CUBE = (0.05, 0.05, 0.05)


@dataclass(frozen=True, eq=False)
class WatchedMotion:
    """A motion with everything that its time line needs. faults: columns of the literals of each fault."""

    stage: Stage
    observer: Observer
    targets: tuple[Target, ...]
    formulas: tuple[GroundOperator, ...]
    faults: Mapping[str, tuple[int, ...]]

    def timeline(self, sampling: Sampling, *, full: bool = False) -> Timeline:
        return observe(self.request, self.observer, sampling, full=full)

    @property
    def request(self) -> ObservationRequest:
        T, T_eoi = monitored_times(self.formulas)
        return ObservationRequest(stage=self.stage, targets=self.targets, faults=self.faults, T=T, T_eoi=T_eoi)


def always(start: float, end: float, *literals: Literal) -> GroundOperator:
    return GroundOperator(start, end, "always", "always", literals)


def eventually(start: float, end: float, *literals: Literal, fault: str | None = None) -> GroundOperator:
    return GroundOperator(start, end, "eventually", "eventually", literals, fault)


def make_motion(model: RobotModel, waypoints: Array, hold: float, X_TO: Array) -> Motion:
    """Joint moves along waypoints (3, n): to the cube, a grasp that lasts `hold` [s], and on with the cube."""
    limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
    first = joint_move(waypoints[0], waypoints[1], limits)
    grasp = Trajectory.standstill(waypoints[1], hold)
    last = joint_move(waypoints[1], waypoints[2], limits)
    X_start = {"cube": model.tool_pose(waypoints[1]) @ X_TO}
    primitives, start = [], 0.0
    for name, trajectory, held in (("a1", first, None), ("a2", grasp, None), ("a3", last, "cube")):
        resting = {} if held else X_start
        end = start + trajectory.duration
        primitives.append(TimedPrimitive(name, start, end, trajectory, held, X_TO if held else None, resting))
        start = end
    joints = dict(zip(model.arm, waypoints[2].tolist(), strict=True))
    return Motion(model.arm, tuple(primitives), World(frozenset(), X_start, "cube", X_TO, joints))


def watched_motion(seed: int, model: RobotModel, min_visible: float = 1.0) -> WatchedMotion:
    """A random motion among random plates, boxes and a cable, with four cameras."""
    rng = np.random.default_rng(seed)
    middle = model.home + rng.uniform(-0.8, 0.8, len(model.arm))
    waypoints = np.stack([middle + rng.uniform(-1, 1, len(model.arm)), middle, middle + rng.uniform(-1, 1, 6)])
    X_TO = pose(position=(0.0, 0.0, CUBE[2] / 2))
    motion = make_motion(model, waypoints, 0.7, X_TO)
    spot = motion.primitives[0].X_WO["cube"]
    near_spot = spot[:3, 3] - 0.4, spot[:3, 3] + 0.4
    parts = [
        *model.parts,
        box_part("cube", CUBE, pose(), "cube"),
        box_part("plate", (0.2, 0.2, 0.003), random_pose(rng, *near_spot)),
        box_part("block", (0.1, 0.08, 0.12), random_pose(rng, *near_spot)),
        Part("cable", "world", Cylinder(0.002, 1.0), random_pose(rng, *near_spot)),
    ]
    cameras = [
        make_camera(
            camera_pose_around(rng, spot[:3, 3], rng.uniform(0.6, 1.5)),
            name=f"cam{i}",
            focal=(500.0, 500.0),
            rate=rate,
            latency=0.05,
        )
        for i, rate in enumerate((10.0, 25.0, 10.0))
    ]
    in_hand = look_at((0.09, 0.0, -0.02), (0.0, 0.0, 0.1), up=(1.0, 0.0, 0.0))
    cameras.append(make_camera(in_hand, name="in_hand", frame="tool0", focal=(400.0, 400.0), rate=30.0))
    detector = make_detector(min_visible, max_incidence=1.4, min_pixels=8.0)
    targets = (
        Target(HOLD, 1, (make_box(CUBE, frame="cube", encloses=["cube", *model.tool_links], detector=detector),)),
        Target(PLACED, 1, (make_box(CUBE, frame="cube@start", encloses=["cube"], detector=detector),)),
    )
    (_, a2, a3), time = motion.primitives, motion.time
    held, gone = Literal(HOLD), Literal(PLACED, positive=False)
    gap = float(rng.uniform(0.0, 0.3)) if rng.random() < 0.5 else 0.0
    formulas = (
        always(0.0, a2.end - gap, held.negated(), gone.negated()),
        always(a3.start, time, held, gone),
        eventually(a3.start, a3.start + 0.7 * (time - a3.start), held.negated(), gone.negated(), fault="slip"),
    )
    spans = [(primitive.start, primitive.end) for primitive in motion.primitives]
    stage = Stage(model, motion, cut_into_pieces(spans, formulas), {"cube": spot})
    return WatchedMotion(stage, Observer(tuple(cameras), load_solids(parts)), targets, formulas, {"slip": (0, 1)})
