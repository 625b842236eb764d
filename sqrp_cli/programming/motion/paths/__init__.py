"""Paths for the arm: straight lines, moves of the joints, ways around what is in between."""
