"""Findings in cameras and detectors: implausible lenses and images, and cameras that see nothing."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import atan, degrees, hypot, inf, tan

import numpy as np

from sqrp_cli.camera.camera import Camera, assumed_latency
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.read_cell import X_BODY_OPTICAL
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks.placement import doubted_objects, warning
from sqrp_cli.errors import Problem
from sqrp_cli.files.frames import WORLD
from sqrp_cli.files.usual_values import FIELD_OF_VIEW, FISHEYE_VIEW, MOST_STRETCHED
from sqrp_cli.geometry import Array, box_corners, inverse, transform
from sqrp_cli.shapes import Box, Mesh, contains, half_extents

MOST_BENT = 3.0  # By which factor a lens with polynomial distortion may bend the middle of an image's sides in or out
MOST_ASIDE = 0.5
"""How far tangential distortion may move the middle of a side, as a share of its distance from the image's middle."""
MOST_OFF_CENTRE = 0.25
"""How far a principal point may be from the middle of an image, as a share of the way to its edge."""
_TOUCHING = 1e-6  # Share of a line of sight that may be in something that only touches it
_WIDEST = 1e3  # Radius in the plane z = 1 that no such lens reaches


def doubtful_images(workspace: Workspace) -> Iterator[Problem]:
    """Cameras with implausible principal points or focal lengths."""
    for camera in workspace.cameras.values():
        at = f"cameras.{camera.name}"
        place = next(
            workspace.places[one] for one in (f"{at}.image", f"{at}.calibration", at) if one in workspace.places
        )
        (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
        found: list[tuple[str, str, str]] = []
        off = max(abs((2 * c + 1) / side - 1) for c, side in ((cx, camera.width), (cy, camera.height)))
        if off > MOST_OFF_CENTRE:
            message = (
                f"its principal point ({cx:g}, {cy:g}) is {100 * off:.0f} % of the way from the middle of its image of "
                f"{camera.width} x {camera.height} pixels to the edge, usual is less than {100 * MOST_OFF_CENTRE:.0f} %"
            )
            mend = "state the width before the height, and the camera matrix of this image, "
            found.append(("unusual-principal-point", message, mend + "not of a scaled or cropped one"))
        if not 1 / MOST_STRETCHED <= fx / fy <= MOST_STRETCHED:
            long = max(fx / fy, fy / fx)
            message = f"the focal lengths {fx:g} and {fy:g} make pixels {long:,.4g} times as long as wide"
            found.append(("unusual-focal-lengths", message, "check `fx` and `fy`; both are in pixels"))
        fisheye = camera.distortion_model == "equidistant"
        usual, half = FISHEYE_VIEW if fisheye else FIELD_OF_VIEW, 0.5 * camera.width / fx
        view = 2 * (half if fisheye else atan(half))
        # Not where the file gives the field of view in place of `fx`.
        if f"{at}.image.horizontal_fov" not in workspace.places and not usual.least <= view <= usual.most:
            message = f"`fx` of {fx:g} pixels makes it see {degrees(view):.3g} deg from left to right, usual is {usual}"
            far = 0.5 * usual.least if fisheye else tan(0.5 * usual.least)
            most = f"of {camera.width} pixels across, `fx` is at most {0.5 * camera.width / far:.0f}"
            mend = "state `fx` in pixels, not in mm" if view > usual.most else f"correct `fx` or the image: {most}"
            found.append(("unusual-focal-lengths", message, mend))
        for code, message, mend in found:
            yield Problem(code, f"camera `{camera.name}`: {message}", place, severity="warning", mend=mend)


def implausible_lenses(workspace: Workspace) -> Iterator[Problem]:
    """Cameras with a distortion that folds back inside the image, or bends or shifts its sides far too much."""
    for camera in workspace.cameras.values():
        message = None if camera.distortion_model == "none" else _why_implausible(camera)
        if message is not None:
            mend = "compare the coefficients and their order with the calibration"
            yield warning("implausible-lens", message, workspace, f"cameras.{camera.name}", mend)


def blind_cameras(workspace: Workspace) -> Iterator[Problem]:
    """World-fixed cameras that see no object: inside a solid, turned elsewhere, or with no object in range.

    A common cause: the axes of body frame and optical frame are mixed up. Objects with a doubted measure are left out,
    and where there is one no camera is known to see nothing.
    """
    doubted = doubted_objects(workspace)
    objects = [item for item in workspace.objects.values() if item.X_WO is not None and item.name not in doubted]
    shown = shown_objects(workspace)
    points = points_of(shown)
    parts = [
        (item.name, part.shape, inverse(item.X_WO @ part.X_PG))
        for item in objects
        for part in item.parts
        if item.X_WO is not None and not isinstance(part.shape, Mesh)
    ]
    for camera in workspace.cameras.values():
        if camera.frame != WORLD or not objects:
            continue
        place, eye = f"cameras.{camera.name}", camera.X_FC[None, :3, 3]
        around = next((name for name, shape, X_GW in parts if contains(shape, transform(X_GW, eye)[0])), None)
        if around is not None:
            message = f"camera `{camera.name}` is inside `{around}`, which hides everything from it"
            mend = f"move one of them; if `{around}` is the camera's own housing, leave it out of the workspace"
            yield warning("camera-inside-object", message, workspace, place, mend)
            continue
        depths = _depths_in_image(camera, camera.X_FC, points)
        seen = points[(depths >= camera.near) & (depths <= camera.far)]
        above = next(_above(workspace, camera.X_FC[:3, 3], seen if len(seen) else points), None) if shown else None
        if above is not None:
            why, mend = f"it is under `{above[0]}`", f"move it above z = {above[1]:.3g} m, the top of `{above[0]}`"
        elif shown and not len(seen):
            why, mend = _why_blind(workspace, camera, shown)
        else:
            continue
        message = f"camera `{camera.name}` sees none of the objects: {why}"
        yield warning("camera-sees-nothing", message, workspace, place, mend)


def _above(workspace: Workspace, eye: Array, points: Array) -> Iterator[tuple[str, float]]:
    """Fixed boxes above an eye, between it and each of the points (n, 3): the object, and its highest z [m]."""
    for item in workspace.objects.values():
        for part in item.parts if item.fixed else ():
            if item.X_WO is None or not isinstance(part.shape, Box):
                continue
            X_WG, half = item.X_WO @ part.X_PG, 0.5 * np.asarray(part.shape.size)
            middle, up = float(X_WG[2, 3]), float(half_extents(part.shape, X_WG[:3, :3])[2])
            start, ends = transform(inverse(X_WG), eye[None])[0], transform(inverse(X_WG), points)
            way = np.where(ends == start, 1e-12, ends - start)
            # Where the segment enters and leaves the slabs between opposite sides, as shares of its length.
            sides = np.stack([(-half - start) / way, (half - start) / way])
            enters, leaves = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
            if eye[2] < middle - up and np.all(np.minimum(leaves, 1.0) - np.maximum(enters, 0.0) > _TOUCHING):
                yield item.name, middle + up


def shown_objects(workspace: Workspace) -> Sequence[SceneObject]:
    """The objects that cameras are there for; none where a size or position is doubted."""
    objects = [item for item in workspace.objects.values() if item.X_WO is not None]
    movable = [item for item in objects if not item.fixed]
    return () if doubted_objects(workspace) else movable or objects


def detectors_out_of_range(workspace: Workspace) -> Iterator[Problem]:
    """Detectors with a range that overlaps no camera's range."""
    if not workspace.cameras:
        return
    farthest = 0.0  # of a corner of an image at the depth `far`, lens distortion ignored; fisheyes see sideways
    for camera in workspace.cameras.values():
        (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
        corner = hypot(1.0, max(cx, camera.width - cx) / fx, max(cy, camera.height - cy) / fy)
        farthest = max(farthest, inf if camera.distortion_model == "equidistant" else camera.far * corner)
    nearest = min(camera.near for camera in workspace.cameras.values())
    for name, detector in workspace.detectors.items():
        near, far = detector.distance
        if near > farthest or far < nearest:
            sees = f"the cameras see from {nearest:g} to {farthest:.3g} m"
            message = f"detector `{name}` works from {near:g} to {far:g} m, and {sees}, so it never detects anything"
            mend = "correct `distance`, or `near` and `far` of the cameras"
            yield warning("detector-out-of-range", message, workspace, f"detectors.{name}.distance", mend)


def guessed_cameras(workspace: Workspace) -> Iterator[Problem]:
    """Cameras whose line in the file says that `init` guessed them, beside others."""
    text = workspace.whole_file.file.read_text(encoding="utf-8", errors="replace")
    guessed = [name for name in workspace.cameras if re.search(rf"^ *{re.escape(name)}: *# check:", text, re.MULTILINE)]
    if 0 < len(guessed) < len(workspace.cameras):
        names = " and ".join(f"`{name}`" for name in guessed)
        message = f"all answers also rest on {names}, which `init` guessed"
        mend = "delete those that you do not have, and `check:` behind those that you have"
        yield warning("guessed-camera", message, workspace, f"cameras.{guessed[0]}", mend)


def slow_cameras(workspace: Workspace) -> Iterator[Problem]:
    """Latencies that are not stated, and tasks that demand a shorter detection delay than any camera can meet."""
    silent = [camera.name for camera in workspace.cameras.values() if camera.latency is None]
    if silent:
        message = f"{assumed_latency(workspace.cameras.values())}; all delays are too short by what it really is"
        mend = "state `latency`, such as `latency: 50 ms`; `latency: 0 s` if there is none"
        yield warning("assumed-latency", message, workspace, f"cameras.{silent[0]}", mend)
    fastest = min(workspace.cameras.values(), key=lambda camera: camera.response, default=None)
    for index, task in enumerate(workspace.tasks):
        most = task.max_delay
        if fastest is not None and most is not None and most < fastest.response - 1e-9:
            takes = f"a frame and the latency of `{fastest.name}`, the fastest camera, take {fastest.response:.3g} s"
            message = f"`max_delay` of `{task.task}` is {most:g} s, but {takes}: nothing can meet it"
            on_top = "and the time in which a lost part parts from the tool on top"
            mend = f"allow {fastest.response:.3g} s, {on_top}, or use a faster camera"
            yield warning("threshold-out-of-reach", message, workspace, f"tasks.{index}.max_delay", mend)


def _why_implausible(camera: Camera) -> str | None:
    """What is implausible in a lens, in the plane z = 1, where points at a radius move out and aside.

    Tangential terms grow with the square of the radius and move opposite points in the same direction: far outside the
    image they dominate, and fold points on one side back through the middle.
    """
    focal, across = camera.matrix[0, 0], 0.5 * camera.width / camera.matrix[0, 0]
    nearest = min(across, 0.5 * camera.height / camera.matrix[1, 1])
    projection = Projection(camera)

    def bent(radius: float) -> Array:
        """Where the four points on the axes at a radius go: right, left, bottom, top, shape (4, 2)."""
        return projection.bent(radius * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]))[0]

    # How far from the middle points at a radius go: right and left together, so without the tangential terms.
    widest = min(projection.radius * (1 - 1e-9), _WIDEST)
    right, left, _, _ = bent(widest)
    largest = 0.5 * float(right[0] - left[0])
    if largest < nearest:
        return (
            f"with its distortion, camera `{camera.name}` shows nothing further than {focal * largest:.0f} pixels from "
            f"the image's middle, whose nearest side is {focal * nearest:.0f} pixels away"
        )
    if camera.distortion_model == "equidistant":
        return None
    side, high = 0.0, widest  # the radius that is mapped to the middle of a side, by bisection
    for _ in range(60):
        middle = 0.5 * (side + high)
        right, left, _, _ = bent(middle)
        side, high = (middle, high) if 0.5 * float(right[0] - left[0]) < min(across, largest) else (side, middle)
    if not largest < across and not 1 / MOST_BENT <= side / across <= MOST_BENT:
        with_it, without = (np.degrees(2 * np.arctan(half)) for half in (side, across))
        return (
            f"with its distortion, camera `{camera.name}` sees {with_it:.1f} deg from left to right, "
            f"without it {without:.1f} deg"
        )
    right, left, bottom, top = bent(side)
    aside = 0.5 * max(float(np.linalg.norm(right + left)), float(np.linalg.norm(bottom + top)))
    if aside > MOST_ASIDE * across:
        return (
            f"the tangential distortion of camera `{camera.name}` moves the middle of a side of its image by "
            f"{focal * aside:.0f} pixels, which is {focal * across:.0f} pixels from the image's middle"
        )
    return None


def _why_blind(workspace: Workspace, camera: Camera, objects: Sequence[SceneObject]) -> tuple[str, str]:
    """Why a camera sees none of these objects, and how to mend it."""
    points = points_of(objects)
    depths = _depths_in_image(camera, camera.X_FC, points)
    depths = depths[~np.isnan(depths)]
    if len(depths):
        beyond = depths.min() > camera.far
        closest = f"{depths.min():.2f} m away or more" if beyond else f"{depths.max():.2f} m away or less"
        limit = f"`far` is {camera.far:g} m" if beyond else f"`near` is {camera.near:g} m"
        mend = "move it closer, or raise `far`" if beyond else "move it back, or lower `near`"
        if not beyond and depths.max() > camera.far:
            closest, limit = "too near or too far", f"its range is {camera.near:g} m to {camera.far:g} m"
            mend = "move it, or change `near` and `far`"
        return f"what is in its image is {closest}, and {limit}", mend
    stated = f"cameras.{camera.name}"
    looks_at_point = f"{stated}.pose.look_at" in workspace.places  # which goes without `convention`
    axes_are_stated = looks_at_point or f"{stated}.convention" in workspace.places
    if not axes_are_stated and sees_any(camera, camera.X_FC @ X_BODY_OPTICAL, points):
        return "it looks elsewhere", "add `convention: body` to the camera: with x forward, y left, z up it sees them"
    nearest = int(np.linalg.norm(points[::9] - camera.X_FC[:3, 3], axis=1).argmin())
    at = ", ".join(f"{value:g}" for value in points[9 * nearest].round(3) + 0.0)
    mend = f"turn it to them: `look_at: [{at}]` in its pose makes it look at `{objects[nearest].name}`"
    if not looks_at_point:
        mend += "; a rotation is that of the optical frame, z forward, x right, y down"
    return "it looks elsewhere", mend


def sees_any(camera: Camera, X_WC: Array, points: Array) -> bool:
    """Whether one of the points (n, 3) is within range and image."""
    depths = _depths_in_image(camera, X_WC, points)
    return bool(((depths >= camera.near) & (depths <= camera.far)).any())


def _depths_in_image(camera: Camera, X_WC: Array, points: Array) -> Array:
    """Depths [m] of the points (n, 3) in a camera, nan for those not in its image; without the distortion of its lens.

    One that folds back is a finding of its own.
    """
    points_C = transform(inverse(X_WC), points)
    depths, ahead = np.full(len(points), np.nan), points_C[:, 2] > 0
    shown = Projection(replace(camera, distortion=np.zeros_like(camera.distortion))).shows(points_C[ahead])
    depths[ahead] = np.where(shown, points_C[ahead, 2], np.nan)
    return depths


def points_of(objects: Sequence[SceneObject]) -> Array:
    """Centre and corners of the boxes of objects of known pose in the world, one after the other, shape (9 n, 3)."""
    boxes = [
        transform(item.X_WO, np.concatenate([np.zeros((1, 3)), box_corners(item.size)]))
        for item in objects
        if item.X_WO is not None
    ]
    return np.concatenate([np.empty((0, 3)), *boxes])


CHECKS = (guessed_cameras, slow_cameras, detectors_out_of_range, doubtful_images, implausible_lenses, blind_cameras)
"""What `lint` calls of this module."""
