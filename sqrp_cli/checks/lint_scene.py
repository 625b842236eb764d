"""Findings in the geometry of a cell: boxes too small to see, blind cameras, objects in one place or in the air."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np

from sqrp_cli.checks.overlap import box_penetration, gap_from_above
from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, box_corners, inverse, pose, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill.skill import BoxSpec, Skill
from sqrp_cli.knowledge.workspace.read_cell import camera_axes_as_body
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.shapes import Box, Mesh

MIN_OVERLAP = 1e-3
"""Depth [m] from which two objects count as being in one place."""

LEAST_GAP = 5e-3
"""Distance [m] from which an object counts as not standing on another one."""


def too_small_boxes(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Boxes that no camera sees as large as their detector needs, even from the nearest possible place."""
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            detector = workspace.detectors[box.detector]
            looks = list(product(workspace.cameras.values(), objects_meant(workspace, skill, box)))
            # Mostly one of the first is large enough, and then the others do not matter.
            if looks and all(_largest_in_image(workspace, box, *look) < detector.min_pixels for look in looks):
                largest = max(_largest_in_image(workspace, box, *look) for look in looks)
                message = (
                    f"skill `{skill.name}`: box `{box.name}` of `{predicate}` measures at most {largest:.1f} "
                    f"pixels in any camera, detector `{box.detector}` needs {detector.min_pixels:g}"
                )
                mend = "use a larger box or marker, a nearer camera or a longer lens"
                place = skill.place("targets", predicate, "boxes", index, "name")
                yield Problem("too-small-for-every-camera", message, place, mend=mend)


def blind_cameras(workspace: Workspace) -> Iterator[Problem]:
    """Cameras in the world that see no object: they are inside a solid, look elsewhere, or no object is in their range.

    Often the axes of body and optical frame are mixed up.
    """
    things = [thing for thing in workspace.objects.values() if thing.X_WO is not None]
    shown = [thing for thing in things if not thing.fixed] or things
    for camera in workspace.cameras.values():
        if camera.frame != WORLD or not shown:
            continue
        place = workspace.places.get(f"cameras.{camera.name}")
        around = next((thing for thing in things if _is_inside(thing, camera.X_FC[:3, 3])), None)
        if around is not None:
            message = f"camera `{camera.name}` is inside `{around.name}`, which hides everything from it"
            mend = f"move one of them; if `{around.name}` is the camera's own housing, leave it out of the workspace"
            yield Problem("camera-inside-object", message, place, severity="warning", mend=mend)
        elif not _sees_any(camera, camera.X_FC, shown):
            why, mend = _why_blind(workspace, camera, shown)
            message = f"camera `{camera.name}` sees none of the objects: {why}"
            yield Problem("camera-sees-nothing", message, place, severity="warning", mend=mend)


def _why_blind(workspace: Workspace, camera: Camera, things: Sequence[SceneObject]) -> tuple[str, str]:
    """Why a camera sees none of these objects, and what would change that."""
    depths = _depths_in_image(camera, camera.X_FC, np.concatenate([_points(thing) for thing in things]))
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
    told_axes = looks_at_point or f"{stated}.convention" in workspace.places
    if not told_axes and _sees_any(camera, camera_axes_as_body(camera.X_FC), things):
        return "it looks elsewhere", "add `convention: body` to the camera: with x forward, y left, z up it sees them"
    nearest = min(things, key=lambda thing: float(np.linalg.norm(_points(thing)[0] - camera.X_FC[:3, 3])))
    at = ", ".join(f"{value:g}" for value in _points(nearest)[0].round(3) + 0.0)
    mend = f"turn it to them: `look_at: [{at}]` in its pose makes it look at `{nearest.name}`"
    if not looks_at_point:
        mend += "; a rotation is that of the optical frame, z forward, x right, y down"
    return "it looks elsewhere", mend


def overlapping_objects(workspace: Workspace) -> Iterator[Problem]:
    """Pairs of objects whose boxes are more than 1 mm deep in each other."""
    things = [thing for thing in workspace.objects.values() if thing.X_WO is not None]
    boxes = {thing.name: _solid_boxes(thing) for thing in things}
    centers = np.array([thing.X_WO[:3, 3] for thing in things if thing.X_WO is not None]).reshape(-1, 3)
    reaches = np.array(
        [max((_reach(thing, X_WG, size) for X_WG, size in boxes[thing.name]), default=-np.inf) for thing in things]
    )
    distances = np.linalg.norm(centers[:, None] - centers[None], axis=-1)
    close = np.triu(distances <= reaches[:, None] + reaches[None], k=1)
    for first, second in np.argwhere(close):
        one, other = things[first], things[second]
        depth = max(box_penetration(*a, *b) for a in boxes[one.name] for b in boxes[other.name])
        if depth > MIN_OVERLAP:
            message = (
                f"objects `{one.name}` and `{other.name}` are in one place: {1e3 * depth:.1f} mm deep in each other"
            )
            place = workspace.places.get(f"objects.{other.name}.pose")
            yield Problem("overlapping-objects", message, place, mend=f"move one of them by {1e3 * depth:.1f} mm")


def floating_objects(workspace: Workspace) -> Iterator[Problem]:
    """Objects that are 5 mm or more away from what they are said to be on.

    With something else under them they may stand on that, if what they are said to be on is below: a cube in a tray is
    on the table too. Parts that are no boxes count as the boxes around them, so the distance may be larger than what is
    told.
    """
    around = {thing.name: list(_boxes_around(thing)) for thing in workspace.objects.values() if thing.X_WO is not None}
    for thing in workspace.objects.values():
        support = workspace.objects.get(thing.on) if thing.on is not None else None
        if support is None or thing.name not in around or support.name not in around:
            continue
        above, below = around[thing.name], around[support.name]
        gap = min(-box_penetration(*one, *other) for one, other in product(above, below))
        if gap < LEAST_GAP - 1e-9:
            continue
        place = workspace.places.get(f"objects.{thing.name}.pose")
        under = next((name for name, boxes in around.items() if name != thing.name and _stand_on(above, boxes)), None)
        if under is not None:
            aside = min(gap_from_above(*one, *other) for one, other in product(above, below))
            if aside >= LEAST_GAP - 1e-9:
                message = f"`{thing.name}` is said to be on `{support.name}`, but does not stand over it: "
                message += f"it is {aside:.3g} m beside it, on `{under}`"
                mend = f"move it onto `{support.name}`, or write `on: {under}`"
                yield Problem("beside-support", message, place, severity="warning", mend=mend)
            continue
        bottom = min(transform(X_WG, box_corners(size))[:, 2].min() for X_WG, size in above)
        top = max(transform(X_WG, box_corners(size))[:, 2].max() for X_WG, size in below)
        mend = f"lower it by {1e3 * gap:.1f} mm" if bottom - top > gap - 1e-6 else f"move it onto `{support.name}`"
        message = f"`{thing.name}` is said to be on `{support.name}`, but between them is a gap of {1e3 * gap:.1f} mm"
        yield Problem("floating-object", message, place, severity="warning", mend=f"{mend}, or correct `on`")


def objects_meant(workspace: Workspace, skill: Skill, box: BoxSpec) -> list[SceneObject | None]:
    """The objects that a box may belong to; only None for a box of its own in a frame without an object."""
    name = box.fits or box.frame.owner
    if name in workspace.objects:
        return [workspace.objects[name]]
    for parameter in skill.action.parameters:
        if parameter.name == name:
            things = workspace.objects.values()
            return [thing for thing in things if skill.domain.fits(thing.types, parameter.type)]
    return [None]


def _largest_in_image(workspace: Workspace, box: BoxSpec, camera: Camera, thing: SceneObject | None) -> float:
    """An upper bound of a box's size in an image [pixels]: square root of its area.

    The largest silhouette of a box has the norm of its three face areas as area; at distance r, perspective enlarges it
    by at most (f / (r - half a diagonal))^2 / cos^3 of the angle to the optical axis, widest at the image's corners.
    """
    enlarged = np.add(thing.size, 2 * box.margin) if thing is not None else (0.0, 0.0, 0.0)
    size = np.asarray(box.size if box.size is not None else enlarged)
    detector = workspace.detectors[box.detector]
    distance = max(detector.distance[0], _known_distance(box, camera, thing))
    nearest = max(distance - 0.5 * float(np.linalg.norm(size)), camera.near)
    area = float(np.linalg.norm([size[1] * size[2], size[0] * size[2], size[0] * size[1]]))
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    tangent = np.hypot(
        max(camera.matrix[0, 2], camera.width - camera.matrix[0, 2]) / fx,
        max(camera.matrix[1, 2], camera.height - camera.matrix[1, 2]) / fy,
    )
    stretch = (1.0 + tangent**2) ** 0.75
    return float(np.sqrt(fx * fy * area) / nearest * stretch)


def _known_distance(box: BoxSpec, camera: Camera, thing: SceneObject | None) -> float:
    """Distance from camera to box where both stay where they are [m], else 0."""
    if camera.frame != WORLD:
        return 0.0
    if box.frame == WORLD:
        X_WF = np.eye(4)
    elif thing is not None and thing.X_WO is not None and (box.frame.at_start or thing.fixed):
        X_WF = thing.X_WO
    else:
        return 0.0
    return float(np.linalg.norm((X_WF @ box.X_FB)[:3, 3] - camera.X_FC[:3, 3]))


def _points(thing: SceneObject) -> Array:
    """Centre and corners of an object's box in the world, shape (9, 3)."""
    assert thing.X_WO is not None  # noqa: S101 - callers choose objects of known pose
    return transform(thing.X_WO, np.concatenate([np.zeros((1, 3)), box_corners(thing.size)]))


def _sees_any(camera: Camera, X_WC: Array, things: Sequence[SceneObject]) -> bool:
    """Whether the centre or a corner of one of the objects is within range and image."""
    depths = _depths_in_image(camera, X_WC, np.concatenate([_points(thing) for thing in things]))
    return bool(((depths >= camera.near) & (depths <= camera.far)).any())


def _depths_in_image(camera: Camera, X_WC: Array, points: Array) -> Array:
    """How far in front of a camera those of the points (n, 3) are that its image has [m], lens distortion aside."""
    x, y, z = transform(inverse(X_WC), points).T
    ahead = z > 0
    depth = np.where(ahead, z, 1.0)
    x, y = x / depth, y / depth
    if camera.distortion_model == "equidistant":
        radius = np.maximum(np.hypot(x, y), 1e-12)
        x, y = x * np.arctan(radius) / radius, y * np.arctan(radius) / radius
    u = camera.matrix[0, 0] * x + camera.matrix[0, 2]
    v = camera.matrix[1, 1] * y + camera.matrix[1, 2]
    in_image = (u >= -0.5) & (u <= camera.width - 0.5) & (v >= -0.5) & (v <= camera.height - 0.5)
    found: Array = z[ahead & in_image]
    return found


def _is_inside(thing: SceneObject, point: Array) -> bool:
    """Whether a point in the world (3,) is inside a solid part of an object; meshes are left out."""
    return thing.X_WO is not None and any(
        not isinstance(part.shape, Mesh)
        and part.shape.contains(transform(inverse(thing.X_WO @ part.X_PG), point[None])[0])
        for part in thing.parts
    )


def _solid_boxes(thing: SceneObject) -> list[tuple[Array, Array]]:
    """Pose in the world and full extents of each box of an object; pieces of other shapes are left out."""
    return [
        (thing.X_WO @ part.X_PG, np.asarray(part.shape.size))
        for part in thing.parts
        if isinstance(part.shape, Box) and thing.X_WO is not None
    ]


def _stand_on(boxes: Sequence[tuple[Array, Array]], others: Sequence[tuple[Array, Array]]) -> bool:
    """Whether boxes that are lowered by `LEAST_GAP` get into one of the others."""
    lowered = [(pose(position=(0.0, 0.0, -LEAST_GAP)) @ X_WG, size) for X_WG, size in boxes]
    return any(box_penetration(*one, *other) > 1e-9 for one, other in product(lowered, others))


def _boxes_around(thing: SceneObject) -> Iterator[tuple[Array, Array]]:
    """Pose in the world and full extents of a box around each part of an object of known pose."""
    assert thing.X_WO is not None  # noqa: S101 - callers choose objects of known pose
    for part in thing.parts:
        if isinstance(part.shape, Mesh):
            yield thing.X_WO, np.asarray(thing.size)
        else:
            yield thing.X_WO @ part.X_PG, 2 * part.shape.half_extents(np.eye(3))


def _reach(thing: SceneObject, X_WG: Array, size: Array) -> float:
    """Distance from the object's centre to the farthest corner of one of its boxes, at most [m]."""
    assert thing.X_WO is not None  # noqa: S101 - callers choose objects of known pose
    return float(np.linalg.norm(X_WG[:3, 3] - thing.X_WO[:3, 3]) + 0.5 * np.linalg.norm(size))
