"""The simulated cell in MuJoCo: bodies, controller, tool and injected faults, and camera images of it.

Arm and fingers are controlled by position, with torque limits, led by velocity and inverse dynamics. A suction cup
holds by a weld that contact makes, fingers by friction alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from copy import copy
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.run.arm_motion import ArmReference
from sqrp_cli.run.cell.mujoco_model import FRICTION, TIME_STEP, TIP, TIP_RADIUS, build_model, mujoco, quaternion
from sqrp_cli.run.cell.render_pool import start_drawing
from sqrp_cli.run.image import CameraImage, check_image_sizes
from sqrp_cli.run.record.report import Stopped

SUCTION_REACH = 3e-3  # Largest gap between the origin of the tool frame and a surface that suction closes [m]
GRIP = 30.0  # Force of a finger, if its effort limit allows it [N]; of one that turns, at `FINGER_LENGTH`
CLOSING_SPEED = 0.05  # Of a finger on its way to what it grasps [m/s]
FINGER_LENGTH = 0.05  # Lever of a finger that turns [m]
_SLIPPERY = 1e-4  # Coefficient of friction between fingers and what slips out of them
BANDWIDTH = 60.0  # Of each joint's position loop, critically damped [rad/s]
FURTHEST = 1e6  # No motor is driven further [rad or m]: a simulation that is told to go on does not get unstable
Follower: TypeAlias = tuple[int, int, float, float]
"""A joint that mimics another one, by their numbers in the model, with offset [rad or m] and multiplier."""


class CellState(NamedTuple):
    """The ground truth of one moment: for injecting faults and for judging detections, never for perception."""

    t: float  # On the cell's clock [s]
    X_WO: Mapping[str, Array]  # Pose of every object in the world, shape (4, 4)
    held: str | None  # The object in the tool, by weld or contact
    joints: Mapping[str, float]  # Position of every movable joint of robot and tool [rad or m]
    tracking: float = 0.0
    """Distance of the tool frame from where the reference wanted it [m], root mean square over all steps so far."""


class SimulatedCell(AbstractContextManager["SimulatedCell"]):
    """A cell in simulated time; a context manager, as it holds processes that draw its images.

    The same workspace, world, seed and calls give the same bytes again.
    """

    @interrupts_later()  # the bindings of MuJoCo turn KeyboardInterrupt into other errors
    def __init__(self, workspace: Workspace, world: World, seed: int | None = None) -> None:
        """The cell at rest in a world, at t = 0; an object of unknown pose is not in it.

        seed: of the image noise; without it, the cell has no images. Raises InputError without OpenGL (with the command
        that installs it), and for a mesh that cannot be used or images that are too large.
        """
        if seed is not None:
            check_image_sizes(workspace)
        self._workspace, self._built = workspace, build_model(workspace, placed_objects(world))
        self.reset(world)
        self._drawing = None if seed is None else start_drawing(self._built, tuple(workspace.cameras.values()), seed)

    @interrupts_later()
    def reset(self, world: World) -> None:
        """Start again at t = 0, at rest in a world with the same objects; as a new cell would, but at once.

        Joints that the world does not name are at 0 or the nearest limit.
        """
        robot, X_WO = self._workspace.robot, placed_objects(world)
        self.model = model = copy(self._built)
        self._data = data = mujoco.MjData(model)
        self._carrier = model.body(robot.tool_frame).id
        self._objects = tuple(X_WO)
        self._welds = {name: model.equality(name).id for name in X_WO if not self._workspace.objects[name].fixed}
        for name in self._welds:
            data.joint(name).qpos[:] = *X_WO[name][:3, 3], *quaternion(X_WO[name])
        for name, limits in robot.limits.items():
            rest = float(np.clip(0.0, limits.lower, limits.upper))
            data.joint(name).qpos[0] = world.joints.get(name, rest)
        follow = followers(model)
        for joint, leader, offset, multiplier in follow:
            data.qpos[model.jnt_qposadr[joint]] = offset + multiplier * data.qpos[model.jnt_qposadr[leader]]
        mujoco.mj_forward(model, data)
        self._controller = Controller(model, data, self._carrier)
        # What a force sensor between arm and tool would carry, without what is held.
        links = (robot.tool_frame,) if robot.tool is None else robot.tool.urdf.links
        self._tool_bodies = {int(model.body(link).id) for link in links}
        self._steps, self._squared_error = 0, 0.0
        self.misses_next_grasp = False
        """Whether the next `grasp` does nothing."""
        # The body that slips out of the fingers, 0 for none, and from where along the tool's z axis it is outside [m].
        self._slipping = 0, 0.0
        # How each motor closes its finger: force with its sign [N or Nm], greatest speed [m/s or rad/s].
        self._pushes: list[tuple[int, float, float]] = []
        if robot.fingers is not None:
            opened, closed = robot.fingers.open, robot.fingers.closed
            joints = [model.joint(name).id for name in opened]
            for name, joint in zip(opened, joints, strict=True):
                limit = model.jnt_actfrcrange[joint, 1] if model.jnt_actfrclimited[joint] else np.inf
                lever = 1.0 if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else FINGER_LENGTH
                force = float(np.copysign(float(min(GRIP * lever, limit)), closed[name] - opened[name]))
                self._pushes.append((self._controller.motors[name], force, CLOSING_SPEED / lever))
            self._tool_bodies |= set(np.flatnonzero(finger_bodies(model, joints) >= 0).tolist())
            joints += [joint for joint, leader, _, _ in follow if leader in joints]
            self._finger_of_body = finger_bodies(model, joints)
            if len(joints) == 1:  # the jaw that stands still is the other finger
                carrier = model.body_weldid[model.body_parentid[model.jnt_bodyid[joints[0]]]]
                self._finger_of_body[model.body_weldid == carrier] = model.njnt
            self._pads = np.flatnonzero(self._finger_of_body[model.geom_bodyid] >= 0)
            model.geom_priority[self._pads] = 1  # so that their friction alone counts
        if world.held is not None and world.X_TO is not None:
            X_WH = self.tool_pose() @ world.X_TO
            data.joint(world.held).qpos[:] = *X_WH[:3, 3], *quaternion(X_WH)
            mujoco.mj_forward(model, data)
            if self._pushes:
                self.grasp()
            else:
                self._weld(world.held)

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        return self._steps * TIME_STEP

    @property
    def positions(self) -> Array:
        """MuJoCo's qpos, a copy."""
        return np.array(self._data.qpos)

    @interrupts_later()
    def advance(self, t: float, reference: ArmReference) -> float:
        """Let time pass until t [s] while the controller follows the reference within its torques; returns the time.

        Joints that the reference does not name keep their position; joints that mimic another one follow it.
        """
        model, data, controller = self.model, self._data, self._controller
        moved = [controller.motors[name] for name in reference.joints]
        velocity, acceleration = np.zeros(model.nu), np.zeros(model.nu)
        times: Array = np.arange(self._steps, round(t / TIME_STEP), dtype=np.float64) * TIME_STEP
        for q, qd, qdd in zip(*reference.states(times), strict=True):
            controller.wanted[moved], velocity[moved], acceleration[moved] = q, qd, qdd
            mujoco.mj_step1(model, data)
            held = None if self._pushes else self.held()
            controller.drive(velocity, acceleration, None if held is None else model.body(held).id)
            mujoco.mj_step2(model, data)
            error = data.xpos[self._carrier] - controller.scratch.xpos[self._carrier]
            self._squared_error += float(error @ error)
            self._steps += 1
            body, outside = self._slipping
            if body and (inverse(self.tool_pose()) @ body_pose(data, body))[2, 3] > outside:
                self._slipping = 0, 0.0
                self.grasp()
        mujoco.mj_kinematics(model, data)
        return t

    def grasp(self) -> None:
        """Switch suction on, or close the fingers with a force: what is there is held, if anything is.

        Suction takes the nearest object whose surface is within 3 mm of the tool frame's origin, at once, as it lies.
        Fingers hold by friction, as soon as they have closed, at 5 cm/s.
        """
        if self.misses_next_grasp:
            self.misses_next_grasp = False
            return
        for push in self._pushes:
            self.model.geom_friction[self._pads] = FRICTION
            self._controller.lead(*push)
        if not self._pushes:
            model, gaps, far = self.model, list[tuple[float, str]](), 10 * SUCTION_REACH
            for obj in self._welds:
                body = model.body(obj)
                solid = [i for i in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]) if model.geom_contype[i]]
                tip = model.geom(TIP).id
                away = min(mujoco.mj_geomDistance(model, self._data, tip, part, far, None) for part in solid)
                gaps.append((TIP_RADIUS + float(away), obj))
            gap, obj = min(gaps, default=(np.inf, ""))
            if gap <= SUCTION_REACH:
                self._weld(obj)

    def _weld(self, obj: str) -> None:
        """Fix an object where it is relative to the tool."""
        X_TO = inverse(self.tool_pose()) @ body_pose(self._data, self.model.body(obj).id)
        weld = self._welds[obj]
        self.model.eq_data[weld, :11] = [0.0, 0.0, 0.0, *X_TO[:3, 3], *quaternion(X_TO), 1.0]
        self._data.eq_active[weld] = 1

    def release(self) -> None:
        """Switch suction off, or let the fingers follow the reference again (which then opens them)."""
        self._slipping = 0, 0.0
        for motor, _, _ in self._pushes:
            self._controller.lead(motor)
            self.model.geom_friction[self._pads] = FRICTION
        if not self._pushes:
            self._data.eq_active[list(self._welds.values())] = 0

    def slip(self) -> None:
        """Lose the hold until the next `release`: the cup leaks, or the fingers get slippery. What was held falls.

        Until it has left them the fingers do not push: a jaw that turns would throw out what it pushes aslant.
        """
        if (obj := self.held()) is not None:
            self.release()
        if self._pushes and obj is not None:
            body = int(self.model.body(obj).id)
            z = (inverse(self.tool_pose()) @ body_pose(self._data, body))[2]
            self._slipping = body, z[3] + float(np.abs(z[:3]) @ self._workspace.objects[obj].size)
        if self._pushes:
            self.model.geom_friction[self._pads] = _SLIPPERY

    def held(self) -> str | None:
        """What the tool really holds: what is welded, or what at least two fingers touch with friction."""
        if not self._pushes:
            return next((obj for obj, weld in self._welds.items() if self._data.eq_active[weld]), None)
        if np.all(self.model.geom_friction[self._pads] == _SLIPPERY):
            return None
        fingers: dict[int, set[int]] = {}
        for contact in self._data.contact[: self._data.ncon]:
            first, second = self.model.geom_bodyid[contact.geom].tolist()
            for body, obj in ((first, second), (second, first)):
                finger = int(self._finger_of_body[body])
                if finger >= 0 and self._finger_of_body[obj] < 0:
                    fingers.setdefault(obj, set()).add(finger)
        return next((self.model.body(obj).name for obj, touching in fingers.items() if len(touching) > 1), None)

    def tool_force(self) -> float:
        """How hard the tool, or what it holds, pushes against anything else [N]: the sum of all contact forces on them.

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

    def frames(self, cameras: Sequence[str]) -> Mapping[str, CameraImage]:
        """An image of each camera, taken now, by name in the order given."""
        assert self._drawing is not None, "a cell without a seed has no images"  # noqa: S101
        images = self._drawing.map([(name, self.positions, self.t) for name in cameras])
        return {name: CameraImage(name, self.t, image) for name, image in zip(cameras, images, strict=True)}

    def measured_joints(self, t: float | None = None) -> Mapping[str, float]:  # noqa: ARG002 - it knows no other time
        """Position of every movable joint of robot and tool as its encoder says now [rad or m]."""
        model = self.model
        moving = [i for i in range(model.njnt) if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE]
        return {model.joint(i).name: float(self._data.qpos[model.jnt_qposadr[i]]) for i in moving}

    def trouble(self) -> Stopped | None:
        """Why nobody may go on with the motion: a simulated robot follows it until it is stopped."""
        return None

    def truth(self) -> CellState:
        """The present ground truth."""
        X_WO = {name: body_pose(self._data, self.model.body(name).id) for name in self._objects}
        tracking = float((self._squared_error / max(self._steps, 1)) ** 0.5)
        return CellState(self.t, X_WO, self.held(), self.measured_joints(), tracking)

    def tool_pose(self) -> Array:
        """X_WT of the tool frame, shape (4, 4)."""
        return body_pose(self._data, self._carrier)

    def __exit__(self, *_: object) -> None:
        """End the processes that draw."""
        if self._drawing is not None:
            self._drawing.close()


def placed_objects(world: World) -> dict[str, Array]:
    """X_WO of every object of a world, shape (4, 4) each; what is held has a place only once the arm has."""
    return {**({} if world.held is None else {world.held: pose()}), **world.X_WO}


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
        self.motors = {model.actuator(i).name: i for i in range(model.nu)}
        """The number of each motor."""
        joint_ids = model.actuator_trnid[:, 0]
        self._joint_ids, self._efforts = joint_ids, model.jnt_actfrcrange[joint_ids].copy()
        self._position, dofs = model.jnt_qposadr[joint_ids], model.jnt_dofadr[joint_ids]
        self._followers = followers(model)
        # How fast each degree of freedom moves with each motor, (nv, motors): followers as their leaders do.
        self._moved = np.zeros((model.nv, model.nu))
        self._moved[dofs, np.arange(model.nu)] = 1.0
        for joint, leader, _, multiplier in self._followers:
            self._moved[model.jnt_dofadr[joint]] = multiplier * self._moved[model.jnt_dofadr[leader]]
        inertia = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, inertia)
        self._stiffness = BANDWIDTH**2 * np.diag(self._moved.T @ inertia @ self._moved)
        self._damping = 2.0 / BANDWIDTH * self._stiffness
        self._still = np.zeros(model.nu)
        self.wanted = data.qpos[self._position].copy()
        limited = model.jnt_actfrclimited[joint_ids].astype(bool)
        weight = self._inverse_dynamics(self._still, self._still, None)
        self._balanced = bool((limited & (np.abs(weight) > self._efforts[:, 1])).any())
        self._force = np.full(model.nu, np.nan)
        for motor in range(model.nu):
            self.lead(motor)

    def lead(self, motor: int, force: float = np.nan, speed: float = np.inf) -> None:
        """Let a motor push with a force [N or Nm], no faster than at a speed [m/s or rad/s]; without, by reference."""
        gain, bias = self._stiffness[motor], (0.0, -self._stiffness[motor], -self._damping[motor])
        if not np.isnan(force):
            gain, bias = 1.0, (0.0, 0.0, -abs(force) / speed)
        self._force[motor], self._model.actuator_gainprm[motor, 0] = force, gain
        self._model.actuator_biasprm[motor, :3] = bias

    def drive(self, velocity: Array, acceleration: Array, payload: int | None) -> None:
        """Set the motors for the next time step; velocity, acceleration: of each [rad/s or m/s, and per s].

        payload: body of the object that the arm knows that it carries.
        """
        if self._balanced:  # the weight alone takes nothing of the effort
            weight = self._inverse_dynamics(self._still, self._still, None)
            self._model.jnt_actfrcrange[self._joint_ids] = self._efforts + weight[:, None]
        torque = self._inverse_dynamics(velocity, acceleration, payload)
        led = self.wanted + (torque + self._damping * velocity) / self._stiffness
        self._data.ctrl[:] = np.where(np.isnan(self._force), np.clip(led, -FURTHEST, FURTHEST), self._force)

    def _inverse_dynamics(self, velocity: Array, acceleration: Array, payload: int | None) -> Array:
        """Torque of each motor that the wanted motion takes; everything else stands still where it now is."""
        model, scratch = self._model, self.scratch
        scratch.qpos[:], scratch.qvel[:], scratch.qacc[:] = self._data.qpos, 0.0, 0.0
        scratch.qpos[self._position] = self.wanted
        for joint, leader, offset, multiplier in self._followers:
            scratch.qpos[model.jnt_qposadr[joint]] = offset + multiplier * scratch.qpos[model.jnt_qposadr[leader]]
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


def followers(model: mujoco.MjModel) -> list[Follower]:
    """The joints that mimic another one, each after that one."""
    left: list[Follower] = [
        (int(model.eq_obj1id[i]), int(model.eq_obj2id[i]), *model.eq_data[i, :2].tolist())
        for i in np.flatnonzero(model.eq_type == mujoco.mjtEq.mjEQ_JOINT)
    ]
    found: list[Follower] = []
    while left:
        waiting = {joint for joint, *_ in left}
        found += [one for one in left if one[1] not in waiting]
        left = [one for one in left if one[1] in waiting]
    return found
