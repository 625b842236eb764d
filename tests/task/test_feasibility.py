from __future__ import annotations

from dataclasses import replace

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.task.feasibility import feasible_motion, unmet_preconditions
from sqrp_cli.task.task import read_task


def test_what_keeps_a_candidate_from_beginning_is_named(tabletop: Workspace) -> None:
    cell = Cell.load(tabletop)
    world, candidate = cell.initial_world, read_task("pickup g2", tabletop).candidates[0]
    nothing = replace(world, facts=frozenset())
    unmet = tuple(f"`pickup` needs `{one}`, which does not hold" for one in ("obj_on_table(g2)", "hand_empty"))
    assert unmet_preconditions(cell, candidate, nothing) == unmet
    lost = replace(world, X_WO={name: X for name, X in world.X_WO.items() if name != "g2"})
    crate_at_tool = replace(world, X_WO={**world.X_WO, "crate": cell.model.tool_pose(cell.model.home)})
    for begun, reasons in ((nothing, unmet), (lost, ("it is not known where `g2` is",)), (crate_at_tool, None)):
        found = feasible_motion(cell, candidate, begun)
        assert isinstance(found, Infeasible)
        if reasons is None:
            (reason,) = found.reasons
            assert "hits crate before anything moves" in reason
        else:
            assert found.reasons == reasons
