"""Lenses whose distortion cannot be meant: a coefficient that lost its decimal point, or stands in the wrong place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.knowledge.workspace.workspace import Workspace

MOST_BENT = 3.0
"""By which factor a lens with polynomial distortion may bend the middle of an image's sides in or out."""

MOST_ASIDE = 0.5
"""How far tangential distortion may move the middle of a side, as a share of its distance from the image's middle."""

_WIDEST = 1e3
"""Radius in the plane z = 1 that no such lens reaches."""


def implausible_lenses(workspace: Workspace) -> Iterator[Problem]:
    """Cameras whose distortion folds back before the nearest side of the image, bends or shifts it by far too much."""
    for camera in workspace.cameras.values():
        if camera.distortion_model == "none":
            continue
        message = _why_implausible(camera)
        if message is not None:
            place = workspace.places.get(f"cameras.{camera.name}")
            mend = "compare the coefficients and their order with the calibration"
            yield Problem("implausible-lens", message, place, severity="warning", mend=mend)


def _why_implausible(camera: Camera) -> str | None:
    focal, across = camera.matrix[0, 0], 0.5 * camera.width / camera.matrix[0, 0]
    nearest = min(across, 0.5 * camera.height / camera.matrix[1, 1])
    projection = Projection.of(camera)
    widest = min(projection.radius * (1 - 1e-9), _WIDEST)
    largest = _bent(projection, widest).out
    if largest < nearest:
        return (
            f"with its distortion, camera `{camera.name}` shows nothing further than {focal * largest:.0f} pixels from "
            f"the image's middle, whose nearest side is {focal * nearest:.0f} pixels away"
        )
    if camera.distortion_model == "equidistant":
        return None
    side = _radius_bent_to(projection, min(across, largest), widest)
    if not largest < across and not 1 / MOST_BENT <= side / across <= MOST_BENT:
        with_it, without = (np.degrees(2 * np.arctan(half)) for half in (side, across))
        return (
            f"with its distortion, camera `{camera.name}` sees {with_it:.1f} deg from left to right, "
            f"without it {without:.1f} deg"
        )
    aside = _bent(projection, side).aside
    if aside > MOST_ASIDE * across:
        return (
            f"the tangential distortion of camera `{camera.name}` moves the middle of a side of its image by "
            f"{focal * aside:.0f} pixels, which is {focal * across:.0f} pixels from the image's middle"
        )
    return None


def _radius_bent_to(projection: Projection, out: float, widest: float) -> float:
    """The radius in the plane z = 1, up to `widest`, that the lens moves so far out; by bisection."""
    low, high = 0.0, widest
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _bent(projection, middle).out < out else (low, middle)
    return low


class _Bent(NamedTuple):
    """Where the lens moves points at a radius in the plane z = 1.

    out: how far from the middle, without the tangential terms. aside: how far these move points on the axes. They grow
    with the square of the radius and move opposite points alike: beyond the image they would outgrow everything else,
    and bend points on one side back through the middle.
    """

    out: float
    aside: float


def _bent(projection: Projection, radius: float) -> _Bent:
    (right, left, bottom, top), _ = projection.bent(
        radius * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    )
    aside = max(np.linalg.norm(right + left), np.linalg.norm(bottom + top))
    return _Bent(0.5 * float(right[0] - left[0]), 0.5 * float(aside))
