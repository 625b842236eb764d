"""Collision checks, at one position and along a path."""
