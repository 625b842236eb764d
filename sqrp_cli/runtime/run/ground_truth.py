"""Ground truth while a run goes on: for checks of what was detected, pictures and the log, never for perception."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sqrp_cli.geometry import Array, matrix_to_quaternion
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.program.record import Step
from sqrp_cli.runtime.cell.interface import CellState, RunnableCell, StoppableReference
from sqrp_cli.runtime.cell.simulated_cell import SimulatedCell
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.nominal_step import Situation, holds
from sqrp_cli.runtime.record.events import AskedBox, Event, EventPublisher, State, WholeState
from sqrp_cli.runtime.robot_body import OPEN_SHARE, RobotBody

RATE = 25.0
"""States per second of the cell's clock; an object that falls freely is within 2 mm of the line between two of them."""

DIGITS = 5
"""Decimals of positions [m or rad] and of quaternions: 10 micrometres, and as much at a distance of 1 m."""


class Truths(Protocol):
    """What knows the true values of atoms, for checks."""

    def atoms(self, attempt: Attempt, tau: float | None) -> dict[str, bool]:
        """The value of each atom that an attempt monitors, at a time of its motion [s], None before it."""


class PlannedTruth:
    """In a real cell, whose state nobody knows: the values of atoms as planned."""

    def atoms(self, attempt: Attempt, tau: float | None) -> dict[str, bool]:
        """As `Truths` says."""
        return {atom: attempt.nominal.holds(atom, tau or 0.0) for atom in attempt.step.targets}


class Witness(Protocol):
    """What knows the state of a cell, or believes to."""

    @property
    def t(self) -> float:
        """On the cell's clock [s]."""

    def advance(self, t: float, reference: StoppableReference) -> float:
        """As `RunnableCell` says."""

    def truth(self) -> CellState:
        """The state now."""


class Beliefs:
    """The state of a real cell as a run believes it: joints as measured, objects as planned."""

    def __init__(self, cell: RunnableCell, world: World) -> None:
        """world: before the first step."""
        self._cell, self._world = cell, world
        self.t = 0.0
        self.attempt: Attempt | None = None

    def advance(self, t: float, reference: StoppableReference) -> float:
        """As `RunnableCell` says."""
        self.t = self._cell.advance(t, reference)
        return self.t

    def truth(self) -> CellState:
        """As `Witness` says."""
        attempt = self.attempt
        if attempt is None:
            return CellState(self.t, self._world.X_WO, self._world.held, self._cell.measured_joints())
        tau = 0.0 if attempt.start is None else self.t - attempt.start
        now = [one for one in attempt.step.primitives if one.start <= tau]
        held = now[-1].held if now and not attempt.failed else None
        return CellState(self.t, attempt.beliefs(tau), held, self._cell.measured_joints())


class GroundTruth:
    """Values of atoms by the state of the simulation."""

    def __init__(self, cell: SimulatedCell, robot: RobotBody) -> None:
        self._cell, self._robot = cell, robot

    def atoms(self, attempt: Attempt, tau: float | None) -> dict[str, bool]:  # noqa: ARG002 - the truth is that of now
        """The present value of each atom that an attempt monitors."""
        truth = self._cell.truth()
        is_open = self._robot.closure(truth.joints) <= OPEN_SHARE
        situation = Situation(self._robot.link_poses(truth.joints), truth.X_WO, attempt.starts, truth.held, is_open)
        return {
            atom: holds(atom, target, situation, when_open=attempt.when_open[atom])
            for atom, target in attempt.step.targets.items()
        }


class StateRecorder:
    """A cell that publishes its true poses at a fixed rate, without any other effect.

    The first event is complete, the others have only changes.
    """

    def __init__(self, cell: Witness, publisher: EventPublisher) -> None:
        self._cell, self._publisher = cell, publisher
        self._number = 0
        self._last: WholeState | None = None

    def advance(self, t: float, reference: StoppableReference) -> float:
        """Let time pass until t [s] as the cell does, publishing the state of each time that is due until then."""
        while (due := self._number / RATE) <= t + 1e-9:
            self._cell.advance(due, reference)
            self._publish(due)
            self._number += 1
        return self._cell.advance(t, reference)

    def finish(self) -> None:
        """Publish the state at the end."""
        if self._last is None or self._cell.t > self._last.t + 1e-9:
            self._publish(self._cell.t)

    def _publish(self, t: float) -> None:
        truth = self._cell.truth()
        state = WholeState(
            t=t,
            joints=list(truth.joints),
            q=[_rounded(q) for q in truth.joints.values()],
            held=truth.held,
            objects={name: logged_pose(X) for name, X in truth.X_WO.items()},
        )
        self._publisher.publish(state if self._last is None else state.since(self._last))
        self._last = state


@dataclass(frozen=True, eq=False)
class Track:
    """Where everything was during a run."""

    t: Array
    """Times on the run's clock [s], shape (n,)."""
    joints: tuple[str, ...]
    """Names of the j joints."""
    q: Array
    """Their positions, shape (n, j) [rad or m]."""
    held: tuple[str | None, ...]
    """What the tool held at each of the n times."""
    poses: Mapping[str, tuple[tuple[int, tuple[float, ...]], ...]]
    """Of each object in the world, as pairs of the index of a time and the pose from then on.

    A pose is x, y, z [m] and a quaternion x, y, z, w.
    """

    @classmethod
    def of(cls, events: Iterable[Event]) -> Track | None:
        """What a `StateRecorder` published, from all events of a run; None if there was none."""
        states = [event for event in events if isinstance(event, State)]
        if not states:
            return None
        first, *others = states
        assert isinstance(first, WholeState)  # noqa: S101 - as a `StateRecorder` publishes and `read_log` makes sure
        q, held = [first.q], [first.held]
        for state in others:
            q.append(state.q if state.has("q") else q[-1])
            held.append(state.held if state.has("held") else held[-1])
        poses: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        for index, state in enumerate(states):
            for name, pose in state.objects.items():
                poses.setdefault(name, []).append((index, tuple(pose)))
        return cls(
            np.array([state.t for state in states]),
            tuple(first.joints),
            np.array(q, dtype=float).reshape(len(states), -1),
            tuple(held),
            {name: tuple(found) for name, found in poses.items()},
        )


def asked_boxes(step: Step) -> dict[str, list[AskedBox]]:
    """The boxes in which images of a step are judged, by atom.

    The frame of each is a link of the robot, or the world for a box at `object@start`. A box that moves with a carried
    object is left out: images are searched for it where the robot believes it is, not where the object is or was.
    """
    found = {atom: [_asked(step, box) for box in target.boxes] for atom, target in step.targets.items()}
    return {atom: [box for box in boxes if box is not None] for atom, boxes in found.items()}


def _asked(step: Step, box: TargetBox) -> AskedBox | None:
    name = box.frame.owner
    carried = {step.before.held, *(primitive.held for primitive in step.primitives)}
    frame: str = WORLD
    if name not in step.before.X_WO:
        frame, X_FB = box.frame, box.X_FB
    elif not box.frame.at_start and name in carried:
        return None
    else:
        X_FB = step.before.X_WO[name] @ box.X_FB
    return AskedBox(frame=frame, size=list(box.size), pose=[[_rounded(x) for x in row] for row in X_FB.tolist()])


def logged_pose(X_WO: Array) -> list[float]:
    """A pose (4, 4) as the log has it: x, y, z [m] and a quaternion x, y, z, w."""
    return [_rounded(float(x)) for x in (*X_WO[:3, 3], *matrix_to_quaternion(X_WO[:3, :3]))]


def _rounded(value: float) -> float:
    return round(value, DIGITS) + 0.0  # no -0.0, which is not 0.0 to whoever reads the log
