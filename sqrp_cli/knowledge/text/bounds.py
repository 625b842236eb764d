"""How large and how small the numbers in files may be, so that no computation overflows or goes on for ever."""

from __future__ import annotations

from math import pi

LARGEST = 1e6
"""Largest number where nothing else is said, in SI units."""

LARGEST_LENGTH = 1000.0
"""Largest coordinate, distance and extent [m]."""

LARGEST_ANGLE = 20 * pi
"""Largest angle: ten turns [rad]."""

LONGEST = 3600.0
"""Longest time [s]."""

SMALLEST_SIZE = 1e-6
"""Smallest extent of anything [m]."""

SHORTEST_DIRECTION = 1e-9
"""A vector that is shorter has no direction."""

SMALLEST_LIMIT = 1e-6
"""Smallest velocity, acceleration and jerk; below it no motion would ever end."""

NO_LIMIT = 1e18
"""Largest limit of a joint in a URDF; some descriptions write large numbers where they mean none."""
