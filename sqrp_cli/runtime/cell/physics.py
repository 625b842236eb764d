"""The moving part of the simulated cell: bodies, controller and tool, without images.

A suction cup holds by a weld that contact makes, fingers by friction alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.knowledge.robot.robot import Robot
from sqrp_cli.knowledge.workspace.workspace import Workspace, World
from sqrp_cli.runtime.cell.controller import Controller, Payload, followers, move_followers
from sqrp_cli.runtime.cell.engine import mujoco
from sqrp_cli.runtime.cell.interface import ArmReference
from sqrp_cli.runtime.cell.mujoco_model import FRICTION, TIME_STEP, TIP, TIP_RADIUS, build_model, quaternion

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
    return joints + [one.joint for one in followers(model) if one.leader in joints]


def finger_bodies(model: mujoco.MjModel, joints: Sequence[int]) -> NDArray[np.int64]:
    """For each body the joint among some that moves it, the nearest one, or -1; shape (bodies,)."""
    finger = np.full(model.nbody, -1)
    for body in range(1, model.nbody):
        first, count = model.body_jntadr[body], model.body_jntnum[body]
        own = [joint for joint in range(first, first + count) if joint in joints]
        finger[body] = own[0] if own else finger[model.body_parentid[body]]
    return finger


def placed_objects(world: World) -> dict[str, Array]:
    """X_WO of every object of a world, shape (4, 4) each; what is held has a place only once the arm has."""
    return {**({} if world.held is None else {world.held: pose()}), **world.X_WO}


class Physics:
    """A model in motion.

    model: of MuJoCo. steps: taken so far. squared_error: sum over them of the squared distance of the tool frame's
    origin from where the reference wanted it [m^2].
    """

    def __init__(self, workspace: Workspace, world: World, model: mujoco.MjModel | None = None) -> None:
        """At rest in a world. model: as `build_model` makes it, for a world with the same objects; it is not changed.

        Raises InputError as `build_model`.
        """
        robot = workspace.robot
        X_WO = placed_objects(world)
        self.model = build_model(workspace, X_WO) if model is None else copy(model)
        self._data = mujoco.MjData(self.model)
        self._carrier = self.model.body(robot.tool_frame).id
        self._movables = [name for name in X_WO if not workspace.objects[name].fixed]
        self._objects = tuple(X_WO)
        for name in self._movables:
            self._place(name, X_WO[name])
        self._rest(robot, world)
        self._controller = Controller(self.model, self._data)
        self._hold = self._tool(robot)
        self._missing = False
        self._tool_bodies = self._bodies_of_tool(robot)
        self.steps, self.squared_error = 0, 0.0
        if world.held is not None and world.X_TO is not None:
            self._place(world.held, self.tool_pose() @ world.X_TO)
            mujoco.mj_forward(self.model, self._data)
            if isinstance(self._hold, SuctionGrip):
                self._hold.weld(world.held)
            else:
                self._hold.grasp()

    @property
    def t(self) -> float:
        """Time [s]."""
        return self.steps * TIME_STEP

    @property
    def positions(self) -> Array:
        """MuJoCo's qpos, a copy."""
        return np.array(self._data.qpos)

    def advance(self, t: float, reference: ArmReference) -> None:
        """Step until t [s], to half a time step."""
        moved = self._controller.indices(reference.joints)
        velocity, acceleration = np.zeros(self.model.nu), np.zeros(self.model.nu)
        times: Array = np.arange(self.steps, round(t / TIME_STEP), dtype=np.float64) * TIME_STEP
        for q, qd, qdd in zip(*reference.states(times), strict=True):
            self._controller.wanted[moved], velocity[moved], acceleration[moved] = q, qd, qdd
            mujoco.mj_step1(self.model, self._data)
            held = self._hold.held() if isinstance(self._hold, SuctionGrip) else None
            payload = None if held is None else Payload(self.model.body(held).id, self._carrier)
            self._controller.drive(velocity, acceleration, payload)
            mujoco.mj_step2(self.model, self._data)
            error = self._data.xpos[self._carrier] - self._controller.wanted_position(self._carrier)
            self.squared_error += float(error @ error)
            self.steps += 1
        mujoco.mj_kinematics(self.model, self._data)

    def grasp(self) -> None:
        """Let the tool hold what is there, unless it is to miss."""
        if not self._missing:
            self._hold.grasp()
        self._missing = False

    def miss_next_grasp(self) -> None:
        """Let the next `grasp` do nothing."""
        self._missing = True

    def release(self) -> None:
        """Let the tool let go."""
        self._hold.release()

    def slip(self) -> None:
        """Let the tool lose what it holds."""
        self._hold.slip()

    def held(self) -> str | None:
        """What the tool really holds."""
        return self._hold.held()

    def tool_force(self) -> float:
        """Size of the sum of all contact forces on the tool and what it holds, but those between them [N]."""
        own = set(self._tool_bodies)
        if (held := self.held()) is not None:
            own.add(int(self.model.body(held).id))
        total = np.zeros(3)
        for index in range(self._data.ncon):
            contact, force = self._data.contact[index], np.zeros(6)
            first, second = (int(body) in own for body in self.model.geom_bodyid[contact.geom])
            if first != second:
                mujoco.mj_contactForce(self.model, self._data, index, force)
                total += (1.0 if second else -1.0) * contact.frame.reshape(3, 3).T @ force[:3]
        return float(np.linalg.norm(total))

    def joints(self) -> dict[str, float]:
        """Position of every movable joint of robot and tool [rad or m]."""
        model = self.model
        free = mujoco.mjtJoint.mjJNT_FREE
        return {
            model.joint(i).name: float(self._data.qpos[model.jnt_qposadr[i]])
            for i in range(model.njnt)
            if model.jnt_type[i] != free
        }

    def tool_pose(self) -> Array:
        """X_WT of the tool frame, shape (4, 4)."""
        return body_pose(self._data, self._carrier)

    def torques(self) -> Array:
        """What each motor gave in the last time step [Nm or N], shape (motors,)."""
        return self._controller.torques()

    def object_poses(self) -> dict[str, Array]:
        """X_WO of every object, shape (4, 4) each."""
        return {name: body_pose(self._data, self.model.body(name).id) for name in self._objects}

    def _tool(self, robot: Robot) -> Grip:
        if robot.fingers is None:
            return SuctionGrip(self.model, self._data, self._carrier, self._movables)
        opened, closed = robot.fingers.open, robot.fingers.closed
        closing = {joint: closed[joint] - opened[joint] for joint in opened}
        return FingerGrip(self.model, self._data, self._controller, closing)

    def _bodies_of_tool(self, robot: Robot) -> frozenset[int]:
        """What a force sensor between arm and tool would carry, without what is held."""
        links = (robot.tool_frame,) if robot.tool is None else robot.tool.urdf.links
        own = {int(self.model.body(link).id) for link in links}
        joints = [] if robot.fingers is None else [self.model.joint(name).id for name in robot.fingers.open]
        return frozenset(own | set(np.flatnonzero(finger_bodies(self.model, joints) >= 0).tolist()))

    def _rest(self, robot: Robot, world: World) -> None:
        """Bring the joints to where they are in the world; joints that it does not name to 0 or the nearest limit."""
        for name, limits in robot.limits.items():
            rest = float(np.clip(0.0, limits.lower, limits.upper))
            self._data.joint(name).qpos[0] = world.joints.get(name, rest)
        move_followers(self.model, followers(self.model), self._data.qpos)
        mujoco.mj_forward(self.model, self._data)

    def _place(self, obj: str, X_WO: Array) -> None:
        self._data.joint(obj).qpos[:] = *X_WO[:3, 3], *quaternion(X_WO)
