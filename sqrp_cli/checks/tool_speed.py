"""Straight moves that are asked to be faster than the joints can move the tool at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.skill.settings import Reference
from sqrp_cli.knowledge.skill.skill import Skill, StraightMove
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel


def unreachable_speeds(workspace: Workspace, model: RobotModel) -> Iterator[Problem]:
    """Warnings about speeds of straight moves that the joints' velocity limits allow nowhere; moves are then slower."""
    fastest = fastest_tool(model)
    for skill in workspace.skills.values():
        for index, primitive in enumerate(skill.primitives):
            if not isinstance(primitive, StraightMove):
                continue
            speed = max(_values(skill, primitive.speed), default=0.0)
            if speed > fastest:
                message = (
                    f"skill `{skill.name}`: a speed of {speed:g} m/s is asked of `{primitive.name}`, but the velocity "
                    f"limits of the joints allow less than {fastest:.3g} m/s anywhere, so the move is slower"
                )
                place = skill.places.get(f"primitives.{index}.speed")
                mend = "lower the speed, or correct `robot.limits.velocity`"
                yield Problem("unreachable-speed", message, place, severity="warning", mend=mend)


def fastest_tool(model: RobotModel) -> float:
    """An upper bound of the tool frame's speed [m/s], with the arm stretched out and every joint at its limit."""
    if not model.joints_move_alone:
        return np.inf
    points = np.concatenate([model.joint_origins(model.home), model.tool_pose(model.home)[None, :3, 3]])
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    lengths = lengths + np.where(model.turns, 0.0, model.upper - model.lower)
    reaches = np.cumsum(lengths[::-1])[::-1]
    return float(model.velocity @ np.where(model.turns, reaches, 1.0))


def _values(skill: Skill, setting: object) -> list[float]:
    """The numbers that a setting may be."""
    if not isinstance(setting, Reference):
        return [setting] if isinstance(setting, float) else []
    named = [parameter.values for parameter in skill.motion_parameters if parameter.name == setting.parameter]
    return [value for values in named for value in values if isinstance(value, float)]
