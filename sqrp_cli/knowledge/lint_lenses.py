"""Lenses whose distortion cannot be meant: a coefficient that lost its decimal point, or stands in the wrong place."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.projection import Projection
from sqrp_cli.knowledge.workspace import Workspace

MOST_BENT = 3.0
"""By which factor a lens with polynomial distortion may bend the middle of an image's sides in or out."""

_WIDEST = 1e3
"""Radius in the plane z = 1 that no such lens reaches."""


def implausible_lenses(workspace: Workspace) -> Iterator[Problem]:
    """Cameras whose distortion folds back before the nearest side of the image, or bends it by far too much."""
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
    largest = _bent(projection, widest)
    if largest < nearest:
        return (
            f"with its distortion, camera `{camera.name}` shows nothing further than {focal * largest:.0f} pixels from "
            f"the image's middle, whose nearest side is {focal * nearest:.0f} pixels away"
        )
    if camera.distortion_model == "equidistant" or largest < across:
        return None
    low, high = 0.0, widest
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _bent(projection, middle) < across else (low, middle)
    if 1 / MOST_BENT <= low / across <= MOST_BENT:
        return None
    with_it, without = (np.degrees(2 * np.arctan(half)) for half in (low, across))
    return (
        f"with its distortion, camera `{camera.name}` sees {with_it:.1f} deg from left to right, "
        f"without it {without:.1f} deg"
    )


def _bent(projection: Projection, radius: float) -> float:
    """Where the lens moves a point at a radius in the plane z = 1: how far from the middle."""
    bent, _ = projection.bent(np.array([radius, 0.0]))
    return float(bent[0])
