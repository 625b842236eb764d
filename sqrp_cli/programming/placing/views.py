"""What may be chosen: the poses of a camera at each place, each with each lens that fits; which places are in the way.

A place is in the way of the robot, of anything solid, of another camera, or of its sight.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from sqrp_cli.geometry import Array, Mask, inverse, pose, read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import SAME, AimsEntry, LensChoice, Spot
from sqrp_cli.programming.advice.aiming import looking_at
from sqrp_cli.programming.advice.room import touched
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.sampling import Adaptive, first_samples
from sqrp_cli.programming.placing.scenes import JudgedWay
from sqrp_cli.programming.sensing.observer import Observer

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


_TOGETHER = 400_000
"""Places to compare with a solid at once, counted in every state, to bound the memory."""


def blocked(cell: Cell, way: JudgedWay, spots: Sequence[Spot]) -> Mask:
    """Whether the body of a camera at each place touches anything during a motion, shape (spots,).

    What is fixed to the same link as a place is not looked at.
    """
    found = np.zeros(len(spots), dtype=bool)
    samples = first_samples(Adaptive(), way.scene.stage, Observer((), cell.observer.solids), way.scene.targets)
    states = way.scene.stage.states(samples)
    order = sorted(range(len(spots)), key=lambda index: (spots[index].frame, spots[index].entry.body))
    for (frame, body), group in groupby(order, key=lambda index: (spots[index].frame, spots[index].entry.body)):
        rows = np.array(list(group))
        places = np.stack([spots[row].position for row in rows])
        X_FW = inverse(states.X_WF[frame])
        for solid in cell.observer.solids:
            X_FP = X_FW @ states.X_WF[solid.part.parent]
            if frame != WORLD and float(np.ptp(X_FP, axis=0).max()) < 1e-9:
                continue
            step = max(1, _TOGETHER // len(X_FP))
            for start in range(0, len(rows), step):
                here = np.flatnonzero(~found[rows[start : start + step]]) + start
                if len(here):
                    found[rows[here]] = touched(solid, X_FP, places[here], 0.5 * body)
    return found


def pairs_apart(spots: Sequence[Spot]) -> Iterator[tuple[int, int]]:
    """The pairs of places in one frame at which the bodies of two cameras would touch each other."""
    places, radii = np.stack([spot.position for spot in spots]), np.array([0.5 * spot.entry.body for spot in spots])
    frames = np.unique([spot.frame for spot in spots], return_inverse=True)[1]
    for first in range(len(spots) - 1):
        gap = np.linalg.norm(places[first + 1 :] - places[first], axis=1) - radii[first + 1 :] - radii[first]
        for other in np.flatnonzero((gap < -1e-9) & (frames[first + 1 :] == frames[first])).tolist():
            yield first, first + 1 + other


def hidden_by(way: JudgedWay, spot: Spot, other: Spot) -> Mask:
    """Which items of a way a camera at one place may hide from a camera at another place, shape (items,).

    Its body is a ball, and so counts what encloses each box: more than is hidden, never less.
    """
    radius, targets = 0.5 * spot.entry.body, way.scene.targets
    sample, target = way.items
    hidden = np.zeros(len(sample), dtype=bool)
    ball, eye = (_in_world(way, one)[sample if one.frame != WORLD else np.zeros_like(sample)] for one in (spot, other))
    for column, entry in enumerate(targets):
        rows = np.flatnonzero(target == column)
        for box in entry.boxes:
            poses = way.states.box_poses(box)
            center = (poses if len(poses) > 1 else np.repeat(poses, len(way.samples), axis=0))[sample[rows], :3, 3]
            reach = 0.5 * float(np.linalg.norm(box.size))
            axis = center - eye[rows]
            far = np.maximum(np.linalg.norm(axis, axis=1), 1e-9)
            axis /= far[:, None]
            along = np.einsum("ri,ri->r", ball[rows] - eye[rows], axis)
            aside = np.linalg.norm(ball[rows] - eye[rows] - along[:, None] * axis, axis=1)
            width = reach * np.clip(along / far, 0.0, 1.0)
            hidden[rows] |= (along > -radius) & (along < far + reach + radius) & (aside < width + radius)
    return hidden


def _in_world(way: JudgedWay, spot: Spot) -> Array:
    """Where a place is in the world, shape (m, 3) or (1, 3)."""
    X_WF = way.states.X_WF[spot.frame]
    return X_WF[:, :3, :3] @ spot.position + X_WF[:, :3, 3]
