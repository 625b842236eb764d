"""Waypoints, by hand and by their laws."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import axis_rotation, box_corners, grasp_pose, inverse, pose, side_pose, transform
from sqrp_cli.motion.waypoints import UnknownPlaceError, WaypointGrounder, put_pose
from tests.motion.cells import read_waypoints

SIZE = (0.1, 0.2, 0.3)
TRAY = (0.6, 0.4, 0.02)
WAYPOINTS = read_waypoints(
    {
        "grasp": {"object": "object", "side": "+z", "yaw": "$yaw"},
        "above": {"from": "grasp", "retreat": 0.02},
        "lifted": {"from": "above", "raise": 0.1},
        "inspect": {"pose": {"position": [1.0, 2.0, 3.0]}},
        "put": {"put": "object", "onto": "onto", "along": "$along", "across": -1.0, "yaw": "$yaw"},
        "over": {"from": "put", "raise": 0.1},
        "turned": {"from": "home", "turn": 0.4, "tilt": 0.2},
        "deep": {"object": "object", "side": "-x", "depth": 0.03},
        "own": {"from": "grasp", "offset": [0.01, -0.02, 0.03]},
        "world": {"from": "grasp", "offset": [0.01, -0.02, -0.03], "along": "world"},
        "of_tray": {"from": "grasp", "offset": [0.01, 0.0, 0.0], "along": "onto"},
        "at_tray": {"pose": {"position": [0, 0, 0.1], "rpy": [np.pi, 0, 0]}, "frame": "tray"},
        "box_at_tray": {"pose": {"position": [0, 0, 0.1]}, "frame": "onto", "of": "object"},
    }
)
HOME = pose(axis_rotation(0, np.pi), (0.3, 0.1, 0.5))
IN_TOOL = pose(axis_rotation(0, 2.0), (0.01, 0.02, 0.15))


def grounder(yaw: float = 0.0, X_WO: np.ndarray | None = None, **X_TO: np.ndarray) -> WaypointGrounder:
    box = SceneObject(name="box", type="thing", size=SIZE, pose=None, parts=())
    tray = SceneObject(name="tray", type="thing", size=TRAY, pose=None, fixed=True, parts=())
    where = {"box": pose() if X_WO is None else X_WO, "tray": pose(axis_rotation(2, 0.7), (0.4, 0.2, 0.01))}
    binding, values = {"object": "box", "onto": "tray"}, {"yaw": yaw, "along": 0.5}
    return WaypointGrounder(WAYPOINTS, binding, values, {"box": box, "tray": tray}, HOME, where, X_TO)


NOWHERE = WaypointGrounder(WAYPOINTS, {"object": "box", "onto": "tray"}, {}, {}, HOME, {}, {"box": IN_TOOL})


def ground(name: str, yaw: float = 0.0, X_WO: np.ndarray | None = None) -> np.ndarray:
    return grounder(yaw, X_WO, box=IN_TOOL).pose(name)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tool_stands_in_the_centre_of_the_side_and_points_into_the_box(axis, sign):
    X_OT = side_pose(SIZE, ("+" if sign > 0 else "-") + "xyz"[axis])
    outward = sign * np.eye(3)[axis]
    np.testing.assert_allclose(X_OT[:3, 3], outward * SIZE[axis] / 2)
    np.testing.assert_allclose(X_OT[:3, 2], -outward)
    np.testing.assert_allclose(X_OT[:3, 0], np.eye(3)[1 if axis == 0 else 0])
    np.testing.assert_allclose(X_OT[:3, :3] @ X_OT[:3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(X_OT[:3, :3]) == pytest.approx(1.0)


def test_yaw_turns_the_tool_about_its_own_axis():
    np.testing.assert_allclose(ground("grasp", 0.5), ground("grasp") @ pose(axis_rotation(2, 0.5)), atol=1e-15)


@pytest.mark.parametrize("side", ["+z", "-x", "+y"])
@pytest.mark.parametrize("yaw", [0.0, 0.5, -np.pi / 2])
def test_a_jaw_that_stands_still_is_beside_the_box_whatever_its_width(side, yaw):
    X_OT, centred = grasp_pose(SIZE, side, yaw, 0.01, 0.002), grasp_pose(SIZE, side, yaw, 0.01)
    corners = transform(inverse(X_OT), box_corners(SIZE))
    assert corners[:, 1].min() == pytest.approx(0.002)
    np.testing.assert_allclose((inverse(centred) @ X_OT)[[0, 2], 3], 0.0, atol=1e-15)  # moved across it alone


def test_retreat_goes_back_along_the_tool_and_raise_goes_up_in_the_world():
    lying = pose(axis_rotation(0, np.pi / 2), (0.5, 0.0, 0.2))  # its +z side now faces -y
    grasp, above, lifted = (ground(name, 0.3, lying) for name in ("grasp", "above", "lifted"))
    np.testing.assert_allclose(grasp[:3, 3], [0.5, -0.15, 0.2], atol=1e-15)
    np.testing.assert_allclose(above[:3, 3], [0.5, -0.17, 0.2], atol=1e-15)
    np.testing.assert_allclose(lifted[:3, 3], [0.5, -0.17, 0.3], atol=1e-15)
    np.testing.assert_array_equal(above[:3, :3], grasp[:3, :3])
    np.testing.assert_array_equal(lifted[:3, :3], grasp[:3, :3])


def test_depth_goes_on_into_the_object():
    np.testing.assert_allclose(ground("deep")[:3, 3], [-0.05 + 0.03, 0.0, 0.0], atol=1e-15)


def test_a_turn_is_about_the_tools_own_axes_and_keeps_its_place():
    turned = ground("turned")
    np.testing.assert_allclose(turned[:3, 3], HOME[:3, 3])
    np.testing.assert_allclose(turned[:3, 0], HOME[:3, :3] @ axis_rotation(2, 0.4)[:, 0], atol=1e-15)  # tilted about x
    assert turned[:3, 2] @ HOME[:3, 2] == pytest.approx(np.cos(0.2))


@pytest.mark.parametrize("yaw", [0.0, 0.5, -2.0])
def test_what_is_put_down_stands_upright_on_the_surface_where_the_tool_leaves_it(yaw):
    tray = grounder().X_WO["tray"]
    X_BO = inverse(tray) @ ground("put", yaw) @ IN_TOOL
    np.testing.assert_allclose(X_BO[:3, :3], axis_rotation(2, yaw), atol=1e-12)
    corners = X_BO[:3, :3] @ (np.array(np.meshgrid(*[(-s / 2, s / 2) for s in SIZE])).reshape(3, -1)) + X_BO[:3, 3:]
    assert corners[2].min() == pytest.approx(TRAY[2] / 2)  # its bottom on the top
    assert corners[1].min() == pytest.approx(-TRAY[1] / 2)  # across -1: flush with the edge
    gaps = TRAY[0] / 2 + corners[0].min(), TRAY[0] / 2 - corners[0].max()
    assert gaps[0] == pytest.approx(3 * gaps[1])  # along 0.5: three quarters of the way
    np.testing.assert_allclose(ground("over", yaw)[:3, 3] - ground("put", yaw)[:3, 3], [0, 0, 0.1], atol=1e-12)


def test_on_something_narrower_it_stands_in_the_middle():
    np.testing.assert_allclose(put_pose(SIZE, (0.05, 0.05, 0.1), 1.0, -1.0, 0.0)[:3, 3], [0.0, 0.0, 0.2])


@pytest.mark.parametrize(("known", "name", "said"), [
        (grounder(), "over", "the tool does not hold `box`"),
        (grounder(), "box_at_tray", "the tool does not hold `box`"),
        (NOWHERE, "lifted", "it is not known where `box` is"),
        (NOWHERE, "over", "it is not known where `tray` is"),
])  # fmt: skip
def test_what_a_waypoint_lacks_is_named_through_others(known, name, said):
    with pytest.raises(UnknownPlaceError, match=said):
        known.pose(name)
    assert all(NOWHERE.pose(other) is not None for other in ("inspect", "turned"))


def test_offsets_go_along_the_axes_that_they_name_down_too():
    X, own, world, of_tray, at_tray, box_at_tray = map(
        ground, ("grasp", "own", "world", "of_tray", "at_tray", "box_at_tray")
    )
    tray = grounder().X_WO["tray"]
    np.testing.assert_allclose(own, X @ pose(position=(0.01, -0.02, 0.03)), atol=1e-15)
    np.testing.assert_allclose(world[:3, 3], X[:3, 3] + [0.01, -0.02, -0.03], atol=1e-15)
    np.testing.assert_allclose(of_tray[:3, 3], X[:3, 3] + 0.01 * tray[:3, 0], atol=1e-15)
    np.testing.assert_allclose(at_tray, tray @ pose(axis_rotation(0, np.pi), (0, 0, 0.1)), atol=1e-15)
    np.testing.assert_allclose(box_at_tray @ IN_TOOL, tray @ pose(position=(0, 0, 0.1)), atol=1e-15)
