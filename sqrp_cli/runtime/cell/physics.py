"""The moving part of the simulated cell: bodies, controller and tool, without images."""

from __future__ import annotations

from copy import copy

import numpy as np

from sqrp_cli.geometry import Array, pose
from sqrp_cli.knowledge.robot.robot import Robot
from sqrp_cli.knowledge.workspace.workspace import Workspace, World
from sqrp_cli.runtime.cell.controller import Controller, Payload
from sqrp_cli.runtime.cell.engine import mujoco
from sqrp_cli.runtime.cell.grip import FingerGrip, Grip, SuctionGrip, body_pose, finger_bodies
from sqrp_cli.runtime.cell.interface import ArmReference
from sqrp_cli.runtime.cell.mujoco_model import TIME_STEP, build_model, quaternion


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
        mimics = np.flatnonzero(self.model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
        for follower, leader, data in zip(
            self.model.eq_obj1id[mimics], self.model.eq_obj2id[mimics], self.model.eq_data[mimics], strict=True
        ):
            position = self.model.jnt_qposadr
            self._data.qpos[position[follower]] = data[0] + data[1] * self._data.qpos[position[leader]]
        mujoco.mj_forward(self.model, self._data)

    def _place(self, obj: str, X_WO: Array) -> None:
        self._data.joint(obj).qpos[:] = *X_WO[:3, 3], *quaternion(X_WO)
