"""The first samples of a motion: a fixed number, a fixed step, or as dense as movement and images ask for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sqrp_cli.geometry import Array, box_corners
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.programming.coverage.stage import Samples, Stage, states_of
from sqrp_cli.programming.motion.plan_motion import Motion
from sqrp_cli.programming.pieces import Piece
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.targets import Target

DEFAULT_TOLERANCE = 1e-3
"""Largest error of Q that bisection leaves, as a fraction (0.1 points)."""

MAX_MOTION = 0.01
"""Largest motion between neighbouring samples in adaptive sampling [m].

It applies to every corner of a target and of a box around a moving part; for a camera on a link, to its centre and a
point 1 m in front of it.
"""

MAX_STEP, MIN_STEP = 0.05, 0.001
"""Largest time between neighbouring samples where a formula applies and a joint moves [s].

The first, or the frame period of the fastest camera if that is less, but no less than the second.
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
    """As dense as `MAX_MOTION` and `longest_step` say, then bisected until Q is exact to `tolerance` (a fraction)."""

    tolerance: float = DEFAULT_TOLERANCE


Sampling = FixedCount | FixedStep | Adaptive


def longest_step(cameras: Iterable[Camera]) -> float:
    """Largest time between adaptive samples where a formula applies and a joint moves [s].

    No gain or loss of sight that lasts as long falls between two samples, whatever the speeds, and at most one image of
    each camera falls into any that does.
    """
    return max(MIN_STEP, min([MAX_STEP, *(1.0 / camera.rate for camera in cameras)]))


def first_samples(sampling: Sampling, stage: Stage, observer: Observer, targets: Sequence[Target]) -> Samples:
    """The samples of every piece before any bisection; both ends of every piece are among them."""
    return all_first_samples(sampling, observer, [(stage, targets)])[0]


def all_first_samples(
    sampling: Sampling, observer: Observer, motions: Sequence[tuple[Stage, Sequence[Target]]]
) -> list[Samples]:
    """As `first_samples` of each of several motions in one cell, which is faster together.

    motions: each with what must be seen during it.
    """
    if isinstance(sampling, Adaptive):
        instants = _equal_motion(observer, motions)
    else:
        instants = [[_fixed(sampling, p.start, p.end) for p in stage.motion.primitives] for stage, _ in motions]
    return [within_pieces(stage.pieces, t) for (stage, _), t in zip(motions, instants, strict=True)]


def _fixed(sampling: FixedCount | FixedStep, start: float, end: float) -> Array:
    """The instants of a primitive."""
    if isinstance(sampling, FixedCount):
        return np.linspace(start, end, sampling.samples, dtype=float)
    return start + sampling.dt * np.arange(int((end - start) / sampling.dt) + 1, dtype=float)


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


_Instants = dict[int, Array]
"""Of some primitives of a motion by their index: instants [s], or something of each."""


def _equal_motion(observer: Observer, motions: Sequence[tuple[Stage, Sequence[Target]]]) -> list[list[Array]]:
    """Instants of each primitive of motions with no more movement and time between them than allowed."""
    probes, longest = [_probes(stage) for stage, _ in motions], longest_step(observer.cameras)
    instants = [
        {index: _spread(t[index], step, longest if stage.asks(index) else np.inf) for index, step in steps.items()}
        for (stage, _), t, steps in zip(motions, probes, _steps_of_all(observer, motions, probes), strict=True)
    ]
    for t, steps in zip(instants, _steps_of_all(observer, motions, instants), strict=True):
        for index, step in steps.items():
            wide = np.flatnonzero(step > MAX_MOTION)
            t[index] = np.insert(t[index], wide + 1, 0.5 * (t[index][wide] + t[index][wide + 1]))
    return [
        [t.get(index, np.array([primitive.start])) for index, primitive in enumerate(stage.motion.primitives)]
        for (stage, _), t in zip(motions, instants, strict=True)
    ]


def _probes(stage: Stage) -> _Instants:
    """Instants at which the speeds of each primitive with pieces are measured."""
    primitives = stage.motion.primitives
    used = sorted({piece.primitive for piece in stage.pieces})
    return {index: np.linspace(primitives[index].start, primitives[index].end, _PROBES) for index in used}


def _spread(probes: Array, moved: Array, longest: float) -> Array:
    """Instants between which about `_SPACING` is moved at most, and no more time passes than `longest` [s].

    moved: between neighbouring probes [m].
    """
    share = np.maximum(moved / _SPACING, np.diff(probes) / longest)
    passed = np.concatenate([[0.0], np.cumsum(share)])
    even = np.linspace(0.0, passed[-1], max(1, int(np.ceil(passed[-1]))) + 1)
    return np.interp(even, passed, probes) if passed[-1] else probes[[0, -1]]


def _steps_of_all(
    observer: Observer, motions: Sequence[tuple[Stage, Sequence[Target]]], instants: Sequence[_Instants]
) -> list[_Instants]:
    """Largest movement from each instant of a primitive to the next [m], for several motions."""
    samples = [_at_instants(stage, t) for (stage, _), t in zip(motions, instants, strict=True)]
    states, found = states_of([stage for stage, _ in motions], samples), []
    ends = np.cumsum([0, *map(len, samples)]).tolist()
    for (stage, targets), t, rows in zip(motions, instants, map(slice, ends, ends[1:]), strict=True):
        moving = {name: X_WF[rows] for name, X_WF in states.X_WF.items() if stage.moves(name)}
        step = np.append(_steps(moving, rows.stop - rows.start, observer, targets), 0.0)
        parts = np.split(step, np.cumsum([len(of_one) for of_one in t.values()])[:-1])
        found.append({index: part[:-1] for index, part in zip(t, parts, strict=True)})
    return found


def _at_instants(stage: Stage, instants: _Instants) -> Samples:
    """Samples at instants of primitives, each in the first piece of its primitive."""
    first = {piece.primitive: number for number, piece in reversed(list(enumerate(stage.pieces)))}
    piece = np.repeat([first[index] for index in instants], [len(t) for t in instants.values()])
    return Samples(piece, np.concatenate(list(instants.values())))


def _steps(moving: Mapping[str, Array], count: int, observer: Observer, targets: Sequence[Target]) -> Array:
    """Movement of the fastest tracked point from each of `count` states to the next [m], shape (count - 1,).

    moving: world poses of the frames that move, shape (count, 4, 4).
    """
    boxes = [box for target in targets for box in target.boxes]
    paths = [_paths(moving[s.part.parent], s.corners) for s in observer.solids if s.part.parent in moving]
    paths += [_paths(moving[box.frame] @ box.X_FB, box_corners(box.size)) for box in boxes if box.frame in moving]
    paths += [_paths(moving[c.frame] @ c.X_FC, VIEW) for c in observer.cameras if c.frame in moving]
    if not paths:
        return np.zeros(count - 1)
    together = np.concatenate(paths)
    moved = together[:, 1:] - together[:, :-1]
    steps: Array = np.sqrt(np.einsum("kmi,kmi->km", moved, moved).max(axis=0))
    return steps


def _paths(X_WF: Array, points: Array) -> Array:
    """World positions, shape (k, m, 3), of k points of a frame, (k, 3), that is at X_WF, (m, 4, 4).

    One matrix product of all states at once is several times faster than one for each.
    """
    rotated = points @ X_WF[:, :3, :3].reshape(-1, 3).T
    return rotated.reshape(len(points), -1, 3) + X_WF[:, :3, 3]
