"""The quick figures of a path agree with the exact study of the whole motion."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.seen.move_search import WatchedMove, blind_times
from sqrp_cli.programming.ways.find import WantedWay
from tests.programming.seen.compared import Compared

LOOKS = 400


@pytest.fixture(scope="module")
def compared(tabletop: Workspace) -> Compared:
    return Compared.of(tabletop, "pickup green", "g4", WantedWay(fastest=True))


def exact(found: Study, primitive: int) -> float:
    """How long a primitive is not covered, by the samples of the study [s]."""
    timeline = found.timeline
    within = np.array([piece.primitive == primitive for piece in timeline.pieces])[timeline.samples.piece]
    seen = timeline.covered[1:] & timeline.covered[:-1]
    return float(timeline.steps[within[:-1] & timeline.monitored[:-1] & ~seen & ~np.isnan(timeline.steps)].sum())


def test_blind_times_of_direct_moves_are_those_of_the_study(compared: Compared) -> None:
    moves = [WatchedMove(compared.seen, index) for index in (0, 4)]
    trajectories = [[compared.seen.motion.primitives[move.primitive].trajectory] for move in moves]
    found = blind_times(
        compared.cell.observer,
        [(move, of_move, LOOKS) for move, of_move in zip(moves, trajectories, strict=True)],
    )
    for move, times, (trajectory,) in zip(moves, found, trajectories, strict=True):
        wanted = exact(compared.seen, move.primitive)
        assert float(times[0]) == pytest.approx(wanted, abs=3 * trajectory.duration / LOOKS)
    assert float(found[0][0]) > 0.3


def test_paths_looked_at_together_have_the_figures_that_they_have_alone(compared: Compared) -> None:
    first, last = (WatchedMove(compared.seen, index) for index in (0, 4))
    away, back = (compared.seen.motion.primitives[index].trajectory for index in (0, 4))
    observer = compared.cell.observer
    together = blind_times(observer, [(first, [away, back, away], 30), (last, [], 30), (last, [back, away], 12)])
    assert [len(times) for times in together] == [3, 0, 2]
    for move, path, looks, time in (
        (first, away, 30, together[0][0]),
        (first, back, 30, together[0][1]),
        (first, away, 30, together[0][2]),
        (last, back, 12, together[2][0]),
        (last, away, 12, together[2][1]),
    ):
        assert blind_times(observer, [(move, [path], looks)])[0][0] == time


def test_a_move_that_no_formula_is_about_is_not_monitored(tabletop: Workspace) -> None:
    inspected = Compared.of(tabletop, "pickup green", "g2", WantedWay(fastest=True)).seen
    assert [WatchedMove(inspected, index).is_monitored for index in range(5)] == [True, True, False, True, True]
