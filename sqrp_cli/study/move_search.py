"""The search for a path of one joint move along which the cameras lose sight of little, and for how long they lose it.

It goes by evolution: N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016. That is in here because it is short, asks
for whole populations at once, and gives the same numbers wherever it runs: the library imports SciPy where that is
installed, which takes longer than a search may.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from itertools import count, islice
from typing import Literal

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.motion.collision import PlacedScene
from sqrp_cli.motion.timing import MotionLimits
from sqrp_cli.motion.way_around import motion_through
from sqrp_cli.records import dataclass
from sqrp_cli.sight.observer import Observer
from sqrp_cli.study.stage import Samples
from sqrp_cli.study.timeline import PlannedMotion, look_at
from sqrp_cli.trajectory import JointSpan, Trajectory


def blind_times(
    planned: PlannedMotion, primitive: int, observer: Observer, trajectories: Sequence[Trajectory], samples: int
) -> Array:
    """How long the state is not covered if a joint move takes each of b trajectories of the arm, about [s], shape (b,).

    primitive: of the move, by index. Cameras look at each trajectory in the middle of as many equal stretches of time
    as `samples` says. Where formulas begin or end within the move, their share of its time counts as in the planned
    motion.
    """
    if not trajectories:
        return np.zeros(0)
    stage, timed = planned.stage, planned.motion.primitives[primitive]
    share = (np.arange(samples) + 0.5) / samples
    q = np.concatenate([trajectory.positions(share * trajectory.duration) for trajectory in trajectories])
    driven = timed.trajectory.path.end
    q = np.concatenate([q, np.broadcast_to(driven[q.shape[1] :], (len(q), len(driven) - q.shape[1]))], axis=1)
    pieces = np.array([index for index, piece in enumerate(stage.pieces) if piece.primitive == primitive])
    ends = np.array([stage.pieces[index].end for index in pieces[:-1]])
    piece = pieces[np.searchsorted(ends, timed.start + share * (timed.end - timed.start))]
    at = Samples(np.tile(piece, len(trajectories)), np.zeros(len(q)))
    blind = look_at(observer, planned, at, q=q).blind.reshape(len(trajectories), samples)
    times: Array = blind.mean(axis=1) * np.array([trajectory.duration for trajectory in trajectories])
    return times


def evolution(mean: Array, deviation: Array, size: int, seed: int) -> Generator[Array, tuple[Array, Array], None]:
    """Populations of a normal distribution of n numbers that moves to where they are best, and adapts its shape.

    mean, deviation: of the first population in each number, shape (n,). Each population has the shape (size, n). What
    is sent back: it, as far as it was kept within limits, and its values, (size,); less is better, equal ones count in
    order. The default constants of the tutorial (table 1), with positive weights.
    """
    n = len(mean)
    weights = np.log((size + 1) / 2) - np.log(np.arange(1, size // 2 + 1))
    weights /= weights.sum()
    mu = 1 / (weights**2).sum()
    c_sigma = (mu + 2) / (n + mu + 5)
    damping = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + c_sigma
    c_c = (4 + mu / n) / (n + 4 + 2 * mu / n)
    c_1 = 2 / ((n + 1.3) ** 2 + mu)
    c_mu = min(1 - c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
    expected = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n * n))
    sigma, C, path_sigma, path_c = 1.0, np.eye(n), np.zeros(n), np.zeros(n)
    random = np.random.default_rng(seed)
    for generation in count(1):
        variances, axes = np.linalg.eigh(C)
        # The symmetric root: unlike the axes, it hardly changes where the shape hardly changes.
        root, whiten = (axes * variances**power @ axes.T for power in (0.5, -0.5))
        population, values = yield mean + deviation * sigma * (random.normal(size=(size, n)) @ root)
        best = np.argsort(values, kind="stable")[: len(weights)]
        steps = (population[best] - mean) / (deviation * sigma)
        step = weights @ steps
        mean = mean + deviation * sigma * step
        path_sigma = (1 - c_sigma) * path_sigma + np.sqrt(c_sigma * (2 - c_sigma) * mu) * (whiten @ step)
        length = float(np.linalg.norm(path_sigma))
        grown = np.sqrt(1 - (1 - c_sigma) ** (2 * generation))
        moving = length / grown < (1.4 + 2 / (n + 1)) * expected
        path_c = (1 - c_c) * path_c + moving * np.sqrt(c_c * (2 - c_c) * mu) * step
        kept = 1 - c_1 - c_mu + (not moving) * c_1 * c_c * (2 - c_c)
        C = kept * C + c_1 * np.outer(path_c, path_c) + c_mu * (steps.T * weights) @ steps
        sigma *= np.exp(min(1.0, c_sigma / damping * (length / expected - 1)))


SEARCH_WEIGHT = 10.0
"""Seconds of motion that a blind second counts for in the search: more than in the end, so that it learns to see."""
COST_DECIMALS = 6  # Costs equal to this many decimals of a second are equal
DEVIATION, FINE_DEVIATION = np.deg2rad(30.0), np.deg2rad(6.0)
"""Of the first vias in every joint [rad]; of sliding joints, as many metres: around the middle of the direct path, and
around the best path so far."""

DETOUR = 0.5  # The same at most, as a share of how far a joint can go during the direct move

PHASES: tuple[tuple[Literal["middle", "near", "split"], int], ...] = (
    ("middle", 8),
    ("near", 3),
    ("split", 6),
    ("near", 3),
)
"""What a search does, one after the other and then again, and for how many generations: look around the middle of the
direct path, near the best path, and around that with two vias in place of one."""

POPULATION = 12  # Paths tried at once
Closeness = tuple[float, int, int]
"""How closely a path is looked at: the time between looks [s], about, and the fewest and most looks at one path."""
ROUGHLY, FINELY = (1.0, 8, 16), (0.3, 24, 48)  # For all of a population, and for the better half of it
EXACTLY = (0.0, 100, 100)  # For paths that seem to be the best, and those that are left in the end
PATH_COST = 10  # The work of drawing and timing one path, in looks
SETTLED = 0.1  # A move that cannot win more than this any more is not searched further [s]


@dataclass(eq=False)
class SeenPath:
    """A path of a joint move, with its figures as far as they are known."""

    vias: Array  # Shape (k, n); without rows, it is the direct path
    trajectory: Trajectory  # Of the arm
    blind: float = np.inf  # How long the state is not covered [s]; infinite as long as nobody looked
    free: bool | None = None  # Whether it keeps every clearance; None as long as nobody asked

    @property
    def time(self) -> float:
        """Its duration [s]."""
        return self.trajectory.duration

    @property
    def cost(self) -> float:
        """What the search minimises [s], rounded, so that rounding does not order equal paths."""
        return round(SEARCH_WEIGHT * self.blind + self.time, COST_DECIMALS)


@dataclass(eq=False, kw_only=True)
class MoveSearch:
    """The paths that a joint move may take, and the evolution of their vias."""

    planned: PlannedMotion  # The way with its direct path
    primitive: int  # The move, by index
    q0: Array
    q1: Array  # Its ends, shape (n,)
    bounds: JointSpan  # Of its vias
    limits: MotionLimits
    placed: PlacedScene  # What it must not touch
    direct: SeenPath  # Its path in the direct way
    longest: float  # Longest duration of interest [s]
    seed: int
    best: SeenPath  # Of all paths so far; the direct one to begin with
    found: list[SeenPath]  # All paths that are not known to touch anything; the direct one to begin with
    _begun: int = 0
    _left: int = 0

    def advance(self, observer: Observer) -> int:
        """One generation: all paths are looked at roughly, then the better half again; gives the work, in looks."""
        if self._left == 0:
            kind, self._left = PHASES[self._begun % len(PHASES)]
            vias, middle = self.best.vias, 0.5 * (self.q0 + self.q1)[None]
            mean = middle if kind == "middle" or not len(vias) else vias
            if kind == "split" and len(mean) == 1:
                mean = np.concatenate([2 * mean + self.q0, 2 * mean + self.q1]) / 3
            deviation = {"middle": DEVIATION, "near": FINE_DEVIATION, "split": 0.5 * DEVIATION}[kind]
            reach = np.tile(DETOUR * self.direct.time * self.limits.velocity, len(mean))
            self._low, self._high = (np.tile(bound, len(mean)) for bound in self.bounds)
            seed = self.seed + self._begun
            self._evolution = evolution(mean.reshape(-1), np.minimum(deviation, reach), POPULATION, seed)
            self._population = next(self._evolution)
            self._begun += 1
        self._left -= 1
        drawn = np.clip(self._population, self._low, self._high)
        paths, worth = self.paths(drawn.reshape(POPULATION, -1, len(self.q0)))
        work = self.look(observer, worth, ROUGHLY)
        better = sorted(worth, key=lambda path: path.cost)[: POPULATION // 2]
        work += self.look(observer, better, FINELY) + self.take(observer, better)
        costs = np.array([np.inf if path.free is False else path.cost for path in paths])
        self._population = self._evolution.send((drawn, costs))
        return work + PATH_COST * len(paths)

    def look(self, observer: Observer, paths: Sequence[SeenPath], closeness: Closeness) -> int:
        """Find the blind times of paths; gives the number of looks."""
        step, fewest, most = closeness
        looks = int(np.clip(self.direct.time / step if step else np.inf, fewest, most))
        times = blind_times(self.planned, self.primitive, observer, [path.trajectory for path in paths], looks)
        for path, blind in zip(paths, times.tolist(), strict=True):
            path.blind = blind
        return len(paths) * looks

    def is_free(self, path: SeenPath) -> bool:
        """Whether a path keeps every clearance."""
        if path.free is None:
            path.free = self.placed.is_free(path.trajectory.path)
        return path.free

    def paths(self, vias: Sequence[Array] | Array) -> tuple[list[SeenPath], list[SeenPath]]:
        """The paths that bend around vias, (k, n) each, and those that would be the best if they were always seen."""
        paths = [SeenPath(some, motion_through(self.q0, some, self.q1, self.limits)) for some in vias]
        return paths, [path for path in paths if path.time < min(self.best.cost, self.longest)]

    def take(self, observer: Observer, paths: Sequence[SeenPath]) -> int:
        """Remember paths; gives the number of looks.

        The first free one that seems to be the best so far is looked at once more: luck between few looks must not
        decide.
        """
        better = (path for path in sorted(paths, key=lambda path: path.cost) if path.cost < self.best.cost)
        hopeful = list(islice(filter(self.is_free, better), 1))
        looks = self.look(observer, hopeful, EXACTLY)
        self.found += [path for path in paths if path.free is not False]
        self.best = min([self.best, *hopeful], key=lambda path: path.cost)
        return looks


def exchange(observer: Observer, searches: Sequence[MoveSearch], others: Sequence[MoveSearch]) -> int:
    """Have searches try the vias that others found best; gives the work that it was, in looks.

    Moves of one candidate pass the same places.
    """
    found = [(other, other.best.vias) for other in others if len(other.best.vias)]
    work = 0
    for search in searches:
        _, worth = search.paths([vias for other, vias in found if other is not search])
        work += search.look(observer, worth, FINELY) + search.take(observer, worth)
    return work + PATH_COST * len(found) * len(searches)
