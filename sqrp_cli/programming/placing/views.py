"""What may be chosen: the poses of a camera at each place, each with each lens that fits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, pose, read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import SAME, AimsEntry, LensChoice, Spot
from sqrp_cli.programming.advice.aiming import looking_at

AT_TARGETS = AimsEntry(targets="middle")
"""The aims of a mount that states none."""


@dataclass(frozen=True, eq=False)
class View:
    """A pose of a camera at a place."""

    spot: int
    """Index of the place."""
    X_FC: Array
    """Pose of the optical frame in the frame that carries it, shape (4, 4)."""
    at: Array | None
    """The point that it looks at, in that frame, if its aim says one, shape (3,)."""
    up: Array
    """What is up in the image then, shape (3,)."""


@dataclass(frozen=True)
class Option:
    """A camera that may be chosen, by index."""

    view: int
    lens: int


def views_of(spots: Sequence[Spot], middle: Array, middles: Sequence[Array]) -> list[View]:
    """The poses at every place. middle: of all that has to be seen, (3,); middles: of what each candidate shows."""
    return [view for index, spot in enumerate(spots) for view in _at(index, spot, middle, middles)]


def options_of(spots: Sequence[Spot], views: Sequence[View], lenses: Sequence[LensChoice]) -> list[Option]:
    """Every pose with every lens that fits its mount."""
    number = {lens.name: index for index, lens in enumerate(lenses)}
    return [Option(index, number[lens.name]) for index, view in enumerate(views) for lens in spots[view.spot].lenses]


def _at(index: int, spot: Spot, middle: Array, middles: Sequence[Array]) -> Iterator[View]:
    aims = spot.entry.aims or AT_TARGETS
    up, eye = np.array(aims.up, dtype=float), spot.position
    points = [np.array(point, dtype=float) for point in aims.at]
    if aims.targets is not None and spot.frame == WORLD:
        points += [middle, *(middles if aims.targets == "each" else ())]
    if aims.cone is not None:
        points += list(np.round(eye + aims.cone.directions(), 6))
    known: list[Array] = []
    for point in points:
        if np.linalg.norm(point - eye) > SAME and not any(np.linalg.norm(point - one) < SAME for one in known):
            known.append(point)
            yield View(index, read_only(looking_at(eye[None], point[None], up)[0]), point, up)
    for one in aims.fixed:
        yield View(index, read_only(pose(one.matrix()[:3, :3], eye)), None, up)


def camera_of(name: str, spot: Spot, view: View, lens: LensChoice) -> Camera:
    """The camera that an option stands for."""
    return completed(Camera, lens, lens.intrinsics, name=name, frame=spot.frame, X_FC=view.X_FC)


def price_of(spot: Spot, lens: LensChoice) -> float:
    """Of a camera and of mounting it there."""
    return spot.entry.price + lens.price
