"""The part of a starter workspace that a recording tells: which joint is which, home, the gripper, where work is."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from math import degrees, inf, pi
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

FIRST_EPISODES, TAKEN = 4, 400
"""So many episodes tell what is guessed, by so many states of each at most."""
WITHIN_TURN = 6.5  # numbers beyond it are no radians
SLACK = 0.2  # degrees may be as far past the limits of a joint, as zeros of joints differ [rad]
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
    plain = {joint: _plain(joint) for joint in limits}
    found = defaultdict[str, list[str]](list)
    for name in recording.names:
        for joint in (joint for joint, word in plain.items() if word == _plain(name)):
            found[joint].append(name)
    for joint, names in found.items():
        if len(names) > 1:
            message = f"{first_names(names)} may each be joint `{joint}`: two arms, or states and commands of one"
            mend = "keep the columns of one arm in the file, or write `recordings` with `joints` yourself"
            raise bad_input("ambiguous-name", message, Place(recording.path), mend=mend)
    pairs = {joint: names[0] for joint, names in found.items()}
    counted = [int(one[0]) for name in recording.names if (one := re.findall(r"\d+", name))]
    rising = counted == [*range(counted[0], counted[0] + len(recording.names))] if counted else False
    if not pairs and len(recording.names) in (len(limits), len({*limits} - {jaw}) if rising else 0):
        pairs = dict(
            zip(limits, recording.names, strict=False)
        )  # in their order, numbered ones without the gripper, too
    if not pairs:
        message = f"none of its names is a joint of the robot: {first_names(recording.names)}"
        known = f"joints are {first_names([*limits])}"
        raise bad_input("unknown-joint", f"{message}; {known}", Place(recording.path), mend="name its robot")
    spans = {joint: numbers[:, recording.names.index(name)] for joint, name in pairs.items()}
    stated = {joint: recording.units.get(name, "") for joint, name in pairs.items()}
    turning = [joint for joint in pairs if joint != jaw and joint not in slides]
    beyond = any(np.abs(spans[joint]).max() > WITHIN_TURN for joint in turning)
    fits = all(
        limits[joint][0] - SLACK <= pi / 180 * spans[joint].min()
        and pi / 180 * spans[joint].max() <= limits[joint][1] + SLACK
        for joint in turning
    )
    most_of_all = max((float(np.abs(spans[joint]).max()) for joint in turning), default=0.0)
    whole_range = most_of_all >= 98.0 and most_of_all <= 100.5  # numbers that stop at 100 are rather shares of a range
    usual = "rad" if not beyond else "deg" if fits and not whole_range else "percent"
    guesses = []
    for joint, name in pairs.items():
        low, high = limits[joint]
        least, most = float(spans[joint].min()), float(spans[joint].max())
        unit = stated[joint] or ("rad" if joint in slides else usual)
        if joint == jaw and not stated[joint] and beyond and least >= -1.0 and most <= 101.0:
            unit = "percent"  # from closed to open
        scale, offset = {"rad": 1.0, "deg": pi / 180}.get(unit, (high - low) / 200), 0.0
        if unit == "percent":
            scale, offset = ((high - low) / 100, low) if least >= -1.0 and joint == jaw else (scale, 0.5 * (high + low))
        guesses.append(JointGuess(name, joint, scale, offset, f"{least:.4g} to {most:.4g}, taken as {unit}"))
    return guesses


def _plain(name: str) -> str:
    """A name without what formats put around it: `observation.state.main_shoulder_pan.pos` -> `shoulderpan`."""
    last = re.sub(r"[._](pos|position|joint|qpos|state)$", "", name.lower().rsplit("/", 1)[-1])
    return re.sub(r"[^a-z0-9]", "", re.sub(r"^(observation|state|action|main|follower|joint|position)[._]", "", last))


def with_recording(layout: Layout, cell: Cell, file: Path, named: str) -> Layout:
    """A layout that begins where a recording does, with cameras at its work, and its entry with all that was guessed.

    cell: of the layout, with its hand. named: the recording as the workspace file says it. Raises InputError for a
    recording that is not of this robot, or cannot be read.
    """
    recording, model = open_recording(file), cell.model
    episodes = [recording.read(number) for number in range(min(FIRST_EPISODES, len(recording.episodes)))]
    numbers = np.concatenate([one.values[:: max(1, len(one.times) // TAKEN)] for one in episodes])
    lower, upper = model.position_limits
    limits = {name: (low, high) for name, low, high in zip(model.joints, lower.tolist(), upper.tolist(), strict=True)}
    jaw = model.fingers.joints[0] if model.fingers.joints else None
    if jaw is not None and model.fingers.closed[0] > model.fingers.open[0]:
        limits[jaw] = limits[jaw][::-1]
    guesses = guess_joints(recording, numbers, limits, jaw, layout.slides)
    q = np.tile([*model.home.tolist(), *model.fingers.open.tolist()], (len(numbers), 1))
    for one in guesses:
        column = recording.names.index(one.name)
        q[:, model.joints.index(one.joint)] = one.scale * numbers[:, column] + one.offset
    said = [f"`{one.name}` is joint `{one.joint}`: {one.why}" for one in guesses]
    told = zip(recording.episodes, episodes, strict=False)
    said += [f"episode {name}: {one}" for name, episode in told for one in episode.told]
    said += [
        f"`{name}` is not recorded and stays at home" for name in model.arm if name not in {g.joint for g in guesses}
    ]
    for number, name in enumerate(model.joints):
        if (past := float(max(lower[number] - q[:, number].min(), q[:, number].max() - upper[number]))) > 0.01:
            said.append(f"joint `{name}` then goes {degrees(past):.0f} deg past its limit: check its scale and offset")
    tips = model.tool_poses(q[:, : len(model.arm)])[:, :3, 3]
    if (depth := float(-tips[:, 2].min())) > 0.005:
        said.append(f"the tool then goes {100 * depth:.1f} cm into the table: check offsets, `robot.base` and the tool")

    # The gripper: two groups of positions, and the level between them.
    entry, gripper = [f"    file: {named}", "    joints:  # check: number x scale + offset = position of the joint"], ""
    for one in guesses:
        unit = "m" if one.joint in layout.slides else "rad" if one.scale == 1.0 else "deg"
        factor = 180 / pi if unit == "deg" else 1.0
        values = f"scale: {factor * one.scale:.9g} {unit}, offset: {factor * one.offset:.6g} {unit}"
        entry.append(f"      {json.dumps(one.name)}: {{joint: {json.dumps(one.joint)}, {values}}}  # {one.why}")
    if jaw is not None and jaw in {one.joint for one in guesses}:
        jaws, (low, high) = q[:, model.joints.index(jaw)], limits[jaw]
        level = 0.5 * (jaws.min() + jaws.max())
        for _ in range(20):
            level = 0.5 * (jaws[jaws <= level].mean() + jaws[jaws >= level].mean())
        if np.ptp(jaws) > OPENS * min(abs(high - low), inf):
            word = "closed_below" if model.fingers.closed[0] < model.fingers.open[0] else "closed_above"
            value = f"{level:.4g} m" if jaw in layout.slides else f"{degrees(level):.3g} deg"
            gripper = f"    gripper: {{joint: {json.dumps(jaw)}, {word}: {value}}}  # check: then something is held"
            said.append(f"something is held while `{jaw}` is {word.removeprefix('closed_')} {value}")
    if gripper or HELD in recording.names:
        size = ", ".join([f"{100 * USUAL_SIZE:g} cm"] * 3)
        entry += [
            *filter(None, [gripper]),
            f"    objects: {{part: {{size: [{size}]}}}}  # check: what is held; it begins where it is grasped",
        ]

    home = {name: float(np.clip(q[0, k], lower[k], upper[k])) for k, name in enumerate(model.arm)}
    lowest = tips[np.argsort(tips[:, 2])[: max(1, len(tips) // 10)]]  # where the work is
    middle = [float(np.median(lowest[:, 0])), float(np.median(lowest[:, 1])), USUAL_SIZE / 2]
    ahead = float(np.arctan2(middle[1], middle[0]))
    begun = replace(
        layout, home=home, directions=(ahead,), table_side=1.0, table_at=(round(middle[0], 1), round(middle[1], 1))
    )
    work = [Cube("part", "green", (middle[0], middle[1], middle[2]))]
    views = views_of(cell, begun, work, 0.1)
    text = "\n".join([f"  {RECORDED}:  # its episodes are the candidates", *entry])
    return replace(begun, views=views, recording=text, told=tuple(said))
