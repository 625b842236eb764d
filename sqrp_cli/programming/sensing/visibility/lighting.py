"""How boxes are lit: how much of each is too dark or too bright for its detector to tell what it looks for.

Each face of a box is a matt surface: a light adds its intensity times the cosine of its angle to the face (Lambert's
law). A light sees of a face what a camera in its place would see; the rest is in shadow, of what hides the box from
cameras. Shadows of several lights on one face are taken as independent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, cross, inverse, pose, transform
from sqrp_cli.knowledge.light import ANY_BRIGHTNESS, MARKER, Brightness, Light, brightness_of
from sqrp_cli.programming.sensing.sight_lines import SightLines, WatchedBoxes
from sqrp_cli.programming.sensing.visibility.culprit import find_largest
from sqrp_cli.programming.sensing.visibility.occlusion import near_pairs
from sqrp_cli.programming.sensing.visibility.visible_share import visible_shares
from sqrp_cli.programming.targets import SoughtBox

ROUGH = 0.02
"""Share of a box up to which it counts as well lit: shares are known to 2 points."""

_FAR = 1000.0
"""Distance from which a directional light shines [m]."""

_THICKNESS = 2e-4
"""Of the plate that stands for a face of a box [m]."""

_FAINT = 1e-3
"""Intensity on a face up to which its shadow does not matter."""

_SIDES = np.repeat(np.eye(3), 2, axis=0) * np.tile([[-1.0], [1.0]], (3, 1))
"""Outward normals of the faces of a box in its own axes, shape (6, 3)."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """How much of the boxes of v sight lines cannot be told for want or excess of light."""

    dark: Array
    """Share of the silhouette that is too dark, in 0..1, shape (v,)."""
    bright: Array
    """Share that is too bright, shape (v,)."""
    whole: Mask
    """Whether all of the box must be told, as of a marker, shape (v,)."""
    _lines: SightLines
    _watched: WatchedBoxes
    _lights: Sequence[Light]
    _faces: _Faces
    _light: _LightOn

    @property
    def lost(self) -> Array:
        """The share that cannot be told, shape (v,)."""
        return _lost(self.dark + self.bright, self.whole)

    @property
    def brightest(self) -> Indices:
        """Index of the light that does most to what is seen of each box, shape (v,)."""
        shares = (self._light.strength * self._light.reached)[:, self._faces.same] * self._faces.weight
        totals = np.stack([np.bincount(self._faces.line, share, len(self.dark)) for share in shares])
        found: Indices = totals.argmax(axis=0)
        return found

    def shading(self, which: Indices, part: Indices) -> Indices:
        """Index of the solid that keeps most light from each of some boxes, by index, -1 where none does.

        part: of each solid, shape (s,), see `find_largest`.
        """
        faces, lit = self._faces, self._light
        missing = (lit.strength * (1.0 - lit.reached))[:, faces.same] * faces.weight
        light, most = missing.argmax(axis=0), missing.max(axis=0)
        order = np.lexsort((most, faces.line))
        last = order[np.flatnonzero(np.diff(faces.line[order], append=-1))]
        darkest = np.full(len(self.dark), -1, dtype=np.int64)
        darkest[faces.line[last]] = last
        face, found = darkest[which], np.full(len(which), -1, dtype=np.int64)
        for index, one in enumerate(self._lights):
            rows = np.flatnonzero((face >= 0) & (light[face] == index) & (most[face] > 0))
            if len(rows):
                plates = _plates(faces, faces.same[face[rows]], self._lines, one)
                near = near_pairs(plates, self._watched.solid_poses, self._watched.opaque)
                found[rows] = find_largest(plates, self._watched.solid_poses, near, part)
        return found


def lighting_of(lines: SightLines, watched: WatchedBoxes, gain: Array, lights: Sequence[Light]) -> Lighting:
    """How the boxes of v sight lines are lit, as cameras with these gains (v,) see them."""
    faces, range_ = _Faces.of(lines), _Range.of(lines, watched.boxes, gain)
    lit = _light_on(faces, range_, lines, watched, lights)
    total = np.bincount(faces.line, faces.weight, len(gain))
    dark, bright = (
        np.bincount(faces.line, faces.weight * share, len(gain)) / np.maximum(total, 1e-300) for share in lit.badly
    )
    return Lighting(
        dark=dark,
        bright=bright,
        whole=range_.whole,
        _lines=lines,
        _watched=watched,
        _lights=lights,
        _faces=faces,
        _light=lit,
    )


def _lost(share: Array, whole: Mask) -> Array:
    return np.where(share <= ROUGH, 0.0, np.where(whole, 1.0, share))


class _Range(NamedTuple):
    """Between which intensities v boxes are told by the cameras that see them."""

    least: Array
    most: Array
    whole: Mask

    @classmethod
    def of(cls, lines: SightLines, boxes: Sequence[SoughtBox], gain: Array) -> _Range:
        ranges = np.array([_brightness(box) for box in boxes], dtype=float)
        box = lines.box[lines.hull]
        least, most = ranges[box].T / gain
        return cls(least, most, np.array([entry.color is None for entry in boxes], dtype=bool)[box])


def _brightness(box: SoughtBox) -> Brightness:
    if box.limits.kind == "aruco":
        return MARKER
    return ANY_BRIGHTNESS if box.color is None else brightness_of(box.color)


@dataclass(frozen=True, eq=False)
class _Faces:
    """The faces of boxes that cameras see: n of them, which show u different ones."""

    line: Indices
    """The sight line of each, shape (n,)."""
    weight: Array
    """How large it is in the image, shape (n,)."""
    same: Indices
    """Which of the different ones it is, shape (n,)."""
    first: Indices
    """A sight line of each different one, shape (u,)."""
    side: Indices
    """Which face of its box that is, shape (u,)."""

    @classmethod
    def of(cls, lines: SightLines) -> _Faces:
        hull = lines.hull
        half = lines.half_size[hull]
        areas = np.repeat(half[:, [1, 0, 0]] * half[:, [2, 2, 1]], 2, axis=1)
        eye = transform(inverse(lines.X_WB[hull]), lines.eyes[hull][:, None])[:, 0] - lines.offset[hull]
        way = eye[:, None] - _SIDES * half[:, None]
        weight = areas * np.maximum((way * _SIDES).sum(axis=2), 0.0) / np.linalg.norm(way, axis=2) ** 3
        line, side = np.nonzero(weight > 0)
        key = (lines.box[hull[line]] * (lines.state.max(initial=0) + 1) + lines.state[line]) * len(_SIDES) + side
        _, first, same = np.unique(key, return_index=True, return_inverse=True)
        return cls(line=line, weight=weight[line, side], same=same, first=line[first], side=side[first])

    def centers(self, lines: SightLines) -> Array:
        """The centres of the different ones in the world, shape (u, 3) [m]."""
        hull = lines.hull[self.first]
        center_B = lines.offset[hull] + _SIDES[self.side] * lines.half_size[hull]
        return transform(lines.X_WB[hull], center_B[:, None])[:, 0]


class _LightOn(NamedTuple):
    """What k lights do to faces."""

    strength: Array
    """Intensity on each of u different faces where nothing casts a shadow, shape (k, u)."""
    reached: Array
    """Share of each that is not in shadow, shape (k, u)."""
    badly: tuple[Array, Array]
    """Shares of n faces that are too dark and too bright, shape (n,) each."""


def _light_on(
    faces: _Faces, range_: _Range, lines: SightLines, watched: WatchedBoxes, lights: Sequence[Light]
) -> _LightOn:
    hull = lines.hull[faces.first]
    normal = (lines.X_WB[hull, :3, :3] @ _SIDES[faces.side][:, :, None])[..., 0]
    point = faces.centers(lines)
    ambient = sum(light.intensity for light in lights if light.is_ambient)
    strength, reached = np.zeros((len(lights), len(hull))), np.ones((len(lights), len(hull)))
    for index, light in enumerate(lights):
        rays = None if light.is_ambient else light.rays(point)
        cosine = 1.0 if rays is None else np.maximum((rays.towards * normal).sum(axis=1), 0.0)
        strength[index] = (light.intensity if rays is None else rays.strength) * cosine
    least, most = range_.least[faces.line], range_.most[faces.line]
    brightest = strength.sum(axis=0)[faces.same]
    # Where shadows change nothing, none is looked for.
    asked = np.isin(np.arange(len(hull)), faces.same[(brightest >= least) & ((ambient < least) | (brightest > most))])
    width = 2.0 * np.linalg.norm(lines.half_size[hull], axis=1)
    shining = [index for index, light in enumerate(lights) if not light.is_ambient]
    for index in shining:
        # Between a face and a lamp that is closer to it than it is wide nothing is taken to be.
        some = np.flatnonzero(asked & (strength[index] > _FAINT) & (lights[index].rays(point).distance > width))
        if len(some):
            plates = _plates(faces, some, lines, lights[index])
            seen = visible_shares(plates, watched.solid_poses, near_pairs(plates, watched.solid_poses, watched.opaque))
            reached[index, some[seen.line]] = seen.share
    dark, bright = np.zeros(len(faces.line)), np.zeros(len(faces.line))
    for chance, total in _combined(strength[shining], reached[shining], float(ambient)):
        dark += chance[faces.same] * (total[faces.same] < least)
        bright += chance[faces.same] * (total[faces.same] > most)
    return _LightOn(strength, reached, (dark, bright))


def _combined(strength: Array, reached: Array, ambient: float) -> Iterator[tuple[Array, Array]]:
    """Which of the lights that throw shadows reach a point of each face, by chance, with all light then, (f,) each."""
    for on in product((False, True), repeat=len(strength)):
        chance, total = np.ones(strength.shape[1]), np.full(strength.shape[1], ambient)
        for intensity, share, lit in zip(strength, reached, on, strict=True):
            chance = chance * (share if lit else 1.0 - share)
            total = total + lit * intensity
        yield chance, total


def _plates(faces: _Faces, some: Indices, lines: SightLines, light: Light) -> SightLines:
    """Some of the different faces, by index, shape (f,), as a light sees them."""
    line, point = faces.first[some], faces.centers(lines)[some]
    hull, side = lines.hull[line], _SIDES[faces.side[some]]
    rays = light.rays(point)
    X_WL = np.tile(pose(), (len(some), 1, 1))
    forward = -rays.towards
    across = cross(forward, np.where(np.abs(forward[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    X_WL[:, :3, 0], X_WL[:, :3, 1], X_WL[:, :3, 2] = across, cross(forward, across), forward
    X_WL[:, :3, 3] = point + np.minimum(rays.distance, _FAR)[:, None] * rays.towards
    half = lines.half_size[hull]
    return SightLines(
        state=lines.state[line],
        hull=np.arange(len(some)),
        box=lines.box[hull],
        X_WC=X_WL,
        X_WB=lines.X_WB[hull],
        half_size=np.where(side != 0, 0.5 * _THICKNESS, half),
        offset=lines.offset[hull] + side * (half + 0.5 * _THICKNESS),
    )
