"""Findings in the poses of objects: two in one place, or one in the air. Exact for boxes; meshes are not read."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Problem
from sqrp_cli.files.units import shown_length
from sqrp_cli.geometry import box_corners, pose, transform
from sqrp_cli.shapes import Box, Mesh, PlacedBox, half_extents

MIN_OVERLAP = 1e-3  # Depth [m] from which two objects count as being in one place
LEAST_GAP = 5e-3  # Distance [m] from which an object does not count as standing on another one
_MEASURE = re.compile(r"objects\.(.+)\.(?:size|pose\.position)\.\d")
"""Path of a number that says how large an object is or where; its name."""


def warning(code: str, message: str, workspace: Workspace, path: str, mend: str) -> Problem:
    """A finding that is no error, where the workspace states something, such as `cameras.cam1`."""
    return Problem(code, message, workspace.places.get(path), severity="warning", mend=mend)


def doubted_objects(workspace: Workspace) -> Mapping[str, Problem]:
    """Objects of which a size or position was probably meant in another unit, with the first warning that says so.

    What follows from such a measure is no finding of its own.
    """
    doubts = {warning.place: warning for warning in workspace.warnings if warning.code == "doubtful-unit"}
    doubted: dict[str, Problem] = {}
    for path, place in workspace.places.items() if doubts else ():
        if place in doubts and (match := _MEASURE.fullmatch(path)):
            doubted.setdefault(match[1], doubts[place])
    return doubted


def overlapping_objects(workspace: Workspace) -> Iterator[Problem]:
    """Pairs of objects whose boxes are more than 1 mm deep in each other.

    Those with a doubted measure have one finding together, as no figure would mend it but the measure.
    """
    doubted = doubted_objects(workspace)
    involved: set[str] = set()
    objects = [(item.name, item.X_WO, item.parts) for item in workspace.objects.values() if item.X_WO is not None]
    boxes = [
        [PlacedBox(X_WO @ p.X_PG, np.asarray(p.shape.size)) for p in parts if isinstance(p.shape, Box)]
        for _, X_WO, parts in objects
    ]
    centers = np.array([X_WO[:3, 3] for _, X_WO, _ in objects]).reshape(-1, 3)
    reaches = np.array(  # to the farthest corner, at most
        [
            max((np.linalg.norm(b.X_WB[:3, 3] - center) + 0.5 * np.linalg.norm(b.size) for b in own), default=-np.inf)
            for center, own in zip(centers, boxes, strict=True)
        ]
    )
    distances = np.linalg.norm(centers[:, None] - centers[None], axis=-1)
    for first, second in np.argwhere(np.triu(distances <= reaches[:, None] + reaches[None], k=1)):
        one, other = objects[first][0], objects[second][0]
        depth = max(-a.gap(b) for a in boxes[first] for b in boxes[second])
        if depth <= MIN_OVERLAP:
            continue
        if one in doubted or other in doubted:
            involved |= {one, other} & doubted.keys()
        else:
            message = f"objects `{one}` and `{other}` are in one place: {shown_length(depth)} deep in each other"
            place = workspace.places.get(f"objects.{other}.pose")
            yield Problem("overlapping-objects", message, place, mend=f"move one of them by {shown_length(depth)}")
    if involved:
        names = sorted(involved, key=list(workspace.objects).index)
        quoted = ", ".join(f"`{name}`" for name in names)
        message = f"{quoted} would be in one place with other objects, probably by the unit of a size or position"
        mend = "write the sizes and positions that the warnings name with their unit"
        yield Problem("overlapping-objects", message, doubted[names[0]].place, mend=mend)


def floating_objects(workspace: Workspace) -> Iterator[Problem]:
    """Objects that are 5 mm or more away from their support, the object that `on` names.

    They may stand on another object instead, if their support is below: a cube in a tray is on the table too. Parts of
    other shapes count as the boxes around them, so the true distance may be larger than the reported one.
    """
    doubted = doubted_objects(workspace)
    placed = [item for item in workspace.objects.values() if item.X_WO is not None and item.name not in doubted]
    around: dict[str, list[PlacedBox]] = {}
    for item in placed:
        X_WO = np.asarray(item.X_WO)
        around[item.name] = [
            PlacedBox(X_WO, np.asarray(item.size))
            if isinstance(part.shape, Mesh)
            else PlacedBox(X_WO @ part.X_PG, 2 * half_extents(part.shape, np.eye(3)))
            for part in item.parts
        ]
    for item in workspace.objects.values():
        support = workspace.objects.get(item.on) if item.on is not None else None
        if support is None or item.name not in around or support.name not in around:
            continue
        above, below = around[item.name], around[support.name]
        gap = min(one.gap(other) for one, other in product(above, below))
        if gap < LEAST_GAP - 1e-9:
            continue
        place = workspace.places.get(f"objects.{item.name}.pose")
        lowered = [PlacedBox(pose(position=(0.0, 0.0, -LEAST_GAP)) @ box.X_WB, box.size) for box in above]
        stands_on = (
            name
            for name, boxes in around.items()
            if name != item.name and any(one.gap(other) < -1e-9 for one, other in product(lowered, boxes))
        )
        under = next(stands_on, None)
        if under is not None:
            aside = min(one.gap(other, from_above=True) for one, other in product(above, below))
            if aside >= LEAST_GAP - 1e-9:
                message = f"`{item.name}` has `on: {support.name}`, but does not stand over it: "
                message += f"it is {aside:.3g} m beside it, on `{under}`"
                mend = f"move it onto `{support.name}`, or write `on: {under}`"
                yield Problem("beside-support", message, place, severity="warning", mend=mend)
            continue
        bottom, top = (
            end(end(transform(box.X_WB, box_corners(box.size))[:, 2]) for box in boxes)
            for end, boxes in ((min, above), (max, below))
        )
        mend = f"lower it by {shown_length(gap)}" if bottom - top > gap - 1e-6 else f"move it onto `{support.name}`"
        message = f"`{item.name}` has `on: {support.name}`, but between them is a gap of {shown_length(gap)}"
        yield Problem("floating-object", message, place, severity="warning", mend=f"{mend}, or correct `on`")
