"""A program at a share of its speed: the same path, and every time as many times as long."""

from __future__ import annotations

from unittest.mock import MagicMock

import numpy as np
import pytest

from sqrp_cli.ask.api.program import late_replanner
from sqrp_cli.logic.image_time import Onset, Window
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.program.record import Program, ProgramSight
from sqrp_cli.run.slowed import slowed
from tests.run.steps import formula, played, step

LIMITS = MotionLimits(np.array([0.2]), np.array([1.0]), np.array([10.0]))


def program() -> Program:
    move = joint_move(np.zeros(1), np.array([1.8]), LIMITS)
    window = Window(start=1.0, end=3.0, period=0.1, lag=0.05)
    sight = ProgramSight(windows=(window,), onsets=(Onset(np.array([1.0, 3.0]), np.array([1.1, 3.1])),))
    formulas = [formula("eventually[1.5, 2.25] (not held(g1) and on(g1, tray))", "retry", "slip")]
    one = step(formulas, {"held(g1)": {"cam1": [(0.5, 4.0)]}}, move.duration)
    sights = {"usual": {"cam1": ((0.25, 4.0),)}, "refuted": {"cam1": ((0.0, 4.0),)}}
    targets = {"held(g1)": one.targets["held(g1)"].model_copy(update=sights)}
    one = one.model_copy(update={"primitives": (played(move),), "sights": {"slip": sight}, "targets": targets})
    return Program(workspace="w", digest="d", joints=("a",), steps=(one,))


@pytest.mark.parametrize("speed", [0.1, 0.5, 0.8])
def test_paths_stay_and_times_grow(speed: float) -> None:
    fast, slow = program().steps[0], slowed(program().steps[0], speed)
    assert slow.time == pytest.approx(fast.time / speed)
    t = np.linspace(0.0, fast.time, 50)
    before, after = fast.primitives[0].trajectory, slow.primitives[0].trajectory
    assert np.allclose(after.positions(t / speed), before.positions(t))
    assert np.allclose(after.motion(t / speed, 1)[1], speed * before.motion(t, 1)[1])
    assert slow.primitives[0].end == pytest.approx(fast.primitives[0].end / speed)


def test_formulas_and_predictions_keep_to_the_motion() -> None:
    slow = slowed(program().steps[0], 0.5)
    assert slow.formulas[0].formula == "eventually[3.0, 4.5] (not held(g1) and on(g1, tray))"
    target = slow.targets["held(g1)"]
    assert target.seen == {"cam1": ((1.0, 8.0),)}
    assert (target.usual, target.refuted) == ({"cam1": ((0.5, 8.0),)}, {"cam1": ((0.0, 8.0),)})
    sight = slow.sights["slip"]
    assert (sight.windows[0].start, sight.windows[0].end) == (2.0, 6.0)
    assert (sight.windows[0].period, sight.windows[0].lag) == (0.1, 0.05)  # of cameras, which stay as fast
    assert sight.onsets[0].shown.tolist() == [2.2, 6.2]


def test_a_whole_speed_changes_nothing_and_retries_are_slowed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = program().steps[0]
    assert slowed(whole, 1.0) is whole
    monkeypatch.setattr("sqrp_cli.motion.cell.Cell.load", MagicMock())
    replanned = lambda _cell, _step, world: whole if world == "free" else None  # noqa: E731
    monkeypatch.setattr("sqrp_cli.study.program_update.replanned", replanned)
    slow = late_replanner(MagicMock(), 0.25)
    assert slow(whole, "free").time == pytest.approx(4 * whole.time)
    assert slow(whole, "full") is None
