"""Surveys the cameras of a recording: where each is, and how far its clock is from the robot's.

The clock is told roughly by when images change and when the robot moves in them, good to some hundredths of a second,
where the edges of the robot (`camera_fit`) take over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import replace
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.audit.bag_footage import Footage
from sqrp_cli.field.audit.camera_fit import CameraFit, SeenEdges, first_guess, fitted
from sqrp_cli.field.audit.expected_edges import EdgeRenderer
from sqrp_cli.field.audit.footage import FARTHEST, Frame
from sqrp_cli.field.audit.report import AuditedCamera, AuditedClock, AuditedPose
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, displacement, inverse, transform
from sqrp_cli.program.record import Program
from sqrp_cli.run.robot_body import RobotBody

IMAGES = 24  # Images of a camera whose edges are looked for, at most
TRIED = 10  # Images of those, the ones that change most, by which offsets of the clock are compared
MEMORY = 250_000_000  # Bytes of images, in grey, that are kept of a camera; at least `TRIED` images are
AROUND = (-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06)  # Offsets around a rough one that are compared [s]
UNKNOWN = 0.02  # A clock whose offset is not known better than this [s] is not judged, and taken to be right
LATE = 0.01  # Least offset by which a clock is wrong [s]
TURNED, SHIFTED = 1.5e-3, 1.5e-3
"""A camera that is off by less than this [rad, m] is where it should be: no mount and no calibration is better."""
SURE = 4.0  # Standard deviations that an error must have to be one
MEETS = 0.75  # Largest mean loss of edges (`CameraFit.cost`) of an image that shows the cell at all
Filmed: TypeAlias = tuple[list[tuple[Frame, NDArray[np.uint8]]], Array, Array]
"""What is needed of the images of a camera: those in which edges are looked for, in grey; the times of all [s], (n,);
and by how much each differs from the next, (n - 1,): mean over the pixels, small changes only [of 255]."""


def survey(
    program: Program,
    workspace: Workspace,
    footage: Footage,
    progress: Callable[[str, int], AbstractContextManager[Callable[[int], object]]],
) -> dict[str, AuditedCamera]:
    """What the images of each camera say of it, by name; progress: of images, then of cameras, which take far longer.

    Raises InputError where an image cannot be used, or the cell cannot be drawn.
    """
    of_camera = {name: [one for one in footage.frames if one.camera == name] for name in workspace.cameras}
    with progress(f"Reading {footage.path}", len(footage.frames)) as advance:
        filmed = _read(workspace, footage, of_camera, lambda: advance(1))
    found = {}
    with (
        closing(EdgeRenderer(program, workspace, footage)) as renderer,
        progress("Surveying the cameras", len(filmed)) as advance,
    ):
        for name, images in filmed.items():
            camera = workspace.cameras[name]
            fit = _fit(camera, images, renderer, footage)
            advance(1)
            if fit is None:
                clock = AuditedClock(offset=None, error=None, wrong=False)
                found[name] = AuditedCamera(images=len(images[1]), clock=clock, pose=None)
                continue
            deviations = np.sqrt(np.diag(fit.covariance))
            error = float(deviations[6])
            offset = None if error > UNKNOWN else float(fit.change[6])
            least = np.diag([TURNED**2] * 3 + [SHIFTED**2] * 3) / SURE**2
            change = fit.change[:6]
            seen = AuditedPose(
                turn=change[:3].tolist(),
                turn_error=deviations[:3].tolist(),
                shift=change[3:].tolist(),
                shift_error=deviations[3:6].tolist(),
                pixels=fit.pixels,
                residual=fit.residual,
                points=fit.points,
                moved=float(change @ np.linalg.solve(fit.covariance[:6, :6] + least, change)) > SURE**2 + 6.0,
                pose=(camera.X_FC @ displacement(fit.change[3:6], fit.change[:3])).tolist(),
            )
            wrong = offset is not None and abs(offset) > max(LATE, SURE * error)
            clock = AuditedClock(offset=offset, error=None if offset is None else error, wrong=wrong)
            found[name] = AuditedCamera(images=len(images[1]), clock=clock, pose=seen)
    return found


def _read(
    workspace: Workspace, footage: Footage, of_camera: Mapping[str, Sequence[Frame]], done: Callable[[], object]
) -> dict[str, Filmed]:
    """What is needed of all images, by camera."""
    wanted = set()
    for name, frames in of_camera.items():
        camera = workspace.cameras[name]
        most = int(np.clip(MEMORY // (camera.width * camera.height), TRIED, IMAGES))
        t = np.array([frame.t for frame in frames])
        near = np.flatnonzero(footage.as_planned(t))
        if len(near):  # evenly spread
            chosen = np.unique(np.linspace(0, len(near) - 1, min(len(near), most)).round().astype(int))
            wanted |= {frames[near[i]] for i in chosen}
    kept: dict[str, list[tuple[Frame, NDArray[np.uint8]]]] = {name: [] for name, frames in of_camera.items() if frames}
    times, changes = {name: list[float]() for name in kept}, {name: list[float]() for name in kept}
    last: dict[str, NDArray[np.uint8]] = {}
    for frame, image in footage.images(footage.frames):
        done()
        gray = cv2.cvtColor(image.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
        name, height = frame.camera, max(1, round(_WIDTH * gray.shape[0] / gray.shape[1]))
        small = cv2.GaussianBlur(cv2.resize(gray, (_WIDTH, height), interpolation=cv2.INTER_AREA), (0, 0), 1.0)
        if name in last:
            changes[name].append(float(np.minimum(cv2.absdiff(small, last[name]), _MOST_CHANGE).mean()))
        times[name].append(frame.t)
        last[name] = small.astype(np.uint8, copy=False)
        if frame in wanted:
            kept[name].append((frame, gray))
    return {name: (kept[name], np.array(times[name]), np.array(changes[name])) for name in kept}


def _fit(camera: Camera, filmed: Filmed, renderer: EdgeRenderer, footage: Footage) -> CameraFit | None:
    """The pose error of a camera and the offset of its clock."""
    projection, (kept, filmed_at, changes) = Projection(camera), filmed

    def seen_in(some: Sequence[tuple[Frame, NDArray[np.uint8]]], offset: float, X_FC: Array) -> SeenEdges | None:
        """What images show if the clock is ahead by an offset [s] and the camera is at a pose."""
        edges = ((renderer.edges(camera.name, X_FC, frame.t - offset), gray) for frame, gray in some)
        return SeenEdges.of(((expected, gray) for expected, gray in edges if expected is not None), projection)

    # What a few images say, those in which most moves, with the best of the offsets that the others tell of.
    if not kept:
        return None
    spans = [np.arange(start - FARTHEST, end + FARTHEST, SPACING) for start, end in renderer.spans]
    t, guesses = np.unique(np.concatenate(spans).round(3)), []
    middles = (filmed_at[1:] + filmed_at[:-1]) / 2
    times = [frame.t for frame, _ in kept]
    around = np.interp(times, middles, changes) if len(middles) else np.zeros(len(times))
    tried = [kept[i] for i in sorted(np.argsort(-around, kind="stable")[:TRIED].tolist())]
    way = motion_in_image(camera, renderer.body, footage, t)
    for at in dict.fromkeys([*rough_offsets(filmed_at, changes, t, way), 0.0]):
        few = seen_in(tried, at, camera.X_FC)
        guess = None if few is None else fitted(few, first_guess(few, AROUND))
        if guess is not None:
            guesses.append((at, guess))
    if not guesses:
        return None
    offset, fit = min(guesses, key=lambda one: one[1].moving_cost)
    change, X_CC, points = fit.change, np.eye(4), np.zeros((0, 3))
    for _ in range(2):  # with the edges of where camera and robot really are, as far as that is known by then
        offset, X_CC = offset + change[6], displacement(change[3:6], change[:3])
        seen = seen_in(kept, offset, camera.X_FC @ X_CC)
        better = None if seen is None else fitted(seen, np.zeros(7))
        if seen is None or better is None or better.cost > MEETS:
            return None
        fit, points = better, seen.points
        X_CC = X_CC @ displacement(fit.change[3:6], fit.change[:3])
        turn, _ = cv2.Rodrigues(X_CC[:3, :3])
        change = np.concatenate([turn.ravel(), X_CC[:3, 3], fit.change[6:]])
    away = projection.pixels(points)[0] - projection.pixels(transform(X_CC, points))[0]
    pixels = float(np.sqrt(np.mean((away**2).sum(axis=1))))
    return replace(fit, change=np.append(change[:6], offset + change[6]), pixels=pixels)


SPACING = 0.01  # Between offsets that are tried, and between instants at which the robot's motion is known [s]
CANDIDATES = 3  # Offsets that are handed on, at most
APART = 0.15  # Least distance between those [s]
FASTEST = 0.5
"""A point that moves faster than this share of the image's width per second changes no more pixels than that."""
_WIDTH, _MOST_CHANGE = 160, 30
_VERTICES = 40  # Points of each solid part of the robot whose motion is followed


def rough_offsets(t: Array, changes: Array, known: Array, way: Array) -> list[float]:
    """Offsets of the clock at which images change when the robot moves in them, the best one first [s].

    t: of the images [s], (n,). changes: between each and the next, (n - 1,), as in `Filmed`. known: times of the
    robot's clock [s], (m,), at which it is known how far everything has moved: way, (m,), as `motion_in_image` gives
    it. What counts is the correlation of what changes with what moves.
    """
    gaps = np.diff(t)
    usable = (gaps > 1e-6) & (gaps < 3.0 * np.median(gaps)) if len(gaps) else np.zeros(0, dtype=bool)
    offsets = np.arange(-FARTHEST, FARTHEST + SPACING / 2, SPACING)
    scores = np.zeros(len(offsets))
    for index, offset in enumerate(offsets):
        at = t - offset
        after = np.clip(np.searchsorted(known, at), 1, len(known) - 1)
        is_known = (at >= known[0]) & (at <= known[-1]) & (known[after] - known[after - 1] < 2 * SPACING)
        inside = usable & is_known[:-1] & is_known[1:]
        if inside.sum() >= 8:
            moved = np.maximum(np.diff(np.interp(at, known, way)), 0.0)
            a, b = np.sqrt(changes[inside]), np.sqrt(moved[inside])
            a, b = a - a.mean(), b - b.mean()
            size = float(np.sqrt((a @ a) * (b @ b)))
            scores[index] = float(a @ b) / size if size > 1e-9 else 0.0
    found: list[float] = []
    for index in np.argsort(-scores):
        if scores[index] <= max(0.2, 0.6 * scores.max()) or len(found) == CANDIDATES:
            break
        if all(abs(offsets[index] - other) >= APART for other in found):
            found.append(float(offsets[index]))
    return found


def motion_in_image(camera: Camera, body: RobotBody, footage: Footage, t: Array) -> Array:
    """How far all points that are followed have moved in the image of a camera, (m,) [widths of the image].

    t: until when, by the robot's clock [s], (m,). Also of what stands, for a camera that moves.
    """
    projection = Projection(camera)
    X_WL = body.poses_over(footage.joints(t))
    X_WC = X_WL[camera.frame] @ camera.X_FC if camera.frame != WORLD else camera.X_FC[None]
    X_CW = np.array([inverse(X) for X in X_WC])
    total, rng = np.zeros(len(t) - 1), np.random.default_rng(0)
    for surface in body.surfaces:
        chosen = surface.vertices[rng.permutation(len(surface.vertices))[:_VERTICES]]
        points = np.column_stack([chosen, np.ones(len(chosen))])
        in_camera = np.einsum("mij,mjk,nk->mni", X_CW, X_WL[surface.parent], points)
        ahead = in_camera[..., 2] > 0.02
        pixels, inside = projection.pixels(np.where(ahead[..., None], in_camera[..., :3], (0.0, 0.0, 1.0)))
        shown = ahead & inside & ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=-1)
        moved = np.linalg.norm(np.diff(pixels, axis=0), axis=-1) / camera.width
        total += (np.minimum(moved, FASTEST * SPACING) * (shown[1:] & shown[:-1])).sum(axis=1)
    return np.append(0.0, np.cumsum(total))
