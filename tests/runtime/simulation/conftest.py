"""Chooses how MuJoCo draws, before a test imports it."""

from __future__ import annotations

from sqrp_cli.runtime.simulation.requirements import check_simulator

check_simulator()
