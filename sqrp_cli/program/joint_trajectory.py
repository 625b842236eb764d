"""A program's joint motion as points in time, for export to a real arm.

There is a point at every multiple of the sampling period and where a primitive action begins or ends. A joint
trajectory has no field for tool commands, so each goes with the point at which it has to be sent.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Literal

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.program.record import Program, ProgramPrimitive
from sqrp_cli.records import dataclass

LEAST_GAP = 0.01  # points closer than this to the beginning or end of a primitive are left out [periods]
YAML_MARK = "# trajectory_msgs/JointTrajectory"
"""First words of an exported YAML file."""
_DIGITS = 9


@dataclass(frozen=True)
class ToolCommand:
    """A tool command, on the clock of the whole program [s]."""

    step: int
    """Its number, from 1."""
    action: Literal["grasp", "release"]
    """What the tool has to do."""
    object: str
    """Name of the object that it grasps or releases."""
    start: float
    """When it is sent [s]."""
    end: float
    """When it is done [s]."""

    def __str__(self) -> str:
        return f"{self.action} {self.object}"


@dataclass(frozen=True)
class Point:
    """The arm at one instant.

    time: [s from the start of the program]. step: its number, from 1. primitive: the one that begins or continues.
    tool: commands to send now. held: the object in the tool from now on. q, v, a: position, velocity and acceleration
    of every joint [rad or m, and per s, and per s^2].
    """

    time: float
    step: int
    primitive: ProgramPrimitive
    tool: tuple[ToolCommand, ...]
    held: str | None
    q: Array
    v: Array
    a: Array


def tool_commands(program: Program) -> tuple[ToolCommand, ...]:
    """The tool commands of the whole program, in order."""
    commands, begin = [], 0.0
    for number, step in enumerate(program.steps, 1):
        held = [*(primitive.held for primitive in step.primitives), step.after.held]  # last, what it holds at the end
        for primitive, after in zip(step.primitives, held[1:], strict=True):
            span = (begin + primitive.start, begin + primitive.end)
            if primitive.held is not None and primitive.held != after:
                commands.append(ToolCommand(number, "release", primitive.held, *span))
            if after is not None and primitive.held != after:
                commands.append(ToolCommand(number, "grasp", after, *span))
        begin += step.time
    return tuple(commands)


def points(program: Program, rate: float) -> Iterator[Point]:
    """The motion at multiples of 1/rate [s], and where a primitive begins or ends; a program has at least one step."""
    waiting = list(tool_commands(program))
    begin = 0.0
    for number, step in enumerate(program.steps, 1):
        for primitive in step.primitives:
            # The start and the multiples of the period before the end; none for a primitive without duration.
            start, end, margin = begin + primitive.start, begin + primitive.end, LEAST_GAP / rate
            times = np.zeros(0)
            if end - start >= margin:
                multiples = np.arange(math.ceil(start * rate), math.floor(end * rate) + 1) / rate
                times = np.append(start, multiples[(multiples > start + margin) & (multiples < end - margin)])
            trajectory = primitive.trajectory
            local = times - begin - primitive.start
            for time, q, v, a in zip(times.tolist(), *trajectory.motion(local, 2), strict=True):
                due = tuple(command for command in waiting if command.start <= time)
                waiting = waiting[len(due) :]
                yield Point(time, number, primitive, due, primitive.held, q, v, a)
        begin += step.time
    at_end = (state[0] for state in trajectory.motion([trajectory.duration], 2))
    yield Point(begin, number, primitive, tuple(waiting), step.after.held, *at_end)


def as_csv(program: Program, joints: Sequence[str], rate: float) -> str:
    """A line per point under a line of column names: time [s], step, primitive, tool command, joint states.

    joints: which of the program's joints to write. rate: [Hz].
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns = ["time", "step", "primitive", "action", "tool", "held"]
    kinds = ("position", "velocity", "acceleration")
    writer.writerow([*columns, *(f"{kind}_{joint}" for kind in kinds for joint in joints)])
    chosen = [program.joints.index(joint) for joint in joints]
    for point in points(program, rate):
        numbers = (text for state in (point.q, point.v, point.a) for text in _texts(state[chosen]))
        tool = " and ".join(map(str, point.tool))
        labels = [point.step, point.primitive.name, action_name(point.primitive), tool, point.held or ""]
        writer.writerow([f"{point.time:.{_DIGITS}f}", *labels, *numbers])
    return text.getvalue()


def as_ros_yaml(program: Program, joints: Sequence[str], rate: float) -> str:
    """One message of type trajectory_msgs/JointTrajectory; steps, primitives and tool commands are comments.

    joints: which of the program's joints to write; a controller accepts only its own. rate: [Hz].
    """
    chosen = [program.joints.index(joint) for joint in joints]
    time = sum(step.time for step in program.steps)
    lines = [
        f"{YAML_MARK}: {time:.3f} s, a point every {1 / rate:g} s and at both ends of each",
        "# primitive action. The arm must stand at the first point. The message cannot tell the tool, which has to",
        *(f"#   {command} at {command.start:.3f} s, done by {command.end:.3f} s" for command in tool_commands(program)),
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        f"joint_names: [{', '.join(joints)}]",
        "points:",
    ]
    last: ProgramPrimitive | None = None
    for point in points(program, rate):
        if point.primitive is not last or point.tool:
            commands = "".join(f", {command}" for command in point.tool)
            lines.append(f"# step {point.step}, {point.primitive.name}: {action_name(point.primitive)}{commands}")
            last = point.primitive
        seconds, nanoseconds = divmod(round(point.time * 1e9), 10**9)
        lines += [
            f"- positions: [{', '.join(_texts(point.q[chosen]))}]",
            f"  velocities: [{', '.join(_texts(point.v[chosen]))}]",
            f"  accelerations: [{', '.join(_texts(point.a[chosen]))}]",
            "  effort: []",
            f"  time_from_start: {{sec: {seconds}, nanosec: {nanoseconds}}}",
        ]
    return "\n".join(lines) + "\n"


FORMATS: Mapping[str, Callable[[Program, Sequence[str], float], str]] = {
    ".csv": as_csv,
    ".yaml": as_ros_yaml,
    ".yml": as_ros_yaml,
}
"""How a program is written, by the ending of the file."""


def action_name(primitive: ProgramPrimitive) -> str:
    """The kind of a primitive, such as `joint_move` or `grasp`."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", primitive.action).lower()


def _texts(numbers: Array) -> Sequence[str]:
    return [f"{number:.{_DIGITS}f}" for number in (np.round(numbers, _DIGITS) + 0.0).tolist()]
