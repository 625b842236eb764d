"""Robots and tools as their URDF and SRDF describe them, and where their joints carry their links."""
