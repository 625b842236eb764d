"""What is doubtful about a robot and its surroundings once their geometry is known."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.checks.camera_places import cameras_inside
from sqrp_cli.checks.mesh_sizes import doubtful_meshes
from sqrp_cli.checks.part_extents import parts_outside_size
from sqrp_cli.checks.shape_overlaps import overlapping_shapes
from sqrp_cli.checks.tool_speed import unreachable_speeds
from sqrp_cli.errors import Place, Problem
from sqrp_cli.programming.cell import Cell


def cell_warnings(cell: Cell) -> tuple[Problem, ...]:
    """Warnings about a cell that need the shapes of its robot and objects; `lint` gives those that need none."""
    workspace, model = cell.workspace, cell.model
    return (
        *doubtful_meshes(workspace, model),
        *parts_outside_size(workspace),
        *overlapping_shapes(workspace),
        *cameras_inside(workspace, model, cell.observer.solids),
        *unreachable_speeds(workspace, model),
        *_assumed_contacts(cell),
    )


def _assumed_contacts(cell: Cell) -> Iterator[Problem]:
    """A warning about pairs of links that are not checked because they touch at home or always."""
    if cell.self_contacts is not None and cell.self_contacts.unchecked:
        names = ", ".join(f"{a}-{b}" for a, b in sorted(cell.self_contacts.unchecked))
        message = f"there is no SRDF, and these links touch at home or wherever the arm is: {names}; not checked"
        mend = "state the pairs that may touch in an SRDF, `robot.srdf`"
        yield Problem("assumed-contact", message, Place(cell.workspace.robot.urdf.path), severity="warning", mend=mend)
