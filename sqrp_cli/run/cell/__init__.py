"""The cell in which a program runs: one in simulated time, or one behind topics of ROS.

Both are told and tell the same, on a clock of their own in seconds; perception gets their images alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:  # MuJoCo is not needed to command a real cell
    from sqrp_cli.run.cell.ros_cell import RosCell
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell

    RunnableCell: TypeAlias = SimulatedCell | RosCell
