"""Cameras and detectors, and how a camera projects."""
