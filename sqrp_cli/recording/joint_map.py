"""From the numbers of a recording to positions of joints and grasps, by what a workspace states."""

from __future__ import annotations

from collections.abc import Mapping
from math import inf, radians

from sqrp_cli.cell.recordings import RecordedJointEntry, RecordedTask
from sqrp_cli.errors import bad_input, expected_names, first_names
from sqrp_cli.files.units import ANGLE, LENGTH, SHARE, Dimension, Quantity, expected_quantity
from sqrp_cli.geometry import Array
from sqrp_cli.recording.episode import HELD, Episode, Recording
from sqrp_cli.recording.phases import Grasp, find_grasps, held_at
from sqrp_cli.robot.kinematics import RobotModel

UNITS: Mapping[str, tuple[float, Dimension]] = {"deg": (radians(1.0), ANGLE), "mm": (1e-3, LENGTH)}
"""What a 1 in these units of a recording means [rad or m], and of which joints it can be a position."""
EMPTY = 0.02  # Of the way from closed to open fingers: within it nothing is between them


def joint_positions(
    task: RecordedTask, recording: Recording, model: RobotModel, episode: Episode
) -> Mapping[str, Array]:
    """Positions of each joint that is recorded at the episode's times, (T,) [rad or m]: scale * number + offset.

    Without a stated map, names of the recording that are joints are those. Raises InputError for names that are not
    there, two that are one joint, and units that do not suit how a joint moves.
    """
    entry, names, joints, found = task.entry, recording.names, model.joints, dict[str, Array]()
    stated = entry.joints or {name: name for name in names if name in joints}
    if not stated:
        message = f"none of the names in {entry.file} is a joint: {first_names(names)}"
        mend = f"say under `joints` which is which, such as `{names[0]}: {joints[0]}`"
        raise bad_input("unknown-joint", message, task.place("joints"), mend=mend)
    able = {*joints, *([entry.gripper.joint] if entry.gripper else [])}
    for name, said in stated.items():
        meant = RecordedJointEntry(joint=said) if isinstance(said, str) else said
        unit, suiting, wrong, mend = recording.units.get(name, ""), _suiting(model, meant.joint), "", ""
        usual, kind = UNITS.get(unit, (1.0, None))
        if name not in names:
            wrong = f"{entry.file} has no numbers called `{name}`; {expected_names(name, names)}"
        elif meant.joint not in able:
            wrong = f"`{meant.joint}` is no joint that moves here; {expected_names(meant.joint, joints)}"
        elif meant.joint in found:
            wrong = f"`{name}` is the second name of joint `{meant.joint}`; expected one for each joint"
        elif meant.scale is None and unit == "percent":
            wrong = f"`{name}` is in percent of a calibrated range, which says nothing about angles by itself"
            mend = "state `scale` and `offset`: the angle of 1 percent, and that where it says 0"
        elif meant.scale is None and kind is not None and kind not in suiting:
            wrong = f"`{name}` is taken to be in {unit}, in which joint `{meant.joint}` does not move"
            mend = f"state what a 1 means as its `scale`: {expected_quantity(*suiting)}"
        if wrong:
            raise bad_input("unknown-joint", wrong, task.place("joints", name), mend=mend or None)
        scale = _number(task, meant.scale, suiting, "joints", name, "scale")
        offset = _number(task, meant.offset, suiting, "joints", name, "offset") or 0.0
        found[meant.joint] = (usual if scale is None else scale) * episode.values[:, names.index(name)] + offset
    return found


def _suiting(model: RobotModel, joint: str) -> tuple[Dimension, ...]:
    """What a position of a joint is; of one that the model does not move, an angle or a length."""
    if joint not in model.joints:
        return ANGLE, LENGTH
    return (ANGLE,) if model.tree.turns[model.tree.index(joint)] else (LENGTH,)


def _number(task: RecordedTask, stated: Quantity | None, suiting: tuple[Dimension, ...], *path: str) -> float | None:
    """A stated number in SI units, None if there is none. Raises InputError for a unit that does not suit."""
    if stated is None or stated.dimension is None or stated.dimension in suiting:
        return None if stated is None else stated.value
    message = f"`{path[-1]}` is {stated.dimension.name}, expected {expected_quantity(*suiting)}"
    raise bad_input("wrong-unit", message, task.place(*path))


def grasps_of(
    task: RecordedTask, recording: Recording, moved: Mapping[str, Array], episode: Episode, model: RobotModel
) -> list[Grasp]:
    """When something is held in an episode: as the workspace says of objects, in seconds, or by the gripper.

    Without either, as the recording says itself, if it does. moved: see `joint_positions`. Raises InputError for a
    gripper that is none of its names, and for units that do not suit it.
    """
    total, gripper, names = float(episode.times[-1]), task.entry.gripper, recording.names
    if stated := task.held_seconds:
        return [Grasp(start, start, end if end < total else None, end) for start, end in stated if start < total]
    if gripper is None:
        return held_at(episode.times, episode.values[:, names.index(HELD)] > 0.5) if HELD in names else []
    name, fingers = gripper.joint, model.fingers
    if name not in moved and name not in names:
        known = expected_names(name, {*moved, *names})
        message = f"`{name}` is no joint that {task.entry.file} moves, and no name in it; {known}"
        raise bad_input("unknown-joint", message, task.place("gripper", "joint"))
    numbers = moved[name] if name in moved else episode.values[:, names.index(name)]
    suiting = _suiting(model, name) if name in moved else (SHARE,)  # as they are stored, in no unit
    below, above, beyond = (
        _number(task, getattr(gripper, key), suiting, "gripper", key)
        for key in ("closed_below", "closed_above", "empty_beyond")
    )
    if beyond is None and name in fingers.joints:
        shut, wide = (float(ends[fingers.joints.index(name)]) for ends in (fingers.closed, fingers.open))
        beyond = shut + EMPTY * (wide - shut)
    sign, limit = (-1.0, above) if below is None else (1.0, below)
    assert limit is not None  # noqa: S101 - it has one of both
    return find_grasps(episode.times, sign * numbers, sign * limit, -inf if beyond is None else sign * beyond)
