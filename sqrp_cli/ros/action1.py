"""An action server of ROS 1 for joint trajectories, by actionlib: for a simulated cell that others command."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from threading import Lock
from typing import Any

from sqrp_cli.ros.messages import MessageTypes
from sqrp_cli.ros.transport import Inbox

_ACTION = "control_msgs/msg/FollowJointTrajectoryAction"


class TrajectoryActionServer:
    """Accepts each goal in place of the one before, and puts its trajectory into an inbox."""

    def __init__(self, name: str, types: MessageTypes, inbox: Inbox, cancel: Callable[[], None]) -> None:
        """cancel: called, in another thread, where the goal that is followed is cancelled."""
        import actionlib
        import genpy.dynamic

        made = genpy.dynamic.generate_dynamic(_ACTION.replace("/msg/", "/"), types.definition(_ACTION).text)
        self._inbox, self._cancel = inbox, cancel
        self._result = made["control_msgs/FollowJointTrajectoryResult"]
        self._goal: Any = None
        self._lock = Lock()
        self._server = actionlib.ActionServer(
            name, made[_ACTION.replace("/msg/", "/")], self._accept, self._cancelled, auto_start=False
        )
        self._server.start()

    def succeed(self) -> None:
        """The goal that is followed is reached."""
        with self._lock:
            if self._goal is not None:
                self._goal.set_succeeded(self._result(error_code=0))
                self._goal = None

    def refuse(self, reason: str) -> None:
        """The newest goal is not followed."""
        with self._lock:
            if self._goal is not None:
                self._goal.set_aborted(self._result(error_code=-1, error_string=reason), reason)
                self._goal = None

    @property
    def busy(self) -> bool:
        """Whether a goal is followed."""
        return self._goal is not None

    def _accept(self, goal: Any) -> None:  # noqa: ANN401 # of a library without types
        with self._lock:
            if self._goal is not None:
                self._goal.set_canceled(self._result(error_code=0), "another goal has replaced it")
            goal.set_accepted()
            self._goal = goal
            packed = BytesIO()
            goal.get_goal().trajectory.serialize(packed)
            self._inbox.put(packed.getvalue())

    def _cancelled(self, goal: Any) -> None:  # noqa: ANN401 # as above
        with self._lock:
            if goal == self._goal:
                goal.set_canceled(self._result(error_code=0))
                self._goal = None
                self._cancel()
