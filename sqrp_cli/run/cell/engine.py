"""MuJoCo, imported once it is certain that it can be."""

from __future__ import annotations

from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.run.cell.requirements import check_simulator

check_simulator()

with interrupts_later():
    import mujoco as mujoco  # reads its environment here; other modules import it from this one
