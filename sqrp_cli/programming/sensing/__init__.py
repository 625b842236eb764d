"""Visibility for the cameras: field of view, detector limits and occlusion."""
