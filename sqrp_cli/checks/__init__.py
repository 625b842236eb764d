"""What SQRP finds in its input: the registry of all findings, and the checks that make those of readable workspaces.

`lint` needs no geometry of the robot, `cell_warnings` does. What cannot be read at all is refused where it is read.
"""
