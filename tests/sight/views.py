"""Makers of cameras, detectors, boxes, solids and poses for the tests of sensing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera, DistortionModel
from sqrp_cli.camera.detector import Detector
from sqrp_cli.camera.light import Light
from sqrp_cli.geometry import BOX_SIGNS, Array, axis_rotation, look_at, pose, quaternion_to_matrix
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.literal import Atom
from sqrp_cli.shapes import Box, Mesh, Part
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox, Target


def make_camera(
    X_FC: Array | None = None,
    *,
    name: str = "cam",
    frame: str = "world",
    size: tuple[int, int] = (640, 480),
    focal: tuple[float, float] = (600.0, 600.0),
    center: tuple[float, float] | None = None,
    model: DistortionModel = "none",
    distortion: Sequence[float] = (),
    near: float = 0.01,
    far: float = 10.0,
    rate: float = 10.0,
    latency: float = 0.05,
) -> Camera:
    cx, cy = center if center is not None else ((size[0] - 1) / 2, (size[1] - 1) / 2)
    matrix = np.array([[focal[0], 0.0, cx], [0.0, focal[1], cy], [0.0, 0.0, 1.0]])
    return Camera(
        name=name, width=size[0], height=size[1], matrix=matrix, distortion_model=model,
        distortion=np.array(distortion), frame=frame, X_FC=pose() if X_FC is None else X_FC, near=near, far=far,
        rate=rate, latency=latency,
    )  # fmt: skip


def make_detector(
    min_visible: float = 1.0,
    distance: tuple[float, float] = (0.0, 100.0),
    max_incidence: float = np.pi,
    min_pixels: float = 0.0,
) -> Detector:
    limits = {"max_incidence": max_incidence, "min_pixels": min_pixels, "min_visible": min_visible}
    return Detector(kind="color", distance=distance, **limits)


def make_box(
    size: tuple[float, float, float] = (0.04, 0.04, 0.04),
    X_FB: Array | None = None,
    *,
    name: str = "box",
    frame: str = "world",
    detector: Detector | None = None,
    normal: tuple[float, float, float] | None = None,
    encloses: Iterable[str] = (),
) -> SoughtBox:
    return SoughtBox(
        name=name, detector="detector", limits=detector or make_detector(), frame=frame, size=size,
        X_FB=pose() if X_FB is None else X_FB, normal=normal, encloses=tuple(encloses),
    )  # fmt: skip


def look(
    camera: Camera,
    box: SoughtBox,
    solids: Iterable[Solid] = (),
    frames: Mapping[str, Array] | None = None,
    lights: Mapping[str, Light] | None = None,
) -> BoxVerdicts:
    """What one camera sees of one box, the same by the matrix and by the fast way.

    frames: world poses, shape (m or 1, 4, 4), of those besides `world`.
    """
    poses = {"world": pose()[None], **(frames or {})}
    states = SceneStates(max(map(len, poses.values())), poses)
    observer, target = Observer((camera,), tuple(solids), lights or {}), Target(Atom("seen"), 1, (box,))
    ((found,),) = observer.verdicts([target], states)
    (covered,) = observer.coverage([target], states, [np.arange(states.count)])
    assert covered.tolist() == (found.cause[:, 0] == Cause.NONE).tolist()
    return found


def box_part(name: str, size: tuple[float, float, float], X_WG: Array, parent: str = "world") -> Part:
    return Part(name, parent, Box(size), X_WG)


def solid_of(vertices: Array, triangles: NDArray[np.int64]) -> Solid:
    """A mesh of triangles in the world frame, with a box along its axes around it. It has no file."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    center, half = (low + high) / 2, (high - low) / 2
    return Solid(
        part=Part("shape", "world", Mesh(Path("shape.stl")), pose()),
        name="shape",
        vertices=vertices,
        triangles=triangles,
        center=center,
        radius=float(np.linalg.norm(vertices - center, axis=1).max()),
        corners=center + BOX_SIGNS * half,
        half_axes=np.diag(half),
    )


def random_rotation(rng: np.random.Generator) -> Array:
    return quaternion_to_matrix(rng.normal(size=4))


def random_pose(rng: np.random.Generator, low: Sequence[float], high: Sequence[float]) -> Array:
    """Any orientation, position [m] in a range."""
    return pose(random_rotation(rng), rng.uniform(low, high))


def camera_pose_around(rng: np.random.Generator, target: Array, distance: float) -> Array:
    """An optical frame at a distance [m] from a point, above its height, rolled at random, looking at the point."""
    azimuth, elevation = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 1.3)
    direction = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    X_WC = look_at(target + distance * direction, target)
    return X_WC @ pose(axis_rotation(2, rng.uniform(-np.pi, np.pi)))
