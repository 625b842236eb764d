"""Branches of inverse kinematics by name, for arms with six revolute joints.

The elbow is up or down: the third joint is above or below the line from the second joint to the wrist. The shoulder is
left or right: seen from the first joint's axis towards the wrist, where the second joint is. The wrist is not flipped
or flipped: the fifth joint is bent to the same side as at home, or to the other one.

A joint's position is that of its frame in the URDF. The wrist is the fourth joint if its axis is parallel to the
third's, else the fifth.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from sqrp_cli.errors import bad_input
from sqrp_cli.geometry import Array, Mask, cross
from sqrp_cli.robot.kinematics import RobotModel

WORDS = {"elbow": ("up", "down"), "shoulder": ("left", "right"), "wrist": ("no_flip", "flip")}
"""The names, each with the word for a positive figure and that for a negative one; see `branch_words`."""
BETWEEN = 1e-9  # largest size of a figure that belongs to neither of two branches
ALONG = np.cos(0.02)  # cosine from which two axes count as parallel: within 0.02 rad
LEAST_OFFSET = 5e-3
"""Least distance of the shoulder from the first joint's axis, along that of the second, to have a side [m]."""


def chosen_branches(model: RobotModel, q: Array, chosen: Mapping[str, str]) -> Mask:
    """Whether each of m arm positions, shape (m, n), belongs to the wanted branches, shape (m,).

    chosen: the wanted word for some names of `WORDS`. Positions between two branches (a stretched arm) belong to
    neither. Raises InputError for a name without meaning for the arm.
    """
    for name, why in _senseless(model).items() if chosen else ():
        if name in chosen:
            message = f"`{name}={chosen[name]}` has no meaning for this arm: {why}"
            raise bad_input("unknown-branch", message, mend=f"leave it at `{name}=any`")
    words = branch_words(model, q) if chosen else [{} for _ in q]
    return np.array([chosen.items() <= of_row.items() for of_row in words], dtype=bool)


def branch_words(model: RobotModel, q: Array) -> list[dict[str, str]]:
    """The branch of each of m arm positions, shape (m, n): the word for each name that has a meaning for the arm.

    A position between two branches has no word for these.
    """
    senseless = _senseless(model)
    names = [name for name in WORDS if name not in senseless]
    if not names:
        return [{} for _ in q]

    dot, (axes, origins) = partial(np.einsum, "mi,mi->m"), model.joint_lines(q)
    is_third = np.abs(dot(axes[:, 2], axes[:, 3])) > ALONG
    wrist = np.where(is_third[:, None], origins[:, 3], origins[:, 4])
    first, second = axes[:, 0], axes[:, 1]
    line, to_elbow = (
        vector - dot(vector, second)[:, None] * second
        for vector in (wrist - origins[:, 1], origins[:, 2] - origins[:, 1])
    )
    across = cross(second, line)
    side = dot(cross(wrist - origins[:, 0], origins[:, 1] - origins[:, 0]), first)
    figures = {
        "elbow": dot(to_elbow, across) * across[:, 2],
        "shoulder": side * np.where(first[:, 2] < 0, -1.0, 1.0),
        "wrist": _bend(axes) * _bend(model.joint_lines(model.home[None])[0]),
    }
    return [
        {name: WORDS[name][0 if figures[name][row] > 0 else 1] for name in names if abs(figures[name][row]) > BETWEEN}
        for row in range(len(q))
    ]


def _bend(axes: Array) -> Array:
    """Signed bend of the fifth joint by the axes, (m, n, 3): 0 where those of the fourth and the sixth are parallel."""
    bend: Array = np.einsum("mi,mi->m", cross(axes[:, 3], axes[:, 5]), axes[:, 4])
    return bend


def _senseless(model: RobotModel) -> Mapping[str, str]:
    """Why names have no meaning for the arm; those that have one are not in it."""
    if len(model.arm) != 6 or not model.turns.all() or not model.joints_move_alone:
        return dict.fromkeys(WORDS, "it takes an arm with six joints that turn one by one")
    axes, origins = model.joint_lines(model.home[None])[:, 0]
    why = {}
    if abs(axes[1] @ axes[2]) < ALONG:
        why["elbow"] = "the axes of its second and third joint are not parallel"
    if abs((origins[1] - origins[0]) @ axes[1]) < LEAST_OFFSET or abs(axes[0] @ axes[1]) > 1 - ALONG:
        why["shoulder"] = "its second joint is not beside the axis of the first one"
    if max(abs(axes[3] @ axes[4]), abs(axes[4] @ axes[5])) > 0.02:
        why["wrist"] = "the axes of its last three joints are not at right angles"
    elif abs(_bend(axes[None])[0]) < 1e-6:
        why["wrist"] = "its fifth joint is straight at home"
    return why
