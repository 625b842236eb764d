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
        answers = []
        for question in questions:
            outline, tag = question.outline.astype(np.float32), found.get(question.marker.id)
            middle = None if tag is None else tag.reshape(-1, 2).mean(axis=0).tolist()
            answers.append(None if middle is None else cv2.pointPolygonTest(outline, middle, False) >= 0)
        return answers


class AsAtFirst:
    """Knows no objects: what was in its place in the first image is there as long as the place looks the same."""

    def __init__(self, camera):
        self._first = None

    def look(self, image, questions):
        """There if most of the box looks as it did, gone if most of it does not."""
        if self._first is None:
            self._first = image.astype(np.int16)
        same = np.abs(image - self._first).max(axis=2) < 25
        insides = [same[question.clear] for question in questions]
        return [None if len(a) < 20 or 0.3 < a.mean() < 0.8 else bool(a.mean() >= 0.8) for a in insides]


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
