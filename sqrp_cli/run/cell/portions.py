"""How a motion reaches a robot: in portions that each end in standing still, so that silence stops it.

Every `EVERY` seconds, and at once when the wanted motion changes, a new trajectory replaces the one before. It follows
the motion for `AHEAD` seconds and ends in a protective stop along the same path. Whoever sends it may be killed, cut
off or hang: the controller then plays what it has, which brakes within its last part and holds where it ends.

Where the joints then were is in a log.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Mapping

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.ros.messages import Message, MessageError
from sqrp_cli.run.arm_motion import ArmMotion, JointStates

AHEAD = 0.4  # How much of the motion a portion holds before its stop [s]
EVERY = 0.08  # Time between two portions [s]
LEAD = 0.02
"""From when a portion is sent to its first point [s]; until then the controller leads over from what it does."""
SPACING = 0.02
"""Between two points [s]; with their velocities and accelerations a controller follows the path to micrometres."""
SETTLES = 0.3  # After a motion, a robot that follows it with a lag may still be off for so long [s]
JUMP = 0.02  # How far a portion may begin from where the robot will be by the one before [rad or m]
Send = Callable[[Array, JointStates], None]
"""Takes points of a trajectory, the last one at rest: when they are, from when it is sent and begins [s], rising, shape
(m,); and the joints then, shape (m, n) each."""


class Portions:
    """Sends a motion in portions, as long as each goes on from where the robot is by the one before.

    After a pause of the sender, or a step of its clock, the robot has braked where the wanted motion has gone on: a
    portion of that would be a jump. None is sent then, nor ever again, but for a stop along the path that was sent.
    """

    def __init__(self, send: Send, loose: Collection[str] = ()) -> None:
        """loose: joints that may be wanted elsewhere at once, such as fingers."""
        self._send, self._loose = send, loose
        self._revision: int | None = None
        self._next = self._brakes_at = float("inf")
        self._told: ArmMotion | None = None
        self.over = False
        """Whether nothing is sent any more."""

    def follow(self, reference: ArmMotion, now: float) -> None:
        """Send what is due at a time [s], if anything is; where that would be a jump, it is `over`."""
        if self.over or (reference.revision == self._revision and now < self._next):
            return
        if self._told is None and reference.rests_at < now:  # until that changes, the robot stands where it begins
            self._revision, self._told = reference.revision, reference.stopped(now)
            return
        jumps = now > self._brakes_at  # it brakes already, because nothing was sent
        if self._told is not None:
            t = np.array([now + LEAD])
            off = np.abs(reference.states(t).positions - self._told.states(t).positions)[0].tolist()
            jumps |= any(q > JUMP for name, q in zip(reference.joints, off, strict=True) if name not in self._loose)
        if jumps:
            self.stop(now)
            return
        self._revision, self._next = reference.revision, now + EVERY
        self._brakes_at = now + LEAD + AHEAD
        ends = reference.rests_at <= self._brakes_at
        self._told = reference.stopped(self._brakes_at)
        self._send(*_portion(reference if ends else self._told, now))
        if ends:
            self._next = self._brakes_at = float("inf")

    def begins(self, reference: ArmMotion, now: float) -> bool:
        """Whether a motion is due at a time [s], from where the robot has stood for so long that it has settled."""
        stands = reference.rests_at >= now if self._told is None else now >= self._told.rests_at + SETTLES
        return reference.revision != self._revision and stands

    def stop(self, now: float) -> float:
        """Have the robot stop from where it is, which is by the last portion; returns when it stands [s].

        Nothing is sent to a robot that brakes or stands already, and nothing ever after.
        """
        if self._told is None:
            return now
        if not self.over and now < min(self._brakes_at, self._told.rests_at):
            self._told = self._told.stopped(now)
            self._send(*_portion(self._told, now))
        self.over = True
        return max(now, self._told.rests_at)


def _portion(reference: ArmMotion, now: float) -> tuple[Array, JointStates]:
    """A motion from `LEAD` after a time [s] on to its end."""
    first = now + LEAD
    last = max(first, reference.rests_at)
    inner = np.arange(first, last - 0.5 * SPACING, SPACING)
    times = np.append(inner, last) if last > first else np.array([first])
    positions, velocities, accelerations = reference.states(times)
    velocities[-1] = accelerations[-1] = 0.0
    return times - now, JointStates(positions, velocities, accelerations)


_REMEMBERED = 2000  # How many joint states are kept, to know where the robot was when an image was taken


class JointLog:
    """Where the joints were lately."""

    def __init__(self, names: Mapping[str, str]) -> None:
        """names: of joints in the workspace, by those in messages."""
        self.names = names
        self._log: deque[tuple[float, Mapping[str, float]]] = deque(maxlen=_REMEMBERED)
        self.changed = 0.0
        """Stamp of the first message that said what the last one says [s]."""
        self.came = self.newest = 0.0
        """When the last one came, and its time [s]; 0 before any."""

    def add(self, t: float, message: Message, now: float) -> None:
        """Joint states of a time [s] have come. Raises MessageError for positions that are none."""
        if len(message.name) != len(message.position):
            raise MessageError(f"{len(message.name)} names of joints with {len(message.position)} positions")
        if not np.isfinite(message.position).all():
            raise MessageError("positions of joints that are no numbers")
        named = zip(message.name, message.position.tolist(), strict=True)
        found = {self.names.get(name, name): q for name, q in named}
        self.came = now
        if self._log and t <= self.newest:
            return
        if not self._log or any(self._log[-1][1].get(name) != q for name, q in found.items()):
            self.changed = t
        self.newest = t
        # A gripper may report apart from the arm.
        self._log.append((t, {**self._log[-1][1], **found} if self._log else found))

    def at(self, t: float | None = None) -> Mapping[str, float]:
        """Positions at a time [s], in between two messages on the line between them; the newest by default."""
        if not self._log:
            return {}
        if t is None or t >= self.newest:
            return self._log[-1][1]
        later = self._log[-1]
        for earlier in reversed(self._log):
            if earlier[0] <= t:
                share = (t - earlier[0]) / max(later[0] - earlier[0], 1e-9)
                return {name: q + share * (later[1][name] - q) for name, q in earlier[1].items()}
            later = earlier
        return later[1]
