"""Solids, boxes, cameras and lights as the compiled kernel reads them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from math import cos

import numpy as np

from sqrp_cli.camera.detector import MODULE_PIXELS, PER_BIT
from sqrp_cli.camera.light import ANY_BRIGHTNESS, MARKER, Light, brightness_of, look_alike
from sqrp_cli.camera.markers import DICTIONARIES
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import Array, pose
from sqrp_cli.kernel import kernel
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import Solid
from sqrp_cli.sight.targets import SoughtBox

SKIN = 1e-3
"""Amount by which a box is shrunk on every side for sight tests [m].

A solid that only touches it must not hide it.
"""

_THIN = 1e-9  # How much thicker than twice the skin a side may be that counts as thin, for rounding [m]
_LENSES = {"none": 0, "equidistant": 1, "plumb_bob": 2, "rational_polynomial": 2}
_NOWHERE = pose(np.eye(3), (0.0, 0.0, -1e6))[None]
"""Of a frame that states do not have: of a question asked before, or of an object whose place is not known."""
_KEPT = 16  # Combinations of cameras and boxes whose records are kept, as they are asked for again and again


def shrink(size: Sequence[float], normal: Sequence[float] | None) -> tuple[Array, Array]:
    """A box of `size` [m] without its skin, so that a solid that only touches it does not hide it.

    Half its extents, and its centre in the frame of the whole box, shape (3,) each [m]. A side no thicker than twice
    the skin keeps its thickness; the box then moves by the skin along its normal instead.
    """
    extents = np.asarray(size, dtype=float)
    thin = extents <= 2 * SKIN + _THIN
    offset = SKIN * np.asarray(normal, dtype=float) if thin.any() and normal is not None else np.zeros(3)
    return 0.5 * np.where(thin, extents, extents - 2 * SKIN), offset


class SightScene:
    """Solids that may hide boxes, with the lights that shine on them."""

    def __init__(self, solids: Sequence[Solid], lights: Mapping[str, Light]) -> None:
        """Lights are numbered in their order, solids too."""
        self._solids, self._colors = solids, list(dict.fromkeys(solid.color for solid in solids))
        parents = [solid.part.parent for solid in solids]
        self._frames = {name: number for number, name in enumerate(dict.fromkeys(parents))}
        self._called: dict[str, list[int]] = {}  # the solids of each link, object or part, by index
        for index, solid in enumerate(solids):
            for name in {solid.part.parent, solid.part.name}:
                self._called.setdefault(name, []).append(index)
        self.parts: list[str] = sorted({solid.name for solid in solids})
        """The name of each part; all pieces of a link are one."""
        rank = {name: number for number, name in enumerate(self.parts)}
        self._with_solids = partial(
            kernel.Scene,
            [solid.compiled for solid in solids],
            frame=np.array([self._frames[parent] for parent in parents], dtype=np.int64),
            part=np.array([rank[solid.name] for solid in solids], dtype=np.int64),
            is_scenery=np.array([solid.color is not None for solid in solids], dtype=bool),
        )
        records = list[tuple[object, ...]]()
        for light in lights.values():
            if light.is_ambient:
                records.append((0, light.intensity, np.zeros(3), np.zeros(3), 0.0))
            else:
                kind, place = (1, np.zeros(3)) if light.position is None else (2, light.position)
                records.append((kind, light.intensity, light.heading, place, cos(light.half_beam)))
        self._lights = np.array(records, dtype=kernel.LIGHT)
        self._masks: dict[object, Array] = {}
        self._scenes: dict[tuple[tuple[Projection, ...], tuple[SoughtBox, ...]], kernel.Scene] = {}

    def request(self, cameras: Sequence[Projection], boxes: Sequence[SoughtBox], states: SceneStates) -> kernel.Request:
        """What cameras see of boxes in states, as a question to the kernel."""
        key = (tuple(cameras), tuple(boxes))
        if key not in self._scenes:
            for old in list(self._scenes)[: 1 - _KEPT]:
                del self._scenes[old]
            self._scenes[key] = self._scene(*key)
        for frame in {*(box.frame for box in boxes), *(one.camera.frame for one in cameras)}:
            if frame not in states.X_WF:
                raise KeyError(frame)
        return kernel.Request(
            self._scenes[key], states.count, [states.X_WF.get(name, _NOWHERE) for name in self._frames]
        )

    def _scene(self, cameras: Sequence[Projection], boxes: Sequence[SoughtBox]) -> kernel.Scene:
        """The scene as the kernel reads it, with what some cameras look for."""
        masks = np.array([self._mask(box) for box in boxes], dtype=bool).reshape(len(boxes), 3, len(self._solids))
        sought, lenses = list[tuple[object, ...]](), list[tuple[object, ...]]()
        for name in (*(box.frame for box in boxes), *(one.camera.frame for one in cameras)):
            self._frames.setdefault(name, len(self._frames))
        for box in boxes:
            shrunk, limits, reads = shrink(box.size, box.normal), box.limits, 0.0
            if limits.is_usual and limits.dictionaries:
                codes = [DICTIONARIES[name] for name in limits.dictionaries]
                reads = max(
                    one.modules * (MODULE_PIXELS * ((one.modules - 2) / (1 + one.corrected)) ** PER_BIT)
                    for one in codes
                )
            told = (
                MARKER if limits.kind == "aruco" else ANY_BRIGHTNESS if box.color is None else brightness_of(box.color)
            )
            # Whether what the image's edge leaves of a box counts as what a part does that hides some of it.
            truncates = limits.is_usual and limits.kind == "color"
            sought.append((
                0.5 * np.asarray(box.size), *shrunk, box.normal or (0.0, 0.0, 0.0), box.normal is not None,
                *limits.distance, limits.max_incidence, limits.min_pixels, limits.min_visible, truncates,
                reads, *told, box.color is None, self._frames[box.frame], box.X_FB[:3],
            ))  # fmt: skip
        for projection in cameras:
            one = projection.camera
            bent = np.pad(np.asarray(one.distortion, dtype=float), (0, 8 - len(one.distortion)))
            lenses.append((
                _LENSES[one.distortion_model], bent, projection.radius, one.matrix[:2], one.width, one.height, one.near,
                one.far, one.gain or 1.0, one.X_FC[:3], self._frames[one.frame],
            ))  # fmt: skip
        return self._with_solids(
            boxes=np.array(sought, dtype=kernel.BOX),
            masks=masks.transpose(1, 2, 0),
            cameras=np.array(lenses, dtype=kernel.CAMERA),
            lights=self._lights,
        )

    def _mask(self, box: SoughtBox) -> Array:
        """Whether each solid can hide the box, looks like what it seeks, and is that, shape (3, s)."""
        key = box.encloses, box.seeks, box.color
        if key not in self._masks:
            found = np.zeros((3, len(self._solids)), dtype=bool)
            found[0] = True
            for name in box.encloses:
                found[0, self._called.get(name, [])] = False
            alike = {color for color in self._colors if look_alike(box.color, color)}
            found[1] = [solid.color in alike for solid in self._solids] if alike else False
            found[2, self._called.get(box.seeks or "", [])] = True
            found[1] &= ~found[2]
            self._masks[key] = found
        return self._masks[key]
