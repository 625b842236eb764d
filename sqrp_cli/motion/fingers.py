"""Fingers: closing them on an object, and their motion."""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array, inverse, transform
from sqrp_cli.motion.collision import CollisionScene, finger_steps
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.robot.kinematics import FingerModel, RobotModel
from sqrp_cli.sight.solids import distance
from sqrp_cli.trajectory import Trajectory

CLOSING_STEP = 0.25e-3  # motion of the fingers [m] between checks whether they touch the object
WIDER = 0.01  # by how much fingers have to open further than an object is wide [m]
TOUCH = 1e-6  # tolerance of the contact position, as motion of the fingers [m]


def closed_on(scene: CollisionScene, name: str, X_TO: Array, start: Array) -> Array | str:
    """Positions at which the fingers, closing in step from `start`, first touch an object, (f,); or why they do not.

    X_TO: pose of the object in the tool frame, shape (4, 4). Without fingers, f is 0.
    """
    model = scene.model
    closed = model.fingers.closed
    if not model.fingers.joints:
        return start

    def touches(share: float) -> bool:
        fingers = start + share * (closed - start)
        poses = model.link_poses(model.with_fingers(model.home, fingers)[None])
        X_TW = inverse(poses[model.tool_frame][0])
        return any(
            distance(solid, X_TW @ poses[solid.part.parent][0], other, X_TO, 0.0) is not None
            for solid in scene.solids
            if solid.part.parent in model.fingers.links
            for other in scene.object_solids[name]
        )

    if touches(0.0):
        if model.fingers.width is None:
            return f"`{name}` does not fit between the open fingers"
        across = np.concatenate([transform(X_TO, solid.vertices)[:, 1] for solid in scene.object_solids[name]])
        hand, wide, said = model.fingers, float(np.ptp(across)), f"`{name}` does not fit between the fingers: "
        said += f"it is {1000 * wide:.3g} mm across, the fingers open to {1000 * (hand.width or 0.0):.3g} mm"
        further = closed + (wide + WIDER) / (hand.width or 1.0) * (hand.open - closed)
        if ((hand.lower <= further) & (further <= hand.upper)).all() and wide + WIDER > (hand.width or 0.0):
            names = ", ".join(f"{joint}: {at:.2f}" for joint, at in zip(hand.joints, further, strict=True))
            said += f"; try `open: {{{names}}}` and `width: {1000 * (wide + WIDER):.0f} mm`"
        return said
    steps = finger_steps(model, start, closed, CLOSING_STEP)
    first = next((k for k in range(1, steps + 1) if touches(k / steps)), None)
    if first is None:
        return f"the fingers close without touching `{name}`"
    apart, touching = (first - 1) / steps, first / steps
    for _ in range(int(np.ceil(np.log2(CLOSING_STEP / TOUCH)))):
        middle = 0.5 * (apart + touching)
        apart, touching = (apart, middle) if touches(middle) else (middle, touching)
    return start + apart * (closed - start)


def opened_to(fingers: FingerModel, width: float | None) -> Array | str:
    """Positions at which the fingers are open by a clear width [m], (f,), or why not; as far as they open for None.

    The width grows evenly from 0, where they are closed, to that of open fingers.
    """
    if width is None:
        return fingers.open
    if fingers.width is None:
        return "it is not stated how wide the fingers open; state `width` in `robot.fingers`, such as `width: 80 mm`"
    if width > fingers.width:
        return f"the fingers open by {1000 * fingers.width:g} mm, not by {1000 * width:g} mm"
    return fingers.closed + width / fingers.width * (fingers.open - fingers.closed)


def move_fingers(fingers: FingerModel, start: Array, end: Array, duration: float) -> Trajectory:
    """The fingers moving from start to end, (f,) each, in `duration` [s], or longer if their limits require it."""
    fastest = joint_move(start, end, MotionLimits.of(fingers))
    if fastest.duration <= 0.0:
        return Trajectory.standstill(end, duration)
    return Trajectory(fastest.path, fastest.law.stretched(max(1.0, duration / fastest.duration)))


def with_fingers(model: RobotModel, arm: Trajectory, fingers: Trajectory | None, resting: Array) -> Trajectory:
    """The trajectory of all driven joints: of the arm while the fingers rest, or of the fingers while the arm stands.

    arm: of n joints. fingers: of f joints; None if they stay at `resting`, shape (f,).
    """
    if not model.fingers.joints:
        return arm
    still, moving = (arm, resting) if fingers is None else (fingers, arm.positions([0.0])[0])
    coefficients = still.path.coefficients
    constant = np.zeros((*coefficients.shape[:2], len(moving)))
    constant[:, 0] = moving
    both = (coefficients, constant) if fingers is None else (constant, coefficients)
    return Trajectory(type(still.path)(still.path.breaks, np.concatenate(both, axis=2)), still.law)


def closed_behind(model: RobotModel, trajectory: Trajectory, share: float) -> Trajectory:
    """A trajectory of all driven joints with the fingers closed throughout by a share of the way they have left."""
    path, first = trajectory.path, len(model.arm)
    coefficients = path.coefficients.copy()
    coefficients[:, :, first:] *= 1.0 - share
    coefficients[:, 0, first:] += share * model.fingers.closed
    return Trajectory(type(path)(path.breaks, coefficients), trajectory.law)
