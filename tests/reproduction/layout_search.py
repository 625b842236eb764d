"""Search for camera poses with which the paper's findings come out of the pipeline.

The paper gives results and no layout. Motions do not depend on cameras, so the candidates are studied once. A camera is
asked what it sees of them from where it stands and from places near by, because the findings have to hold there too.
Simulated annealing looks for the few cameras of a random pool that together make the figures come out; then single
cameras are moved by small steps, or exchanged, as long as that helps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import displacement, look_at
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.solids import Solid
from sqrp_cli.study.assessment import Study

Random = np.random.Generator
Mask = NDArray[np.bool_]
Penalty = Callable[[Sequence["Sight"]], float]

MOVED, TURNED = 0.002, np.radians(0.2)
"""How far cameras may be off [m, rad]."""

WIDER = 1.3
"""How much further than that they are off while they are sought, so that what is found does not just hold."""


class Watched:
    """A study that cameras watch.

    What is in the way depends on where a camera is and not on how it is turned, and hardly changes over `MOVED`; it is
    looked up once for every place. Whether a box lies in the image is asked for every camera that is off.
    """

    def __init__(self, study: Study, solids: tuple[Solid, ...]) -> None:
        self.study, self._solids = study, solids
        self._states = study.stage.states(study.timeline.samples)
        self._free: dict[tuple[float, ...], Mask] = {}

    def seen_by(self, crowd: Sequence[Camera]) -> tuple[Mask, Mask]:
        """What cameras near the first of them see: as `Sight.sees` and `Sight.hidden`."""
        in_view = self._in_view(crowd)
        free = self._free_from(crowd[0]) if in_view.any() else np.ones(in_view.shape[1:], dtype=bool)
        return in_view & free, in_view & ~free

    def qualities(self, seen: Mask) -> np.ndarray:
        """Q_avg and Q_eoi [%], shape (v, 2), of what is seen of each target, shape (v, m, a)."""
        timeline = self.study.timeline
        required, steps = timeline.observation.required, np.nan_to_num(timeline.steps)
        covered = (seen | ~required).all(axis=-1) & required.any(axis=-1)
        run = covered[:, :-1] & covered[:, 1:]
        inside = timeline.interesting[:-1] & timeline.interesting[1:]
        return 100 * np.stack([run @ steps / timeline.T, (run & inside) @ steps / timeline.T_eoi], axis=-1)

    def column(self, predicate: str) -> int:
        """The index of the target of a predicate."""
        return next(i for i, target in enumerate(self.study.targets) if target.atom.predicate == predicate)

    def _in_view(self, crowd: Sequence[Camera]) -> Mask:
        """Whether every box of each target is within the limits of cameras and detector, shape (v, m, a)."""
        observer, rows = Observer(tuple(crowd), self._solids), np.arange(self._states.count)
        within = [
            np.all([observer.limits([box], self._states, rows).cause == Cause.NONE for box in target.boxes], axis=0)
            for target in self.study.targets
        ]
        return np.broadcast_to(np.stack(within, axis=-1), (len(crowd), self._states.count, len(within)))

    def _free_from(self, camera: Camera) -> Mask:
        """Whether nothing hides a target from where a camera is, shape (m, a)."""
        place = tuple(np.round(camera.X_FC[:3, 3], 6).tolist())
        if place not in self._free:
            observer = Observer((_seeing_all(camera),), self._solids)
            verdicts = observer.verdicts(self.study.targets, self._states, shares=False)
            free = [np.all([box.cause[:, 0] == Cause.NONE for box in boxes], axis=0) for boxes in verdicts]
            self._free[place] = np.stack(free, axis=-1)
        return self._free[place]


def _seeing_all(camera: Camera) -> Camera:
    """A camera in the same place with an image so large and fine that nothing before it is outside or too small."""
    focal, size = 5e3, 2_000_000
    matrix = np.array([[focal, 0, (size - 1) / 2], [0, focal, (size - 1) / 2], [0, 0, 1]])
    ahead = look_at(camera.X_FC[:3, 3], np.array([0.0, 0.0, 0.3]))
    return replace(camera, width=size, height=size, matrix=matrix, X_FC=ahead)


class Sight:
    """What one camera sees of each study, where it stands (the first variant) and in variants where it is off.

    It is asked when that is needed for the first time. A camera that is moved keeps its seed, so that the variants stay
    comparable.
    """

    def __init__(self, camera: Camera, seed: int, watched: Sequence[Watched], variants: int) -> None:
        random = np.random.default_rng(seed)
        self.camera, self.seed, self._watched = camera, seed, watched
        self._crowd = [camera, *(displaced(camera, random, WIDER) for _ in range(variants - 1))]
        self._seen: dict[int, tuple[Mask, Mask]] = {}

    def sees(self, index: int) -> Mask:
        """Whether it covers each target of a study, shape (variants, samples, targets)."""
        return self._look(index)[0]

    def hidden(self, index: int) -> Mask:
        """Whether only something in the way prevents that, shape (variants, samples, targets)."""
        return self._look(index)[1]

    def _look(self, index: int) -> tuple[Mask, Mask]:
        if index not in self._seen:
            self._seen[index] = self._watched[index].seen_by(self._crowd)
        return self._seen[index]


def displaced(camera: Camera, random: Random, times: float = 1.0) -> Camera:
    """The camera moved by `times` `MOVED` in a random direction and turned by `times` `TURNED` about a random axis."""
    position, rotation = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    return replace(camera, X_FC=camera.X_FC @ displacement(times * MOVED * position, times * TURNED * rotation))


def random_camera(random: Random, aims: np.ndarray, model: Camera, fovs: Sequence[float]) -> Camera:
    """A camera out of the arm's reach that looks near one of the points `aims`, shape (n, 3) [m]; fovs: [rad]."""
    eye = np.zeros(3)
    while np.linalg.norm(eye) < 1.05:
        azimuth, radius = random.uniform(0, 2 * np.pi), random.uniform(0.5, 1.7)
        eye = np.round([radius * np.cos(azimuth), radius * np.sin(azimuth), random.uniform(0.2, 1.5)], 2)
    aim = np.round(random.choice(aims) + random.normal(size=3) * (0.12, 0.12, 0.08), 2)
    return placed(model, eye, aim, float(random.choice(fovs)))


def nudged(random: Random, camera: Camera) -> Camera:
    """The camera turned, by tenths of a degree to degrees, and half of the time moved as well, by as many centimetres.

    Sometimes its field of view changes too.
    """
    step, eye = random.choice([0.002, 0.005, 0.01, 0.02, 0.05]), camera.X_FC[:3, 3]
    aim = eye + 1.2 * camera.X_FC[:3, 2] + step * random.normal(size=3)
    fov = np.degrees(2 * np.arctan(0.5 * camera.width / camera.matrix[0, 0])) + random.choice([0, 0, 0, -2, -1, 1, 2])
    moved = eye + step * random.normal(size=3) * random.integers(0, 2)
    return placed(camera, np.round(moved, 3), np.round(aim, 3), float(np.radians(np.clip(round(fov), 18, 60))))


def placed(model: Camera, eye: np.ndarray, aim: np.ndarray, fov: float) -> Camera:
    """A camera like `model` at `eye`, looking at `aim` [m], with a horizontal field of view [rad]."""
    focal = 0.5 * model.width / np.tan(0.5 * fov)
    matrix = np.array([[focal, 0, (model.width - 1) / 2], [0, focal, (model.height - 1) / 2], [0, 0, 1]])
    return replace(model, matrix=matrix, X_FC=look_at(eye, aim))


def anneal(pool: Sequence[Sight], count: int, penalty: Penalty, random: Random, rounds: int) -> list[Sight]:
    """The `count` sights of the pool with the least penalty that is found by exchanging one at a time."""
    chosen = [pool[index] for index in random.choice(len(pool), count, replace=False)]
    current = penalty(chosen)
    best = (current, chosen)
    for heat in np.geomspace(30.0, 0.2, rounds):
        trial = list(chosen)
        trial[random.integers(count)] = pool[random.integers(len(pool))]
        cost = penalty(trial)
        if cost < current or random.random() < np.exp((current - cost) / heat):
            chosen, current = trial, cost
            best = min(best, (current, chosen), key=lambda found: found[0])
    return best[1]


def off(values: np.ndarray, lower: float, upper: float) -> np.ndarray:
    """By how much values lie outside an interval."""
    return np.maximum(np.maximum(lower - values, values - upper), 0.0)


def total(costs: Iterable[np.ndarray], enough: float = np.inf) -> float:
    """The penalty of costs of every variant, shape (v,) each: their sum, and how many variants are not quite good.

    enough: where the penalty is at least that, costs that are left are not looked at any more.
    """
    cost, penalty = np.zeros(1), 0.0
    for one in costs:
        cost = cost + one
        penalty = float(cost.mean() + 20.0 * (cost > 0).mean())
        if penalty >= enough:
            break
    return penalty
