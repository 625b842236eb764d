"""Bounds of the numbers in files, so that no computation overflows or runs for ever."""

from __future__ import annotations

from math import pi

LARGEST = 1e6
"""Largest number by default, in SI units."""

LARGEST_LENGTH = 1000.0
"""Largest coordinate, distance and extent [m]."""

LARGEST_ANGLE = 20 * pi
"""Largest angle: ten turns [rad]."""

LONGEST = 3600.0
"""Longest time [s]."""

SMALLEST_SIZE = 1e-6
"""Smallest extent of a shape [m]."""

SHORTEST_DIRECTION = 1e-9
"""A vector that is shorter has no direction."""

SMALLEST_LIMIT = 1e-6
"""Smallest velocity, acceleration and jerk; below it motions would never end."""

NO_LIMIT = 1e18
"""Largest joint limit in a URDF; some descriptions write huge numbers for "no limit"."""
