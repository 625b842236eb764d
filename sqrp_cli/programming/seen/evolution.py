"""Search of a minimum among real numbers by evolution: N. Hansen, The CMA Evolution Strategy: A Tutorial, 2016.

In here because it is short, asks for whole populations at once, and gives the same numbers wherever it runs: the
library imports SciPy where that is installed, which takes longer than a search may.
"""

from __future__ import annotations

import numpy as np

from sqrp_cli.geometry import Array


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
