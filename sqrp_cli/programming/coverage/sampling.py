"""The first samples of a motion: a fixed number, a fixed step, or adapted to the speed of objects and robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, box_corners
from sqrp_cli.programming.coverage.stage import Samples, Stage
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.pieces import Piece
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates
from sqrp_cli.programming.targets import Target

DEFAULT_TOLERANCE = 1e-3
"""Largest error of Q that bisection leaves, as a fraction (0.1 points)."""

MAX_MOTION = 0.01
"""Largest motion between neighbouring samples in adaptive sampling [m].

It applies to every corner of a target and of a box around a moving part; for a camera on a link, to its centre and a
point 1 m in front of it.
"""

VIEW = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Tracked points of a moving camera, in its optical frame, shape (2, 3) [m]."""

_PROBES = 21
"""Instants per primitive at which speeds are measured, to place the adaptive samples."""

_SPACING = 0.97 * MAX_MOTION
"""Motion between adaptive samples as they are placed [m].

Speed counts as constant between the probes, and steps longer than `MAX_MOTION` are halved; this margin of a few per
cent avoids most halving.
"""

MAX_SAMPLES = 200_000
"""Samples of one candidate beyond which a request is refused."""


@dataclass(frozen=True)
class FixedCount:
    """A number of instants per primitive, equally spaced in time, both ends included."""

    samples: int


@dataclass(frozen=True)
class FixedStep:
    """An instant every `dt` seconds from each primitive's start, and its end."""

    dt: float


@dataclass(frozen=True)
class Adaptive:
    """As dense as `MAX_MOTION` requires, then bisected until Q is exact to `tolerance` (a fraction)."""

    tolerance: float = DEFAULT_TOLERANCE


Sampling = FixedCount | FixedStep | Adaptive


def first_samples(sampling: Sampling, stage: Stage, observer: Observer, targets: Sequence[Target]) -> Samples:
    """The samples of every piece before any bisection; both ends of every piece are among them."""
    primitives = stage.motion.primitives
    instants: list[Array]
    match sampling:
        case FixedCount(samples):
            instants = [np.linspace(p.start, p.end, samples, dtype=float) for p in primitives]
        case FixedStep(dt):
            instants = [p.start + dt * np.arange(int((p.end - p.start) / dt) + 1, dtype=float) for p in primitives]
        case Adaptive():
            instants = _equal_motion(stage, observer, targets)
    return within_pieces(stage.pieces, instants)


def within_pieces(pieces: Sequence[Piece], instants: Sequence[Array]) -> Samples:
    """Samples at instants of each primitive [s], shape (k,) each, and at both ends of every piece."""
    t = [_within(piece, instants[piece.primitive]) for piece in pieces]
    return Samples(np.repeat(np.arange(len(t)), [len(times) for times in t]), np.concatenate(t))


def sample_count(sampling: Sampling, motion: Motion) -> float:
    """Approximate number of samples of a fixed sampling; 0 for the adaptive one, which bounds itself."""
    match sampling:
        case FixedCount(samples):
            return float(samples) * len(motion.primitives)
        case FixedStep(dt):
            return motion.time / dt
        case Adaptive():
            return 0.0


def _within(piece: Piece, instants: Array) -> Array:
    inner = instants[(instants > piece.start + 1e-9) & (instants < piece.end - 1e-9)]
    return np.concatenate([[piece.start], inner, [piece.end]] if piece.end > piece.start else [[piece.start]])


def _equal_motion(stage: Stage, observer: Observer, targets: Sequence[Target]) -> list[Array]:
    """Instants of each primitive with no motion larger than `MAX_MOTION` between them."""
    pieces = {piece.primitive: number for number, piece in reversed(list(enumerate(stage.pieces)))}
    primitives = stage.motion.primitives

    def steps(instants: dict[int, Array]) -> dict[int, Array]:
        """Largest motion between the instants of each primitive [m]."""
        piece = np.repeat([pieces[index] for index in instants], [len(t) for t in instants.values()])
        samples = Samples(piece, np.concatenate(list(instants.values())))
        found = np.append(_steps(stage.states(samples), observer, targets), 0.0)
        parts = np.split(found, np.cumsum([len(t) for t in instants.values()])[:-1])
        return {index: part[:-1] for index, part in zip(instants, parts, strict=True)}

    probes = {i: np.linspace(primitives[i].start, primitives[i].end, _PROBES) for i in sorted(pieces)}
    instants = {}
    for index, step in steps(probes).items():
        travelled = np.concatenate([[0.0], np.cumsum(step)])
        count = max(1, int(np.ceil(travelled[-1] / _SPACING)))
        even = np.linspace(0.0, travelled[-1], count + 1)
        instants[index] = np.interp(even, travelled, probes[index]) if travelled[-1] else probes[index][[0, -1]]
    for index, step in steps(instants).items():
        t, wide = instants[index], np.flatnonzero(step > MAX_MOTION)
        instants[index] = np.insert(t, wide + 1, 0.5 * (t[wide] + t[wide + 1]))
    return [instants.get(index, np.array([primitive.start])) for index, primitive in enumerate(primitives)]


def _steps(states: SceneStates, observer: Observer, targets: Sequence[Target]) -> Array:
    """Motion of the fastest tracked point from each state to the next [m], shape (m - 1,)."""
    boxes = [box for target in targets for box in target.boxes]
    tracked = [(states.X_WF[solid.part.parent], solid.corners) for solid in observer.solids]
    tracked += [(states.box_poses(box), box_corners(box.size)) for box in boxes]
    tracked += [(states.camera_poses(camera), VIEW) for camera in observer.cameras]
    moving = [(X_WF, points) for X_WF, points in tracked if len(X_WF) > 1]
    if not moving:
        return np.zeros(states.count - 1)
    paths = np.concatenate([_paths(X_WF, points) for X_WF, points in moving])
    moved = paths[:, 1:] - paths[:, :-1]
    steps: Array = np.sqrt(np.einsum("kmi,kmi->km", moved, moved).max(axis=0))
    return steps


def _paths(X_WF: Array, points: Array) -> Array:
    """World positions, shape (k, m, 3), of k points of a frame, (k, 3), that is at X_WF, (m, 4, 4).

    One matrix product of all states at once is several times faster than one for each.
    """
    rotated = points @ X_WF[:, :3, :3].reshape(-1, 3).T
    paths: Array = rotated.reshape(len(points), -1, 3) + X_WF[:, :3, 3]
    return paths
