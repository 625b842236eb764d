"""Detectors as a package of the user's own brings them; each is an entry point of the group `sqrp.detectors`."""

# ruff: noqa: ARG002 - not every detector needs all that it is told

import cv2
import numpy as np


class AprilTags:
    """Looks for AprilTags of the family 36h11."""

    def __init__(self, camera):
        family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        self._detector = cv2.aruco.ArucoDetector(family, cv2.aruco.DetectorParameters())

    def look(self, image, questions):
        """There if the tag is seen in the box, elsewhere if it is seen beside it."""
        corners, ids, _ = self._detector.detectMarkers(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
        found = {} if ids is None else dict(zip(ids.ravel().tolist(), corners, strict=True))
        return [self._answer(question, found.get(question.marker.id)) for question in questions]

    def _answer(self, question, corners):
        if corners is None:
            return None
        middle = corners.reshape(-1, 2).mean(axis=0)
        outline = question.outline.astype(np.float32)
        return cv2.pointPolygonTest(outline, [float(value) for value in middle], False) >= 0


class AsAtFirst:
    """Knows no objects: what was in its place in the first image is there as long as the place looks the same."""

    def __init__(self, camera):
        self._first = None

    def look(self, image, questions):
        """There if most of the box looks as it did, gone if most of it does not."""
        if self._first is None:
            self._first = image.astype(np.int16)
        same = np.abs(image - self._first).max(axis=2) < 25
        return [self._answer(question, same) for question in questions]

    def _answer(self, question, same):
        inside = same[question.clear]
        if len(inside) < 20 or 0.3 < inside.mean() < 0.8:
            return None
        return bool(inside.mean() >= 0.8)


class Fails:
    """Cannot look."""

    def __init__(self, camera):
        pass

    def look(self, image, questions):
        """Raise what a package may raise."""
        raise RuntimeError("no network loaded")


class Babbles(Fails):
    """Answers what nobody asked."""

    def look(self, image, questions):
        """Say too much."""
        return ["yes"] * 3
