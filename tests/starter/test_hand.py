"""How a hand grasps: what was told by the shapes of its fingers, judged by rays through their meshes."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
import trimesh

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, inverse, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.starter import search
from sqrp_cli.starter.by_name import find_named
from sqrp_cli.starter.description import OwnRobot
from sqrp_cli.starter.make import make_starter

HANDS = {"panda": (None, 80e-3, 40e-3), "ur5e": ("robotiq_2f_85", 85e-3, 42.5e-3), "so101": (None, 0.0673, 0.018)}
"""A gripper for the arm; clear width [m], by the data sheets of the first two; from the frame to the nearer finger. Of
so101 only one jaw moves, and the frame is on the face of the other one: there it is measured from 18 mm beside."""


@pytest.fixture(scope="module", params=HANDS)
def cell(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Cell:
    name, gripper = request.param, HANDS[request.param][0]
    tool = None if gripper is None else find_named(gripper, "gripper")[0]
    folder, stands = tmp_path_factory.mktemp(name) / name, search.stands
    with pytest.MonkeyPatch.context() as patch:  # the hand is enough
        patch.setattr(search, "stands", lambda *given: islice(stands(*given), 1))
        patch.setattr(search, "find_home", lambda *_: Infeasible(("not sought",)))
        make_starter(folder, OwnRobot(find_named(name, "robot")[0], gripper=tool))
    return Cell.load(load_workspace(folder))


def hits(cell: Cell, way: Array, start: Array) -> Array:
    """How far rays in the tool frame, with the fingers open, go along a direction (3,) from points (n, 3), (n,) [m]."""
    X_WL = cell.model.home_links
    X_TW = inverse(X_WL[cell.model.tool_frame])
    last = cell.collision.depth[cell.model.tool_frame]
    solids = load_solids([part for part in cell.model.parts if cell.collision.depth[part.parent] >= last])
    bodies = [trimesh.Trimesh(transform(X_TW @ X_WL[s.part.parent], s.vertices), s.triangles) for s in solids]
    rays = trimesh.util.concatenate(bodies).ray
    places, index, _ = rays.intersects_location(start, np.tile(way, (len(start), 1)), multiple_hits=False)
    far = np.full(len(start), np.inf)
    far[index] = np.linalg.norm(places - start[index], axis=1)
    return far


def test_the_frame_lies_between_the_tips_and_the_stated_width_is_free_there(cell: Cell) -> None:
    # Of a jaw that turns, the tip is 14 mm before the frame when it is open.
    lowest, beside = (-32e-3, 0.018) if cell.workspace.name == "so101" else (-18e-3, 0.0)
    x, z = np.meshgrid([-3e-3, 0.0, 3e-3], np.linspace(lowest, -1e-3, 18))
    start = np.column_stack([x.ravel(), np.full(x.size, beside), z.ravel()])
    left, right = hits(cell, np.array([0.0, -1.0, 0.0]), start), hits(cell, np.array([0.0, 1.0, 0.0]), start)
    gaps = np.array([np.min(side[np.isfinite(side)]) for side in (left, right)])
    gripper, width, nearer = HANDS[cell.workspace.name]
    assert cell.workspace.robot.geometry == ("visual" if gripper else "collision")  # that of some grippers has gaps
    edges = 2.5e-3 if cell.workspace.name == "so101" else 1e-3  # by which those of a jaw that turns may be nearer
    assert -1e-3 < gaps.sum() - (cell.model.fingers.width or 0.0) < edges
    assert [gaps.sum(), gaps.min()] == pytest.approx([width, nearer], abs=1.1e-3)
    # In front of the frame is nothing: open, these fingers reach as far as it at most.
    across = [[-3e-3, y, 2e-3] for y in np.linspace(-0.2, 0.2, 81)]
    assert not np.isfinite(hits(cell, np.array([0.0, 0.0, 1.0]), np.array(across))).any()
