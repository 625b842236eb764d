"""The arm: forward and inverse kinematics, and reach."""
