"""From a seen fault to another attempt: the robot looks, locates objects and plans again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Replanner, Step
from sqrp_cli.runtime.monitor.attempt import Attempt
from sqrp_cli.runtime.monitor.program_formulas import condition_atoms, condition_value
from sqrp_cli.runtime.monitor.step_monitor import Alarm
from sqrp_cli.runtime.record.events import MovingOn, listed
from sqrp_cli.runtime.record.report import Stopped
from sqrp_cli.runtime.run.lockstep import Lockstep

LOOK_AGAIN = 2.0
"""How long the robot stands and waits for the condition of a retry to be seen [s]."""

SPACING = 0.05
"""Sampling period of a motion in the search for a viewpoint [s]."""


@dataclass(frozen=True)
class Viewpoint:
    """Where to stand and look."""

    stop_at: float
    """The time of the step at which to begin to stop [s]."""
    cameras: tuple[str, ...]
    """Those predicted to see something from there; empty if the motion ends without a viewpoint."""

    def __str__(self) -> str:
        return f"where {listed(self.cameras)} should see it" if self.cameras else "at the end of the motion"


class RetryPlanner:
    """Brings the robot from a fault to a new plan of the same step from where it stands."""

    def __init__(self, lockstep: Lockstep, replanner: Replanner) -> None:
        self._lockstep, self._replanner = lockstep, replanner
        self._robot, self._collector = lockstep.robot, lockstep.collector

    def prepare(self, attempt: Attempt, alarm: Alarm) -> Step:
        """The step of an attempt that failed again, from where the arm stands then, in the world that is seen then.

        The robot stops at once where it is predicted to see the condition of the retry, or sees it already; else it
        moves on first. Raises Stopped where the condition is not seen or no motion is found.
        """
        attempt.failed, attempt.undisturbed = True, False
        self._lockstep.cancel("tool")
        when = alarm.response.when
        viewpoint = None if when is None or self._is_seen(when) else self._viewpoint(attempt, when)
        if when is not None and viewpoint is not None and viewpoint.stop_at > self._tau():
            self._move_on(when, viewpoint)
        self._lockstep.stop(alarm.text)
        self._robot.let_go()
        self._collector.forget(self._lockstep.now)
        if when is not None:
            self._await(when, viewpoint)
        planned = self._replanner.replan(attempt.step, self._world_seen(attempt.step))
        if planned is None:
            raise Stopped(f"{attempt.step.skill} cannot be tried again: no feasible motion from here")
        return planned

    def _move_on(self, when: str, viewpoint: Viewpoint) -> None:
        """Go on with the motion, without any command to the tool, until it can be stopped at a viewpoint."""
        began = self._lockstep.now
        until = round(viewpoint.stop_at, 6)
        self._lockstep.publisher.publish(MovingOn(t=began, to_see=when, cameras=list(viewpoint.cameras), until=until))
        self._robot.keep_fingers(began)
        end = began + viewpoint.stop_at - self._tau()
        while self._lockstep.now < end - 1e-9 and not self._is_seen(when):
            self._lockstep.pass_time(end)
        self._lockstep.faults.moved_on(self._lockstep.now - began)

    def _await(self, when: str, viewpoint: Viewpoint | None) -> None:
        """Stand until the condition is seen, and all cameras have said where objects are. Raises Stopped if not."""
        until = self._lockstep.now + LOOK_AGAIN
        while not (self._collector.caught_up and self._is_seen(when)):
            if self._lockstep.now >= until - 1e-9:
                where = f" {viewpoint}" if viewpoint is not None else ""
                raise Stopped(f"`{when}` was not seen within {LOOK_AGAIN:g} s of standing{where}, so there is no retry")
            self._lockstep.pass_time(until)

    def _is_seen(self, when: str) -> bool:
        return condition_value(when, self._collector.values) == Truth.TRUE

    def _viewpoint(self, attempt: Attempt, when: str) -> Viewpoint:
        """The next place along the motion from which all atoms of a condition are predicted to be seen."""
        atoms, end = condition_atoms(when), attempt.step.time
        for begin in np.arange(min(self._tau(), end), end, SPACING).tolist():
            stands = self._robot.motion.standing_time(begin)
            margin = min(self._collector.streams.period, stands, end - stands)
            if self._is_predicted(attempt, atoms, stands, margin):
                cameras = {name for atom in atoms for name in attempt.nominal.covering(atom, stands, margin)}
                return Viewpoint(begin, tuple(sorted(cameras)))
        return Viewpoint(end, ())

    def _is_predicted(self, attempt: Attempt, atoms: Sequence[str], tau: float, margin: float) -> bool:
        targets = attempt.step.targets
        return all(atom in targets and attempt.nominal.is_covered(atom, tau, margin) for atom in atoms)

    def _tau(self) -> float:
        return self._robot.motion.step_time(self._lockstep.now)

    def _world_seen(self, step: Step) -> World:
        """The world as the images show it: objects where they were located, facts by evidence."""
        before = step.before
        X_WO = dict(before.X_WO)
        for name, place in self._collector.places.items():
            X_WO[name] = X_WO[name].copy()
            X_WO[name][:3, 3] = place
        known = {Atom.of(atom): value for atom, value in self._collector.values.items()}
        seen = {atom for atom, value in known.items() if value == Truth.TRUE}
        refuted = {atom for atom, value in known.items() if value == Truth.FALSE}
        measured = self._robot.cell.measured_joints()
        joints = {name: measured.get(name, value) for name, value in before.joints.items()}
        return replace(before, facts=(before.facts | seen) - refuted, X_WO=X_WO, joints=joints)
