"""Cameras, detectors and the projection of a camera."""
