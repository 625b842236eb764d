"""The motions of a recording: joints between its frames on straight lines, and objects where the tool takes them.

Nothing is planned, and nothing is checked for collisions. What the tool grasps is rigid in it until it is released,
and then stays where that is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from sqrp_cli.cell.recordings import EPISODE, RecordedTask
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible, InputError, bad_input, expected_names
from sqrp_cli.files.units import shown_length
from sqrp_cli.geometry import Array, inverse, read_only, rpy_to_matrix, transform
from sqrp_cli.motion.collision import CollisionScene
from sqrp_cli.motion.plan_motion import MEASURED, Motion, TimedPrimitive
from sqrp_cli.recording.episode import Episode, Recording
from sqrp_cli.recording.joint_map import grasps_of, joint_positions
from sqrp_cli.recording.phases import Grasp, phases
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Mesh, PlacedBox, half_extents
from sqrp_cli.skill.skill import SkillChoice
from sqrp_cli.trajectory import JointPath, PiecewiseCubic, Trajectory

REACH = 0.05  # Farther than this from the tool frame, an object is not what the tool grasps: it closes on nothing [m]
SPEED_OVER, CONTACT_STEP = 0.05, 0.01
"""Times [s] over which speeds of recorded joints are measured, and between instants at which contacts are checked."""


@lru_cache(maxsize=4)
def opened(file: Path, signal: str | None = None, rate: float | None = None, _state: str = "") -> Recording:
    """A recording, opened once, and again when its state is another one."""
    from sqrp_cli.recording.recording import open_recording  # few workspaces have any, and formats are many

    return open_recording(file, signal=signal, rate=rate)


@dataclass(frozen=True, eq=False)
class RecordedMotions:
    """The motions of a recording's episodes, by the parameter `episode`."""

    task: RecordedTask
    objects: Mapping[str, SceneObject]  # Those of the cell

    @cached_property
    def _state(self) -> str:
        return self.task.file_state

    @property
    def recording(self) -> Recording:
        """As its workspace wants it to be read, and as its files are when it is first asked for. Raises InputError."""
        return opened(self.task.file, self.task.entry.signal, self.task.entry.rate, self._state)

    def episode(self, choice: SkillChoice) -> Episode:
        """The episode that is chosen. Raises InputError."""
        number, numbers = choice.values[EPISODE], self.recording.numbers
        if number not in numbers:
            asked = number if isinstance(number, str) else f"{number:.10g}"
            message = f"there is no episode {asked} in {self.task.entry.file}"
            raise bad_input("unknown-candidate", f"{message}; {expected_names(asked, [*map(str, numbers)])}")
        return self.recording.read(numbers.index(int(number)))

    def motion(self, choice: SkillChoice, world: World, model: RobotModel) -> Motion | Infeasible:
        """The motion of an episode; world: has the objects and joints that it does not tell. Raises InputError."""
        recording = self.recording
        try:
            episode = self.episode(choice)
        except InputError as error:  # one damaged episode of many is one that cannot be judged
            if len(recording.episodes) == 1 or error.problems[0].code == "unknown-candidate":
                raise
            return Infeasible((error.problems[0].message,))
        t, objects = episode.times, self.task.objects
        if len(t) < 2:
            return Infeasible(("it has one state, so there is no motion",))
        moved = joint_positions(self.task, recording, model, episode)
        still = np.ones(len(t))
        q = np.column_stack([moved.get(name, world.joints.get(name, 0.0) * still) for name in model.joints])

        def positions(at: float) -> Array:
            return np.array([np.interp(at, t, column) for column in q.T])

        # What each grasp takes. An object begins as stated, else upright at the tool when that first takes it.
        stated = {name: read_only(one.pose.matrix()) for name, one in objects.items() if one.pose is not None}
        initial = {**world.X_WO, **stated}
        now, missed = dict(initial), list[str]()
        taken, carried, rests = list[Grasp](), list[tuple[str | None, Array | None]](), [initial]
        for grasp in grasps_of(self.task, recording, moved, episode, model):
            X_TO: Array | None = None
            if (name := self.task.held_in(len(taken), grasp.start)) is not None:
                X_WT, size = model.tool_pose(positions(grasp.start)), self.objects[name].size
                if name not in now:
                    now[name] = initial[name] = self._beginning(name, X_WT, model, now)
                away = np.abs(transform(inverse(now[name]), X_WT[:3, 3])) - 0.5 * np.array(size)
                if (far := float(np.linalg.norm(np.maximum(away, 0.0)))) > REACH:
                    missed.append(f"at {grasp.start:.1f} s the gripper closes {far:.2f} m away from `{name}`")
                    continue
                X_TO = read_only(inverse(X_WT) @ now[name])
                X_WT = model.tool_pose(positions(float(t[-1]) if grasp.end is None else grasp.end))
                now[name] = read_only(X_WT @ X_TO)
            taken.append(grasp)
            carried.append((name, X_TO))
            rests.append(dict(now))
        if missed and not any(name for name, _ in carried):
            return Infeasible(tuple(missed))
        if missing := [name for name in objects if name not in initial]:
            return Infeasible((f"nothing is grasped in it, so it is not known where `{missing[0]}` is",))

        own_places = [name for name in objects if name in stated or name not in world.X_WO]
        doubts = [said for name in own_places for said in self._inside(name, initial[name], {**world.X_WO, **stated})]

        # Its phases: while an object is carried it moves with the tool, afterwards it is where that let it go.
        primitives, held, X_TO = list[TimedPrimitive](), None, None
        for phase, start, end, number in phases(taken, float(t[-1])):
            held, X_TO = carried[number] if taken and phase.startswith("carry") else (None, None)
            rest = {**initial, **rests[number + phase.startswith(("release", "retreat"))]}
            inside = (t > start + 1e-9) & (t < end - 1e-9)
            times = np.concatenate([[start], t[inside], [end]])
            knots = np.concatenate([positions(start)[None], q[inside], positions(end)[None]])
            primitives.append(
                TimedPrimitive(
                    name=phase,
                    start=start,
                    end=end,
                    trajectory=_through(times - start, knots),
                    held=held,
                    X_TO=X_TO,
                    X_WO={name: X for name, X in rest.items() if name != held},
                )
            )
        begin, after = ({**world.joints, **dict(zip(model.joints, one.tolist(), strict=True))} for one in (q[0], q[-1]))
        return Motion(
            joint_names=model.joints,
            primitives=tuple(primitives),
            final=replace(world, X_WO=now, held=held, X_TO=X_TO, joints=after),
            initial=replace(world, X_WO=initial, held=None, X_TO=None, joints=begin),
            doubts=(*episode.told, *missed, *doubts),
        )

    def _beginning(self, name: str, X_WT: Array, model: RobotModel, X_WO: Mapping[str, Array]) -> Array:
        """Where an object begins that a tool at X_WT takes first, upright: (4, 4). X_WO: where the others are."""
        size, X_WB = np.array(self.objects[name].size), np.eye(4)
        X_WB[:3, :3] = rpy_to_matrix((0.0, 0.0, float(np.arctan2(X_WT[1, 0], X_WT[0, 0]))))
        # On which side along y of the tool frame the only jaw is that moves: 1 or -1; 0 where none or several move.
        X_WL = model.link_poses(
            np.stack([model.with_fingers(model.home, one) for one in (model.fingers.closed, model.fingers.open)])
        )
        X_TL = [inverse(X_WL[model.tool_frame]) @ X_WL[link] for link in model.fingers.links]
        moved = [float((opened @ inverse(closed))[1, 3]) for closed, opened in X_TL]  # of what is there when closed
        ways = {float(np.sign(way)) for way in moved if abs(way) > 1e-4}
        side = ways.pop() if len(ways) == 1 else 0.0
        # Before a tip that it sticks to, in the middle between fingers, else beside the jaw on whose face the frame is.
        ahead = 0.0 if model.fingers.joints else 0.5 * size[2]
        aside = 0.5 * side * np.abs(X_WT[:3, 1] @ X_WB[:3, :3]) @ size
        X_WB[:3, 3] = X_WT[:3, 3] + ahead * X_WT[:3, 2] + aside * X_WT[:3, 1]
        # On what is below, if it is less than its height deep in that, or less than half of it above.
        middle, bottom = PlacedBox(X_WB, np.zeros(3)), X_WB[2, 3] - 0.5 * size[2]
        below = [box for _, box in self._boxes(X_WO) if middle.gap(box, from_above=True) < 0.0]
        rises = [float(box.X_WB[2, 3] + 0.5 * np.abs(box.X_WB[2, :3]) @ box.size - bottom) for box in below]
        X_WB[2, 3] += max((rise for rise in rises if -0.5 * size[2] < rise < size[2]), default=0.0)
        return read_only(X_WB)

    def _boxes(self, X_WO: Mapping[str, Array]) -> Iterator[tuple[str, PlacedBox]]:
        """Boxes around the parts of placed objects but meshes, with the names of these."""
        parts = ((name, part.X_PG, part.shape) for name in X_WO for part in self.objects[name].parts)
        for name, X_OP, shape in parts:
            if not isinstance(shape, Mesh):
                yield name, PlacedBox(X_WO[name] @ X_OP, 2.0 * half_extents(shape, np.eye(3)))

    def _inside(self, name: str, X_WO: Array, others: Mapping[str, Array]) -> Iterator[str]:
        """What an object at X_WO begins more than 1 mm deep in, in words."""
        own = PlacedBox(X_WO, np.array(self.objects[name].size))
        depths = sorted((-own.gap(box), other) for other, box in self._boxes(others) if other != name)
        for other, deep in {other: depth for depth, other in depths if depth > 1e-3}.items():  # of its parts, the most
            yield f"`{name}` begins {shown_length(deep)} inside `{other}`: state `pose` in `recordings`, or move that"


def limits_broken(motion: Motion, scene: CollisionScene, handled: Collection[str]) -> Iterator[str]:
    """What a recorded motion breaks of what planned ones keep, the first instant of each: limits of joints, contacts.

    Speeds are means over `SPEED_OVER`, contacts are looked for every `CONTACT_STEP`. Objects that it handles do not
    count, nor what is less than `MEASURED` past a limit.
    """
    model = scene.model
    fine, coarse = (np.arange(0.0, motion.time, step) for step in (CONTACT_STEP, SPEED_OVER))
    index = np.searchsorted([one.end for one in motion.primitives[:-1]], fine, side="right")
    q = np.concatenate([motion.positions(k, fine[index == k]) for k in sorted(set(index.tolist()))])
    lower, upper = model.position_limits
    fastest = (1.0 + MEASURED) * np.concatenate([model.velocity, model.fingers.velocity])
    past = np.maximum(lower - q, q - upper)
    slow = np.array([np.interp(coarse, fine, column) for column in q.T]).T
    speed = np.abs(np.diff(slow, axis=0)) / SPEED_OVER
    for number, name in enumerate(model.joints):
        factor, unit = (180.0 / np.pi, "deg") if model.tree.turns[model.tree.index(name)] else (1000.0, "mm")
        if (rows := np.flatnonzero(past[:, number] > MEASURED)).size:
            most = factor * past[:, number].max()
            yield f"at {fine[rows[0]]:.1f} s joint `{name}` goes past its limit, by up to {most:.1f} {unit}"
        if (rows := np.flatnonzero(speed[:, number] > fastest[number])).size:
            most, limit = factor * speed[:, number].max(), factor * fastest[number]
            said = f"goes up to {most:.0f} {unit}/s, its limit is {limit:.0f} {unit}/s"
            yield f"at {coarse[rows[0]]:.1f} s joint `{name}` {said}"
    assert motion.initial is not None  # noqa: S101 - recorded motions have their own world
    around = {name: X for name, X in motion.initial.X_WO.items() if name not in handled}
    world = replace(motion.initial, X_WO=around, held=None, X_TO=None)
    found: dict[str, float] = {}
    for t, contact in zip(fine.tolist(), scene.placed(world).check_all(q), strict=True):
        if contact is not None:
            found.setdefault(str(contact), t)
    for said, t in found.items():
        yield f"at {t:.1f} s {said}"


def _through(times: Array, knots: Array) -> Trajectory:
    """The motion through joint positions, shape (k, n), at times from 0 on, shape (k,) [s]: on straight lines."""
    breaks = times / times[-1]
    coefficients = np.stack([0.5 * (knots[1:] + knots[:-1]), 0.5 * (knots[1:] - knots[:-1])], axis=1)
    law = PiecewiseCubic(times[[0, -1]], np.array([[0.0, 1.0 / times[-1], 0.0, 0.0]]))
    return Trajectory(JointPath(breaks, coefficients), law)
