"""URDF, SRDF, xacro and MoveIt's limits come in; one robot with its joint tree and kinematics goes out."""
