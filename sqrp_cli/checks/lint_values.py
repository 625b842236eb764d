"""Numbers that each could be and together cannot be meant: of cameras, detectors, thresholds and boxes."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan, degrees, hypot

from sqrp_cli.checks.lint_scene import objects_meant
from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.text.usual_values import FIELD_OF_VIEW, MOST_STRETCHED
from sqrp_cli.knowledge.workspace.workspace import Workspace


def doubtful_images(workspace: Workspace) -> Iterator[Problem]:
    """Cameras whose principal point is not in their image, or whose focal lengths cannot be meant."""
    for camera in workspace.cameras.values():
        stated = f"cameras.{camera.name}"
        place = next(
            workspace.places[key]
            for key in (f"{stated}.image", f"{stated}.calibration", stated)
            if key in workspace.places
        )
        for code, message, mend in _image_doubts(camera, f"{stated}.image.horizontal_fov" in workspace.places):
            yield Problem(code, f"camera `{camera.name}`: {message}", place, severity="warning", mend=mend)


def _image_doubts(camera: Camera, told_of_view: bool) -> Iterator[tuple[str, str, str]]:
    """Code, message and remedy of what is doubtful; told_of_view: the field of view is stated itself."""
    (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
    width, height = camera.width, camera.height
    if not (-0.5 <= cx <= width - 0.5 and -0.5 <= cy <= height - 0.5):
        message = f"the principal point ({cx:g}, {cy:g}) is outside its image of {width} x {height} pixels"
        yield "principal-point-outside", message, "check `cx` and `cy`; is the calibration that of another image size?"
    if not 1 / MOST_STRETCHED <= fx / fy <= MOST_STRETCHED:
        message = f"the focal lengths {fx:g} and {fy:g} make pixels {max(fx / fy, fy / fx):.3g} times as long as wide"
        yield "unusual-focal-lengths", message, "check `fx` and `fy`; both are in pixels"
    view = 2 * atan(0.5 * width / fx)
    if (
        camera.distortion_model != "equidistant"
        and not told_of_view
        and not (FIELD_OF_VIEW.least <= view <= FIELD_OF_VIEW.most)
    ):
        message = (
            f"`fx` of {fx:g} pixels makes it see {degrees(view):.3g} deg from left to right, usual is {FIELD_OF_VIEW}"
        )
        yield "unusual-focal-lengths", message, "state `fx` in pixels, not in mm"


def detectors_out_of_range(workspace: Workspace) -> Iterator[Problem]:
    """Detectors that begin where every camera's range has ended, or end where it has not begun."""
    if not workspace.cameras:
        return
    farthest = max(_farthest(camera) for camera in workspace.cameras.values())
    nearest = min(camera.near for camera in workspace.cameras.values())
    for name, detector in workspace.detectors.items():
        near, far = detector.distance
        if near > farthest or far < nearest:
            sees = f"the cameras see from {nearest:g} to {farthest:.3g} m"
            message = f"detector `{name}` works from {near:g} to {far:g} m, and {sees}, so it never detects anything"
            place = workspace.places.get(f"detectors.{name}.distance")
            mend = "correct `distance`, or `near` and `far` of the cameras"
            yield Problem("detector-out-of-range", message, place, severity="warning", mend=mend)


def _farthest(camera: Camera) -> float:
    """Distance to the corner of the image at the depth `far` [m], lens distortion aside; fisheyes see to the side."""
    if camera.distortion_model == "equidistant":
        return float("inf")
    (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
    return camera.far * hypot(1.0, max(cx, camera.width - cx) / fx, max(cy, camera.height - cy) / fy)


def thresholds_out_of_reach(workspace: Workspace) -> Iterator[Problem]:
    """Tasks of which faults must be noticed sooner than any camera shows anything."""
    fastest = min(workspace.cameras.values(), key=lambda camera: camera.response, default=None)
    for index, task in enumerate(workspace.tasks):
        most = task.max_delay
        if fastest is not None and most is not None and most < fastest.response - 1e-9:
            takes = f"a frame and the latency of `{fastest.name}`, the fastest camera, take {fastest.response:.3g} s"
            message = f"`max_delay` of `{task.task}` is {most:g} s, but {takes}: nothing can meet it"
            place = workspace.places.get(f"tasks.{index}.max_delay")
            mend = f"allow {fastest.response:.3g} s or more, or use a faster camera"
            yield Problem("threshold-out-of-reach", message, place, severity="warning", mend=mend)


def empty_boxes(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Boxes of which a negative margin leaves nothing."""
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            things = [thing for thing in objects_meant(workspace, skill, box) if thing is not None]
            thing = min(things, key=lambda thing: min(thing.size), default=None)
            if thing is None or box.size is not None or min(thing.size) + 2 * box.margin > 0:
                continue
            message = (
                f"skill `{skill.name}`: with a margin of {box.margin:g} m nothing is left of box `{box.name}` around "
                f"`{thing.name}`, which is {min(thing.size):g} m thin"
            )
            place = skill.place("targets", predicate, "boxes", index, "margin")
            yield Problem("empty-box", message, place, mend="the margin enlarges a box on every side; raise it to 0 m")
