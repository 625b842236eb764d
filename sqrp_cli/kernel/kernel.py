"""The boundary of the compiled kernel: records and arrays in, arrays out.

Nothing is kept between calls but solids, which are made once; calls of several threads run side by side. Frames, parts
and colours are numbers here: who asks knows their names. What goes in is checked here, because the kernel does not.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from ctypes import c_int64, c_void_p
from enum import IntEnum
from itertools import compress
from typing import Any, NamedTuple
from weakref import finalize

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.kernel import library
from sqrp_cli.records import dataclass

CAMERA = np.dtype(
    [
        ("model", "f8"), ("distortion", "f8", 8), ("radius", "f8"), ("matrix", "f8", (2, 3)), ("width", "f8"),
        ("height", "f8"), ("near", "f8"), ("far", "f8"), ("gain", "f8"), ("X_FC", "f8", (3, 4)), ("frame", "f8"),
    ]
)  # fmt: skip
"""A camera: see `Camera` in `camera.hpp`."""

BOX = np.dtype(
    [
        ("half", "f8", 3), ("shrunk", "f8", 3), ("middle", "f8", 3), ("normal", "f8", 3), ("has_normal", "f8"),
        ("nearest", "f8"), ("farthest", "f8"), ("incidence", "f8"), ("pixels", "f8"), ("visible", "f8"),
        ("allows_truncation", "f8"), ("reads", "f8"), ("least_light", "f8"), ("most_light", "f8"), ("whole", "f8"),
        ("frame", "f8"), ("X_FB", "f8", (3, 4)),
    ]
)  # fmt: skip
"""A box of a target with the limits of its detector: see `Box` in `camera.hpp`."""
LIGHT = np.dtype([("kind", "f8"), ("intensity", "f8"), ("heading", "f8", 3), ("position", "f8", 3), ("cosine", "f8")])
"""A light: see `Light` in `scene.hpp`."""

_REQUEST = np.dtype(
    [
        ("solid_count", "i8"), ("solids", "u8"), ("solid_frame", "u8"), ("solid_part", "u8"), ("is_scenery", "u8"),
        ("X_WF", "u8"), ("pose_count", "u8"), ("box_count", "i8"), ("boxes", "u8"), ("opaque", "u8"), ("alike", "u8"),
        ("own", "u8"), ("camera_count", "i8"), ("cameras", "u8"), ("light_count", "i8"), ("lights", "u8"),
    ]
)  # fmt: skip
"""Counts and addresses of all that a call is about: see `Request` in `scene.hpp`."""

_COLLISIONS = np.dtype(
    [
        ("joints", "i8"), ("driven", "i8"), ("arm", "i8"), ("spine_joints", "i8"), ("bodies", "i8"), ("pairs", "i8"),
        ("parents", "u8"), ("turns", "u8"), ("axes", "u8"), ("terms", "u8"), ("ratios", "u8"), ("offsets", "u8"),
        ("radii", "u8"), ("spine", "u8"), ("solids", "u8"), ("frame", "u8"), ("depth", "u8"), ("rods_from", "u8"),
        ("rods", "u8"), ("X_FP", "u8"), ("inner", "u8"), ("outer", "u8"), ("clearance", "u8"),
    ]
)  # fmt: skip
"""Counts and addresses of what may collide: see `Collisions` in `collision.hpp`."""
MOST_LIGHTS = 8  # Of a call
Record = NDArray[np.void]  # Of one of these types


class Form(IntEnum):
    """The exact form of a solid."""

    MESH = 0
    BOX = 1
    SPHERE = 2
    CYLINDER = 3
    CAPSULE = 4


class Solid:
    """A solid as the kernel holds it, in the frame of its parent."""

    def __init__(
        self, vertices: Array, triangles: Indices, form: Form, X_PG: Array, half: Sequence[float], ball: Sequence[float]
    ) -> None:
        """vertices: (n, 3) [m]; triangles: indices of three each, (f, 3), counter-clockwise seen from outside.

        form: it is placed by X_PG (4, 4); half: half its sides, or its radius, 0 and half its straight part [m]; ball:
        the centre and the radius of one around it [m]. Raises ValueError for no triangles, for vertices that do not
        exist, and for what is not finite.
        """
        vertices, triangles = _reals(vertices), np.ascontiguousarray(triangles, np.int64)
        figures = np.array([*np.reshape(X_PG, -1), *half, *ball], dtype=float)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or triangles.shape != (len(triangles), 3) or not len(triangles):
            raise ValueError(f"a solid needs triangles, found shapes {vertices.shape} and {triangles.shape}")
        if triangles.min() < 0 or triangles.max() >= len(vertices):
            raise ValueError(f"a triangle names a vertex that is none of {len(vertices)}")
        if len(figures) != 23 or not (np.isfinite(vertices).all() and np.isfinite(figures).all()):
            raise ValueError("a solid has a figure that is not finite")
        made = library.load()
        made.solid_new.restype = c_void_p
        self.address: int = made.solid_new(
            _at(vertices), len(vertices), _at(triangles), len(triangles), int(form), _at(figures)
        )
        finalize(self, made.solid_free, c_void_p(self.address))

    def distance(self, other: Solid, X_AB: Array, within: float, enough: float) -> float | None:
        """The distance to another solid [m] if it is at most `within`, otherwise None; 0 where they meet.

        X_AB: pose of the other one's parent in that of this one, (4, 4). enough: one of at most this may be too large.
        Raises ValueError for a pose that is not finite.
        """
        X_AB = _reals(X_AB)
        if X_AB.shape != (4, 4) or not np.isfinite(X_AB).all():
            raise ValueError(f"a pose must be finite and of shape (4, 4), found {X_AB}")
        measure = library.load().solid_distance
        measure.restype = ctypes.c_double
        figures = map(ctypes.c_double, (within, enough))
        found: float = measure(c_void_p(self.address), c_void_p(other.address), _at(X_AB), *figures)
        return found if found <= within + 1e-9 else None


class Items(NamedTuple):
    """Questions: whether cameras see all of some consecutive boxes in a state; arrays of shape (n,)."""

    state: Indices
    first: Indices  # The first box, by index
    boxes: Indices  # How many there are


class Loss(NamedTuple):
    """How much of what matters may be lost by one target, in two respects."""

    steps: Array  # How much is, in each of m states in which and before which the target is not seen, shape (m, 2)
    bars: Array  # Too much, in both respects of a row; shape (b, 2)


@dataclass(frozen=True, eq=False)
class BoxVerdicts:
    """What c cameras make of n boxes, or of one box in n states: arrays of shape (n, c)."""

    cause: NDArray[np.int8]  # Of `Cause` in `camera.hpp`: the first limit that fails
    by: Indices
    """The image's side, the solid that hides or shades it or is behind it, or the light that is too bright; else -1."""
    figure: Array  # By how much the first failing limit is missed [m, pixels or rad]
    visible: Array  # The visible share of the silhouette, NAN where an earlier limit failed or it was not measured


def joint_poses(parents: Indices, turns: Mask, terms: Array, positions: Array) -> Array:
    """World poses (N, m, 4, 4) of N joints at m positions (m, N) [rad or m]; see `JointTree` for the other arrays."""
    terms, positions = _reals(terms), _reals(positions)
    joints, count = len(parents), len(positions)
    if len(turns) != joints or terms.shape != (joints, 3, 4, 4) or positions.shape != (count, joints):
        raise ValueError(f"{joints} joints have terms of shape {terms.shape} and positions of shape {positions.shape}")
    if not (np.asarray(parents) < np.arange(joints)).all():
        raise ValueError("a joint comes before its parent")
    X_WJ = np.empty((joints, count, 4, 4))
    parents, turns = _whole(parents), np.ascontiguousarray(turns, dtype=np.int64)
    given = (c_int64(joints), _at(parents), _at(turns), _at(terms), c_int64(count), _at(positions), _at(X_WJ))
    library.load().joint_poses(*given)
    return X_WJ


class Collisions:
    """Solids on and around an arm, and pairs of them that must not touch."""

    def __init__(self, solids: Sequence[Solid], whole: Mapping[str, Any], real: Mapping[str, Any]) -> None:
        """whole, real: arrays of these numbers by name.

        Of N joints, parents first: `parents` (N,), -1 for the world; `turns` (N,), else they slide; `axes` (N, 3);
        `terms` (N, 3, 4, 4), `ratios` (N, d) and `offsets` (N,) as of `JointTree`. Of the n joints of
        the arm, the first ones of the d driven: `radii` (n,), a size of each one's motions. Of the solids: `frame`, the
        joint that carries each, -1 for the world; `depth`, how many of the joints of the `spine` (s,) move it; `rods`
        from `rods_from[k]` to `rods_from[k + 1]`, the joints beside the spine that move it, too; `X_FP`, the poses of
        their parents. Of pairs: `inner`, `outer` and `clearance` [m]. Raises ValueError for what is not finite, and for
        indices of nothing.
        """
        arrays: dict[str, NDArray[Any]] = {name: _whole(np.asarray(values)) for name, values in whole.items()}
        arrays |= {name: _reals(values) for name, values in real.items()}
        arrays["solids"] = np.array([solid.address for solid in solids], dtype=np.uint64)
        joints, bodies = len(arrays["parents"]), len(solids)
        if not all(np.isfinite(array).all() for array in arrays.values()):
            raise ValueError("a figure of an arm, or of what is around it, is not finite")
        ends = {"parents": joints, "spine": joints, "rods": joints, "frame": joints, "inner": bodies, "outer": bodies}
        for name, end in ends.items():
            if len(arrays[name]) and not -1 <= arrays[name].min() <= arrays[name].max() < end:
                raise ValueError(f"`{name}` names one that is none of {end}")
        self.pairs, self.arm = len(arrays["inner"]), len(arrays["radii"])
        self.driven = arrays["ratios"].shape[1]
        self._kept = [solids, arrays]
        counts = {"joints": joints, "spine_joints": len(arrays["spine"]), "bodies": bodies, "pairs": self.pairs}
        counts |= {"driven": self.driven, "arm": self.arm}
        self._scene = _record(_COLLISIONS, counts | {name: array.ctypes.data for name, array in arrays.items()})

    def touching(self, q: Array, *, every: bool) -> Mask:
        """Which pairs are closer than their clearance at m positions of the driven joints (m, d), shape (m, pairs).

        every: whether all are found, or only the last one at each position.
        """
        q, found = self._positions(q), np.zeros((len(q), self.pairs), dtype=np.uint8)
        library.load().collisions_touching(_at(self._scene), _at(q), c_int64(len(q)), c_int64(every), _at(found))
        return found.view(bool)

    def motion_bounds(self, q: Array, variation: Array) -> Array:
        """How far each pair can move against each other around q (d,), where the arm's joints differ by (n,) [m]."""
        (q,), bounds = self._positions(q[None]), np.zeros(self.pairs)
        change = _reals(variation)
        library.load().collisions_bounds(_at(self._scene), _at(q), _at(change), _at(bounds))
        return bounds

    def first_contact(
        self, breaks: Array, coefficients: Array, slopes: Array, fingers: Array, resolution: float
    ) -> tuple[int, float] | None:
        """The first pair that comes too close along a path of the arm, and where; None proves that none does.

        breaks (p + 1,), coefficients (p, k, n), slopes (p, n): of its pieces, as of `JointPath` and its
        `derivative_bounds`. fingers: positions of the other driven joints. resolution: see `PlacedScene.check_path`.
        """
        fingers = _reals(fingers)
        arrays = [_reals(array) for array in (breaks, coefficients, slopes)]
        pieces, terms, joints = coefficients.shape
        shapes = [array.shape for array in arrays]
        if (
            shapes != [(pieces + 1,), (pieces, terms, self.arm), (pieces, self.arm)]
            or len(fingers) + joints != self.driven
        ):
            raise ValueError(f"a path has the shapes {shapes}, expected one of {self.arm} joints")
        if not all(np.isfinite(array).all() for array in (*arrays, fingers)):
            raise ValueError("a path is not finite")
        at, search = ctypes.c_double(), library.load().collisions_first
        search.restype = c_int64
        found: int = search(
            _at(self._scene), c_int64(pieces), c_int64(terms - 1), *map(_at, (*arrays, fingers)),
            ctypes.c_double(resolution), ctypes.byref(at),
        )  # fmt: skip
        return None if found < 0 else (found, at.value)

    def _positions(self, q: Array) -> Array:
        q = _reals(q)
        if q.shape != (len(q), self.driven) or not np.isfinite(q).all():
            raise ValueError(f"positions must be finite and of {self.driven} joints, found the shape {q.shape}")
        return q


class Scene:
    """Solids, boxes, cameras and lights, wherever their frames are: what many requests have in common."""

    def __init__(
        self,
        solids: Sequence[Solid],
        *,
        frame: Indices,
        part: Indices,
        is_scenery: Mask,
        boxes: Record,
        masks: Mask,
        cameras: Record,
        lights: Record,
    ) -> None:
        """boxes, cameras, lights: records of these types, shape (b,), (c,) and (l,).

        Of each of the s solids: frame, that of its parent, by number, shape (s,); part, a number that pieces share
        which are named together, (s,); is_scenery, whether its colour is known, so that it can be behind a box, (s,).
        masks: whether each solid can hide each box, looks like what it seeks, and is what it seeks, shape (3, s, b).
        Raises ValueError for shapes that do not fit, and for NAN.
        """
        s, b = len(solids), len(boxes)
        if masks.shape != (3, s, b):
            raise ValueError(f"masks of {s} solids and {b} boxes must have the shape (3, {s}, {b})")
        opaque, alike, own = map(_flags, masks)
        if not all(len(column) == s for column in (frame, part, is_scenery)):
            raise ValueError(f"columns of {s} solids must have as many rows")
        if len(lights) > MOST_LIGHTS:
            raise ValueError(f"found {len(lights)} lights, expected at most {MOST_LIGHTS}")
        for name, records, kind in (("box", boxes, BOX), ("camera", cameras, CAMERA), ("light", lights, LIGHT)):
            if records.dtype != kind or np.isnan(np.ascontiguousarray(records).view(float)).any():
                raise ValueError(f"a {name} has a figure that is none")
        frames = np.concatenate([frame, boxes["frame"], cameras["frame"]])
        if frames.min(initial=0) < 0:
            raise ValueError("the number of a frame is negative")
        self.frames, self.cameras, self.boxes = int(frames.max(initial=-1)) + 1, len(cameras), b
        self._kept: list[object] = [solids]
        self.fields = {
            "solid_count": s, "box_count": b, "camera_count": len(cameras), "light_count": len(lights),
            "solids": self._keep(np.array([solid.address for solid in solids], dtype=np.uint64)),
            "solid_frame": self._keep(_whole(frame)), "solid_part": self._keep(_whole(part)),
            "is_scenery": self._keep(_flags(is_scenery)), "boxes": self._keep(np.ascontiguousarray(boxes)),
            "cameras": self._keep(np.ascontiguousarray(cameras)), "lights": self._keep(np.ascontiguousarray(lights)),
            "opaque": self._keep(opaque), "alike": self._keep(alike), "own": self._keep(own),
        }  # fmt: skip
        """Those of `_REQUEST` that do not depend on states."""

    def _keep(self, array: NDArray[Any]) -> int:
        self._kept.append(array)
        address: int = array.ctypes.data
        return address


class Request:
    """A scene in m states: what a call is about."""

    def __init__(self, scene: Scene, states: int, X_WF: Sequence[Array]) -> None:
        """X_WF: poses of every frame, by number, (m, 4, 4) each, or (1, 4, 4) where it never moves; states: m.

        Raises ValueError for shapes that do not fit, where a frame is missing, and for poses that are not finite.
        """
        self._scene, self._states = scene, states
        self._count = np.array(list(map(len, X_WF)), dtype=np.int64)
        still = self._count == 1
        # Those that never move are often hundreds, and lie one after the other.
        resting = np.concatenate([np.empty((0, 4, 4)), *compress(X_WF, still.tolist())])
        moving = [_reals(X) for X in compress(X_WF, (~still).tolist())]
        if len(X_WF) < scene.frames or any(X.shape != (states, 4, 4) for X in moving):
            raise ValueError(f"poses of {scene.frames} frames are needed, found {sorted({X.shape for X in X_WF})}")
        self._X = [resting, *moving]
        if not np.isfinite(sum(X.sum() for X in self._X)):
            raise ValueError("the poses of a frame are not finite")
        self._places = np.empty(len(X_WF), dtype=np.uint64)
        self._places[still] = resting.ctypes.data + np.arange(len(resting)) * resting[:1].nbytes
        self._places[~still] = [X.ctypes.data for X in moving]
        at, counts = self._places.ctypes.data, self._count.ctypes.data
        self._request = _record(_REQUEST, {"X_WF": at, "pose_count": counts, **scene.fields})

    def cover(self, items: Items, needed: Indices, loss: Loss | None = None) -> Mask:
        """Whether cameras see items, shape (c, n), as far as they are asked.

        needed: how many cameras must see each item, shape (n,); no more are asked. Items of the same boxes follow each
        other. loss: after which none is asked.
        """
        steps, bars = Loss(np.empty((0, 2)), np.empty((0, 2))) if loss is None else loss
        if bars.shape != (len(bars), 2) or (len(bars) and steps.shape != (self._states, 2)):
            raise ValueError(f"a loss in {self._states} states has the shapes {steps.shape} and {bars.shape}")
        items = self._checked(items)
        state, first, count = items
        sights = np.full((self._scene.cameras, len(state)), -1, dtype=np.int8)
        bars, steps, needed = _reals(bars), _reals(steps), _whole(needed)
        self._call("cover", len(state), state, first, count, needed, len(bars), bars, steps, sights)
        sees: Mask = sights == 1
        return sees

    def judge(self, box: Indices, state: Indices, *, shares: bool, culprits: bool) -> BoxVerdicts:
        """What all cameras make of boxes in states, shape (n,) each.

        shares, culprits: whether visible shares are measured, and what is in the way is named.
        """
        box, state = self._looks(box, state)
        shape = self._scene.cameras, len(box)
        cause, by = np.empty(shape, dtype=np.int8), np.full(shape, -1)
        figure, visible = np.empty(shape), np.full(shape, np.nan)
        asked = by if culprits else None, figure, visible if shares else None
        self._call("judge", len(box), box, state, cause, *asked, None)
        return BoxVerdicts(cause.T, by.T, figure.T, visible.T)

    def measure(self, box: Indices, state: Indices) -> Array:
        """How all cameras face boxes in states, shape (n,) each: distance, incidence and size, shape (3, c, n).

        The distance is that from camera to box centre [m], the incidence the angle between the box's normal and the
        direction to the camera, 0 without a normal [rad], the size the square root of the area of the outline of the
        box's corners, NAN behind a camera [pixels].
        """
        box, state = self._looks(box, state)
        shape = self._scene.cameras, len(box)
        cause, by, figure, facing = np.empty(shape, np.int8), None, np.empty(shape), np.empty((3, *shape))
        self._call("judge", len(box), box, state, cause, by, figure, None, facing)
        return facing

    def occluders(self, box: Indices, camera: Indices, state: Indices, parts: int) -> tuple[Array, Array]:
        """How much of boxes each of some parts hides from cameras: as the first, and as the only one, (n, parts) each.

        box, camera, state: by index, shape (n,). All boxes must lie in front of the cameras.
        """
        box, state = self._looks(box, state)
        camera = _whole(camera)
        if camera.shape != box.shape or (
            len(camera) and not (camera.min() >= 0 and camera.max() < self._scene.cameras)
        ):
            raise ValueError(f"a camera is none of {self._scene.cameras}")
        first, alone = np.zeros((len(box), parts)), np.zeros((len(box), parts))
        self._call("occluders", len(box), box, camera, state, parts, first, alone)
        return first, alone

    def look_from(self, X_FC: Array, items: Items, decisive: Mask | None = None, *, limits_only: bool = False) -> Mask:
        """Which items each of l lenses, the request's cameras, sees from each of p poses in their frame, (l, p, n).

        X_FC: the poses, (p, 4, 4). decisive: items, shape (n,), without which a pose is given up: all that follow come
        out unseen. limits_only: whether only the limits of camera and detector count.
        """
        items, X_FC = self._checked(items), _reals(X_FC)
        if X_FC.shape[1:] != (4, 4) or not np.isfinite(X_FC).all():
            raise ValueError(f"the poses of a camera must be finite and of shape (p, 4, 4), found {X_FC.shape}")
        if decisive is not None and decisive.shape != items.state.shape:
            raise ValueError(f"what is decisive must have the shape {items.state.shape}")
        sees = np.zeros((self._scene.cameras, len(X_FC), len(items.state)), dtype=np.uint8)
        ends = None if decisive is None else _flags(decisive)
        self._call("look_from", len(X_FC), X_FC, len(items.state), *items, ends, int(limits_only), sees)
        return sees.view(bool)

    def _call(self, name: str, *arguments: int | NDArray[Any] | None) -> None:
        given = [_at(one) if isinstance(one, np.ndarray) else one for one in arguments]
        getattr(library.load(), name)(_at(self._request), *given)

    def _looks(self, box: Indices, state: Indices) -> tuple[Indices, Indices]:
        items = self._checked(Items(state, box, np.ones(len(box), dtype=np.int64)))
        return items.first, items.state

    def _checked(self, items: Items) -> Items:
        """Raises ValueError for a state or box that does not exist."""
        state, first, count = map(_whole, items)
        if not state.shape == first.shape == count.shape == (len(state),):
            raise ValueError(f"columns of items differ: {state.shape}, {first.shape}, {count.shape}")
        if len(state) and not (state.min() >= 0 and state.max() < max(self._states, 1)):
            raise ValueError(f"a state is none of {self._states}")
        if len(state) and not (first.min() >= 0 and count.min() >= 1 and (first + count).max() <= self._scene.boxes):
            raise ValueError(f"a box is none of {self._scene.boxes}")
        return Items(state, first, count)


def _record(kind: np.dtype[np.void], fields: Mapping[str, int]) -> Record:
    """One record of counts and addresses. Raises KeyError for a field that is missing."""
    return np.array(tuple(fields[name] for name in kind.fields or ()), dtype=kind)


def _at(array: NDArray[Any]) -> c_void_p:
    return c_void_p(array.ctypes.data)


def _reals(figures: Array) -> Array:
    return np.ascontiguousarray(figures, dtype=float)


def _whole(numbers: Indices) -> Indices:
    return np.ascontiguousarray(numbers, dtype=np.int64)


def _flags(mask: Mask) -> NDArray[np.uint8]:
    return np.ascontiguousarray(mask, dtype=np.uint8)
