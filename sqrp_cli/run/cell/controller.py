"""The controller of arm and fingers: position control with torque limits, led by velocity and inverse dynamics."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass
from sqrp_cli.run.cell.engine import mujoco

BANDWIDTH = 60.0
"""Of each joint's position loop, critically damped [rad/s]."""

FURTHEST = 1e6
"""No motor is driven further [rad or m]: a simulation that is told to go on does not get unstable."""


@dataclass(frozen=True)
class Payload:
    """What the arm knows that it carries: body of the object, and the body that carries it."""

    obj: int
    carrier: int


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

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """data: at the start, with everything computed."""
        self._model, self._data, self._scratch = model, data, mujoco.MjData(model)
        self.joints = tuple(model.actuator(i).name for i in range(model.nu))
        joint_ids = model.actuator_trnid[:, 0]
        self._joint_ids, self._efforts = joint_ids, model.jnt_actfrcrange[joint_ids].copy()
        self._position, self._velocity = model.jnt_qposadr[joint_ids], model.jnt_dofadr[joint_ids]
        self._followers = followers(model)
        # How fast each degree of freedom moves with each motor, (nv, motors): followers as their leaders do.
        self._moved = np.zeros((model.nv, model.nu))
        self._moved[self._velocity, np.arange(model.nu)] = 1.0
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

    def drive(self, velocity: Array, acceleration: Array, payload: Payload | None) -> None:
        """Set the motors for the next time step; velocity, acceleration: of each [rad/s or m/s, and per s]."""
        if self._balanced:
            self._model.jnt_actfrcrange[self._joint_ids] = self._efforts + self._weight()[:, None]
        torque = self._inverse_dynamics(velocity, acceleration, payload)
        led = self.wanted + (torque + self._damping * velocity) / self._stiffness
        self._data.ctrl[:] = np.where(np.isnan(self._force), np.clip(led, -FURTHEST, FURTHEST), self._force)

    def torques(self) -> Array:
        """What each motor gave in the last time step, within its limit [Nm or N], shape (motors,)."""
        given: Array = self._data.qfrc_actuator[self._velocity]
        return given

    def wanted_position(self, body: int) -> Array:
        """Position of a body if every motor were where it is wanted [m], at the last `drive`."""
        wanted: Array = self._scratch.xpos[body]
        return wanted

    def _weight(self) -> Array:
        """Torque of each motor that holds the robot where it is wanted."""
        still = np.zeros(self._model.nu)
        return self._inverse_dynamics(still, still, None)

    def _inverse_dynamics(self, velocity: Array, acceleration: Array, payload: Payload | None) -> Array:
        """Torque of each motor that the wanted motion takes; everything else stands still where it now is."""
        model, scratch = self._model, self._scratch
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
            mujoco.mj_jac(model, scratch, jacobian, None, self._data.xipos[payload.obj], payload.carrier)
            torque -= model.body_mass[payload.obj] * model.opt.gravity @ jacobian
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
