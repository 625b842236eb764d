"""What is before a part or beside the lens, by rays; things count by what they show, as the simulator draws them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import Array, Mask, inverse, pose, read_only, rpy_to_matrix, transform
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.perception.projected import (
    LEAST_DEPTH,
    TOUCH,
    PosedCamera,
    ProjectedObject,
    pieces_mask,
)
from sqrp_cli.run.perception.vision import color_mask, dilated, filled
from sqrp_cli.run.robot_body import Surface
from sqrp_cli.shapes import Box, Mesh, Part, surface
from tests.run.cell.scenes import camera, thing
from tests.run.perception.detector_limits import GROUND, SCREEN, Stage, staged

SIZE = np.array([0.04, 0.05, 0.06])
EYE = camera("near", (4.3, 0.4, 0.5), (4.0, 0.0, 0.02))
AROUND = (slice(-100, EYE.height + 100), slice(-100, EYE.width + 100))
VIEW = PosedCamera(Projection(EYE), EYE.X_FC)


def hides_some(points_B: Array, eye_B: Array) -> bool:
    """Whether a ray from the lens through one of some points, (n, 3) [m], goes on into the box, less what may touch."""
    along, half = points_B - eye_B, SIZE / 2 - TOUCH
    at_faces = (np.stack([-half, half]) - eye_B)[:, None] / along
    first, last = at_faces.min(axis=0).max(axis=1), at_faces.max(axis=0).min(axis=1)
    return bool((last > np.maximum(first, 1.0)).any())


@pytest.mark.parametrize("seed", range(20))
def test_what_is_taken_to_be_behind_a_box_hides_none_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    X_WB = pose(rpy_to_matrix(random.uniform(-np.pi, np.pi, 3)), np.array([4.0, 0.0, 0.05]))
    box, eye_B = VIEW.outline(X_WB, SIZE.tolist()), transform(inverse(X_WB), VIEW.X_WC[:3, 3])
    shares = random.dirichlet(np.ones(3), size=200)
    mended = 0
    for _ in range(100):
        middle = random.uniform(-0.06, 0.06, 3)
        corners_B = middle + random.uniform(-0.03, 0.03, (3, 3))
        corners_W = transform(X_WB, corners_B)
        piece = Surface("finger", corners_W, np.array([[0, 1, 2]]))
        parts = VIEW.silhouette([piece], {"finger": np.eye(4)}, beyond=True)
        before, behind = (pieces_mask(AROUND, parts, box, behind=behind).any() for behind in (False, True))
        assert before != behind
        if before:
            continue
        nearer = transform(inverse(VIEW.X_WC), corners_W)[:, 2].mean() < box.depth
        mended += nearer
        if nearer:  # a piece that is farther with its middle may still reach before the box
            assert not hides_some(shares @ corners_B, eye_B)
    assert mended > 0


WIDE = camera("beside", (0.3, 0.4, 0.5), (0.0, 0.0, 0.0), size=(160, 120), focal=(150.0, 150.0))
WIDE_VIEW = PosedCamera(Projection(WIDE), WIDE.X_FC)
FINE = 5
"""Rays across a pixel: what a link shows may be thinner."""


def met(X_CP: Array, size: Array) -> Mask:
    """The pixels of which any ray meets a box at a pose before the optical frame."""
    v, u = (np.mgrid[: WIDE.height * FINE, : WIDE.width * FINE] + 0.5) / FINE - 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(WIDE.matrix).T
    X_PC = inverse(X_CP)
    start, steps = transform(X_PC, np.zeros((1, 3)))[0], rays @ X_PC[:3, :3].T
    sides = (0.5 * np.stack([-size, size])[:, None, None] - start) / steps
    first, last = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    meets = last > np.maximum(first, LEAST_DEPTH)
    return meets.reshape(WIDE.height, FINE, WIDE.width, FINE).any(axis=(1, 3))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (1, 2))])
def test_a_link_that_reaches_behind_the_camera_still_hides_what_is_behind_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    found = 0
    for _ in range(40):
        size = random.uniform((0.05, 0.05, 0.6), (0.2, 0.2, 1.6))
        X_CP = pose(rpy_to_matrix(random.uniform(-np.pi, np.pi, 3)), random.uniform(-0.4, 0.4, 3))
        corners = transform(X_CP, 0.5 * size * np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T)
        around = (np.abs(inverse(X_CP)[:3, 3]) < size / 2 + 0.02).all()
        if around or not corners[:, 2].min() < 0 < corners[:, 2].max() or not (shown := met(X_CP, size)).any():
            continue
        shape = Box(tuple(size.tolist()))
        drawn = surface(shape, 4, enclosing=False)
        whole = Surface.of(Part("link/0", "link", shape, pose()))
        for solid in (whole, Surface("link", drawn.vertices, drawn.faces)):
            mask = pieces_mask(WIDE_VIEW.whole, WIDE_VIEW.silhouette([solid], {"link": WIDE.X_FC @ X_CP}))
            assert not (mask & ~dilated(shown, 1)).any()
            assert not (shown & ~dilated(mask, 1)).any()
        found += 1
    assert found > 1


PLACE = np.array([4.0, 0.0, 0.02])
AWAY = pose(position=(4.0, -6.0, 0.5))
EYES = [
    camera("near", (4.3, 0.4, 0.5), (4.0, 0.0, 0.02)),
    camera("low", (4.9, -0.2, 0.25), (4.02, 0.0, 0.05)),
    camera("steep", (4.1, 0.1, 0.7), (4.0, 0.03, 0.0)),
    camera("lens", (3.6, 0.3, 0.5), (4.05, 0.05, 0.0), lens=("plumb_bob", (-0.25, 0.08, 0.001, 0.001, 0.0))),
]


def made_of(size: tuple[float, float, float], *boxes: tuple[tuple[float, float, float], tuple[float, float, float]]):
    """A thing of boxes, each with its full extents and its middle."""
    parts = [Part(f"part/{i}", "part", Box(each), read_only(pose(position=at))) for i, (each, at) in enumerate(boxes)]
    return replace(thing("part", PLACE, size, color="green"), parts=tuple(parts))


CUBE = made_of((0.04, 0.04, 0.04), ((0.04, 0.04, 0.04), (0, 0, 0)))
TEE = made_of((0.06, 0.04, 0.04), ((0.06, 0.04, 0.004), (0, 0, -0.018)), ((0.006, 0.04, 0.036), (0, 0, 0.002)))
ANGLE = made_of(
    (0.04, 0.04, 0.04), ((0.04, 0.04, 0.003), (0, 0, -0.0185)), ((0.003, 0.04, 0.037), (-0.0185, 0, 0.0015))
)


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> SceneObject:
    """A ring of 6 cm that stands upright, by a mesh."""
    hoop = trimesh.creation.annulus(0.024, 0.030, 0.03)
    hoop.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1.0, 0.0, 0.0)))
    file: Path = tmp_path_factory.mktemp("ring") / "ring.stl"
    hoop.export(file)
    part = Part("part", "part", Mesh(file), read_only(pose()))
    return replace(thing("part", PLACE, (0.06, 0.03, 0.06), color="green"), parts=(part,))


@pytest.fixture(scope="module", params=["cube", "tee", "angle", "ring"])
def stage(request: pytest.FixtureRequest, ring: SceneObject) -> Iterator[Stage]:
    part = {"cube": CUBE, "tee": TEE, "angle": ANGLE, "ring": ring}[request.param]
    with staged([GROUND, part, SCREEN], EYES) as made:
        made.put("screen", AWAY)
        yield made


def projected(stage: Stage, eye: Camera, X_WO: np.ndarray) -> ProjectedObject:
    view = PosedCamera(Projection(eye), eye.X_FC)
    box = view.outline(X_WO, stage.knowledge.objects["part"].size)
    assert box is not None
    return ProjectedObject.of(box, view.silhouette(stage.knowledge.surfaces["part"], {"part": X_WO}, beyond=True))


@pytest.mark.parametrize("eye", EYES, ids=lambda eye: eye.name)
def test_a_silhouette_is_what_the_simulator_draws(stage: Stage, eye: Camera) -> None:
    random = np.random.default_rng(1)
    for trial in range(5):
        X_WO = pose(rpy_to_matrix(random.uniform(-np.pi, np.pi, 3)), PLACE + np.array([0.0, 0.0, 0.06]))
        stage.put("part", X_WO)
        drawn = color_mask(stage.frame(eye.name, trial).image, "green")
        found = projected(stage, eye, X_WO)
        mask = found.mask((slice(0, eye.height), slice(0, eye.width)))
        assert drawn.sum() > 300
        assert not (mask & ~dilated(drawn, 1)).any()
        assert not (drawn & ~dilated(mask, 1)).any()
        rim = dilated(mask, 1) & dilated(~mask, 1)
        assert abs(found.area - drawn.sum()) <= 0.5 * rim.sum()


def test_a_box_is_its_own_silhouette() -> None:
    with staged([GROUND, CUBE], EYES) as stage:
        found, whole = projected(stage, EYES[0], pose(position=PLACE)), (slice(0, 480), slice(0, 640))
        np.testing.assert_array_equal(found.mask(whole), filled(whole, [found.box.corners]))
        assert found.area == found.box.area
        assert (found.offset == 0.0).all()


@pytest.mark.parametrize("eye", EYES, ids=lambda eye: eye.name)
def test_what_is_there_is_seen_and_what_is_gone_is_not(stage: Stage, eye: Camera) -> None:
    height = stage.knowledge.objects["part"].size[2] / 2
    here = pose(rpy_to_matrix((0.0, 0.0, 0.4)), (4.0, 0.0, height))
    there, gone = stage.look(eye, "part", here, {"part": here}, {"part": AWAY})
    assert (there.evidence, gone.evidence) == (Truth.TRUE, Truth.FALSE)
    assert min(there.share, gone.share) > 0.7


def test_a_background_of_its_colour_does_not_prove_that_it_is_gone() -> None:
    here = pose(rpy_to_matrix((0.0, 0.0, 0.4)), (4.0, 0.0, 0.02))
    with staged([replace(GROUND, color="green"), CUBE, SCREEN], EYES) as stage:
        stage.put("screen", AWAY)
        for eye in EYES:
            _, gone = stage.look(eye, "part", here, {"part": here}, {"part": AWAY})
            assert (gone.evidence, gone.because) == (Truth.UNKNOWN, "same colour behind"), eye.name


def test_what_has_tipped_over_is_still_there(stage: Stage) -> None:
    here, tipped = pose(position=PLACE), pose(rpy_to_matrix((np.pi / 2, 0.0, 0.2)), PLACE)
    sights = [stage.look(eye, "part", here, {"part": here}, {"part": tipped})[1] for eye in EYES]
    assert all(sight.evidence is Truth.TRUE for sight in sights)


FRONT, ON_EDGE = camera("front", (4.0, 0.8, 0.03), (4.0, 0.0, 0.03)), pose(position=(4.0, 0.0, 0.03))


def test_a_hidden_part_is_not_judged_by_the_hole_that_is_seen(ring: SceneObject) -> None:
    """A screen hides the ring but for its hole: the background in that is evidence of nothing."""
    plates = [((0.1, 0.002, 0.03), (0, 0, sign * 0.029)) for sign in (-1, 1)]
    plates += [((0.03, 0.002, 0.028), (sign * 0.029, 0, 0)) for sign in (-1, 1)]
    parts = [Part(f"m/{i}", "mask", Box(size), read_only(pose(position=at))) for i, (size, at) in enumerate(plates)]
    mask = replace(thing("mask", (4.0, 2.0, 0.5), (0.1, 0.002, 0.088), color="black"), parts=tuple(parts))
    with staged([GROUND, ring, mask, SCREEN], [FRONT]) as stage:
        before = {"part": ON_EDGE, "mask": AWAY, "screen": AWAY}
        masked = {**before, "mask": pose(position=(4.0, 0.05, 0.03))}
        free, there, gone = stage.look(FRONT, "part", ON_EDGE, before, masked, {**masked, "part": AWAY})
    assert free.evidence is Truth.TRUE
    assert (there.evidence, gone.evidence) == (Truth.UNKNOWN, Truth.UNKNOWN)


def test_a_thing_is_seen_through_a_ring_before_it(ring: SceneObject) -> None:
    hoop = replace(ring, name="hoop", color="black", parts=tuple(replace(part, parent="hoop") for part in ring.parts))
    ball = made_of((0.03, 0.03, 0.03), ((0.03, 0.03, 0.03), (0, 0, 0)))
    with staged([GROUND, ball, hoop, SCREEN], [FRONT]) as stage:
        poses = {"part": ON_EDGE, "hoop": pose(position=(4.0, 0.1, 0.03)), "screen": AWAY}
        there, gone = stage.look(FRONT, "part", ON_EDGE, poses, {**poses, "part": AWAY})
    assert (there.evidence, gone.evidence) == (Truth.TRUE, Truth.FALSE)


@pytest.mark.parametrize("wire", [0.02, 0.0005])
def test_a_fine_mesh_has_the_same_silhouette_when_it_is_coarse(wire: float) -> None:
    """wire: radius of the wire that a ring is bent from [m]."""
    bent = trimesh.creation.torus(0.05, wire, major_sections=400, minor_sections=100)
    fine = Surface("part", np.array(bent.vertices), np.array(bent.faces))
    coarse = fine.coarsened()
    assert coarse.triangles is not None
    assert len(coarse.triangles) < 30_000 < len(bent.faces)
    view = PosedCamera(Projection(EYES[0]), EYES[0].X_FC)
    placed = {"part": pose(position=PLACE)}
    masks = [pieces_mask(view.whole, view.silhouette([surface], placed)) for surface in (fine, coarse)]
    assert masks[0].sum() > 300
    assert not (masks[0] & ~dilated(masks[1], 2)).any()
    assert not (masks[1] & ~dilated(masks[0], 2)).any()
