"""Calibrations of all formats come in; cameras with lens, pose, light, markers and detectors go out."""
