"""Fits the curve of a detector to what it saw and did not see, and judges it on frames that it did not learn from.

The document of `calibrate` has both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.detector import COEFFICIENTS, BoxSights, Curve, Detector, features
from sqrp_cli.document import Record, WorkspaceDocument, how_many, live
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.records import dataclass

FOLDS = 5  # Parts of the frames of which each is judged by the curve that the others teach
BINS = 10  # Of equal width, between probabilities 0 and 1, in which what is told is compared with what was seen
LEAST_LOOKS = 10  # Of a detector of which anything can be told
PER_TERM = 5  # Boxes that must have been seen, and as many missed, for each term of a curve
_VARIES = 0.02  # Standard deviation of a feature from which on its effect can be told
_RIDGE = 0.1  # Weight of the squares of coefficients, in standard deviations: without it some are endless
_MOST = (1.0, 0.995, 0.99, 0.98, 0.97, 0.95, 0.925, 0.9, 0.85, 0.8, 0.7, 0.6)
"""Probabilities in the best of views that are tried."""


@dataclass(frozen=True, eq=False, kw_only=True)
class DetectorLooks:
    """Looks of one detector at boxes in images, n in all; only those in range, in the image and not all hidden."""

    sights: BoxSights  # How each box was seen, shape (5, n)
    seen: Mask  # Whether the detector said what was true, shape (n,)
    covered: Mask  # Whether the box was within all limits, shape (n,)
    pose: Indices
    """Looks with the same number have much the same pose, and are learned from or judged together, shape (n,)."""

    def some(self, which: Mask) -> DetectorLooks:
        """Some of the looks."""
        return DetectorLooks(**{part.name: getattr(self, part.name)[..., which] for part in fields(self)})


@dataclass(frozen=True)
class ReliabilityBin:
    """Looks of which a curve tells much the same probability."""

    looks: int
    """How many."""
    told: float
    """Mean of the probability that the curve tells, in 0..1."""
    seen: float
    """Share of them in which the detector saw what was there, in 0..1."""


@dataclass(frozen=True, kw_only=True)
class Judged:
    """How well probabilities agree with what was seen."""

    calibration_error: float
    """Mean difference, over all looks, between what their bin tells and the share that was seen, in 0..1."""
    brier: float
    """Mean square of the difference between the probability and 1 (seen) or 0 (not seen)."""
    bins: tuple[ReliabilityBin, ...]
    """Those that are not empty, the least likely first."""


def judge(told: Array, seen: Mask) -> Judged:
    """Compare probabilities (n,) with what was seen (n,)."""
    at = np.minimum((told * BINS).astype(np.int64), BINS - 1)
    bins = [
        ReliabilityBin(int(here.sum()), float(told[here].mean()), float(seen[here].mean()))
        for here in (at == number for number in range(BINS))
        if here.any()
    ]
    return Judged(
        calibration_error=sum(one.looks * abs(one.told - one.seen) for one in bins) / len(seen),
        brier=float(((told - seen) ** 2).mean()),
        bins=tuple(bins),
    )


def held_out(looks: DetectorLooks, detector: Detector) -> Array:
    """How likely each look sees (n,), by the curve that the other parts teach. Each pose is in one part."""
    part, told = looks.pose % FOLDS, np.zeros(len(looks.seen))
    for number in range(FOLDS):
        here: NDArray[np.bool_] = part == number
        if here.any():
            told[here] = tell(fit(looks.some(~here), detector), looks.some(here), detector)
    return told


def tell(curve: Curve, looks: DetectorLooks, detector: Detector) -> Array:
    """How likely each look sees (n,), by a curve and the limits that it keeps."""
    hard_limits = replace(detector, curve=curve).hard_limits
    passed: Mask = ~np.any(list(_failed(hard_limits, looks.sights).values()), axis=0)
    return np.where(passed, curve.probability(looks.sights), 0.0)


def fit(looks: DetectorLooks, detector: Detector) -> Curve:
    """The curve that tells most likely what was seen, with coefficients that are not negative.

    It has a term for each `PER_TERM` boxes seen, and as many missed, those that tell most. A term stays out where
    the frames do not vary what it is about, or the effect would have the wrong sign; its limit then goes on, unless
    frames outside it show that it need not. Without terms it is the share that was seen within the limits, by the rule
    of succession, which is never 0 or 1.
    """
    found = features(looks.sights)
    spread, middle = found.std(axis=1), found.mean(axis=1)
    used = [index for index in range(len(found)) if spread[index] > _VARIES]
    most_terms = min(int(looks.seen.sum()), int((~looks.seen).sum())) // PER_TERM
    while used and most_terms:
        weights, most = _fitted(((found[used].T - middle[used]) / spread[used]).T, looks.seen.astype(float))
        if weights[1:].min() >= 0.0 and len(used) <= most_terms:
            break
        del used[int(weights[1:].argmin())]
    else:
        within = looks.seen[looks.covered]
        share = (within.sum() + 1.0) / (len(within) + 2.0)
        return Curve(bias=float(f"{np.log(share / (1.0 - share)):.4g}"))
    # The curve replaces the limits that some frame fails, if only by nothing. Its numbers have four digits.
    terms = {name: 0.0 for name, fails in _failed(detector, looks.sights).items() if fails.any()}
    slopes = weights[1:] / spread[used]
    terms |= {COEFFICIENTS[index]: float(f"{slope:.4g}") for index, slope in zip(used, slopes, strict=True)}
    slopes = np.array([terms.get(name, 0.0) for name in COEFFICIENTS])
    return Curve(bias=float(f"{weights[0] - float(slopes @ middle):.4g}"), most=most, **terms)


def _failed(detector: Detector, sights: BoxSights) -> dict[str, Mask]:
    """Which looks fail which limit, shape (n,) each."""
    (pixels, incidence, distance, visible, _), (near, far) = sights, detector.distance
    return {
        "pixels": pixels < detector.min_pixels,
        "incidence": incidence > detector.max_incidence,
        "distance": (distance < near) | (distance > far),
        "visible": visible < detector.min_visible,
    }


def _fitted(features: Array, seen: Array) -> tuple[Array, float]:
    """Weights of 1 and of features (f, n), and the probability in the best of views, that tell best what was seen.

    By Fisher scoring with halved steps, for each probability from the weights of the one before.
    """
    rows = np.vstack([np.ones(len(seen)), features])
    ridge = _RIDGE * np.diag([0.0, *np.ones(len(features))])

    def told(weights: Array, most: float) -> tuple[Array, float]:
        """How likely each look sees (n,), and the loss that is to be least."""
        probability: Array = most / (1.0 + np.exp(-np.clip(weights @ rows, -30.0, 30.0)))
        p = np.clip(probability, 1e-12, 1.0 - 1e-12)
        log_likelihood = seen * np.log(p) + (1.0 - seen) * np.log(1.0 - p)
        return p, float(0.5 * _RIDGE * (weights[1:] ** 2).sum() - log_likelihood.sum())

    weights = np.zeros(len(rows))
    found: list[tuple[float, int, Array, float]] = []
    for most in _MOST:
        if most < 1.0 and seen.mean() >= most:
            continue
        p, loss = told(weights, most)
        for _ in range(100):
            slope = p * (1.0 - p / most) / np.maximum(p * (1.0 - p), 1e-12)
            gradient = rows @ ((seen - p) * slope) - ridge @ weights
            information = (rows * (slope * slope * p * (1.0 - p))) @ rows.T + ridge
            step = np.linalg.solve(information + 1e-9 * np.eye(len(rows)), gradient)
            while (better := told(weights + step, most))[1] > loss and np.abs(step).max() > 1e-9:
                step = 0.5 * step
            if better[1] >= loss - 1e-9:
                break
            weights, (p, loss) = weights + step, better
        found.append((loss, len(found), weights, most))
    _, _, weights, most = min(found, key=lambda one: one[:2])
    return weights, most


@dataclass(frozen=True, kw_only=True)
class CalibratedDetector(Record):
    """What frames say about one detector."""

    looks: int
    """How often it looked at a box that was in range, in the image and not all hidden."""
    seen: float
    """Share of them in which it said what was true, in 0..1."""
    curve: Curve | None
    """Learned from all frames; null where these are too few."""
    held_out: Judged | None
    """The probabilities of each fifth of the poses by the curve that the others teach, compared with what was seen."""
    limits: Judged | None
    """The limits of the workspace, as probabilities of 1 and 0, compared with what was seen; null without looks."""
    reason: str | None
    """Why there is no curve."""


@dataclass(frozen=True, kw_only=True, repr=False)
class CalibrateDocument(WorkspaceDocument):
    """What `sqrp calibrate` finds."""

    VIEW = "sqrp_cli.show.terminal.run_view:print_calibration"

    document: Literal["calibrate"] = "calibrate"
    images: int
    """How many were looked at."""
    detectors: Mapping[str, CalibratedDetector]
    """By name, those that looked for anything."""
    patch: str
    """A unified diff that gives the workspace these curves; empty where there are none."""
    cell: Any = live()
    """The cell of the frames, as `open_cell` gives it."""
    looked: Any = live()
    """What each detector saw, by its name, as `calibrating.fit` has it."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        curves = [one for one in self.detectors.values() if one.curve is not None]
        return f"{self.workspace}: {how_many(curves, 'curve')} from {self.images} images"
