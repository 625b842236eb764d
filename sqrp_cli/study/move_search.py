"""The search for a path of one joint move along which the cameras lose sight of little, and for how long they lose it.

It goes by evolution: N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016. That is in here because it is short, asks
for whole populations at once, and gives the same numbers wherever it runs: the library imports SciPy where that is
installed, which takes longer than a search may.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import islice
from typing import Literal

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.timing import MotionLimits
from sqrp_cli.motion.way_around import motion_through
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer
from sqrp_cli.study.observation import look_at
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import PlannedMotion
from sqrp_cli.trajectory import JointSpan, Trajectory


class _ElsewhereStage(Stage):
    """The stage of a motion with its joints at other positions."""

    def __init__(self, stage: Stage, q: Array) -> None:
        """q: positions of the driven joints at the samples to come, shape (m, n)."""
        super().__init__(stage.model, stage.motion, stage.pieces, stage.X_WO)
        self._q = q

    def positions(self, samples: Samples) -> Array:
        """Those given, whatever the samples."""
        if len(samples) != len(self._q):
            raise ValueError(f"there are positions for {len(self._q)} samples, not {len(samples)}")
        return self._q


@dataclass(frozen=True, eq=False)
class WatchedMove:
    """A joint move of a studied way, which may take any path between its ends."""

    scene: PlannedMotion
    primitive: int
    """Its index."""

    @property
    def name(self) -> str:
        """Of the move."""
        return self.scene.motion.primitives[self.primitive].name

    @cached_property
    def pieces(self) -> list[int]:
        """Indices of the motion's pieces within the move."""
        return [index for index, piece in enumerate(self.scene.stage.pieces) if piece.primitive == self.primitive]

    @property
    def is_monitored(self) -> bool:
        """Whether any formula applies during the move."""
        return any(self.scene.stage.pieces[index].literals for index in self.pieces)

    def blind_times(self, observer: Observer, trajectories: Sequence[Trajectory], samples: int) -> Array:
        """How long the state is not covered on each of b trajectories of the arm, about [s], shape (b,).

        Cameras look at each in the middle of as many equal stretches of time as `samples` says. Where formulas begin
        or end within the move, their share of its time counts as that in the studied motion.
        """
        if not trajectories:
            return np.zeros(0)
        stage, timed = self.scene.stage, self.scene.motion.primitives[self.primitive]
        share = (np.arange(samples) + 0.5) / samples
        q = np.concatenate([trajectory.positions(share * trajectory.duration) for trajectory in trajectories])
        driven = timed.trajectory.path.end
        q = np.concatenate([q, np.broadcast_to(driven[q.shape[1] :], (len(q), len(driven) - q.shape[1]))], axis=1)
        ends = np.array([stage.pieces[index].end for index in self.pieces[:-1]])
        piece = np.array(self.pieces)[np.searchsorted(ends, timed.start + share * (timed.end - timed.start))]
        at = Samples(np.tile(piece, len(trajectories)), np.zeros(len(q)))
        seen = look_at(observer, _ElsewhereStage(stage, q), self.scene.targets, at)
        blind = (seen.monitored & ~seen.states_covered).reshape(len(trajectories), samples)
        times: Array = blind.mean(axis=1) * np.array([trajectory.duration for trajectory in trajectories])
        return times


class Evolution:
    """A normal distribution of n numbers that moves to where populations drawn from it are best, and adapts its shape.

    The default constants of the tutorial (table 1), with positive weights.
    """

    def __init__(self, mean: Array, deviation: Array, size: int, seed: int) -> None:
        """mean, deviation: of the first population in each number, shape (n,). size: of every population."""
        n = len(mean)
        weights = np.log((size + 1) / 2) - np.log(np.arange(1, size // 2 + 1))
        self._weights = weights / weights.sum()
        mu = 1 / (self._weights**2).sum()
        self._c_sigma = (mu + 2) / (n + mu + 5)
        self._damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + self._c_sigma
        self._c_c = (4 + mu / n) / (n + 4 + 2 * mu / n)
        self._c_1 = 2 / ((n + 1.3) ** 2 + mu)
        self._c_mu = min(1 - self._c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        self._mu, self._expected = mu, np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
        self._mean, self._scale, self._size = mean, deviation, size
        self._sigma, self._C = 1.0, np.eye(n)
        self._path_sigma, self._path_c, self._generation = np.zeros(n), np.zeros(n), 0
        self._random = np.random.default_rng(seed)

    def population(self) -> Array:
        """The next population, shape (size, n)."""
        variances, axes = np.linalg.eigh(self._C)
        # The symmetric root: unlike the axes, it hardly changes where the shape hardly changes.
        root, self._whiten = (axes * variances**power @ axes.T for power in (0.5, -0.5))
        drawn = self._random.normal(size=(self._size, len(self._mean)))
        population: Array = self._mean + self._scale * self._sigma * (drawn @ root)
        return population

    def learn(self, population: Array, values: Array) -> None:
        """Adapt to the values of the last population, shape (size,); less is better, equal ones count in order."""
        best = np.argsort(values, kind="stable")[: len(self._weights)]
        steps = (population[best] - self._mean) / (self._scale * self._sigma)
        step = self._weights @ steps
        self._mean = self._mean + self._scale * self._sigma * step
        c = self._c_sigma
        self._path_sigma = (1 - c) * self._path_sigma + np.sqrt(c * (2 - c) * self._mu) * (self._whiten @ step)
        length, self._generation = float(np.linalg.norm(self._path_sigma)), self._generation + 1
        grown = np.sqrt(1 - (1 - c) ** (2 * self._generation))
        moving = length / grown < (1.4 + 2 / (len(step) + 1)) * self._expected
        c = self._c_c
        self._path_c = (1 - c) * self._path_c + moving * np.sqrt(c * (2 - c) * self._mu) * step
        kept = 1 - self._c_1 - self._c_mu + (not moving) * self._c_1 * c * (2 - c)
        shape = self._c_mu * (steps.T * self._weights) @ steps
        self._C = kept * self._C + self._c_1 * np.outer(self._path_c, self._path_c) + shape
        self._sigma *= np.exp(min(1.0, self._c_sigma / self._damping * (length / self._expected - 1)))


SEARCH_WEIGHT = 10.0
"""Seconds of motion that a blind second counts for in the search: more than in the end, so that it learns to see."""

COST_DECIMALS = 6
"""Costs equal to this many decimals of a second are equal."""

DEVIATION, FINE_DEVIATION = np.deg2rad(30.0), np.deg2rad(6.0)
"""Of the first vias in every joint [rad]; of sliding joints, as many metres: around the middle of the direct path, and
around the best path so far."""

DETOUR = 0.5
"""The same at most, as a share of how far a joint can go during the direct move."""

PHASES: tuple[tuple[Literal["middle", "near", "split"], int], ...] = (
    ("middle", 8),
    ("near", 3),
    ("split", 6),
    ("near", 3),
)
"""What a search does, one after the other and then again, and for how many generations: look around the middle of the
direct path, near the best path, and around that with two vias in place of one."""

POPULATION = 12
"""Paths tried at once."""


@dataclass(frozen=True)
class Closeness:
    """How closely a path is looked at."""

    step: float
    """Time between looks [s], about."""
    fewest: int
    most: int
    """Looks at one path."""


ROUGHLY, FINELY = Closeness(1.0, 8, 16), Closeness(0.3, 24, 48)
"""For all of a population, and for the better half of it."""

EXACTLY = Closeness(0.0, 100, 100)
"""For paths that seem to be the best, and those that are left in the end."""

PATH_COST = 10
"""The work of drawing and timing one path, in looks."""

SETTLED = 0.1
"""A move that cannot win more than this any more is not searched further [s]."""


@dataclass(eq=False)
class SeenPath:
    """A path of a joint move, with its figures as far as they are known."""

    vias: Array
    """Shape (k, n); without rows, it is the direct path."""
    trajectory: Trajectory
    """Of the arm."""
    blind: float = np.inf
    """How long the state is not covered [s]; infinite as long as nobody looked."""
    free: bool | None = None
    """Whether it keeps every clearance; None as long as nobody asked."""

    @property
    def time(self) -> float:
        """Its duration [s]."""
        return self.trajectory.duration


@dataclass(frozen=True, eq=False)
class MoveSpace:
    """The paths that a joint move may take."""

    move: WatchedMove
    q0: Array
    q1: Array
    """Its ends, shape (n,)."""
    bounds: JointSpan
    """Of its vias."""
    limits: MotionLimits
    scene: PlacedScene
    direct: SeenPath
    """Its path in the direct way."""
    longest: float
    """Longest duration of interest [s]."""

    def cost(self, path: SeenPath) -> float:
        """What the search minimises [s], rounded, so that rounding does not order equal paths."""
        return round(SEARCH_WEIGHT * path.blind + path.time, COST_DECIMALS)

    def path(self, vias: Array) -> SeenPath:
        """The path that bends around vias, shape (k, n)."""
        return SeenPath(vias, motion_through(self.q0, vias, self.q1, self.limits))

    def is_free(self, path: SeenPath) -> bool:
        """Whether a path keeps every clearance."""
        if path.free is None:
            path.free = self.scene.is_free(path.trajectory.path)
        return path.free


class MoveSearch:
    """Evolution of the vias of one joint move."""

    def __init__(self, space: MoveSpace, seed: int) -> None:
        self.space, self.best = space, space.direct
        self._found, self._seed, self._begun, self._left = [space.direct], seed, 0, 0

    @property
    def best_cost(self) -> float:
        """Of the best path so far [s]."""
        return self.space.cost(self.best)

    @property
    def is_settled(self) -> bool:
        """Whether hardly anything can be won."""
        return self.best_cost - self.space.direct.time < SETTLED

    def advance(self, observer: Observer) -> int:
        """One generation: all paths are looked at roughly, then the better half again; gives the work, in looks."""
        space = self.space
        if self._left == 0:
            kind, self._left = PHASES[self._begun % len(PHASES)]
            vias, middle = self.best.vias, 0.5 * (space.q0 + space.q1)[None]
            mean = middle if kind == "middle" or not len(vias) else vias
            if kind == "split" and len(mean) == 1:
                mean = np.concatenate([2 * mean + space.q0, 2 * mean + space.q1]) / 3
            deviation = {"middle": DEVIATION, "near": FINE_DEVIATION, "split": 0.5 * DEVIATION}[kind]
            reach = np.tile(DETOUR * space.direct.time * space.limits.velocity, len(mean))
            self._low, self._high = (np.tile(bound, len(mean)) for bound in space.bounds)
            seed = self._seed + self._begun
            self._evolution = Evolution(mean.reshape(-1), np.minimum(deviation, reach), POPULATION, seed)
            self._begun += 1
        self._left -= 1
        drawn = np.clip(self._evolution.population(), self._low, self._high)
        paths = [space.path(vias) for vias in drawn.reshape(POPULATION, -1, len(space.q0))]
        worth = list(filter(self._is_worth_a_look, paths))
        work = self.look(observer, worth, ROUGHLY)
        better = sorted(worth, key=space.cost)[: POPULATION // 2]
        work += self.look(observer, better, FINELY) + self._take(observer, better)
        costs = [np.inf if path.free is False else space.cost(path) for path in paths]
        self._evolution.learn(drawn, np.array(costs))
        return work + PATH_COST * len(paths)

    def try_others(self, observer: Observer, vias: Sequence[Array]) -> int:
        """Try the vias that other searches found best: moves of one candidate pass the same places; gives the work."""
        paths = [path for path in map(self.space.path, vias) if self._is_worth_a_look(path)]
        return self.look(observer, paths, FINELY) + self._take(observer, paths)

    def look(self, observer: Observer, paths: Sequence[SeenPath], closeness: Closeness) -> int:
        """Find the blind times of paths; gives the number of looks."""
        wanted = self.space.direct.time / closeness.step if closeness.step else np.inf
        looks = int(np.clip(wanted, closeness.fewest, closeness.most))
        times = self.space.move.blind_times(observer, [path.trajectory for path in paths], looks)
        for path, blind in zip(paths, times.tolist(), strict=True):
            path.blind = blind
        return len(paths) * looks

    def _is_worth_a_look(self, path: SeenPath) -> bool:
        """Whether a path would be better than the best, if it were seen throughout."""
        return path.time < min(self.best_cost, self.space.longest)

    def _take(self, observer: Observer, paths: Sequence[SeenPath]) -> int:
        """Remember paths; gives the number of looks.

        The first free one that seems to be the best so far is looked at once more: luck between few looks must not
        decide.
        """
        better = (path for path in sorted(paths, key=self.space.cost) if self.space.cost(path) < self.best_cost)
        hopeful = list(islice(filter(self.space.is_free, better), 1))
        looks = self.look(observer, hopeful, EXACTLY)
        self._found += [path for path in paths if path.free is not False]
        self.best = min([self.best, *hopeful], key=self.space.cost)
        return looks

    def left(self, weight: float, most: int) -> list[SeenPath]:
        """The direct path and the best others of which none is both longer and blind for longer than another.

        weight: seconds of motion that a blind second counts for.
        """
        kept: list[SeenPath] = []
        for path in sorted(self._found, key=lambda path: (path.time, path.blind)):
            if not kept or path.blind < kept[-1].blind:
                kept.append(path)
        others = sorted((path for path in kept if len(path.vias)), key=lambda path: weight * path.blind + path.time)
        return [self.space.direct, *others[: most - 1]]


def exchange(observer: Observer, searches: Sequence[MoveSearch], others: Sequence[MoveSearch]) -> int:
    """Have searches try the vias that others found best; gives the work that it was, in looks."""
    found = [(other, other.best.vias) for other in others if len(other.best.vias)]
    work = 0
    for search in searches:
        work += search.try_others(observer, [vias for other, vias in found if other is not search])
    return work + PATH_COST * len(found) * len(searches)
