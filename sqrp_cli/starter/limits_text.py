"""What a starter workspace says about the limits of joints."""

from __future__ import annotations

import json

from sqrp_cli.starter.description import Description

ASSUMED = {"acceleration": 2, "jerk": 20}
"""Limits that a URDF cannot state: gentle ones [rad/s^2, rad/s^3, or m for a sliding joint]."""


def limits_text(description: Description) -> str:
    """The value of `robot.limits`: MoveIt's file where there is one, and what it leaves open."""
    if description.limits is None or description.limits_file is None:
        assumed = ", ".join(f"{kind}: {value}" for kind, value in ASSUMED.items())
        return f"{{{assumed}}}  # rad/s^2 and rad/s^3, which a URDF cannot say; velocity is the URDF's"
    joints = [joint.name for joint in description.urdf.movable_joints]
    entries = [f"moveit: {json.dumps(description.limits_file, ensure_ascii=False)}"]
    guessed = []
    for kind, value in ASSUMED.items():
        open_joints = [name for name in joints if name not in description.limits.stated[kind]]
        if len(open_joints) == len(joints):
            entries.append(f"{kind}: {value}")
        elif open_joints:
            entries.append(f"{kind}: {{{', '.join(f'{json.dumps(name)}: {value}' for name in open_joints)}}}")
        guessed += [kind] if open_joints else []
    scaling = [f"{kind} x {factor:g}" for kind, factor in description.limits.scaling.items() if factor != 1.0]
    notes = [f"scaled as MoveIt does: {', '.join(scaling)}"] if scaling else []
    notes += [f"check: {' and '.join(guessed)} assumed, not stated there"] if guessed else []
    return f"{{{', '.join(entries)}}}" + (f"  # {'; '.join(notes)}" if notes else "")
