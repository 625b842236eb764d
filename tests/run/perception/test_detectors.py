"""The background learned from painted images, what a marker on a finger says, and several cameras on one atom."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.camera.markers import Marker
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.run.image import ImageArray, corners_of
from sqrp_cli.run.perception import detectors
from sqrp_cli.run.perception.detections import BoxDetection, Detection, FusedTruth, fuse
from sqrp_cli.run.perception.detectors import Background, marker_detection
from sqrp_cli.run.perception.vision import FoundMarker
from sqrp_cli.skill.target_box import TargetBox
from tests.run.steps import box

GREY, WHITE, RED, BLUE = (60, 60, 66), (200, 200, 200), (200, 30, 30), (30, 30, 200)
EVERYWHERE = (slice(0, 60), slice(0, 80))


def area(top: int, bottom: int, left: int, right: int) -> Mask:
    mask = np.zeros((60, 80), dtype=bool)
    mask[top:bottom, left:right] = True
    return mask


ROBOT, WATCHED, OTHER = area(0, 60, 20, 60), area(10, 20, 30, 40), area(40, 50, 30, 40)


def painted() -> ImageArray:
    """A grey robot before a white wall; before the robot a red thing, which is watched, and a blue one."""
    image = np.empty((60, 80, 3), dtype=np.uint8)
    for mask, color in ((~ROBOT, WHITE), (ROBOT, GREY), (WATCHED, RED), (OTHER, BLUE)):
        image[mask] = color
    return image


@pytest.mark.parametrize("moving", [False, True])
def test_the_background_is_what_nothing_covers_and_what_stands_before_the_robot_does_not_colour_it(moving) -> None:
    image = painted()
    shown, _, robot_colored = Background(image, ROBOT, WATCHED, OTHER, moving=moving).compared(image, EVERYWHERE, "red")
    assert shown[~ROBOT].all()
    assert not shown[WATCHED].any()
    assert (robot_colored == ROBOT & ~WATCHED & ~OTHER).all()


def test_of_a_moving_camera_the_colours_around_robot_and_objects_are_the_background() -> None:
    image = painted()
    image[0:5, 0:5] = RED  # a movable object of the watched one's colour
    aside = area(0, 5, 0, 5)
    background = Background(image, ROBOT, WATCHED, OTHER | aside, moving=True)
    assert (background.matches(image, EVERYWHERE) == ~ROBOT & ~aside).all()


@pytest.mark.parametrize("moving", [False, True])
def test_a_shade_on_a_background_of_its_colour_has_its_hue(*, moving: bool) -> None:
    image = painted()
    image[50:60, 0:10] = RED
    background = Background(image, ROBOT, WATCHED, OTHER, moving=moving)
    red = area(50, 60, 0, 10)
    assert (background.compared(image, EVERYWHERE, "red")[1] >= red).all()
    shaded = image.copy()
    shaded[50:60, 0:5] = (120, 18, 18)
    told = background.compared(shaded, EVERYWHERE, "red")[1]
    assert told[50:60, 5:10].all()
    assert told[50:60, 0:5].all() != moving  # of a moving camera only the colours themselves are known
    assert not background.compared(shaded, EVERYWHERE, "blue")[1][~OTHER].any()


def test_what_a_watched_thing_covers_is_guessed_again_once_the_robot_has_left_its_surroundings() -> None:
    background = Background(painted(), ROBOT, WATCHED, OTHER, moving=False)
    wall, crop = np.full((60, 80, 3), WHITE, dtype=np.uint8), (slice(5, 25), slice(25, 45))
    wall[:, 20:60] = BLUE
    gone = wall.copy()
    gone[WATCHED] = RED
    background.learn(gone, WATCHED)
    assert not background.matches(wall, crop)[5:15, 5:15].any()
    assert background.compared(wall, crop, "red")[0].all()
    assert not background.matches(gone, crop)[5:15, 5:15].any()


OPEN, CLOSED, SIDE = 100.0, 160.0, 20.0
"""Where the marker's middle is seen along the image's rows with the fingers open and closed, and its side [pixels]."""
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
BOX = TargetBox(
    name="left", detector="aruco", frame="finger", size=(0.02, 0.02, 0.001), X_FB=np.eye(4), normal=None,
    encloses=("finger",),
)  # fmt: skip


def at(column: float, row: float = 50.0) -> FoundMarker:
    return 0, SIDE / 2 * CORNERS + np.array([column, row])


def link_poses(joints: dict[str, float]) -> dict[str, Array]:
    X_WL = np.eye(4)
    X_WL[:2, 3] = joints["finger"], 50.0
    return {"finger": X_WL}


def detected(
    markers: list[FoundMarker], by_encoder: float, *, edge: float = 1000.0, beside: list[FoundMarker] | None = None
) -> BoxDetection:
    """edge: up to where the lens shows anything. beside: the markers that are found beside a part in the way."""
    joints = {"finger": by_encoder}

    def outline(X_WB: Array, _: object) -> SimpleNamespace | None:
        center, square = X_WB[:2, 3], X_WB[:2, 3] + SIDE / 2 * CORNERS
        known = SimpleNamespace(center=center, area=SIDE**2, polygon=square, corners=corners_of(square), depth=1.0)
        return known if center[0] < edge else None

    fingers = SimpleNamespace(open={"finger": OPEN}, closed={"finger": CLOSED})
    robot = SimpleNamespace(fingers=fingers, surfaces=(), link_poses=link_poses, with_fingers=lambda _, other: other)
    sought = SimpleNamespace(targets={"open": SimpleNamespace(boxes=(BOX,))}, when_open={"open": True})
    view: Any = SimpleNamespace(
        image=np.zeros((100, 400, 3), dtype=np.uint8), outline=outline, robot=(), sought=sought,
        pose=lambda box: link_poses(joints)[box.frame], believed=SimpleNamespace(joints=joints),
        marker=lambda *_: Marker(id=0, side=0.02), markers=lambda _: markers, object_of=lambda *_: None,
        crop=lambda *_: (slice(0, 100), slice(0, 400)),
        cell=SimpleNamespace(robot=robot, markers={"finger": Marker(id=0, side=0.02)}),
    )  # fmt: skip
    covered = lambda *_, **__: np.full((100, 400), beside is not None)  # noqa: E731
    with patch.multiple(detectors, find_markers=lambda *_: beside, pieces_mask=covered):
        return marker_detection(view, None, "open", BOX)  # type: ignore[arg-type]


@pytest.mark.parametrize(("seen", "says"), [(OPEN, Truth.TRUE), (OPEN + 10, Truth.TRUE), (CLOSED, Truth.FALSE)])
@pytest.mark.parametrize("by_encoder", [OPEN, CLOSED])
def test_where_the_marker_is_seen_counts_not_where_the_encoder_has_it(
    seen: float, says: Truth, by_encoder: float
) -> None:
    assert detected([at(seen)], by_encoder).evidence is says


@pytest.mark.parametrize("elsewhere", [(20.0, 50.0), (300.0, 50.0), (110.0, 90.0)])
def test_what_looks_like_it_elsewhere_is_not_the_marker(elsewhere: tuple[float, float]) -> None:
    assert detected([at(*elsewhere)], CLOSED).evidence is Truth.UNKNOWN
    assert detected([at(*elsewhere), at(CLOSED)], CLOSED).evidence is Truth.FALSE
    # Nor is it if a part beside it hid it at first.
    assert detected([], CLOSED, beside=[at(*elsewhere)]).evidence is Truth.UNKNOWN
    assert detected([], CLOSED, beside=[at(*elsewhere), at(CLOSED)]).evidence is Truth.FALSE


def test_a_marker_whose_way_ends_out_of_sight_does_not_say_how_far_the_fingers_are_closed() -> None:
    seen, by_encoder, edge = OPEN + 12, OPEN + 15, OPEN + 30
    assert detected([at(seen)], by_encoder, edge=edge).evidence is Truth.UNKNOWN
    assert detected([at(seen)], by_encoder).evidence is Truth.TRUE


def detection(camera: str, *evidence: Truth, frozen: bool = False, t: float = 0.0) -> Detection:
    boxes = tuple(BoxDetection("box", found, 1.0, np.zeros((0, 2))) for found in evidence)
    return Detection(camera, t, frozen, {"held": boxes})


def fused(cameras: int, *detections: Detection) -> FusedTruth:
    return fuse("held", ProgramTarget(cameras=cameras, boxes=(box(),), seen={}), detections)


def test_one_camera_needs_all_boxes_to_confirm_and_one_to_refute() -> None:
    seen, absent, blind = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
    assert detection("a", seen, seen).truth("held") == Truth.TRUE
    assert detection("a", seen, blind).truth("held") == Truth.UNKNOWN
    assert detection("a", blind, absent).truth("held") == Truth.FALSE
    assert detection("a").truth("held") == Truth.UNKNOWN
    assert detection("a", seen, frozen=True).truth("held") == Truth.UNKNOWN


@given(st.lists(st.sampled_from(list(Truth)), max_size=6), st.integers(1, 3))
def test_most_cameras_decide_if_they_are_as_many_as_needed(votes: list[Truth], needed: int) -> None:
    yes, no = votes.count(Truth.TRUE), votes.count(Truth.FALSE)
    found = fused(needed, *(detection(str(i), vote) for i, vote in enumerate(votes))).truth
    assert (found == Truth.TRUE) == (yes >= needed and yes > no)
    assert (found == Truth.FALSE) == (no >= needed and no > yes)


def test_cameras_that_contradict_each_other_at_the_same_time_are_a_conflict() -> None:
    assert fused(1, detection("a", Truth.TRUE), detection("b", Truth.FALSE)).conflict
    assert not fused(1, detection("a", Truth.TRUE), detection("b", Truth.UNKNOWN)).conflict
    later = fused(1, detection("a", Truth.TRUE), detection("b", Truth.FALSE, t=0.1))
    assert not later.conflict
    assert later.votes == {"a": Truth.TRUE, "b": Truth.FALSE}
