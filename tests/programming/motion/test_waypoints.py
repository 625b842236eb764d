"""Waypoints, by hand and by their laws."""

from __future__ import annotations

import numpy as np
import pytest

from sqrp_cli.geometry import axis_rotation, pose
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill import GraspWaypoint, PoseWaypoint, RaiseWaypoint, Reference, RetreatWaypoint
from sqrp_cli.programming.motion.waypoints import ground_waypoint, needed_objects, side_pose

SIZE = (0.1, 0.2, 0.3)
WAYPOINTS = {
    "grasp": GraspWaypoint("object", "+z", Reference("yaw")),
    "above": RetreatWaypoint("grasp", 0.02),
    "lifted": RaiseWaypoint("above", 0.1),
    "inspect": PoseWaypoint(pose(position=(1.0, 2.0, 3.0))),
}


def ground(name: str, yaw: float = 0.0, X_WO: np.ndarray | None = None) -> np.ndarray:
    thing = SceneObject("box", "thing", None, (), SIZE, None, False, None, None, ())
    where = pose() if X_WO is None else X_WO
    return ground_waypoint(WAYPOINTS[name], WAYPOINTS, {"object": "box"}, {"yaw": yaw}, {"box": thing}, {"box": where})


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tool_stands_in_the_centre_of_the_side_and_points_into_the_box(axis: int, sign: float) -> None:
    X_OT = side_pose(SIZE, ("+" if sign > 0 else "-") + "xyz"[axis])
    outward = sign * np.eye(3)[axis]
    np.testing.assert_allclose(X_OT[:3, 3], outward * SIZE[axis] / 2)
    np.testing.assert_allclose(X_OT[:3, 2], -outward)
    np.testing.assert_allclose(X_OT[:3, 0], np.eye(3)[1 if axis == 0 else 0])
    np.testing.assert_allclose(X_OT[:3, :3] @ X_OT[:3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(X_OT[:3, :3]) == pytest.approx(1.0)


def test_yaw_turns_the_tool_about_its_own_axis() -> None:
    np.testing.assert_allclose(ground("grasp", 0.5), ground("grasp") @ pose(axis_rotation(2, 0.5)), atol=1e-15)


def test_retreat_goes_back_along_the_tool_and_raise_goes_up_in_the_world() -> None:
    lying = pose(axis_rotation(0, np.pi / 2), (0.5, 0.0, 0.2))  # its +z side now faces -y
    grasp, above, lifted = (ground(name, 0.3, lying) for name in ("grasp", "above", "lifted"))
    np.testing.assert_allclose(grasp[:3, 3], [0.5, -0.15, 0.2], atol=1e-15)
    np.testing.assert_allclose(above[:3, 3], [0.5, -0.17, 0.2], atol=1e-15)
    np.testing.assert_allclose(lifted[:3, 3], [0.5, -0.17, 0.3], atol=1e-15)
    np.testing.assert_array_equal(above[:3, :3], grasp[:3, :3])
    np.testing.assert_array_equal(lifted[:3, :3], grasp[:3, :3])


def test_a_waypoint_needs_the_objects_that_it_refers_to_through_others() -> None:
    assert needed_objects("lifted", WAYPOINTS, {"object": "box"}) == {"box"}
    assert needed_objects("inspect", WAYPOINTS, {"object": "box"}) == frozenset()
