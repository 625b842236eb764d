"""The first samples of a motion: a fixed number, a fixed step, or as dense as movement and images ask for."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.stage import Samples, Stage

DEFAULT_TOLERANCE = 1e-3  # Largest error of Q that bisection leaves, as a fraction (0.1 points)
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
_PROBES = 21  # Instants per primitive at which speeds are measured, to place the adaptive samples
_SPACING = 0.97 * MAX_MOTION
"""Motion between adaptive samples as they are placed [m].

Speed counts as constant between the probes, and steps longer than `MAX_MOTION` are halved; this margin of a few per
cent avoids most halving.
"""

MAX_SAMPLES = 200_000  # Samples of one candidate beyond which a request is refused


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
    primitives = stage.motion.primitives
    match sampling:
        case FixedCount(count):
            instants = [np.linspace(p.start, p.end, count, dtype=float) for p in primitives]
        case FixedStep(dt):
            instants = [p.start + dt * np.arange(int((p.end - p.start) / dt) + 1, dtype=float) for p in primitives]
        case Adaptive():
            instants = _equal_motion(stage, observer, targets)
    times: list[Array] = []
    for piece in stage.pieces:
        t = instants[piece.primitive]
        inner = t[(t > piece.start + 1e-9) & (t < piece.end - 1e-9)]
        times.append(
            np.concatenate([[piece.start], inner, [piece.end]] if piece.end > piece.start else [[piece.start]])
        )
    return Samples(np.repeat(np.arange(len(times)), list(map(len, times))), np.concatenate(times))


def _equal_motion(stage: Stage, observer: Observer, targets: Sequence[Target]) -> list[Array]:
    """Instants of each primitive with no more movement and time between them than allowed."""
    primitives, longest = stage.motion.primitives, longest_step(observer.cameras)
    used = sorted({piece.primitive for piece in stage.pieces})
    asked = {piece.primitive for piece in stage.pieces if piece.literals}
    t = {index: np.linspace(primitives[index].start, primitives[index].end, _PROBES) for index in used}
    # The points of each frame that may move of which movement counts, before a column of ones, shape (k, 4).
    boxes = dict.fromkeys(box for target in targets for box in target.boxes)
    points: list[tuple[str, Array | None, Array]] = [(one.part.parent, None, one.corners) for one in observer.solids]
    points += [(box.frame, box.X_FB, box_corners(box.size)) for box in boxes]
    points += [(camera.frame, camera.X_FC, VIEW) for camera in observer.cameras]
    of_frames: defaultdict[str, list[Array]] = defaultdict(list)
    for frame, X_FP, some in points:
        if frame not in stage.resting:
            of_frames[frame].append(some if X_FP is None else transform(X_FP, some))
    joined = {name: np.concatenate(some) for name, some in of_frames.items()}
    tracked = {name: np.append(some, np.ones((len(some), 1)), axis=1) for name, some in joined.items()}
    for index, moved in _movements(stage, tracked, t).items():
        # About `_SPACING` is moved between two instants at most, and no more time passes than allowed.
        most = longest if index in asked and not primitives[index].trajectory.stands else np.inf
        passed = np.concatenate([[0.0], np.cumsum(np.maximum(moved / _SPACING, np.diff(t[index]) / most))])
        even = np.linspace(0.0, passed[-1], max(1, int(np.ceil(passed[-1]))) + 1)
        t[index] = np.interp(even, passed, t[index]) if passed[-1] else t[index][[0, -1]]
    for index, moved in _movements(stage, tracked, t).items():
        wide = np.flatnonzero(moved > MAX_MOTION)
        t[index] = np.insert(t[index], wide + 1, 0.5 * (t[index][wide] + t[index][wide + 1]))
    return [t.get(index, np.array([primitive.start])) for index, primitive in enumerate(primitives)]


def _movements(stage: Stage, tracked: Mapping[str, Array], instants: Mapping[int, Array]) -> dict[int, Array]:
    """Movement of the fastest tracked point from each instant of a primitive to the next [m].

    tracked: points of each frame before a column of ones, shape (k, 4). instants: of primitives, by their index [s].
    """
    first = {piece.primitive: number for number, piece in reversed(list(enumerate(stage.pieces)))}
    counts = [len(t) for t in instants.values()]
    samples = Samples(np.repeat([first[index] for index in instants], counts), np.concatenate([*instants.values()]))
    squares = np.zeros(len(samples))
    for name, X_WF in stage.states(samples).X_WF.items():
        if name in tracked and len(X_WF) > 1:
            # One matrix product of all states at once is several times faster than one for each.
            change = (X_WF[1:, :3] - X_WF[:-1, :3]).transpose(2, 1, 0).reshape(4, -1)
            moved = (tracked[name] @ change).reshape(-1, 3, len(X_WF) - 1)
            moved *= moved
            np.maximum(squares[:-1], moved.sum(axis=1).max(axis=0), out=squares[:-1])
    parts = np.split(np.sqrt(squares), np.cumsum(counts)[:-1])
    return {index: part[:-1] for index, part in zip(instants, parts, strict=True)}
