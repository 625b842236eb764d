"""What a marker on a finger says: only where the fingers can carry it, whatever else looks like it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from sqrp_cli.camera.markers import Marker
from sqrp_cli.files.frames import FrameName
from sqrp_cli.geometry import Array
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception import detectors
from sqrp_cli.run.perception.detections import BoxDetection
from sqrp_cli.run.perception.detectors import marker_detection
from sqrp_cli.run.perception.vision import Crop, FoundMarker, corners_of
from sqrp_cli.skill.target_box import TargetBox

OPEN, CLOSED, SIDE = 100.0, 160.0, 20.0
"""Where the marker's middle is seen along the image's rows with the fingers open and closed, and its side [pixels]."""
CORNERS = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
BOX = TargetBox(
    name="left", detector="aruco", frame=FrameName("finger"), size=(0.02, 0.02, 0.001), X_FB=np.eye(4), normal=None,
    encloses=("finger",),
)  # fmt: skip


def at(column: float, row: float = 50.0) -> FoundMarker:
    return FoundMarker(0, SIDE / 2 * CORNERS + np.array([column, row]))


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
        center = X_WB[:2, 3]
        square = center + SIDE / 2 * CORNERS
        known = SimpleNamespace(center=center, area=SIDE**2, polygon=square, corners=corners_of(square), depth=1.0)
        return known if center[0] < edge else None

    robot = SimpleNamespace(
        fingers=SimpleNamespace(open={"finger": OPEN}, closed={"finger": CLOSED}), surfaces=(), link_poses=link_poses,
        with_fingers=lambda _, fingers: fingers,
    )  # fmt: skip
    view: Any = SimpleNamespace(
        image=np.zeros((100, 400, 3), dtype=np.uint8), outline=outline,
        robot=(),
        pose=lambda box: link_poses(joints)[box.frame], believed=SimpleNamespace(joints=joints),
        marker=lambda *_: Marker(id=0, side=0.02), markers=lambda _: markers,
        crop=lambda *_: Crop.whole(100, 400),
        object_of=lambda *_: None, cell=SimpleNamespace(robot=robot, markers={"finger": Marker(id=0, side=0.02)}),
        sought=SimpleNamespace(
            targets={"open": SimpleNamespace(boxes=(BOX,))}, when_open={"open": True}
        ),
    )  # fmt: skip
    background: Any = None
    covered = lambda *_, **__: np.full((100, 400), beside is not None)  # noqa: E731
    with patch.multiple(detectors, find_markers=lambda *_: beside, pieces_mask=covered):
        return marker_detection(view, background, "open", BOX)


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
