"""MuJoCo, imported once it is certain that it can be."""

from __future__ import annotations

from sqrp_cli.runtime.simulation.requirements import check_simulator

check_simulator()

import mujoco as mujoco  # noqa: E402 - MuJoCo reads its environment here; others import it from this module
