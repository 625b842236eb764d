"""Frames by their names, and objects that move with the tool."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.files.frames import WORLD, WORLD_LINK, carried_poses, frame_poses, link_called
from sqrp_cli.geometry import Array, axis_rotation, inverse, pose


def some_pose(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return pose(axis_rotation(int(rng.integers(3)), rng.uniform(-3.0, 3.0)), rng.uniform(-1.0, 1.0, 3))


def test_every_frame_has_its_pose() -> None:
    link, now, before = some_pose(1), some_pose(2), some_pose(3)
    X_WF = frame_poses({"wrist": link}, {"g1": now}, {"g1": before})
    assert X_WF["wrist"] is link
    assert X_WF["g1"] is now
    assert X_WF["g1@start"] is before
    assert (X_WF[WORLD] == np.eye(4)).all()


def test_the_link_world_is_not_the_world() -> None:
    assert link_called(WORLD, ["base", WORLD_LINK]) == WORLD_LINK
    assert link_called(WORLD, ["base"]) == WORLD
    assert link_called("base", ["base", WORLD_LINK]) == "base"


def test_a_carried_object_keeps_its_pose_in_the_tool_and_rests_where_it_is_left() -> None:
    X_WT = np.array([some_pose(seed) for seed in range(6)])
    before, X_TO = some_pose(8), some_pose(9)
    after = X_WT[3] @ X_TO
    stays = [(slice(0, 2), None, before), (slice(2, 4), X_TO, None), (slice(4, 6), None, after)]
    X_WO = carried_poses(X_WT, stays)
    assert (X_WO[:2] == before).all()
    assert (X_WO[4:] == after).all()
    assert inverse(X_WT[2:4]) @ X_WO[2:4] == pytest.approx(np.array([X_TO, X_TO]))
