"""Parts that reach outside the `size` of their object: what is predicted of the object's box is not true of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sqrp_cli.checks.mesh_sizes import scale_is_doubtful
from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.sensing.solids import load_solid
from sqrp_cli.shapes import Mesh, Part

ALLOWED = 1e-3
"""How far a part may reach outside the size of its object [m], as sizes are often rounded."""

FINEST = 1e-4
"""To what a size is rounded up that would hold all parts [m]."""


def parts_outside_size(workspace: Workspace) -> Iterator[Problem]:
    """A warning about each object with parts that reach more than 1 mm outside its box; the place is the worst part's.

    Objects with a mesh whose scale is doubted already are left out.
    """
    for thing in workspace.objects.values():
        if not any(_is_doubted(part, thing) for part in thing.parts):
            reached = np.array([_reach(part) for part in thing.parts])
            outside = reached - 0.5 * np.asarray(thing.size)
            if outside.max() > ALLOWED + 1e-9:
                yield _told(workspace, thing, reached, outside)


def _told(workspace: Workspace, thing: SceneObject, reached: Array, outside: Array) -> Problem:
    index, axis = divmod(int(outside.argmax()), 3)
    part = thing.parts[index]
    shape = type(part.shape).__name__.lower()
    message = (
        f"part `{part.name}` of `{thing.name}`, a {shape}, reaches {1e3 * outside[index, axis]:.1f} mm outside the "
        f"object's `size` along {'xyz'[axis]}"
    )
    others = int((outside.max(axis=1) > ALLOWED + 1e-9).sum()) - 1
    if others:
        message += f", and {others} other part{'s' * (others > 1)} outside it too"
    needed = FINEST * np.ceil(2 * reached.max(axis=0) / FINEST - 1e-6)
    size = ", ".join(f"{value:.5g}" for value in np.maximum(needed, thing.size))
    mend = f"`size: [{size}]` would hold all parts, centred as the box is; or correct the part's measures or `pose`"
    place = workspace.places.get(f"objects.{thing.name}.parts.{index}")
    return Problem("part-outside-size", message, place, severity="warning", mend=mend)


def _is_doubted(part: Part, thing: SceneObject) -> bool:
    return isinstance(part.shape, Mesh) and scale_is_doubtful(load_solid(part), thing)


def _reach(part: Part) -> Array:
    """How far a part reaches from its object's centre along the object's axes, to either side at most [m], shape (3,).

    Exact also for round shapes, whose solids are a little too wide.
    """
    if isinstance(part.shape, Mesh):
        reach: Array = np.abs(load_solid(part).vertices).max(axis=0)
        return reach
    outermost: Array = np.abs(part.X_PG[:3, 3]) + part.shape.half_extents(part.X_PG[:3, :3])
    return outermost
