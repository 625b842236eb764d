"""Cells in which colours collide: what is promised of them against what simulated cameras show."""
