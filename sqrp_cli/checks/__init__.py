"""Findings in the input: the registry of all findings, and the checks of workspaces that could be read.

`lint` needs no geometry of the robot, `cell_warnings` does. The readers refuse what cannot be read at all.
"""
