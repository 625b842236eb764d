"""From the numbers of a recording to positions of joints and grasps, by what a workspace states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf, radians

from sqrp_cli.cell.recordings import RecordedJointEntry, RecordedTask
from sqrp_cli.errors import bad_input, expected_names, first_names
from sqrp_cli.geometry import Array
from sqrp_cli.recording.episode import HELD, Episode, Recording
from sqrp_cli.recording.phases import Grasp, find_grasps, held_at
from sqrp_cli.robot.robot import Fingers

EMPTY = 0.02
"""Of the way from closed to open fingers: within it nothing is between them."""


def joint_positions(
    task: RecordedTask, recording: Recording, joints: Sequence[str], episode: Episode
) -> Mapping[str, Array]:
    """Positions of each joint that is recorded at the episode's times, (T,) [rad or m]: scale * number + offset.

    joints: those that can be moved. Without a stated map, names of the recording that are joints are those. Raises
    InputError for names that are not there.
    """
    entry, names, found = task.entry, recording.names, dict[str, Array]()
    stated = entry.joints or {name: name for name in names if name in joints}
    if not stated:
        message = f"none of the names in {entry.file} is a joint: {first_names(names)}"
        mend = f"say under `joints` which is which, such as `{names[0]}: {joints[0]}`"
        raise bad_input("unknown-joint", message, task.place("joints"), mend=mend)
    able = {*joints, *([entry.gripper.joint] if entry.gripper else [])}
    for name, said in stated.items():
        meant = RecordedJointEntry(joint=said) if isinstance(said, str) else said
        unit, wrong, mend = recording.units.get(name, ""), "", ""
        if name not in names:
            wrong = f"{entry.file} has no numbers called `{name}`; {expected_names(name, names)}"
        elif meant.joint not in able:
            wrong = f"`{meant.joint}` is no joint that moves here; {expected_names(meant.joint, joints)}"
        elif meant.scale is None and unit == "percent":
            wrong = f"`{name}` is in percent of a calibrated range, which says nothing about angles by itself"
            mend = "state `scale` and `offset`: the angle of 1 percent, and that where it says 0"
        if wrong:
            raise bad_input("unknown-joint", wrong, task.place("joints", name), mend=mend or None)
        usual = radians(1.0) if unit == "deg" else 1.0
        scale = usual if meant.scale is None else meant.scale.value
        offset = 0.0 if meant.offset is None else meant.offset.value
        found[meant.joint] = scale * episode.values[:, names.index(name)] + offset
    return found


def grasps_of(
    task: RecordedTask, recording: Recording, moved: Mapping[str, Array], episode: Episode, fingers: Fingers | None
) -> list[Grasp]:
    """When something is held in an episode: as the workspace says of objects, in seconds, or by the gripper.

    Without either, as the recording says itself, if it does. moved: see `joint_positions`. Raises InputError for a
    gripper that is none of its names.
    """
    total, gripper, names = float(episode.times[-1]), task.entry.gripper, recording.names
    stated = sorted(
        (float(start), float(end))
        for start, end in (one.held or ("", "") for one in task.objects.values())
        if not isinstance(start, str) and not isinstance(end, str)
    )
    if stated:
        return [Grasp(start, start, end if end < total else None, end) for start, end in stated if start < total]
    if gripper is None:
        return held_at(episode.times, episode.values[:, names.index(HELD)] > 0.5) if HELD in names else []
    name = gripper.joint
    if name not in moved and name not in names:
        known = expected_names(name, {*moved, *names})
        message = f"`{name}` is no joint that {task.entry.file} moves, and no name in it; {known}"
        raise bad_input("unknown-joint", message, task.place("gripper", "joint"))
    numbers = moved[name] if name in moved else episode.values[:, names.index(name)]
    limit, sign = gripper.closed_below or gripper.closed_above, 1.0 if gripper.closed_below else -1.0
    assert limit is not None  # noqa: S101 - it has one of both
    empty = -inf
    if gripper.empty_beyond is not None:
        empty = sign * gripper.empty_beyond.value
    elif fingers is not None and name in fingers.open:
        empty = sign * (fingers.closed[name] + EMPTY * (fingers.open[name] - fingers.closed[name]))
    return find_grasps(episode.times, sign * numbers, sign * limit.value, empty)
