"""Names of branches: by joint angles of arms for which they are known, and refused where they mean nothing."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.geometry import axis_rotation, pose
from sqrp_cli.robot.branches import WORDS, chosen_branches
from sqrp_cli.robot.inverse_kinematics import all_solutions
from tests.task.robots import real_arm

DOWN = pose(axis_rotation(0, np.pi), (0.35, 0.35, 0.2))


def test_each_name_halves_the_branches_of_a_ur5_and_together_they_leave_one(ur5):
    q = all_solutions(ur5, DOWN).solutions
    assert len(q) == 8
    for name, words in WORDS.items():
        first, second = (chosen_branches(ur5, q, {name: word}) for word in words)
        assert (first != second).all(), name
        assert first.sum() == 4, name
    chosen = [chosen_branches(ur5, q, dict(zip(WORDS, words, strict=True))) for words in product(*WORDS.values())]
    assert np.array_equal(np.sum(chosen, axis=0), np.ones(8))


def test_elbow_and_wrist_of_a_ur5_go_by_the_signs_of_its_joints(ur5):
    """Reaching forward, its elbow is up where joint 3 is positive; the wrist as at home where joint 5 is negative."""
    q = all_solutions(ur5, DOWN).solutions
    forward = chosen_branches(ur5, q, {"shoulder": "left"})
    up = chosen_branches(ur5, q, {"elbow": "up"})
    assert (up[forward] == (q[forward, 2] > 0)).all()
    assert ur5.home[4] < 0
    assert (chosen_branches(ur5, q, {"wrist": "no_flip"}) == (np.sin(q[:, 4]) < 0)).all()


def test_an_elbow_that_is_up_is_higher(ur5):
    q = all_solutions(ur5, DOWN).solutions
    for others in product(*[*WORDS.values()][1:]):
        rows = [chosen_branches(ur5, q, dict(zip(WORDS, (elbow, *others), strict=True))) for elbow in ("up", "down")]
        up, down = (ur5.joint_origins(q[row][0])[2, 2] for row in rows)
        assert up > down + 0.05


def test_a_name_without_meaning_is_refused_and_any_has_one_for_every_arm():
    panda = real_arm("panda")
    assert chosen_branches(panda, panda.home[None], {}).all()
    with pytest.raises(InputError, match="`elbow=up` has no meaning for this arm: it takes an arm with six joints"):
        chosen_branches(panda, panda.home[None], {"elbow": "up"})
