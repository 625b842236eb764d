"""From the numbers of a recording to positions of joints, by the map that a workspace states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, radians

import numpy as np

from sqrp_cli.cell.recordings import RecordedJointEntry, RecordedTask
from sqrp_cli.errors import bad_input, expected_names, first_names
from sqrp_cli.geometry import Array
from sqrp_cli.recording.episode import HELD, Episode, Recording
from sqrp_cli.recording.phases import Grasp, find_grasps, held_at
from sqrp_cli.records import dataclass
from sqrp_cli.robot.robot import Fingers

EMPTY = 0.02
"""Of the way from closed to open fingers: within it nothing is between them."""


@dataclass(frozen=True, eq=False)
class JointMap:
    """The joints that a recording moves: position = scale * number + offset [rad or m]."""

    columns: Mapping[str, int]
    """Of each joint, the column of its numbers."""
    scale: Mapping[str, float]
    offset: Mapping[str, float]

    @staticmethod
    def of(task: RecordedTask, recording: Recording, joints: Sequence[str]) -> JointMap:
        """As the workspace states it; joints: those that can be moved. Raises InputError for names that are not there.

        Without a stated map, names of the recording that are joints are those.
        """
        place, names = task.place("joints"), recording.names
        stated = task.entry.joints or {name: name for name in names if name in joints}
        if not stated:
            message = f"none of the names in {task.entry.file} is a joint: {first_names(names)}"
            mend = f"say under `joints` which is which, such as `{names[0]}: {joints[0]}`"
            raise bad_input("unknown-joint", message, place, mend=mend)
        columns, scales, offsets = dict[str, int](), dict[str, float](), dict[str, float]()
        for name, said in stated.items():
            entry = RecordedJointEntry(joint=said) if isinstance(said, str) else said
            if name not in names:
                message = f"{task.entry.file} has no numbers called `{name}`; {expected_names(name, names)}"
                raise bad_input("unknown-joint", message, task.place("joints", name))
            if entry.joint not in joints and (task.entry.gripper is None or task.entry.gripper.joint != entry.joint):
                message = f"`{entry.joint}` is no joint that moves here; {expected_names(entry.joint, joints)}"
                raise bad_input("unknown-joint", message, task.place("joints", name))
            unit = recording.units.get(name, "")
            if entry.scale is None and unit == "percent":
                message = f"`{name}` is in percent of a calibrated range, which says nothing about angles by itself"
                mend = "state `scale` and `offset`: the angle of 1 percent, and that where it says 0"
                raise bad_input("unknown-joint", message, task.place("joints", name), mend=mend)
            columns[entry.joint] = names.index(name)
            usual = radians(1.0) if unit == "deg" else 1.0
            scales[entry.joint] = usual if entry.scale is None else entry.scale.value
            offsets[entry.joint] = 0.0 if entry.offset is None else entry.offset.value
        return JointMap(columns, scales, offsets)

    def positions(self, episode: Episode, joints: Sequence[str], resting: Mapping[str, float]) -> Array:
        """Positions of joints [rad or m] at the episode's times, shape (T, n); those not recorded stay at `resting`."""
        q = np.empty((len(episode.times), len(joints)))
        for number, joint in enumerate(joints):
            q[:, number] = resting.get(joint, 0.0)
            if joint in self.columns:
                q[:, number] = self.scale[joint] * episode.values[:, self.columns[joint]] + self.offset[joint]
        return q


def grasps_of(
    task: RecordedTask, recording: Recording, mapped: JointMap, episode: Episode, fingers: Fingers | None
) -> list[Grasp]:
    """When something is held in an episode: as the workspace says of objects, in seconds, or by the gripper.

    Without either, as the recording says itself, if it does.
    """
    total = float(episode.times[-1])
    stated = sorted(
        (float(start), float(end))
        for start, end in (one.held or ("", "") for one in task.objects.values())
        if not isinstance(start, str) and not isinstance(end, str)
    )
    if stated:
        return [Grasp(start, start, end if end < total else None, end) for start, end in stated if start < total]
    gripper = task.entry.gripper
    if gripper is None and HELD in recording.names:
        return held_at(episode.times, episode.values[:, recording.names.index(HELD)] > 0.5)
    if gripper is None:
        return []
    name = gripper.joint
    if name in mapped.columns:
        numbers = mapped.positions(episode, [name], {})[:, 0]
    elif name in recording.names:
        numbers = episode.values[:, recording.names.index(name)]
    else:
        known = {*mapped.columns, *recording.names}
        message = f"`{name}` is no joint that {task.entry.file} moves, and no name in it; {expected_names(name, known)}"
        raise bad_input("unknown-joint", message, task.place("gripper", "joint"))
    limit, sign = gripper.closed_below, 1.0
    if limit is None:
        assert gripper.closed_above is not None  # noqa: S101 - the entry has one of the two
        limit, sign = gripper.closed_above, -1.0
    empty = -inf
    if gripper.empty_beyond is not None:
        empty = sign * gripper.empty_beyond.value
    elif fingers is not None and name in fingers.open:
        closed, opened = fingers.closed[name], fingers.open[name]
        empty = sign * (closed + EMPTY * (opened - closed))
    return find_grasps(episode.times, sign * numbers, sign * limit.value, empty)
