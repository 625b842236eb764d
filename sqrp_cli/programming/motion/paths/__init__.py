"""Paths for the arm: straight lines, joint moves, ways around obstacles."""
