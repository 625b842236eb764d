"""The quick figures of a path agree with the exact study of the whole motion."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.study.assessment import Analysis
from sqrp_cli.study.find import WantedWay
from sqrp_cli.study.move_search import WatchedMove
from tests.study.compared import Compared

LOOKS = 400


@pytest.fixture(scope="module")
def compared(tabletop: Workspace) -> Compared:
    return Compared.of(tabletop, "pickup green", "g4", WantedWay(fastest=True))


def exact(found: Analysis, primitive: int) -> float:
    """How long a primitive is not covered, by the samples of the study [s]."""
    timeline = found.timeline
    within = np.array([piece.primitive == primitive for piece in timeline.pieces])[timeline.samples.piece]
    seen = timeline.covered[1:] & timeline.covered[:-1]
    return float(timeline.steps[within[:-1] & timeline.monitored[:-1] & ~seen & ~np.isnan(timeline.steps)].sum())


def test_blind_times_of_direct_moves_are_those_of_the_study(compared: Compared) -> None:
    found = []
    for move in (WatchedMove(compared.seen, index) for index in (0, 4)):
        trajectory = compared.seen.motion.primitives[move.primitive].trajectory
        (time,) = move.blind_times(compared.cell.observer, [trajectory], LOOKS).tolist()
        found.append(time)
        assert time == pytest.approx(exact(compared.seen, move.primitive), abs=3 * trajectory.duration / LOOKS)
    assert found[0] > 0.3


def test_paths_looked_at_together_have_the_figures_that_they_have_alone(compared: Compared) -> None:
    observer, move = compared.cell.observer, WatchedMove(compared.seen, 0)
    away, back = (compared.seen.motion.primitives[index].trajectory for index in (0, 4))
    alone = [move.blind_times(observer, [path], 30)[0] for path in (away, back, away)]
    assert move.blind_times(observer, [away, back, away], 30).tolist() == alone
    assert len(move.blind_times(observer, [], 30)) == 0


def test_a_move_that_no_formula_is_about_is_not_monitored(tabletop: Workspace) -> None:
    inspected = Compared.of(tabletop, "pickup green", "g2", WantedWay(fastest=True)).seen
    assert [WatchedMove(inspected, index).is_monitored for index in range(5)] == [True, True, False, True, True]
