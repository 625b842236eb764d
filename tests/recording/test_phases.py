"""Grasps are found from how far a gripper is closed, despite noise and jitter, and none where nothing is taken."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.recording.phases import SHORTEST_PHASE, Grasp, find_grasps, held_at, phases

OPEN, HELD, SHUT = 1.0, 0.45, 0.0
LIMIT, EMPTY = 0.7, 0.05


Keys = list[tuple[float, float]]
"""Times [s] and how far a gripper is open, with straight lines between them."""


def found_grasps(rng: np.random.Generator, keys: Keys) -> list[Grasp]:
    """What is found in noisy numbers at jittering times, of which some are missing, in one unit or another."""
    rate = rng.choice([10.0, 30.0])
    even = np.arange(0.0, keys[-1][0], 1 / rate)
    times = np.append(0.0, even[1:] + rng.uniform(-0.36, 0.36, len(even) - 1) / rate)
    gap = rng.uniform(0.0, times[-1])
    kept = (rng.uniform(size=len(times)) > 0.1) & ((times < gap) | (times > gap + 0.15)) | (times == 0.0)
    scale, offset = [(1.0, 0.0), (100.0, 0.0), (1.92, -0.17)][rng.integers(3)]
    t, values = np.array(keys).T
    opening = np.interp(times[kept], t, values) + rng.normal(0.0, 0.012, kept.sum())
    return find_grasps(times[kept], scale * opening + offset, scale * LIMIT + offset, scale * EMPTY + offset)


def test_grasp_and_release_are_found_within_a_fifth_of_a_second() -> None:
    wrong = list[str]()
    for seed in range(50):
        rng = np.random.default_rng(seed)
        start, holds, takes = rng.uniform(1.5, 3.0), rng.uniform(1.0, 5.0), rng.uniform(0.3, 1.0)
        end, half = start + takes + holds, 0.5 * (OPEN + HELD)
        keys = [(0, OPEN), (start, OPEN), (start + takes, HELD), (end, HELD)]
        keys += [(end + 0.1, SHUT)] if seed % 5 == 0 else []  # it slips out, and the gripper shuts
        keys += [(end + 1.0, keys[-1][1]), (end + 1.5, OPEN)] if seed % 5 == 0 else [(end + takes, OPEN)]
        keys = (
            [(0, OPEN), (0.4, OPEN), (0.7, half + 0.1), (1.1, OPEN), *keys[1:]] if seed % 5 == 1 else keys
        )  # half shut
        found = found_grasps(rng, [*keys, (keys[-1][0] + 2, OPEN)])
        errors = [(one.start - start - takes, (one.end or 0.0) - end) for one in found]
        if len(found) != 1 or np.abs(errors).max() > 0.2:
            wrong.append(f"{seed}: {errors}")
    assert len(wrong) <= 2, wrong


def test_nothing_is_taken_where_a_gripper_stays_open_or_closes_on_nothing() -> None:
    for seed in range(50):
        rng = np.random.default_rng(seed)
        t, takes = float(rng.uniform(1.0, 3.0)), float(rng.uniform(0.3, 1.5))
        keys: Keys = [
            [(0, OPEN), (8, OPEN)],
            [(0, SHUT), (t, SHUT), (t + 0.5, OPEN), (8, OPEN)],  # closed at first, then open
            [(0, OPEN), (t, OPEN), (t + takes, SHUT), (t + 2, SHUT), (t + 3, OPEN), (8, OPEN)],
            [(0, OPEN), (t, OPEN), (t + 0.05, HELD), (t + 0.12, HELD), (t + 0.17, OPEN), (8, OPEN)],  # a twitch
            [(0, OPEN), (t, OPEN), (t + takes, 0.8), (t + 2, 0.8), (t + 3, OPEN), (8, OPEN)],  # half closed
        ][seed % 5]
        assert found_grasps(rng, keys) == [], (seed, keys)


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


def test_a_gripper_that_opens_further_while_it_counts_as_closed_is_read_without_an_error() -> None:
    t = np.arange(0.0, 8.0, 0.02)
    opening = np.select([t < 1.0, t < 2.0, t < 5.0], [0.32, 0.2, 0.38], 0.9)
    (grasp,) = find_grasps(t, opening, 0.3, -np.inf)
    assert 0.9 < grasp.closing <= grasp.start < grasp.opened == pytest.approx(5.0, abs=0.1)


def test_a_release_that_opens_little_is_one() -> None:
    t = np.arange(0.0, 8.0, 0.02)
    opening = np.select([t < 2.0, t < 5.0], [100.0, 20.0], 99.0)
    (grasp,) = find_grasps(t, opening, 95.0, -np.inf)
    assert grasp.end == pytest.approx(5.0, abs=0.2)
