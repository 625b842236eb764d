"""Search for camera poses with which the paper's findings come out of the pipeline.

The paper gives results and no layout. Motions do not depend on cameras, so the candidates are studied once. Every
camera of a random pool is asked once what it sees of them, where it stands and displaced by small errors. Simulated
annealing then looks for the few cameras of the pool that together make the figures come out, and finally moves these
cameras by small steps until the figures hold for the displaced ones too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.geometry import displacement, look_at
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.programming.assessment import Study
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.observer import Observer

Random = np.random.Generator
Penalty = Callable[[Sequence["Sight"]], float]

MOVED, TURNED = 0.002, np.radians(0.2)
"""How far cameras may be off [m, rad]."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera sees of each study, where it stands and displaced.

    sees, hidden: whether it covers each target, and whether only something in the way prevents it, per study an array
    of shape (variants, samples, targets).
    """

    camera: Camera
    sees: tuple[np.ndarray, ...]
    hidden: tuple[np.ndarray, ...]


def sight(camera: Camera, observer: Observer, studies: Sequence[Study], variants: int) -> Sight:
    """Ask a camera about every study; the first variant is the camera itself."""
    random = np.random.default_rng(int(1e4 * np.abs(camera.X_FC[:3, 3]).sum()))
    crowd = Observer((camera, *(displaced(camera, random) for _ in range(variants - 1))), observer.solids)
    sees, hidden = [], []
    for study in studies:
        states = study.stage.states(study.timeline.samples)
        causes = [np.stack([box.cause for box in crowd.verdicts(target, states)]) for target in study.targets]
        clear = [(c == Cause.NONE).all(axis=0).T for c in causes]
        in_view = [np.isin(c, (Cause.NONE, Cause.HIDDEN)).all(axis=0).T for c in causes]
        sees.append(np.stack(clear, axis=-1))
        hidden.append(np.stack([view & ~free for view, free in zip(in_view, clear, strict=True)], axis=-1))
    return Sight(camera, tuple(sees), tuple(hidden))


def displaced(camera: Camera, random: Random) -> Camera:
    """The camera moved by `MOVED` in a random direction and turned by `TURNED` about a random axis."""
    position, rotation = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    return replace(camera, X_FC=camera.X_FC @ displacement(MOVED * position, TURNED * rotation))


def qualities(study: Study, index: int, chosen: Sequence[Sight]) -> np.ndarray:
    """Q_avg and Q_eoi [%] of a study, which has this index in the sights, for every variant, shape (variants, 2)."""
    timeline = study.timeline
    required, steps = timeline.observation.required, np.nan_to_num(timeline.steps)
    seen = np.any([one.sees[index] for one in chosen], axis=0)
    covered = (seen | ~required).all(axis=-1) & required.any(axis=-1)
    run = covered[:, :-1] & covered[:, 1:]
    inside = timeline.interesting[:-1] & timeline.interesting[1:]
    return 100 * np.stack([run @ steps / timeline.T, (run & inside) @ steps / timeline.T_eoi], axis=-1)


def random_camera(random: Random, aims: np.ndarray, model: Camera, fovs: Sequence[float]) -> Camera:
    """A camera around the robot that looks near one of the points `aims`, shape (n, 3) [m]; fovs: [rad]."""
    azimuth, radius = random.uniform(0, 2 * np.pi), random.uniform(0.9, 1.7)
    eye = np.round([radius * np.cos(azimuth), radius * np.sin(azimuth), random.uniform(0.35, 1.5)], 2)
    aim = np.round(random.choice(aims) + random.normal(size=3) * (0.12, 0.12, 0.08), 2)
    return placed(model, eye, aim, float(random.choice(fovs)))


def nudged(random: Random, camera: Camera) -> Camera:
    """The camera with another place, direction or field of view, by some millimetres or centimetres and degrees."""
    step, eye = random.choice([0.005, 0.01, 0.02, 0.05]), camera.X_FC[:3, 3]
    aim = eye + 1.2 * camera.X_FC[:3, 2] + step * random.normal(size=3)
    fov = np.degrees(2 * np.arctan(0.5 * camera.width / camera.matrix[0, 0])) + random.choice([0, 0, -2, -1, 1, 2])
    moved = eye + step * random.normal(size=3) * random.integers(0, 2, size=3)
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


def refine(
    chosen: Sequence[Sight], look: Callable[[Camera], Sight], penalty: Penalty, random: Random, rounds: int
) -> list[Sight]:
    """The cameras after small steps that lower the penalty."""
    best, least = list(chosen), penalty(chosen)
    for _ in range(rounds):
        index = int(random.integers(len(best)))
        trial = [*best[:index], look(nudged(random, best[index].camera)), *best[index + 1 :]]
        if (cost := penalty(trial)) < least:
            best, least = trial, cost
    return best


def beyond(value: float, lower: float, upper: float) -> float:
    """By how much a value lies outside an interval."""
    return max(lower - value, value - upper, 0.0)
