"""The part of a starter workspace that a recording tells: which joint is which, home, the gripper, where work is."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from math import degrees, pi, radians
from pathlib import Path

import numpy as np

from sqrp_cli.cell.recordings import USUAL_SIZE
from sqrp_cli.errors import Place, bad_input, first_names
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.recording.episode import HELD, Recording
from sqrp_cli.recording.recording import open_recording
from sqrp_cli.records import dataclass
from sqrp_cli.starter.layout import RECORDED, Cube, Layout
from sqrp_cli.starter.search import views_of

FIRST_EPISODES, TAKEN = 4, 400  # so many episodes tell what is guessed, by so many states of each at most
WITHIN_TURN = 6.5  # numbers beyond it are no radians
MUCH = 5.0  # numbers of a joint that slides are in mm, if they are so many times as large as its limits
SLACK = 0.2  # degrees may be as far past the limits of a joint, as zeros of joints differ [rad]
ROUNDED = 2e-4  # home stays so far within limits, as its file has hundredths of a degree, or tenths of a millimetre
OPENS = 0.05  # a gripper that opens and closes by less than this share of its limits takes nothing


@dataclass(frozen=True)
class JointGuess:
    """How a name of a recording becomes a joint: position = scale * number + offset [rad or m]."""

    name: str
    joint: str
    scale: float
    offset: float
    why: str


def guess_joints(
    recording: Recording,
    numbers: Array,
    limits: Mapping[str, tuple[float, float]],
    jaw: str | None,
    slides: frozenset[str],
) -> list[JointGuess]:
    """Which joint each name of a recording is, and its unit: by names, stated units and ranges.

    numbers: of some episodes, (m, N). limits: lower and upper of the joints, of the gripper's joint `jaw` those of
    closed and open [rad or m]. Raises InputError where no name is that of a joint, or two are of one.
    """
    joints, found = {_plain(joint): joint for joint in limits}, defaultdict[str, list[str]](list)
    for name in recording.names:
        one_side = _plain(name).removeprefix("left").removeprefix("right")
        if (known := joints.get(_plain(name), joints.get(one_side))) is not None:
            found[known].append(name)
    if two := next(((joint, names) for joint, names in found.items() if len(names) > 1), None):
        message = f"{first_names(two[1])} may each be joint `{two[0]}`: two arms, or states and commands of one"
        mend = "keep the columns of one arm in the file, or write `recordings` with `joints` yourself"
        raise bad_input("ambiguous-name", message, Place(recording.path), mend=mend)
    pairs = {joint: names[0] for joint, names in found.items()}
    if not pairs and {"x", "y", "z"} <= {_plain(name) for name in recording.names}:
        message = f"{first_names(recording.names)} are poses of a tool; expected positions of joints"
        raise bad_input("no-joints", message, Place(recording.path), mend="record the joints, too")
    if not pairs:  # in their order, numbered ones without the gripper, too
        counts = [int(one[0]) for name in recording.names if (one := re.findall(r"\d+", name))]
        numbered = counts == [*range(min(counts, default=0), min(counts, default=0) + len(recording.names))]
        ordered = [one for one in limits if len(recording.names) == len(limits) or (numbered and one != jaw)]
        pairs = dict(zip(ordered, recording.names, strict=True)) if len(ordered) == len(recording.names) else {}
    if not pairs:
        message = f"none of its names is a joint of the robot: {first_names(recording.names)}"
        mend = f"call its columns {first_names([*limits])}; or name the robot that it is of after --robot or --urdf"
        raise bad_input("unknown-joint", message, Place(recording.path), mend=mend)

    # The unit of joints that turn where none is stated: numbers that stop at 100 are rather shares of a range.
    columns = {joint: numbers[:, recording.names.index(name)] for joint, name in pairs.items()}
    spans = {joint: (float(column.min()), float(column.max())) for joint, column in columns.items()}
    turning = [(*spans[joint], *limits[joint]) for joint in pairs if joint != jaw and joint not in slides]
    ends = [max(-least, most) for least, most, _, _ in turning]
    farthest, at_end = max(ends, default=0.0), sum(98.0 <= end <= 100.5 for end in ends)
    fits = all(low - SLACK <= radians(least) and radians(most) <= high + SLACK for least, most, low, high in turning)
    beyond, in_shares = farthest > WITHIN_TURN, at_end and (farthest == 100.0 or (at_end > 1 and farthest <= 100.5))
    usual = "rad" if not beyond else "deg" if fits and not in_shares else "percent"
    either = f", though they may be {'deg' if usual == 'percent' else 'percent'}" if at_end and fits else ""
    guesses = []
    for joint, name in pairs.items():
        (least, most), (low, high) = spans[joint], limits[joint]
        stated = recording.units.get(name, "")
        unit = stated or usual
        if joint == jaw and not stated and beyond and least >= -1.0 and most <= 101.0:
            unit = "percent"
        elif joint in slides and unit != "percent":
            far = stated != "rad" and max(-least, most) > MUCH * max(abs(low), abs(high))
            unit = "mm" if stated == "mm" or far else "m"
        scale, offset = {"deg": pi / 180, "mm": 1e-3}.get(unit, 1.0), 0.0
        if unit == "percent" and joint == jaw and least >= -1.0:  # from closed to open
            scale, offset = (high - low) / 100, low
        elif unit == "percent":
            scale, offset = (high - low) / 200, 0.5 * (high + low)
        doubt = either if (least, most, low, high) in turning and not stated else ""
        guesses.append(JointGuess(name, joint, scale, offset, f"{least:.4g} to {most:.4g}, taken as {unit}{doubt}"))
    return guesses


def _plain(name: str) -> str:
    """A name without what formats put around it: `observation.state.main_shoulder_pan.pos` -> `shoulderpan`."""
    last = re.sub(r"[._](pos|position|joint|qpos|state)$", "", name.lower().rsplit("/", 1)[-1])
    return re.sub(
        r"[^a-z0-9]", "", re.sub(r"^((observation|state|action|main|follower|joint|position)[._])+", "", last)
    )


def with_recording(layout: Layout, cell: Cell, file: Path, named: str) -> Layout:
    """A layout that begins where a recording does, with cameras at its work, and its entry with all that was guessed.

    cell: of the layout, with its hand. named: the recording as the workspace file says it. Raises InputError for a
    recording that is not of this robot, or cannot be read.
    """
    recording, model, slides = open_recording(file), cell.model, layout.slides
    episodes = [recording.read(number) for number in range(min(FIRST_EPISODES, len(recording.episodes)))]
    numbers = np.concatenate([one.values[:: max(1, len(one.times) // TAKEN)] for one in episodes])
    lower, upper = model.position_limits
    limits = dict(zip(model.joints, zip(lower.tolist(), upper.tolist(), strict=True), strict=True))
    jaw = next(iter(model.fingers.joints), None)
    upwards = jaw is not None and model.fingers.closed[0] > model.fingers.open[0]  # it closes
    if jaw is not None and upwards:
        limits[jaw] = limits[jaw][::-1]
    guesses = guess_joints(recording, numbers, limits, jaw, slides)
    recorded = {one.joint for one in guesses}
    q = np.tile([*model.home.tolist(), *model.fingers.open.tolist()], (len(numbers), 1))
    for one in guesses:
        q[:, model.joints.index(one.joint)] = one.scale * numbers[:, recording.names.index(one.name)] + one.offset

    # What is said of it.
    said = [f"`{one.name}` is joint `{one.joint}`: {one.why}" for one in guesses]
    said += [f"`{name}` is not recorded and stays at home" for name in model.arm if name not in recorded]
    past = np.maximum(lower - q.min(axis=0), q.max(axis=0) - upper).tolist()
    said += [
        f"joint `{name}` then goes {degrees(far):.0f} deg past its limit: check its scale and offset"
        for name, far in zip(model.joints, past, strict=True)
        if far > 0.01
    ]
    tips = model.tool_poses(q[:, : len(model.arm)])[:, :3, 3]
    if (depth := float(-tips[:, 2].min())) > 0.005:
        mend = "check offsets, `robot.base`, the tool, and the height of the table, a guess (`pose` of `objects.table`)"
        said.append(f"the tool then goes {100 * depth:.1f} cm into the table: {mend}")

    # Its entry. The gripper has two groups of positions, and holds beyond the level between them.
    entry = [f"  {RECORDED}:  # its episodes are the candidates", f"    file: {named}"]
    entry.append("    joints:  # check: number x scale + offset = position of the joint")
    for one in guesses:
        unit = "m" if one.joint in slides else "rad" if one.scale == 1.0 else "deg"
        factor = 180 / pi if unit == "deg" else 1.0
        values = f"scale: {factor * one.scale:.9g} {unit}, offset: {factor * one.offset:.6g} {unit}"
        entry.append(f"      {json.dumps(one.name)}: {{joint: {json.dumps(one.joint)}, {values}}}  # {one.why}")
    grips = HELD in recording.names
    if jaw is not None and jaw in recorded:
        jaws = q[:, model.joints.index(jaw)]
        if np.ptp(jaws) > OPENS * abs(limits[jaw][1] - limits[jaw][0]):
            level = 0.5 * (jaws.min() + jaws.max())
            for _ in range(20):
                level = 0.5 * (jaws[jaws <= level].mean() + jaws[jaws >= level].mean())
            word, grips = "above" if upwards else "below", True
            value = f"{level:.4g} m" if jaw in slides else f"{degrees(level):.3g} deg"
            stated = f"{{joint: {json.dumps(jaw)}, closed_{word}: {value}}}"
            entry.append(f"    gripper: {stated}  # check: then something is held")
            said.append(f"something is held while `{jaw}` is {word} {value}")
    if grips:
        size = ", ".join([f"{100 * USUAL_SIZE:g} cm"] * 3)
        entry.append(f"    objects: {{part: {{size: [{size}]}}}}  # check: what is held; it begins where it is grasped")

    # Where it begins, and where its work is, which is where the tool is lowest.
    begin = np.clip(q[0], lower + ROUNDED, upper - ROUNDED)
    home = {name: float(begin[k]) for k, name in enumerate(model.arm)}
    lowest = tips[np.argsort(tips[:, 2])[: max(1, len(tips) // 10)]]
    x, y = np.median(lowest[:, :2], axis=0).tolist()
    ahead, at = float(np.arctan2(y, x)), (round(x, 1), round(y, 1))
    begun = replace(layout, home=home, directions=(ahead,), table_side=1.0, table_at=at)
    views = views_of(cell, begun, [Cube("part", "green", (x, y, USUAL_SIZE / 2))], 0.1)
    return replace(begun, views=views, recording="\n".join(entry), told=tuple(said))
