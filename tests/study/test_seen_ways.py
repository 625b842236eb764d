"""Seen paths lose less sight than direct ones, in motions that are as honest, and are the same each time."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.find import TimeLimit, WantedWay, find_way
from sqrp_cli.study.robustness import Calibration
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.seen_ways import MOST_COMBINATIONS, blind_ends, move_searches, paths_together, way_with_seen_paths
from sqrp_cli.task.feasibility import feasible_motion
from tests.motion.cells import assert_keeps_limits
from tests.random_cell import Crowd, random_cell
from tests.study.compared import Compared, blind_time

pytestmark = pytest.mark.slow

WORKSPACES = Path(__file__).parents[2] / "workspaces"

G2 = "pickup green path=seen approach_yaw=90deg"

SHIPPED = {
    "tabletop": ("tabletop", G2, "g2"),
    "tabletop, two moves": ("tabletop", "pickup red path=seen", None),
    "screws": ("screws", "pickup_two_finger screw path=seen", None),
    "tower": ("tower", "stack red green path=seen", None),
}


@pytest.fixture(scope="module", params=SHIPPED)
def compared(request: pytest.FixtureRequest) -> Compared:
    folder, task, name = SHIPPED[request.param]
    return Compared.of(load_workspace(WORKSPACES / folder), task, name)


@pytest.fixture(scope="module")
def g2(tabletop: Workspace) -> Compared:
    return Compared.of(tabletop, G2, "g2")


def assert_honest(compared: Compared) -> None:
    """The laws of all motions: limits, continuity, rest at the ends, and no contact at steps of a millimetre."""
    assert_keeps_limits(compared.cell.model, compared.seen.planned.motion, 2e-3)
    cell, seen = compared.cell, compared.seen
    for space in move_searches(cell, seen.planned, compared.candidate.open_paths, np.inf):
        path = space.direct.trajectory.path
        coarse = path.positions(np.linspace(0, 1, 200))
        far = float((np.abs(np.diff(coarse, axis=0)) @ space.placed.radii).sum())
        q = path.positions(np.linspace(0, 1, 2 + int(1.2 * far / 1e-3)))
        assert all(contact is None for contact in space.placed.check_all(q))


def test_seen_paths_keep_every_law_are_no_worse_than_direct_ones_and_need_no_second_search(compared: Compared) -> None:
    assert_honest(compared)
    seen, direct = compared.seen, compared.direct
    assert blind_time(seen) <= blind_time(direct) + 1e-3 * seen.planned.T
    for primitive in seen.planned.motion.primitives:  # stops nowhere
        if primitive.name in seen.planned.candidate.vias:
            law = primitive.trajectory.law
            assert (law.derivatives(np.linspace(0, law.breaks[-1], 300)[1:-1])[1] > 0).all()
    again = feasible_motion(compared.cell, seen.planned.candidate, seen.planned.world)
    assert isinstance(again, Motion)
    for one, other in zip(seen.planned.motion.primitives, again.primitives, strict=True):
        assert one.trajectory.to_numbers() == other.trajectory.to_numbers()


def test_g2_loses_sight_for_less_than_a_quarter_of_the_time(g2: Compared) -> None:
    """A tenth would do if a green part before another green one counted as seen."""
    assert g2.seen.planned.candidate.values["path"] == "seen"
    assert set(g2.seen.planned.candidate.vias) <= {"a1", "a5"}
    assert blind_time(g2.seen) < 0.25 * blind_time(g2.direct)
    seen, direct = (4 * blind_time(analysis) + analysis.planned.motion.time for analysis in (g2.seen, g2.direct))
    assert seen < 0.92 * direct
    assert g2.seen.planned.motion.time < 1.2 * g2.direct.planned.motion.time


def test_the_search_depends_on_its_seed_alone(tabletop: Workspace, g2: Compared) -> None:
    again = Compared.of(tabletop, G2, "g2")
    assert again.seen.planned.candidate.vias.keys() == g2.seen.planned.candidate.vias.keys()
    for name, vias in g2.seen.planned.candidate.vias.items():
        np.testing.assert_array_equal(again.seen.planned.candidate.vias[name], vias)
    cell = replace(g2.cell, seed=5)
    seeded = find_way(cell, g2.candidate, cell.initial_world, Adaptive(), WantedWay())
    assert not isinstance(seeded, Infeasible)
    assert blind_time(seeded.analysis) < 0.5 * blind_time(g2.direct)


def test_a_retry_of_a_seen_step_is_seen_too(g2: Compared) -> None:
    way = replace(g2.seen.planned.candidate, vias={})
    found = way_with_seen_paths(g2.cell, way, g2.cell.initial_world)
    assert found.vias
    again = analyse(g2.cell, found, g2.cell.initial_world, Adaptive(), full=False)
    assert isinstance(again, Analysis)
    assert blind_time(again) < 0.5 * blind_time(g2.direct)


def test_where_nothing_is_monitored_or_paths_are_to_be_direct_none_is_looked_for(tabletop: Workspace) -> None:
    unwatched = replace(tabletop.skills["pickup"], requirements=())
    compared = Compared.of(replace(tabletop, skills={**tabletop.skills, "pickup": unwatched}), G2, "g2")
    assert (compared.seen.planned.candidate.vias, compared.seen.planned.T) == ({}, 0.0)
    compared = Compared.of(tabletop, "pickup green", "g2")
    assert (compared.seen.planned.candidate.vias, compared.candidate.open_paths) == ({}, frozenset())


def test_blind_ends_are_where_no_path_can_help(tabletop: Workspace) -> None:
    """g5 of the cell: the cameras do not see what matters at home, where a1 begins and a5 ends."""
    compared = Compared.of(tabletop, "pickup green path=seen wrist=flip approach_yaw=180deg", "g5")
    ends = blind_ends(compared.seen, compared.candidate.open_paths)
    assert {(end.primitive, end.at) for end in ends} >= {("a1", "home"), ("a5", "home")}
    timeline = compared.seen.timeline
    for end, instant in zip(ends, (0.0, compared.seen.planned.motion.time), strict=False):
        first = abs(timeline.samples.t[timeline.covered] - instant).min()
        assert end.seconds == pytest.approx(first, abs=1e-9)
    for name in ("a1", "a5"):
        direct = [end for end in blind_ends(compared.direct, {name}) if end.at == "home"]
        assert len(direct) == 1


def test_a_move_that_is_never_seen_is_named_once(tabletop: Workspace) -> None:
    dark = replace(tabletop, cameras={"cam3": tabletop.cameras["cam3"]})
    compared = Compared.of(dark, "pickup green path=seen approach_yaw=0deg", "g5", WantedWay(fastest=True))
    ends = blind_ends(compared.seen, compared.candidate.open_paths)
    moves = {p.name: p.trajectory.duration for p in compared.seen.planned.motion.primitives}
    assert [(end.primitive, end.at) for end in ends] == [("a1", "home"), ("a5", "lifted")]
    for end in ends:
        assert end.seconds == pytest.approx(moves[end.primitive], abs=1e-9)


@pytest.mark.parametrize(
    "limit", ["1.02x", *(pytest.param(limit, marks=pytest.mark.trial) for limit in ("1x", "10.1 s"))]
)
def test_a_limit_of_the_time_is_kept(tabletop: Workspace, g2: Compared, limit: str) -> None:
    bounded = Compared.of(tabletop, G2, "g2", WantedWay(limit=TimeLimit.read(limit)))
    fastest = g2.direct.planned.motion.time
    longest = 10.1 if limit.endswith("s") else float(limit[:-1]) * fastest
    assert bounded.seen.planned.motion.time <= longest + 1e-6
    assert bounded.seen.timeline.qualities.q_avg >= g2.direct.timeline.qualities.q_avg - 1e-3


def test_the_gain_of_g2_outlives_cameras_that_are_off(g2: Compared) -> None:
    off = [g2.off(Calibration(0.005, np.deg2rad(0.5), seed=0), draw) for draw in range(5)]
    gains = [blind_time(one.direct) - blind_time(one.seen) for one in off]
    assert np.mean(gains) > 0.5 * (blind_time(g2.direct) - blind_time(g2.seen))


def test_any_is_the_better_of_direct_and_seen(tabletop: Workspace, g2: Compared) -> None:
    either = Compared.of(tabletop, G2.replace("seen", "any"), "g2")
    assert either.seen.planned.candidate.values["path"] == "seen"
    assert blind_time(either.seen) == pytest.approx(blind_time(g2.seen), abs=1e-9)
    fastest = Compared.of(tabletop, G2.replace("seen", "any"), "g2", WantedWay(by="time"))
    assert fastest.seen.planned.candidate.values["path"] == "direct"
    assert fastest.seen.planned.candidate.vias == {}


def test_of_many_moves_the_best_paths_together_are_found_without_all_combinations() -> None:
    """Of 12 moves with 6 paths each there are 2e9; the best have the least of each move while there is time for it."""
    rng = np.random.default_rng(0)
    left = [[SimpleNamespace(time=t, blind=b) for t, b in rng.random((6, 2))] for _ in range(12)]
    found = paths_together(left, 12.0, weight=3.0)
    cost = min(sum(3 * path.blind + path.time for path in paths) for paths in found)
    assert len(found) <= MOST_COMBINATIONS
    assert cost == pytest.approx(sum(min(3 * path.blind + path.time for path in paths) for paths in left))
    few = left[:3]
    assert paths_together(few, 1.0, 3.0) == [some for some in product(*few) if sum(path.time for path in some) <= 1.0]


@pytest.mark.trial
def test_in_random_cells_seen_paths_are_honest_and_no_worse_than_others(tmp_path: Path) -> None:
    better, cells = 0, 30
    for seed in range(cells):
        workspace = load_workspace(random_cell(tmp_path / str(seed), Crowd(seed, 6, 4)))
        compared = Compared.of(workspace, "pickup path=seen")
        assert_honest(compared)
        blind, tolerance = blind_time(compared.seen), 1e-3 * compared.seen.planned.T
        better += blind <= min(blind_time(compared.direct), blind_time(compared.planned)) + tolerance
    assert better >= 0.9 * cells
