"""A look sees what the verdicts of every camera say, and keeps what is known."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.study.observation import look_at, look_closely
from sqrp_cli.study.sampling import FixedCount, first_samples
from sqrp_cli.study.stage import Samples
from tests.task.studies import watched_motion

COUNT = FixedCount(9)


@pytest.mark.parametrize("seed", range(4))
def test_a_look_sees_what_a_close_look_sees(seed: int, ur5: RobotModel) -> None:
    motion = watched_motion(seed, ur5, min_visible=1.0 if seed % 2 else 0.5)
    samples = first_samples(COUNT, motion.stage, motion.observer, motion.targets)
    found = look_at(motion.observer, motion.stage, motion.targets, samples)
    close = look_closely(motion.observer, motion.stage, motion.targets, samples)
    for name in ("looked", "required", "known", "covered"):
        assert np.array_equal(getattr(found, name), getattr(close, name)), name
    assert np.array_equal(found.response, close.response, equal_nan=True)
    assert found.covered.any()
    assert not found.covered.all()


@pytest.mark.parametrize("seed", range(3))
def test_what_neighbours_agree_on_is_kept_and_the_rest_is_looked_at(seed: int, ur5: RobotModel) -> None:
    motion = watched_motion(seed, ur5)
    samples = first_samples(COUNT, motion.stage, motion.observer, motion.targets)
    seen = look_at(motion.observer, motion.stage, motion.targets, samples)
    rows = np.arange(len(samples) - 1)
    known = seen.agreed(rows, rows + 1)
    between = Samples(samples.piece[:-1], samples.t[:-1])  # the same instants: the answer is known
    again = look_at(motion.observer, motion.stage, motion.targets, between, known)
    assert np.array_equal(again.covered, seen.covered[:-1])
    assert known.known.any()
    assert not known.known.all()


def test_a_motion_without_samples_has_no_coverage(ur5: RobotModel) -> None:
    motion = watched_motion(0, ur5)
    nothing = Samples(np.zeros(0, dtype=np.int64), np.zeros(0))
    assert len(look_at(motion.observer, motion.stage, motion.targets, nothing).covered) == 0
