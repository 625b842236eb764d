"""Search for camera poses with which the paper's findings come out of the pipeline.

The paper gives results and no layout. Motions do not depend on cameras, so the candidates are studied once; every
camera of a random pool is asked once what it sees of them, alone and displaced by small errors; and simulated annealing
then looks for the few cameras of the pool that together make the figures come out, for every set of errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.geometry import look_at, pose
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.programming.assessment import Study
from sqrp_cli.programming.robustness import _error as small_displacement
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.observer import Observer

VARIANTS = 7
"""The pose itself and this many, less one, with errors."""


@dataclass(frozen=True)
class Figures:
    """Qualities in percent."""

    q_avg: float
    q_eoi: float


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera sees of each study.

    sees, hidden: whether it covers each target, and whether only something in the way prevents it, per study an array
    of shape (variants, samples, targets).
    """

    camera: Camera
    sees: tuple[np.ndarray, ...]
    hidden: tuple[np.ndarray, ...]


def sight(camera: Camera, observer: Observer, studies: Sequence[Study], variants_: int = VARIANTS) -> Sight:
    """Ask one camera, and the same with errors, about every study."""
    random = np.random.default_rng(int(1e4 * np.abs(camera.X_FC[:3, 3]).sum()))
    crowd = Observer((camera, *(displaced(camera, random) for _ in range(variants_ - 1))), observer.solids)
    sees, hidden = [], []
    for study in studies:
        states = study.stage.states(study.timeline.samples)
        causes = [np.stack([box.cause for box in crowd.verdicts(target, states)]) for target in study.targets]
        sees.append(np.stack([(c == Cause.NONE).all(axis=0).T for c in causes], axis=-1))
        unseen = [np.isin(c, (Cause.NONE, Cause.HIDDEN)).all(axis=0) & (c == Cause.HIDDEN).any(axis=0) for c in causes]
        hidden.append(np.stack([u.T for u in unseen], axis=-1))
    return Sight(camera, tuple(sees), tuple(hidden))


def displaced(camera: Camera, random: np.random.Generator) -> Camera:
    """The camera moved by 2 mm in a random direction and turned by 0.2 degrees about a random axis."""
    position, rotation = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
    return replace(camera, X_FC=camera.X_FC @ small_displacement(0.002 * position, np.radians(0.2) * rotation))


def random_camera(random: np.random.Generator, aims: np.ndarray, model: Camera, fovs: Sequence[float]) -> Camera:
    """A camera on a ring around the robot that looks near one of the points `aims`, shape (n, 3) [m]."""
    azimuth, radius = random.uniform(0, 2 * np.pi), random.uniform(0.9, 1.7)
    eye = np.round([radius * np.cos(azimuth), radius * np.sin(azimuth), random.uniform(0.35, 1.5)], 2)
    aim = np.round(random.choice(aims) + random.normal(size=3) * (0.12, 0.12, 0.08), 2)
    return placed(model, eye, aim, float(random.choice(fovs)))


def placed(model: Camera, eye: np.ndarray, aim: np.ndarray, fov: float) -> Camera:
    """A camera like `model` at `eye`, looking at `aim` [m], with a horizontal field of view [rad]."""
    focal = 0.5 * model.width / np.tan(0.5 * fov)
    matrix = np.array([[focal, 0, (model.width - 1) / 2], [0, focal, (model.height - 1) / 2], [0, 0, 1]])
    return replace(model, matrix=matrix, X_FC=look_at(eye, aim))


@dataclass(frozen=True, eq=False)
class Grading:
    """Qualities of the studies for a choice of cameras, for every variant."""

    studies: Sequence[Study]

    def figures(self, chosen: Sequence[Sight]) -> list[list[Figures]]:
        """Per study and variant the qualities."""
        return [[Figures(*q) for q in self._of_study(index, chosen)] for index in range(len(self.studies))]

    def _of_study(self, index: int, chosen: Sequence[Sight]) -> np.ndarray:
        timeline = self.studies[index].timeline
        required, steps = timeline.observation.required, np.nan_to_num(timeline.steps)
        seen = np.any([s.sees[index] for s in chosen], axis=0)
        state = (seen | ~required).all(axis=-1) & required.any(axis=-1)
        run = state[:, :-1] & state[:, 1:]
        inside = timeline.interesting[:-1] & timeline.interesting[1:]
        return 100 * np.stack([run @ steps / timeline.T, (run & inside) @ steps / timeline.T_eoi], axis=-1)


def anneal(
    pool: Sequence[Sight],
    count: int,
    penalty: Callable[[Sequence[Sight]], float],
    random: np.random.Generator,
    rounds: int,
    start: Sequence[int] | None = None,
) -> tuple[float, list[int]]:
    """Indices of `count` sights of the pool with a small penalty."""
    chosen = list(start) if start is not None else random.choice(len(pool), count, replace=False).tolist()
    current = penalty([pool[i] for i in chosen])
    best = (current, list(chosen))
    for heat in np.geomspace(30.0, 0.2, rounds):
        trial = list(chosen)
        trial[random.integers(count)] = int(random.integers(len(pool)))
        cost = penalty([pool[i] for i in trial])
        if cost < current or random.random() < np.exp((current - cost) / heat):
            chosen, current = trial, cost
            best = min(best, (current, list(chosen)))
    return best


def beyond(value: float, lower: float, upper: float) -> float:
    """By how much a value lies outside an interval."""
    return max(lower - value, value - upper, 0.0)
