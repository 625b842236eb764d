"""The simulated cell in MuJoCo: bodies, controller, tool and injected faults, and camera images of it.

Arm and fingers are controlled by position, with torque limits, led by velocity and inverse dynamics. A suction cup
holds by a weld that contact makes, fingers by friction alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.run.cell.interface import ArmReference, CellState
from sqrp_cli.run.cell.mujoco_model import FRICTION, TIME_STEP, TIP, TIP_RADIUS, build_model, mujoco, quaternion
from sqrp_cli.run.cell.render_pool import RenderPool
from sqrp_cli.run.image import CameraImage, check_simulated

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


class SuctionGrip:
    """A suction cup: the object at the tool frame's origin when it is switched on becomes welded to it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, carrier: int, movables: Sequence[str]) -> None:
        """carrier: body of the tool frame. movables: names of the movable objects."""
        self._model, self._data, self._carrier, self._movables = model, data, carrier, movables

    def grasp(self) -> None:
        """Weld the nearest object within reach, as it lies."""
        model, gaps, far = self._model, list[tuple[float, str]](), 10 * SUCTION_REACH
        for obj in self._movables:
            body = model.body(obj)
            solid = [i for i in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]) if model.geom_contype[i]]
            tip = model.geom(TIP).id
            away = min(mujoco.mj_geomDistance(model, self._data, tip, part, far, None) for part in solid)
            gaps.append((TIP_RADIUS + float(away), obj))
        gap, obj = min(gaps, default=(np.inf, ""))
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

    slip = release

    def held(self) -> str | None:
        """What is welded."""
        return next((obj for obj in self._movables if self._data.eq_active[self._model.equality(obj).id]), None)


class FingerGrip:
    """A gripper whose fingers push with a constant force and hold by friction."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, controller: Controller, closing: Mapping[str, float]
    ) -> None:
        """closing: the joints that drive the fingers, each with the direction in which it closes (positive or not)."""
        self._model, self._data, self._controller = model, data, controller
        # How each motor closes its finger: force with its sign [N or Nm], greatest speed [m/s or rad/s].
        self._pushes: list[tuple[int, float, float]] = []
        for motor, (name, sign) in zip(controller.indices(list(closing)), closing.items(), strict=True):
            joint = model.joint(name).id
            limit = model.jnt_actfrcrange[joint, 1] if model.jnt_actfrclimited[joint] else np.inf
            lever = 1.0 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else FINGER_LENGTH
            force = float(np.copysign(float(min(GRIP * lever, limit)), sign))
            self._pushes.append((int(motor), force, CLOSING_SPEED / lever))
        joints = [model.joint(name).id for name in closing]
        joints += [one.joint for one in followers(model) if one.leader in joints]
        self._finger_of_body = finger_bodies(model, joints)
        self._pads = np.flatnonzero(self._finger_of_body[model.geom_bodyid] >= 0)
        model.geom_priority[self._pads] = 1  # so that their friction alone counts

    def grasp(self) -> None:
        """Close with a force."""
        self._model.geom_friction[self._pads] = FRICTION
        for push in self._pushes:
            self._controller.push(*push)

    def release(self) -> None:
        """Follow the reference again."""
        for motor, _, _ in self._pushes:
            self._controller.follow(motor)
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


def body_pose(data: mujoco.MjData, body: int) -> Array:
    """X_WB of a body, shape (4, 4)."""
    return pose(data.xmat[body].reshape(3, 3), data.xpos[body])


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
    """A model in motion: the cell without images."""

    steps: int
    """Taken so far."""
    squared_error: float
    """Sum over them of the squared distance of the tool frame's origin from where the reference wanted it [m^2]."""

    def __init__(self, workspace: Workspace, world: World, model: mujoco.MjModel | None = None) -> None:
        """At rest in a world. model: as `build_model` makes it, for a world with the same objects; it is not changed.

        Joints that the world does not name are at 0 or the nearest limit. Raises InputError as `build_model`.
        """
        robot, X_WO = workspace.robot, placed_objects(world)
        self.model = build_model(workspace, X_WO) if model is None else copy(model)
        self._data = mujoco.MjData(self.model)
        self._carrier = self.model.body(robot.tool_frame).id
        movables, self._objects = [name for name in X_WO if not workspace.objects[name].fixed], tuple(X_WO)
        for name in movables:
            self._place(name, X_WO[name])
        for name, limits in robot.limits.items():
            rest = float(np.clip(0.0, limits.lower, limits.upper))
            self._data.joint(name).qpos[0] = world.joints.get(name, rest)
        move_followers(self.model, followers(self.model), self._data.qpos)
        mujoco.mj_forward(self.model, self._data)
        self._controller = Controller(self.model, self._data, self._carrier)
        self._hold: SuctionGrip | FingerGrip = SuctionGrip(self.model, self._data, self._carrier, movables)
        # What a force sensor between arm and tool would carry, without what is held.
        links = (robot.tool_frame,) if robot.tool is None else robot.tool.urdf.links
        self._tool_bodies = {int(self.model.body(link).id) for link in links}
        if robot.fingers is not None:
            opened, closed = robot.fingers.open, robot.fingers.closed
            closing = {joint: closed[joint] - opened[joint] for joint in opened}
            self._hold = FingerGrip(self.model, self._data, self._controller, closing)
            moved = finger_bodies(self.model, [self.model.joint(name).id for name in opened]) >= 0
            self._tool_bodies |= set(np.flatnonzero(moved).tolist())
        self._missing, self.steps, self.squared_error = False, 0, 0.0
        if world.held is not None and world.X_TO is not None:
            self._place(world.held, self.tool_pose() @ world.X_TO)
            mujoco.mj_forward(self.model, self._data)
            if isinstance(self._hold, SuctionGrip):
                self._hold.weld(world.held)
            else:
                self._hold.grasp()

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self.steps * TIME_STEP

    @property
    def positions(self) -> Array:
        """MuJoCo's qpos, a copy."""
        return np.array(self._data.qpos)

    @interrupts_later()  # the bindings of MuJoCo turn KeyboardInterrupt into other errors
    def advance(self, t: float, reference: ArmReference) -> float:
        """Let time pass until t [s], and return it, while the controller follows the reference within its torques."""
        moved = self._controller.indices(reference.joints)
        velocity, acceleration = np.zeros(self.model.nu), np.zeros(self.model.nu)
        times: Array = np.arange(self.steps, round(t / TIME_STEP), dtype=np.float64) * TIME_STEP
        for q, qd, qdd in zip(*reference.states(times), strict=True):
            self._controller.wanted[moved], velocity[moved], acceleration[moved] = q, qd, qdd
            mujoco.mj_step1(self.model, self._data)
            held = self._hold.held() if isinstance(self._hold, SuctionGrip) else None
            self._controller.drive(velocity, acceleration, None if held is None else self.model.body(held).id)
            mujoco.mj_step2(self.model, self._data)
            error = self._data.xpos[self._carrier] - self._controller.scratch.xpos[self._carrier]
            self.squared_error += float(error @ error)
            self.steps += 1
        mujoco.mj_kinematics(self.model, self._data)
        return t

    def grasp(self) -> None:
        """Switch suction on, or close the fingers with a force: what is there is held, if anything is.

        Suction takes the object whose surface is within 3 mm of the tool frame's origin, at once. Fingers hold by
        friction, as soon as they have closed, at 5 cm/s.
        """
        if not self._missing:
            self._hold.grasp()
        self._missing = False

    def miss_next_grasp(self) -> None:
        """Let the next `grasp` do nothing."""
        self._missing = True

    def release(self) -> None:
        """Switch suction off, or let the fingers follow the reference again (which then opens them)."""
        self._hold.release()

    def slip(self) -> None:
        """Lose the hold until the next `release`: the cup leaks, or the fingers get slippery. What was held falls."""
        self._hold.slip()

    def held(self) -> str | None:
        """What the tool really holds."""
        return self._hold.held()

    def tool_force(self) -> float:
        """Size of the sum of all contact forces on the tool and what it holds, but those between them [N].

        So a force sensor between arm and tool would say.
        """
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
        moving = [i for i in range(model.njnt) if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
        return {model.joint(i).name: float(self._data.qpos[model.jnt_qposadr[i]]) for i in moving}

    def tool_pose(self) -> Array:
        """X_WT of the tool frame, shape (4, 4)."""
        return body_pose(self._data, self._carrier)

    def torques(self) -> Array:
        """What each motor gave in the last time step, within its limit [Nm or N], shape (motors,)."""
        return np.array(self._data.qfrc_actuator[self._controller.dofs])

    def object_poses(self) -> dict[str, Array]:
        """X_WO of every object, shape (4, 4) each."""
        return {name: body_pose(self._data, self.model.body(name).id) for name in self._objects}

    def _place(self, obj: str, X_WO: Array) -> None:
        self._data.joint(obj).qpos[:] = *X_WO[:3, 3], *quaternion(X_WO)


class SimulatedCell(Physics, AbstractContextManager["SimulatedCell"]):
    """A cell in simulated time, with cameras; a context manager, as it holds processes that draw.

    The same workspace, world, seed and calls give the same bytes again.
    """

    @interrupts_later()
    def __init__(self, workspace: Workspace, world: World, seed: int) -> None:
        """The cell at rest in a world, at t = 0; an object of unknown pose is not in it. seed: of the image noise.

        Raises InputError without OpenGL (with the command that installs it), and for a mesh that cannot be used or
        images that are too large.
        """
        check_simulated(workspace)
        self._workspace, self._built = workspace, build_model(workspace, placed_objects(world))
        super().__init__(workspace, world, self._built)
        self._renderers = RenderPool(self._built, tuple(workspace.cameras.values()), seed)

    @interrupts_later()
    def reset(self, world: World) -> None:
        """Start again at t = 0, at rest in a world with the same objects; as a new cell would, but at once."""
        super().__init__(self._workspace, world, self._built)

    def frames(self, cameras: Sequence[str]) -> Mapping[str, CameraImage]:
        """An image of each camera as all now is, by name in the order given."""
        images = self._renderers.images(cameras, self.positions, self.t)
        return {name: CameraImage(name, self.t, image) for name, image in zip(cameras, images, strict=True)}

    def measured_joints(self, t: float | None = None) -> Mapping[str, float]:  # noqa: ARG002 - it knows no other time
        """Position of every movable joint of robot and tool as its encoder says now [rad or m]."""
        return self.joints()

    def trouble(self) -> None:
        """A simulated robot follows its motion until it is stopped."""

    def truth(self) -> CellState:
        """The present ground truth."""
        return CellState(self.t, self.object_poses(), self.held(), self.joints())

    def tracking_error(self) -> float:
        """Distance of the tool frame from where the reference wanted it [m], root mean square over all steps so far."""
        return float((self.squared_error / max(self.steps, 1)) ** 0.5)

    def __exit__(self, *_: object) -> None:
        """End the processes that draw."""
        self._renderers.close()


BANDWIDTH = 60.0
"""Of each joint's position loop, critically damped [rad/s]."""
FURTHEST = 1e6
"""No motor is driven further [rad or m]: a simulation that is told to go on does not get unstable."""


class Follower(NamedTuple):
    """A joint that mimics another one, by their numbers in the model."""

    joint: int
    leader: int
    offset: float
    multiplier: float


class Controller:
    """Drives every motor of a model, given by the joint of the same name.

    A motor's torque is stiffness (wanted - position) - damping velocity, with its gains set from the inertia that the
    joint has at the start, with that of the joints that mimic it. What is wanted is shifted so that on the reference
    the torque is that of inverse dynamics, payload included. MuJoCo limits the torque to the effort that the URDF says.
    An arm that this effort could not even hold where it starts is one that springs or counterweights balance, which no
    URDF can say: then what its weight takes goes beside the effort.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, carrier: int) -> None:
        """data: at the start, with everything computed. carrier: the body that carries what the tool holds."""
        self._model, self._data, self._carrier = model, data, carrier
        self.scratch = mujoco.MjData(model)
        """As if every motor were where it is wanted, at the last `drive`."""
        self.joints = tuple(model.actuator(i).name for i in range(model.nu))
        joint_ids = model.actuator_trnid[:, 0]
        self._joint_ids, self._efforts = joint_ids, model.jnt_actfrcrange[joint_ids].copy()
        self._position, self.dofs = model.jnt_qposadr[joint_ids], model.jnt_dofadr[joint_ids]
        self._followers = followers(model)
        # How fast each degree of freedom moves with each motor, (nv, motors): followers as their leaders do.
        self._moved = np.zeros((model.nv, model.nu))
        self._moved[self.dofs, np.arange(model.nu)] = 1.0
        for one in self._followers:
            leader = model.jnt_dofadr[one.leader]
            self._moved[model.jnt_dofadr[one.joint]] = one.multiplier * self._moved[leader]
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        self._stiffness = BANDWIDTH**2 * np.diag(self._moved.T @ inertia @ self._moved)
        self._damping = 2.0 / BANDWIDTH * self._stiffness
        self.wanted = data.qpos[self._position].copy()
        limited = model.jnt_actfrclimited[joint_ids].astype(bool)
        self._balanced = bool((limited & (np.abs(self._weight()) > self._efforts[:, 1])).any())
        self._force = np.full(model.nu, np.nan)
        for motor in range(model.nu):
            self.follow(motor)

    def indices(self, joints: Sequence[str]) -> NDArray[np.int64]:
        """Where joints stand in `joints`."""
        return np.array([self.joints.index(name) for name in joints], dtype=np.int64)

    def push(self, motor: int, force: float, speed: float) -> None:
        """Let a motor push with a force [N or Nm], and no faster than at a speed [m/s or rad/s], until `follow`."""
        self._force[motor] = force
        self._model.actuator_gainprm[motor, 0] = 1.0
        self._model.actuator_biasprm[motor, :3] = 0.0, 0.0, -abs(force) / speed

    def follow(self, motor: int) -> None:
        """Let a motor follow its reference."""
        self._force[motor] = np.nan
        self._model.actuator_gainprm[motor, 0] = self._stiffness[motor]
        self._model.actuator_biasprm[motor, :3] = 0.0, -self._stiffness[motor], -self._damping[motor]

    def drive(self, velocity: Array, acceleration: Array, payload: int | None) -> None:
        """Set the motors for the next time step; velocity, acceleration: of each [rad/s or m/s, and per s].

        payload: body of the object that the arm knows that it carries.
        """
        if self._balanced:
            self._model.jnt_actfrcrange[self._joint_ids] = self._efforts + self._weight()[:, None]
        torque = self._inverse_dynamics(velocity, acceleration, payload)
        led = self.wanted + (torque + self._damping * velocity) / self._stiffness
        self._data.ctrl[:] = np.where(np.isnan(self._force), np.clip(led, -FURTHEST, FURTHEST), self._force)

    def _weight(self) -> Array:
        """Torque of each motor that holds the robot where it is wanted."""
        still = np.zeros(self._model.nu)
        return self._inverse_dynamics(still, still, None)

    def _inverse_dynamics(self, velocity: Array, acceleration: Array, payload: int | None) -> Array:
        """Torque of each motor that the wanted motion takes; everything else stands still where it now is."""
        model, scratch = self._model, self.scratch
        scratch.qpos[:], scratch.qvel[:], scratch.qacc[:] = self._data.qpos, 0.0, 0.0
        scratch.qpos[self._position] = self.wanted
        move_followers(model, self._followers, scratch.qpos)
        scratch.qvel[:], scratch.qacc[:] = self._moved @ velocity, self._moved @ acceleration
        mujoco.mj_kinematics(model, scratch)
        mujoco.mj_comPos(model, scratch)
        mujoco.mj_comVel(model, scratch)
        torque = np.zeros(model.nv)
        mujoco.mj_rne(model, scratch, 1, torque)
        torque += model.dof_armature * scratch.qacc
        if payload is not None:
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, scratch, jacobian, None, self._data.xipos[payload], self._carrier)
            torque -= model.body_mass[payload] * model.opt.gravity @ jacobian
        return self._moved.T @ torque


def followers(model: mujoco.MjModel) -> tuple[Follower, ...]:
    """The joints that mimic another one, each after that one."""
    found = [
        Follower(int(model.eq_obj1id[i]), int(model.eq_obj2id[i]), *model.eq_data[i, :2].tolist())
        for i in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
    ]
    leaders = {one.joint: one.leader for one in found}

    def depth(joint: int) -> int:
        return 1 + depth(leaders[joint]) if joint in leaders else 0

    return tuple(sorted(found, key=lambda one: depth(one.joint)))


def move_followers(model: mujoco.MjModel, joints: Iterable[Follower], qpos: Array) -> None:
    """Put joints that mimic others, each after that one, where those have them, in MuJoCo's qpos."""
    for one in joints:
        leader, follower = model.jnt_qposadr[one.leader], model.jnt_qposadr[one.joint]
        qpos[follower] = one.offset + one.multiplier * qpos[leader]
