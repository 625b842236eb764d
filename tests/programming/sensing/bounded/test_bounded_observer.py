"""What cameras surely and possibly see within bounds of their poses, against the exact verdicts from drawn poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import Array, Mask, displacement, look_at, pose
from sqrp_cli.knowledge.camera.camera import Camera, DistortionModel
from sqrp_cli.knowledge.camera.detector import Detector
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.observer import BoundedObserver
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates, fixed_frame
from sqrp_cli.programming.solids import Solid, load_solid
from sqrp_cli.programming.targets import SoughtBox, Target
from sqrp_cli.shapes import Cylinder, Part
from tests.programming.sensing.views import box_part, make_box, make_camera, make_detector, random_rotation

STATES, DRAWS = 200, 18

SMALL, LARGE = PoseBounds(0.002, np.radians(0.2)), PoseBounds(0.03, np.radians(3.0))

LENSES: dict[DistortionModel, tuple[float, ...]] = {
    "none": (),
    "plumb_bob": (-0.28, 0.09, 0.002, -0.001, -0.01),
    "rational_polynomial": (0.2, 0.05, -0.001, 0.002, 0.01, 0.45, 0.1, 0.01),
    "equidistant": (-0.02, 0.01, -0.005, 0.001),
}


def occluders() -> list[Solid]:
    """A post, a bar and a tilted board between camera and boxes."""
    tilted = pose(random_rotation(np.random.default_rng(2)), (0.1, 0.05, 0.75))
    return [
        load_solid(Part("post", "world", Cylinder(0.02, 0.6), pose(None, (-0.05, 0.0, 0.6)))),
        load_solid(box_part("bar", (0.7, 0.012, 0.012), pose(None, (0.0, -0.08, 0.5)))),
        load_solid(box_part("board", (0.2, 0.15, 0.004), tilted)),
    ]


def observed(observer: Observer, box: SoughtBox, X_WB: Array) -> Mask:
    """Whether the camera sees the box at each of its poses."""
    states = SceneStates(len(X_WB), {"world": fixed_frame(), "thing": X_WB})
    target = Target(Atom("seen", ()), 1, (box,))
    return observer.coverage([target], states, [np.arange(len(X_WB))])[0].covered


def poses_of_boxes(seed: int, spread: float) -> Array:
    """Boxes about 1 m before a camera, all over its image and a little beyond, turned at random."""
    random = np.random.default_rng(seed)
    places = random.uniform((-spread, -0.75 * spread, 0.8), (spread, 0.75 * spread, 1.3), (STATES, 3))
    return np.stack([pose(random_rotation(random), place) for place in places])


def moved(camera: Camera, bounds: PoseBounds, draw: int) -> Camera:
    """The camera as far off as it may be, in random directions; in every third draw anywhere in between."""
    random = np.random.default_rng(draw)
    errors = [error / np.linalg.norm(error) for error in random.normal(size=(2, 3))]
    shares = random.uniform(size=2) if draw % 3 == 0 else np.ones(2)
    error = displacement(bounds.position * shares[0] * errors[0], bounds.rotation * shares[1] * errors[1])
    return replace(camera, X_FC=camera.X_FC @ error)


def decided_share(camera: Camera, solids: Sequence[Solid], box: SoughtBox, X_WB: Array, bounds: PoseBounds) -> float:
    """How much is decided, after a look from many poses that nothing decided is otherwise from any of them."""
    sure, possible = (
        observed(BoundedObserver((camera,), tuple(solids), bounds=bounds, surely=surely), box, X_WB)
        for surely in (True, False)
    )
    for draw in range(DRAWS):
        seen = observed(Observer((moved(camera, bounds, draw),), tuple(solids)), box, X_WB)
        assert not (sure & ~seen).any(), f"sees less than surely from draw {draw}"
        assert not (seen & ~possible).any(), f"sees more than possibly from draw {draw}"
    return float((sure | ~possible).mean())


@pytest.mark.parametrize("bounds", [SMALL, LARGE], ids=["small", "large"])
@pytest.mark.parametrize("model", LENSES)
@pytest.mark.parametrize(
    "detector",
    [
        make_detector(),
        make_detector(max_incidence=np.radians(60)),
        make_detector(distance=(0.9, 1.2)),
        make_detector(min_pixels=30.0),
    ],
    ids=["image", "oblique", "range", "small"],
)
def test_no_pose_breaks_what_is_decided_by_limits(
    model: DistortionModel, detector: Detector, bounds: PoseBounds
) -> None:
    camera = make_camera(model=model, distortion=LENSES[model], focal=(500.0, 520.0), near=0.85, far=1.25)
    box = make_box((0.05, 0.05, 0.001), frame="thing", detector=detector, normal=(0.0, 0.0, 1.0))
    share = decided_share(camera, [], box, poses_of_boxes(1, 0.75), bounds)
    assert share > (0.85 if bounds is SMALL else 0.2)


@pytest.mark.parametrize("bounds", [SMALL, LARGE], ids=["small", "large"])
@pytest.mark.parametrize("least", [1.0, 0.5])
@pytest.mark.parametrize("size", [(0.06, 0.05, 0.04), (0.12, 0.03, 0.001)], ids=["block", "strip"])
def test_no_pose_breaks_what_is_decided_of_hidden_boxes(
    size: tuple[float, float, float], least: float, bounds: PoseBounds
) -> None:
    camera = make_camera(look_at((0.02, 0.03, 0.0), (0.0, 0.0, 1.0), up=(0.0, -1.0, 0.0)), focal=(400.0, 400.0))
    box = make_box(size, frame="thing", detector=make_detector(least), normal=(0.0, 0.0, 1.0))
    share = decided_share(camera, occluders(), box, poses_of_boxes(2, 0.35), bounds)
    assert share > (0.8 if bounds is SMALL else 0.1)


def test_little_more_of_shares_is_left_open_than_what_poses_change() -> None:
    """A wall midway, whose edge moves before the boxes, and a board close to them, which hardly moves."""
    camera = make_camera(focal=(400.0, 400.0))
    box = make_box((0.06, 0.05, 0.04), frame="thing", detector=make_detector(0.5))
    wall = load_solid(box_part("wall", (0.4, 0.4, 0.01), pose(None, (0.306, 0.0, 0.5))))
    board = load_solid(box_part("board", (0.01, 0.2, 0.01), pose(None, (0.171, 0.0, 0.9))))
    X_WB = np.stack([pose(None, (x, 0.0, 1.0)) for x in np.linspace(0.185, 0.215, 100)])
    sure, possible = (
        observed(BoundedObserver((camera,), (wall, board), bounds=SMALL, surely=surely), box, X_WB)
        for surely in (True, False)
    )
    seen = np.stack([observed(Observer((moved(camera, SMALL, draw),), (wall, board)), box, X_WB) for draw in range(60)])
    assert not (sure & ~seen).any()
    assert not (seen & ~possible).any()
    changed = seen.any(axis=0) & ~seen.all(axis=0)
    assert changed.sum() > 10
    assert (possible & ~sure).sum() < 2.5 * changed.sum()


@pytest.mark.parametrize("bounds", [SMALL, LARGE], ids=["small", "large"])
def test_no_pose_breaks_what_is_decided_before_backgrounds(bounds: PoseBounds) -> None:
    """Green posts, a green wall and a grey board before it, behind and beside what is green."""
    camera = make_camera(focal=(400.0, 400.0))
    box = replace(make_box(frame="thing", detector=make_detector(0.5)), seeks="cube", color="green")
    posts = [load_solid(box_part(f"post {x}", (0.05, 2.0, 0.05), pose(None, (x, 0.0, 1.8)))) for x in (-0.3, 0.0, 0.3)]
    wall = load_solid(box_part("wall", (1.0, 0.5, 0.01), pose(None, (0.6, 0.0, 2.5))))
    board = load_solid(box_part("board", (0.2, 2.0, 0.01), pose(None, (0.3, 0.1, 2.0))))
    painted = [*(replace(solid, color="green") for solid in [*posts, wall]), replace(board, color="grey")]
    share = decided_share(camera, [*painted, *occluders()], box, poses_of_boxes(4, 0.35)[:80], bounds)
    assert share > (0.6 if bounds is SMALL else 0.05)


@pytest.mark.parametrize("least", [1.0, 0.5])
def test_nothing_is_undecided_of_a_camera_that_is_where_it_should_be(least: float) -> None:
    camera, solids = make_camera(focal=(400.0, 400.0)), tuple(occluders())
    box, X_WB = make_box(frame="thing", detector=make_detector(least)), poses_of_boxes(3, 0.35)
    seen = observed(Observer((camera,), solids), box, X_WB)
    sure, possible = (
        observed(BoundedObserver((camera,), solids, bounds=PoseBounds(0.0, 0.0), surely=surely), box, X_WB)
        for surely in (True, False)
    )
    # Shares so close to the limit that counting rays does not decide stay open.
    assert (sure <= seen).all()
    assert (seen <= possible).all()
    assert (possible & ~sure).sum() <= (0 if least == 1.0 else 0.03 * STATES)
