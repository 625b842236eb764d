"""When images show that a part is lost, against the detector on painted images, one displacement after the other."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sqrp_cli.camera.detector import SHIFT_PIXELS, SHIFT_SHARE, Detector
from sqrp_cli.camera.projection import Projection
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, pose, rpy_to_matrix
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception.detectors import Background, color_detections
from sqrp_cli.run.perception.projected import ExpectedView, PosedCamera, ProjectedObject, pieces_mask
from sqrp_cli.run.perception.vision import color_mask, filled
from sqrp_cli.run.robot_body import Surface
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox
from sqrp_cli.skill.target_box import TargetBox
from sqrp_cli.study.drop_detection import SURE, USUAL, SeenOffset, majority_time, may_judge
from tests.run.cell.scenes import camera, thing

Size = tuple[float, float, float]

EYES = [camera("low", (4.9, 0.1, 0.45), (4.0, 0.0, 0.2)), camera("high", (4.2, 0.4, 0.9), (4.0, 0.0, 0.2))]
NEAR = camera("near", (4.4, 0.0, 0.2), (4.0, 0.0, 0.2))
SIZES = [(0.02, 0.02, 0.06), (0.05, 0.03, 0.04)]
LIMITS = Detector(kind="color", distance=(0.1, 3.0), max_incidence=1.5, min_pixels=12.0)
HELD = np.array([4.0, 0.0, 0.2])
STEPS = 24
"""Displacements along each way."""
WAYS = [(0.0, 0.0, -1.0), (0.3, 0.5, -0.8), (0.0, 1.0, 0.0)]


class Painted:
    """What one camera shows of a green box wherever it is, before grey, and of a dark tool that may stand before it."""

    def __init__(self, eye: Any, size: tuple[float, float, float], tool: tuple[Array, Size] | None = None) -> None:
        """tool: where its middle is, and its size."""
        self.size, self.eye = size, eye
        self.object = thing("part", (4.0, 0.0, 0.02), size, color="green")
        self.posed = PosedCamera(Projection(eye), eye.X_FC)
        self._surface = [Surface.of(part) for part in self.object.parts]
        self._tool = []
        if tool is not None:
            surfaces = [Surface.of(part) for part in thing("tool", (0.0, 0.0, 0.0), tool[1]).parts]
            self._tool = self.posed.silhouette(surfaces, {surfaces[0].parent: pose(np.eye(3), tool[0])})

    def projected(self, X_WO: Array) -> ProjectedObject:
        box = self.posed.outline(X_WO, self.size)
        assert box is not None
        return ProjectedObject.of(box, self.posed.silhouette(self._surface, {p.parent: X_WO for p in self._surface}))

    def says_of_held(self, boxes: list[TargetBox], X_WO: Array, min_visible: float = 0.5) -> Truth:
        """What the detector says of the first of some boxes, that the part is in it, when it is at a pose."""
        plain = np.full((self.eye.height, self.eye.width, 3), 128, dtype=np.uint8)
        image = plain.copy()
        image[filled(self.posed.whole, [self.projected(X_WO).box.corners])] = (0, 200, 0)
        image[pieces_mask(self.posed.whole, self._tool)] = 20
        nothing = np.zeros(plain.shape[:2], dtype=bool)
        view: Any = SimpleNamespace(
            image=image, whole=self.posed.whole, camera=self.eye, projection=self.posed.projection,
            X_WC=self.posed.X_WC, robot=self._tool,
            believed=SimpleNamespace(holding=True, X_WO={}), pose=lambda box: box.X_FB,
            cell=SimpleNamespace(objects={}, detectors={"color": SimpleNamespace(min_visible=min_visible)}),
            X_WL={"tool": np.eye(4)}, projected=lambda _, X: self.projected(X), colored=partial(color_mask, image),
        )  # fmt: skip
        view.crop = lambda polygon, margin: ExpectedView.crop(view, polygon, margin)
        background = Background(plain, nothing, nothing, nothing, moving=False)
        return color_detections(view, background, self.object, boxes)[0][0].evidence

    def visible(self, X_WO: Array) -> float:
        """The share of the part's silhouette that the tool does not hide."""
        part = filled(self.posed.whole, [self.projected(X_WO).box.corners])
        return 1.0 - float((part & pieces_mask(self.posed.whole, self._tool)).sum() / part.sum())


def turned(at: Array) -> Array:
    X_WO = np.eye(4)
    X_WO[:3, :3], X_WO[:3, 3] = rpy_to_matrix((0.2, 0.1, 0.7)), at
    return X_WO


def box_at(name: str, X_WB: Array, size: tuple[float, float, float]) -> TargetBox:
    frame = "tool" if name == "tool" else "world"
    return TargetBox(name=name, detector="color", frame=frame, size=size, X_FB=X_WB, normal=None, encloses=())


@pytest.mark.parametrize("eye", EYES, ids=lambda eye: eye.name)
@pytest.mark.parametrize("size", SIZES)
def test_from_when_on_a_part_counts_as_seen_lost_the_detector_says_so(eye: Any, size: tuple[float, ...]) -> None:
    painted, between, late = Painted(eye, size), 0, []  # type: ignore[arg-type]
    X_WH, far = turned(HELD), 2.2 * np.linalg.norm(size)
    for way in np.array(WAYS) / np.linalg.norm(WAYS, axis=1)[:, None]:
        free = HELD + np.linspace(0.0, far, STEPS)[:, None] * way
        X_WR = turned(HELD + 0.4 * max(size) * way)
        tool, rest = box_at("tool", X_WH, size), box_at("rest", X_WR, size)  # type: ignore[arg-type]
        eyes, focal = eye.X_FC[:3, 3].reshape(3, 1, 1), np.array([(eye.matrix[0, 0] * eye.matrix[1, 1]) ** 0.5])

        def offset(X_WB: Array) -> SeenOffset:
            """From where the tool or a place would show the part."""
            expected, way = X_WB[:3, 3].reshape(3, 1, 1), free.T[:, None]  # noqa: B023
            return SeenOffset.of(expected, way, eyes, focal, X_WB[None, :3, :3], np.array(size))  # noqa: B023

        held = offset(X_WH)
        apart, clear = (margin[0] >= 0 for margin in held.gone(SURE))
        there = offset(rest.X_FB).fills(SURE)[0] >= 0
        poses = [turned(at) for at in free]
        alone = np.array([painted.says_of_held([tool], X) is Truth.FALSE for X in poses])
        assert clear.any() and alone[clear].all()  # noqa: PT018
        assert (apart & there).any()
        shown = (poses[i] for i in np.flatnonzero(clear | (apart & there)))
        assert {painted.says_of_held([tool, rest], X) for X in shown} == {Truth.FALSE}
        between += int((apart & ~alone).sum())
        late.append((alone.argmax() - clear.argmax()) / STEPS)
    assert between, "apart is not enough: in between the detector calls it neither held nor gone"
    assert min(late) >= -0.2, "the bound is close to what the detector really needs"


@pytest.mark.parametrize("hidden", [0.3, pytest.param(0.5, marks=pytest.mark.trial), 0.7])
@pytest.mark.parametrize("size", SIZES)
def test_a_part_must_fall_as_far_whatever_its_tool_hides_of_it(size: Size, hidden: float) -> None:
    depth, width, height = size
    before_it = HELD + np.array([0.6 * depth, 0.0, 0.5 * height])
    painted = Painted(NEAR, size, (before_it, (0.1 * depth, hidden * width, 0.5 * height)))
    X_WH = pose(np.eye(3), HELD)
    boxes = [box_at("tool", X_WH, size), box_at("rest", pose(np.eye(3), HELD - (0, 0, 0.1 * height)), size)]
    falls = np.linspace(0.0, 0.5 * height, 120)
    fallen = ((fall, pose(np.eye(3), HELD - (0, 0, fall))) for fall in falls)
    first = next(fall for fall, X_WO in fallen if painted.says_of_held(boxes, X_WO) is Truth.FALSE)
    outline = painted.projected(X_WH).box
    along = np.ptp(outline.polygon, axis=0)[1] / height  # pixels of a metre
    usual, sure = (rule.pixels + rule.share * outline.area**0.5 for rule in (USUAL, SURE))
    seen = first * along
    assert SHIFT_PIXELS + SHIFT_SHARE * outline.area**0.5 - 0.5 <= seen <= sure
    assert seen == pytest.approx(usual, abs=1.0)  # the detector measures by whole pixels


@pytest.mark.parametrize("min_visible", [0.45, pytest.param(0.5, marks=pytest.mark.trial), 0.9])
@pytest.mark.parametrize("size", SIZES)
def test_cameras_count_that_judge_a_part_though_too_much_is_hidden(size: Size, min_visible: float) -> None:
    depth, width, height = size
    X_WH, limits = pose(np.eye(3), HELD), replace(LIMITS, min_visible=min_visible)
    box = SoughtBox(
        name="tool", detector="color", frame=WORLD, size=size, X_FB=X_WH, normal=None, encloses=(),
        limits=limits.judging,
    )  # fmt: skip
    states = SceneStates(1, {WORLD: np.eye(4)[None]})
    uncovered = 0
    for hidden in np.linspace(0.0, 0.9, 46):
        before_it = HELD + np.array([0.6 * depth, 0.0, 0.5 * (1.0 - hidden) * height])
        painted = Painted(NEAR, size, (before_it, (0.1 * depth, 2.0 * width, hidden * height)))
        if painted.says_of_held([box_at("tool", X_WH, size)], X_WH, min_visible) is Truth.UNKNOWN:
            continue
        visible = painted.visible(X_WH)
        cause = Cause.HIDDEN if visible < box.limits.min_visible else Cause.NONE
        one = np.ones((1, 1))
        verdicts = BoxVerdicts((cause * one).astype(np.int8), one.astype(int), one, visible * one)
        assert may_judge(box, verdicts, [NEAR], states).all()
        uncovered += visible < min_visible
    assert uncovered


def test_cameras_show_what_more_of_them_say_than_deny() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        cameras, needed = int(rng.integers(1, 6)), int(rng.integers(1, 3))
        until = rng.integers(0, 20, (cameras, 3)).astype(float)
        since = until + rng.integers(0, 10, (cameras, 3))
        for column, found in enumerate(majority_time(until, since, needed)):
            agreed = (
                t
                for t in np.arange(30.0)
                if (since[:, column] <= t).sum() > (until[:, column] > t).sum()
                and (since[:, column] <= t).sum() >= needed
            )
            assert found == next(agreed, np.inf)
