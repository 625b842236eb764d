"""Robots and tools from their URDF and SRDF, and their joint trees."""
