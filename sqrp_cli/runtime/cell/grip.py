"""How tools hold: a suction cup by a weld that contact makes, fingers by friction alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.runtime.cell.controller import Controller
from sqrp_cli.runtime.cell.engine import mujoco
from sqrp_cli.runtime.cell.mujoco_model import FRICTION, TIP, TIP_RADIUS, quaternion

SUCTION_REACH = 3e-3
"""Largest gap between the origin of the tool frame and a surface that suction closes [m]."""

GRIP = 30.0
"""Force of a finger, if its effort limit allows it [N]; of one that turns, at `FINGER_LENGTH`."""

CLOSING_SPEED = 0.05
"""Of a finger on its way to what it grasps [m/s]."""

FINGER_LENGTH = 0.05
"""Lever of a finger that turns [m]."""

_SLIPPERY = 1e-4
"""Coefficient of friction between fingers and what slips out of them."""


class Grip(Protocol):
    """A tool that can hold one object."""

    def grasp(self) -> None:
        """Hold what is there."""

    def release(self) -> None:
        """Let go of it, and reset."""

    def slip(self) -> None:
        """Lose it while still grasping."""

    def held(self) -> str | None:
        """The object that is really held."""


class SuctionGrip:
    """A suction cup: the object at the tool frame's origin when it is switched on becomes welded to it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, carrier: int, movables: Sequence[str]) -> None:
        """carrier: body of the tool frame. movables: names of the movable objects."""
        self._model, self._data, self._carrier, self._movables = model, data, carrier, movables

    def grasp(self) -> None:
        """Weld the nearest object within reach, as it lies."""
        gap, obj = min(((self._gap(obj), obj) for obj in self._movables), default=(np.inf, ""))
        if gap <= SUCTION_REACH:
            self.weld(obj)

    def weld(self, obj: str) -> None:
        """Fix an object where it is relative to the tool."""
        X_TO = inverse(body_pose(self._data, self._carrier)) @ body_pose(self._data, self._model.body(obj).id)
        weld = self._model.equality(obj).id
        self._model.eq_data[weld, :11] = [0.0, 0.0, 0.0, *X_TO[:3, 3], *quaternion(X_TO), 1.0]
        self._data.eq_active[weld] = 1

    def release(self) -> None:
        """Break the weld."""
        for obj in self._movables:
            self._data.eq_active[self._model.equality(obj).id] = 0

    def slip(self) -> None:
        """Break the weld."""
        self.release()

    def held(self) -> str | None:
        """What is welded."""
        return next((obj for obj in self._movables if self._data.eq_active[self._model.equality(obj).id]), None)

    def _gap(self, obj: str) -> float:
        tip, body = self._model.geom(TIP).id, self._model.body(obj)
        parts = range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
        solid = [part for part in parts if self._model.geom_contype[part]]
        far = 10 * SUCTION_REACH
        gaps = [mujoco.mj_geomDistance(self._model, self._data, tip, part, far, None) for part in solid]
        return TIP_RADIUS + float(min(gaps))


@dataclass(frozen=True)
class _Push:
    """How a motor closes its finger; force with its sign [N or Nm], greatest speed [m/s or rad/s]."""

    motor: int
    force: float
    speed: float


class FingerGrip:
    """A gripper whose fingers push with a constant force and hold by friction."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, controller: Controller, closing: Mapping[str, float]
    ) -> None:
        """closing: the joints that drive the fingers, each with the direction in which it closes (positive or not)."""
        self._model, self._data, self._controller = model, data, controller
        motors = controller.indices(list(closing))
        self._pushes = [
            _Push(int(motor), float(np.copysign(self._force(joint), sign)), self._speed(joint))
            for motor, (joint, sign) in zip(motors, closing.items(), strict=True)
        ]
        self._finger_of_body = finger_bodies(model, _with_followers(model, closing))
        self._pads = np.flatnonzero(self._finger_of_body[model.geom_bodyid] >= 0)
        model.geom_priority[self._pads] = 1  # so that their friction alone counts

    def grasp(self) -> None:
        """Close with a force."""
        self._model.geom_friction[self._pads] = FRICTION
        for push in self._pushes:
            self._controller.push(push.motor, push.force, push.speed)

    def release(self) -> None:
        """Follow the reference again."""
        for push in self._pushes:
            self._controller.follow(push.motor)
        self._model.geom_friction[self._pads] = FRICTION

    def slip(self) -> None:
        """Lose friction: what is held slides out, and the fingers close behind it."""
        self._model.geom_friction[self._pads] = _SLIPPERY

    def held(self) -> str | None:
        """What at least two fingers touch with friction."""
        if np.all(self._model.geom_friction[self._pads] == _SLIPPERY):
            return None
        fingers: dict[int, set[int]] = {}
        for contact in self._data.contact[: self._data.ncon]:
            first, second = self._model.geom_bodyid[contact.geom].tolist()
            for body, obj in ((first, second), (second, first)):
                finger = int(self._finger_of_body[body])
                if finger >= 0 and self._finger_of_body[obj] < 0:
                    fingers.setdefault(obj, set()).add(finger)
        return next((self._model.body(obj).name for obj, touching in fingers.items() if len(touching) > 1), None)

    def _force(self, joint: str) -> float:
        index = self._model.joint(joint).id
        limit = self._model.jnt_actfrcrange[index, 1] if self._model.jnt_actfrclimited[index] else np.inf
        return float(min(GRIP if self._slides(joint) else GRIP * FINGER_LENGTH, limit))

    def _speed(self, joint: str) -> float:
        return CLOSING_SPEED if self._slides(joint) else CLOSING_SPEED / FINGER_LENGTH

    def _slides(self, joint: str) -> bool:
        return bool(self._model.jnt_type[self._model.joint(joint).id] == mujoco.mjtJoint.mjJNT_SLIDE)


def body_pose(data: mujoco.MjData, body: int) -> Array:
    """X_WB of a body, shape (4, 4)."""
    return pose(data.xmat[body].reshape(3, 3), data.xpos[body])


def _with_followers(model: mujoco.MjModel, leaders: Mapping[str, float]) -> list[int]:
    """The joints with those names, and those that mimic them."""
    joints = [model.joint(name).id for name in leaders]
    mimics = model.eq_type == mujoco.mjtEq.mjEQ_JOINT
    followers = [int(model.eq_obj1id[i]) for i in np.flatnonzero(mimics) if model.eq_obj2id[i] in joints]
    return joints + followers


def finger_bodies(model: mujoco.MjModel, joints: Sequence[int]) -> NDArray[np.int64]:
    """For each body the joint among some that moves it, the nearest one, or -1; shape (bodies,)."""
    finger = np.full(model.nbody, -1)
    for body in range(1, model.nbody):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        own = [joint for joint in range(first, first + count) if joint in joints]
        finger[body] = own[0] if own else finger[model.body_parentid[body]]
    return finger
