"""Grasps are found from how far a gripper is closed, despite noise and jitter, and none where nothing is taken."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.recording.phases import SHORTEST_PHASE, Grasp, find_grasps, held_at, phases

OPEN, HELD, SHUT = 1.0, 0.45, 0.0
LIMIT, EMPTY = 0.7, 0.05


def gripper(rng: np.random.Generator, keys: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Noisy numbers of a gripper at jittering times, 30 a second, through (time, opening) on straight lines."""
    even = np.arange(0.0, keys[-1][0], 1 / 30)
    times = np.append(0.0, even[1:] + rng.uniform(-0.012, 0.012, len(even) - 1))
    t, values = np.array(keys).T
    return times, np.interp(times, t, values) + rng.normal(0.0, 0.012, len(times))


@pytest.mark.parametrize("seed", range(50))
def test_grasp_and_release_are_found_within_a_fifth_of_a_second(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, holds, speed = rng.uniform(1.5, 3.0), rng.uniform(1.0, 5.0), rng.uniform(0.3, 1.0)
    end = start + speed + holds
    keys = [(0, OPEN), (start, OPEN), (start + speed, HELD), (end, HELD), (end + speed, OPEN), (end + speed + 2, OPEN)]
    (found,) = find_grasps(*gripper(rng, keys), LIMIT, EMPTY)
    assert found.start == pytest.approx(start + speed, abs=0.2)
    assert found.end == pytest.approx(end, abs=0.2)
    assert found.closing == pytest.approx(start, abs=0.2)
    assert found.opened == pytest.approx(end + speed, abs=0.2)


@pytest.mark.parametrize("seed", range(50))
def test_nothing_is_taken_where_a_gripper_stays_open_or_closes_on_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = float(rng.uniform(1.0, 3.0))
    keys = [
        [(0, OPEN), (8, OPEN)],
        [(0, SHUT), (t, SHUT), (t + 0.5, OPEN), (8, OPEN)],  # closed at first, then open
        [(0, OPEN), (t, OPEN), (t + 0.5, SHUT), (t + 2, SHUT), (t + 3, OPEN), (8, OPEN)],
        [(0, OPEN), (t, OPEN), (t + 0.05, HELD), (t + 0.12, HELD), (t + 0.17, OPEN), (8, OPEN)],  # a twitch
    ][seed % 4]
    assert find_grasps(*gripper(rng, keys), LIMIT, EMPTY) == []


def test_phases_follow_each_other_without_gaps() -> None:
    grasps = [Grasp(2.0, 2.8, 5.0, 5.3), Grasp(7.0, 7.2, None, 9.0)]
    found = list(phases(grasps, 9.0))
    assert [one.name for one in found] == [
        "approach",
        "grasp",
        "carry",
        "release",
        "retreat",
        "approach2",
        "grasp2",
        "carry2",
    ]
    assert [one.start for one in found] == [0.0, *(one.end for one in found[:-1])]
    assert found[-1].end == 9.0
    assert (found[1].start, found[1].end, found[2].end) == (2.0, 2.8, 5.0)
    assert found[3].end - found[3].start == pytest.approx(SHORTEST_PHASE)
    assert found[6].end - found[6].start == pytest.approx(SHORTEST_PHASE)  # longer than its closing
    assert [(one.name, one.end) for one in phases([], 3.0)] == [("approach", 3.0)]


def test_what_says_itself_whether_it_holds_is_believed_to_the_instant() -> None:
    times = np.array([0.0, 0.5, 0.6, 2.0, 2.5])
    assert held_at(times, np.array([0, 1, 1, 0, 1], dtype=bool)) == [
        Grasp(0.5, 0.5, 2.0, 2.0), Grasp(2.5, 2.5, None, 2.5)
    ]  # fmt: skip
