"""Detectors that installed packages bring: image in, evidence out.

A package declares an entry point of the group `sqrp.detectors`, whose name is the `kind` of a detector in a workspace.
Its object is called with a camera, once for each, and gives something with a method `look(image, questions)`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from sqrp_cli.errors import SqrpError, bad_input
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.detector import BUILT_IN, GROUP, installed_detectors, package_of
from sqrp_cli.knowledge.markers import Marker
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.runtime.image import ImageArray


@dataclass(frozen=True, eq=False, kw_only=True)
class BoxQuestion:
    """A box in an image: whether that shows what the box is for."""

    atom: str
    """What is to be decided, such as `hold(g1)`."""
    box: str
    """Name of the box in the skill."""
    object: str | None
    """The object that it is for, if it is for one."""
    color: str | None
    """Of that object, as the workspace calls it."""
    marker: Marker | None
    """The marker on that object, or on the link that carries the box: `dictionary`, `id` and `side` [m]."""
    size: tuple[float, float, float]
    """Full extents of the box [m]."""
    X_CB: Array
    """Pose of the box in the optical frame of the camera (x right, y down, z forward), shape (4, 4)."""
    outline: Array
    """Of the box in the image, a convex polygon, shape (n, 2) [pixels]."""
    clear: Mask
    """The pixels of the outline that no part of the robot covers, by its encoders, shape (height, width)."""


class DetectorPlugin(Protocol):
    """Looks at the images of one camera, one after the other."""

    def look(self, image: ImageArray, questions: Sequence[BoxQuestion]) -> Sequence[bool | None]:
        """What an image shows, for each question: it is there, it is not there, or None if that cannot be told.

        image: red, green and blue, shape (height, width, 3). It is called for every image in turn, also without
        questions, with what is asked of it at that moment.
        """


MakeDetector = Callable[[Camera], DetectorPlugin]
"""What an entry point names."""


class PluginError(SqrpError):
    """A detector of an installed package did not do what it should."""


def check_plugins(workspace: Workspace) -> None:
    """Raises InputError, at its line, for a detector of an installed package that cannot be loaded."""
    for name, detector in workspace.detectors.items():
        if detector.kind not in BUILT_IN:
            try:
                load_detector(detector.kind)
            except PluginError as error:
                place = workspace.places.get(f"detectors.{name}.kind")
                raise bad_input("broken-detector", str(error), place) from error


def load_detector(kind: str) -> MakeDetector:
    """What makes detectors of an installed kind. Raises PluginError if it cannot be loaded."""
    entry = installed_detectors().get(kind)
    if entry is None:
        raise PluginError(f"no installed package has a detector `{kind}` any more (entry points `{GROUP}`)")
    try:
        make: MakeDetector = entry.load()
    except Exception as error:  # it is somebody else's code
        raise PluginError(complaint(kind, f"cannot be loaded: {named(error)}")) from error
    return make


def complaint(kind: str, what: str) -> str:
    """What is wrong with a kind of detector, with the package that brings it."""
    entry = installed_detectors().get(kind)
    return f"the detector `{kind}` of the package {'' if entry is None else package_of(entry)} {what}"


def named(error: Exception) -> str:
    """An exception of somebody else's code."""
    return f"{type(error).__name__}: {error}"
