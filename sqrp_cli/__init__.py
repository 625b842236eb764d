"""SQRP tells how well the cameras of a robot cell will see what matters, before the robot moves."""

__version__ = "0.1.0"
