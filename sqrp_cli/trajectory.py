"""Joint trajectories: a smooth path in joint space, and a time law along it.

Program files store trajectories and the runtime evaluates them, so this module needs only NumPy.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sqrp_cli.geometry import Array, Indices, read_only
from sqrp_cli.records import dataclass

NO_SLOPE = 1e-11
"""Highest coefficients of a path's slope up to this size count as rounding when its zeros are sought [rad or m]."""


@dataclass(frozen=True, eq=False)
class PiecewiseCubic:
    """The time law s(t): a cubic polynomial per piece, with constant jerk in each."""

    breaks: Array  # Start times of the pieces, and the end of the last one [s], rising from 0, shape (k + 1,)
    coefficients: Array  # Coefficients of 1, u, u^2 and u^3 with u = t minus the start of the piece, shape (k, 4)

    def __post_init__(self) -> None:
        object.__setattr__(self, "breaks", read_only(self.breaks))
        object.__setattr__(self, "coefficients", read_only(self.coefficients))

    def derivatives(self, t: ArrayLike, order: int = 3) -> Array:
        """The parameter s and its first time derivatives, up to 3, at times t [s] of shape (m,), shape (order + 1, m).

        A time outside the law counts as the nearest end. At a break the piece that begins there is evaluated.
        """
        inside = np.minimum(np.maximum(np.asarray(t, dtype=float), 0.0), self.breaks[-1])
        piece = _piece(self.breaks, inside)
        u, (c0, c1, c2, c3) = inside - self.breaks[piece], self.coefficients[piece].T
        found = [c0 + u * (c1 + u * (c2 + u * c3))]
        if order:
            found += [c1 + u * (2 * c2 + u * 3 * c3), 2 * c2 + u * 6 * c3, 6 * c3][:order]
        return np.array(found)

    def stretched(self, factor: float) -> PiecewiseCubic:
        """The same law `factor` times as slow: derivatives of order i shrink by factor^i."""
        return PiecewiseCubic(self.breaks * factor, self.coefficients / factor ** np.arange(4))

    def time_at(self, s: float) -> float:
        """The first time [s] at which a monotonic law reaches `s`, to floating-point resolution."""
        reached = self.derivatives(self.breaks, 0)[0]
        piece = int(np.clip(np.searchsorted(reached, s) - 1, 0, len(self.coefficients) - 1))
        c0, c1, c2, c3 = self.coefficients[piece].tolist()
        start = float(self.breaks[piece])
        early, late = 0.0, float(self.breaks[piece + 1]) - start
        while early < (u := 0.5 * (early + late)) < late:
            if c0 + u * (c1 + u * (c2 + u * c3)) < s:
                early = u
            else:
                late = u
        return start + late


class JointSpan(NamedTuple):
    """The range of positions of each of n joints."""

    lower: Array  # Shape (n,) [rad or m]
    upper: Array  # Shape (n,) [rad or m]


@dataclass(frozen=True, eq=False)
class JointPath:
    """A path of n joints over the parameter s in [0, 1]: a Chebyshev polynomial per piece and joint."""

    breaks: Array  # Starts of the pieces, and the end of the last one, rising from 0 to 1, shape (p + 1,)
    coefficients: Array  # Coefficients of T_0..T_d over each piece, mapped to [-1, 1] [rad or m], shape (p, d + 1, n)

    def __post_init__(self) -> None:
        object.__setattr__(self, "breaks", read_only(self.breaks))
        object.__setattr__(self, "coefficients", read_only(self.coefficients))

    @classmethod
    def line(cls, q0: ArrayLike, q1: ArrayLike) -> JointPath:
        """The straight line in joint space from q0 to q1, shape (n,) each."""
        start, end = np.asarray(q0, dtype=float), np.asarray(q1, dtype=float)
        return cls(np.array([0.0, 1.0]), np.array([[0.5 * (end + start), 0.5 * (end - start)]]))

    @property
    def end(self) -> Array:
        """Joint positions at s = 1 [rad or m], shape (n,): the sum of the coefficients, as T_k(1) = 1."""
        end: Array = self.coefficients[-1].sum(axis=0)
        return end

    def positions(self, s: ArrayLike) -> Array:
        """Joint positions [rad or m] at s of shape (m,), shape (m, n)."""
        return self.derivatives(s, 0)

    def derivatives(self, s: ArrayLike, order: int) -> Array:
        """The derivative of an order with respect to s, at s of shape (m,), shape (m, n); order 0 is the position.

        An s outside [0, 1] counts as the nearest end. At a break the piece that begins there is evaluated.
        """
        inside = np.minimum(np.maximum(np.asarray(s, dtype=float), 0.0), 1.0)
        start, width = self.breaks[:-1], self.breaks[1:] - self.breaks[:-1]
        coefficients = self.derived(order)
        if order:
            coefficients = coefficients * (2.0 / width[:, None]) ** order
        if len(width) > 1:
            piece = _piece(self.breaks, inside)
            start, width, coefficients = start[piece], width[piece], coefficients[:, piece]
        x = (2.0 * (inside - start) / width - 1.0)[:, None]
        # The sum of coefficients times Chebyshev polynomials at x, by the recurrence of C. W. Clenshaw (1955).
        if len(coefficients) == 1:
            constant: Array = coefficients[0] + 0.0 * x
            return constant
        lower, upper = coefficients[-2], coefficients[-1]
        for coefficient in coefficients[-3::-1]:
            lower, upper = coefficient - upper, lower + upper * (2 * x)
        total: Array = lower + upper * x
        return total

    def derivative_bounds(self, order: int = 1) -> Array:
        """An upper bound of the derivative's magnitude over each piece, for every joint, shape (p, n).

        It is the sum of the magnitudes of the derivative's Chebyshev coefficients, as |T_k| <= 1; exact for lines.
        """
        width = self.breaks[1:] - self.breaks[:-1]
        bounds: Array = np.abs(self.derived(order)).sum(axis=0) * (2.0 / width[:, None]) ** order
        return bounds

    def range_bounds(self) -> JointSpan:
        """Bounds of the least and the greatest positions over the whole path, shape (n,) each; exact for lines."""
        width = np.abs(self.coefficients[:, 1:]).sum(axis=1)
        middle = self.coefficients[:, 0]
        return JointSpan((middle - width).min(axis=0), (middle + width).max(axis=0))

    def extremes(self, joint: int) -> tuple[float, float]:
        """The least and the greatest position of one joint over the whole path [rad or m], exact up to rounding.

        They are at the ends of a piece or where its derivative is zero: the eigenvalues of the colleague matrix.
        """
        chebyshev = np.polynomial.chebyshev
        found = []
        for piece in self.coefficients[:, :, joint]:
            slopes = chebyshev.chebtrim(chebyshev.chebder(piece), NO_SLOPE)
            flat = np.clip(np.real(chebyshev.chebroots(slopes)), -1.0, 1.0) if len(slopes) > 1 else ()
            found.append(chebyshev.chebval(np.array([-1.0, 1.0, *flat]), piece))
        positions = np.concatenate(found)
        return float(positions.min()), float(positions.max())

    def derived(self, order: int) -> Array:
        """Chebyshev coefficients of a derivative with respect to x in [-1, 1], shape (max(d - order, 0) + 1, p, n).

        They are computed once, from those of the order below.
        """
        known: list[Array] = self.__dict__.setdefault("_derivatives", [self.coefficients.swapaxes(0, 1)])
        while len(known) <= order:
            above = known[-1].copy()
            derivative = np.empty_like(above[1:]) if len(above) > 1 else np.zeros_like(above)
            for k in range(len(above) - 1, 2, -1):
                derivative[k - 1] = 2 * k * above[k]
                above[k - 2] += k * above[k] / (k - 2)
            if len(above) > 2:
                derivative[1] = 4 * above[2]
            if len(above) > 1:
                derivative[0] = above[1]
            known.append(derivative)
        return known[order]

    def shifted(self, offset: ArrayLike) -> JointPath:
        """The same path moved by a constant, shape (n,), such as whole turns of some joints."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += np.asarray(offset, dtype=float)
        return JointPath(self.breaks, coefficients)


def side_by_side(paths: Sequence[JointPath]) -> Iterator[tuple[Indices, JointPath]]:
    """Paths joined into one for each polynomial degree, which takes hardly longer to evaluate than one of them.

    Each with the indices of its paths, shape (b,); those of the first path's n joints come first. All paths must have
    the same breaks and the same number of joints.
    """
    degrees = np.array([path.coefficients.shape[1] for path in paths])
    for degree in sorted(set(degrees.tolist())):
        rows = np.flatnonzero(degrees == degree)
        joints = np.concatenate([paths[row].coefficients for row in rows.tolist()], axis=2)
        yield rows, JointPath(paths[0].breaks, joints)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint positions over time: q(t) = path(law(t)) from 0 to `duration`."""

    path: JointPath
    law: PiecewiseCubic

    @classmethod
    def standstill(cls, q: ArrayLike, duration: float) -> Trajectory:
        """Standing at q, shape (n,), for `duration` [s]."""
        law = PiecewiseCubic(np.array([0.0, duration]), np.zeros((1, 4)))
        return cls(JointPath(np.array([0.0, 1.0]), np.asarray(q, dtype=float)[None, None, :]), law)

    @property
    def duration(self) -> float:
        """Length in time [s]."""
        return float(self.law.breaks[-1])

    @property
    def stands(self) -> bool:
        """Whether no joint ever moves."""
        return not (self.path.coefficients[:, 1:].any() and self.law.coefficients[:, 1:].any())

    def positions(self, t: ArrayLike) -> Array:
        """Joint positions [rad or m] at times t [s] of shape (m,), shape (m, n); the nearest end for times outside."""
        return self.path.positions(self.law.derivatives(t, 0)[0])

    def motion(self, t: ArrayLike, order: int) -> list[Array]:
        """Joint positions and their derivatives up to an order, 3 at most, at times t [s] of shape (m,), (m, n) each.

        Where the law's pieces meet, jerk jumps: the later piece counts, and the earlier one just before
        (`numpy.nextafter`). The formulas are those of the chain rule.
        """
        law = self.law.derivatives(t)
        path = [self.path.derivatives(law[0], k) for k in range(order + 1)]
        return [path[0], *(chain_rule(law[1:, :, None], path[1 : k + 1]) for k in range(1, order + 1))]

    def resting(self, duration: float) -> Trajectory:
        """The motion, from rest to rest, followed by standing at its end for `duration` [s]."""
        breaks = np.append(self.law.breaks, self.duration + duration)
        standing = [[float(self.law.derivatives([self.duration], 0)[0, 0]), 0.0, 0.0, 0.0]]
        return Trajectory(self.path, PiecewiseCubic(breaks, np.concatenate([self.law.coefficients, standing])))

    def shortened(self, duration: float) -> Trajectory:
        """What happens of it up to a time within its last standstill [s]."""
        kept = self.law.breaks < duration - 1e-9
        law = PiecewiseCubic(np.append(self.law.breaks[kept], duration), self.law.coefficients[: kept.sum()])
        return Trajectory(self.path, law)

    def followed_by(self, other: Trajectory) -> Trajectory:
        """The motion followed by another that begins where it ends, both from rest to rest.

        Each is one half of the new path; a motion without duration is left out.
        """
        if self.duration <= 0.0 or other.duration <= 0.0:
            return self if other.duration <= 0.0 else other
        both = [part.path.coefficients for part in (self, other)]
        degree = max(part.shape[1] for part in both)
        pieces = [np.pad(part, ((0, 0), (0, degree - part.shape[1]), (0, 0))) for part in both]
        path = JointPath(np.concatenate([self.path.breaks[:-1], 1.0 + other.path.breaks]) / 2, np.concatenate(pieces))
        later = 0.5 * other.law.coefficients
        later[:, 0] += 0.5
        breaks = np.concatenate([self.law.breaks[:-1], self.duration + other.law.breaks])
        return Trajectory(path, PiecewiseCubic(breaks, np.concatenate([0.5 * self.law.coefficients, later])))

    def to_numbers(self) -> dict[str, Any]:
        """Nested lists of plain numbers; `from_numbers` restores the same trajectory, bit for bit."""
        parts = (("path", self.path), ("law", self.law))
        return {
            name: {"breaks": part.breaks.tolist(), "coefficients": part.coefficients.tolist()} for name, part in parts
        }

    @classmethod
    def from_numbers(cls, numbers: Mapping[str, Mapping[str, Sequence[Any]]]) -> Trajectory:
        """The trajectory that `to_numbers` wrote."""
        path, law = (
            [np.array(numbers[name][key], dtype=float) for key in ("breaks", "coefficients")]
            for name in ("path", "law")
        )
        return cls(JointPath(*path), PiecewiseCubic(*law))


def chain_rule(law: Array, path: Sequence[Array]) -> Array:
    """The time derivative of q(s(t)) of order len(path), 1 to 3.

    law: the first three derivatives of s, shape (3, ...). path: those of q with respect to s, in order, shape (...)
    each, broadcast. Given bounds of their magnitudes, the result bounds its magnitude.
    """
    ds, dds, ddds = law
    if len(path) == 1:
        derivative: Array = path[0] * ds
    elif len(path) == 2:
        derivative = path[1] * ds**2 + path[0] * dds
    elif len(path) == 3:
        derivative = path[2] * ds**3 + 3 * path[1] * ds * dds + path[0] * ddds
    else:
        raise ValueError(f"the order of a derivative is 1, 2 or 3, not {len(path)}")
    return derivative


def _piece(breaks: Array, values: Array) -> Indices:
    """Index of the piece that each value lies in; the later one at a break, the last one at the end."""
    if len(breaks) == 2:
        return np.zeros(values.shape, dtype=np.intp)
    return np.minimum(np.maximum(breaks.searchsorted(values, side="right") - 1, 0), len(breaks) - 2)
