"""Ways to change one camera: its position, its aim, its lens. Each is a vector, which stands for a pose or a view."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan, degrees, radians, tan
from typing import Protocol

import numpy as np

from sqrp_cli.geometry import Array, read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.programming.advice.aiming import Aim, looking_at, turned
from sqrp_cli.programming.advice.change import Kind, ProposedChange, Unit

MILLIMETRE = 1e-3
"""Positions and aims are proposed in whole ones [m]."""

LENS_STEP, LENS_STRIDE = radians(0.1), 10
"""Views are proposed in whole steps [rad]; first so many of them at once are tried."""

WIDEST, NARROWEST = radians(120), radians(2)
"""Horizontal fields of view that are proposed [rad]."""


class CameraMove(Protocol):
    """A way to change one camera, by vectors (d,)."""

    @property
    def dimension(self) -> int:
        """D."""

    @property
    def step(self) -> float:
        """Of the grid on which it is searched, in the unit of the vectors."""

    @property
    def reaches(self) -> tuple[float, ...]:
        """How far it is searched, one after the other, until something is found."""

    def poses(self, vectors: Array) -> Array:
        """The optical frame in the frame that carries it, for vectors (p, d); shape (p, 4, 4)."""

    def change(self, vector: Array) -> ProposedChange:
        """The change that a vector (d,) stands for, in values that people can set; nearly the same one."""


@dataclass(frozen=True, eq=False)
class Displacement:
    """Moving a camera, in the frame that carries it [m]."""

    camera: Camera
    aim: Aim
    """What it looks at from everywhere."""
    dimension: int = 3
    step: float = 0.01
    reaches: tuple[float, ...] = (0.3, 1.0)

    def poses(self, vectors: Array) -> Array:
        """See `CameraMove`."""
        eyes = self.camera.X_FC[:3, 3] + vectors
        return looking_at(eyes, np.tile(self.aim.point, (len(eyes), 1)), self.aim.up)

    def change(self, vector: Array) -> ProposedChange:
        """See `CameraMove`."""
        moved = whole(vector)
        eye = np.round(self.camera.X_FC[:3, 3] + moved, 6)
        size = float(np.linalg.norm(moved))
        now = placed(self.camera, eye, self.aim, kind="position", values=moved, size=size, unit="m")
        return replace(now, turn=_turn(self.camera, now))


@dataclass(frozen=True, eq=False)
class Turn:
    """Turning a camera: angles to the right and up in its image [rad]."""

    camera: Camera
    aim: Aim
    dimension: int = 2
    step: float = radians(0.5)
    reaches: tuple[float, ...] = (radians(30), radians(90))

    def poses(self, vectors: Array) -> Array:
        """See `CameraMove`."""
        eye = self.camera.X_FC[:3, 3]
        points = turned(self.aim, eye, vectors)
        return looking_at(np.tile(eye, (len(points), 1)), points, self.aim.up)

    def change(self, vector: Array) -> ProposedChange:
        """See `CameraMove`."""
        eye = self.camera.X_FC[:3, 3]
        aim = replace(self.aim, point=read_only(whole(turned(self.aim, eye, vector[None])[0])))
        now = placed(self.camera, eye, aim, kind="aim", values=vector, size=0.0, unit="rad")
        size = _turn(self.camera, now)
        values = vector * (size / max(float(np.linalg.norm(vector)), 1e-12))
        return replace(now, values=_floats(values), size=size, turn=size)


@dataclass(frozen=True, eq=False)
class Lens:
    """Another field of view for a camera: more or less of it [rad]."""

    camera: Camera
    aim: Aim

    def steps(self, stride: int = 1) -> Array:
        """Numbers of steps by which the view may differ, the least first, shape (v,)."""
        present = field_of_view(self.camera)
        least, most = -(present - NARROWEST) / LENS_STEP, (WIDEST - present) / LENS_STEP
        steps = stride * np.arange(int(least / stride), int(most / stride) + 1)
        steps = steps[steps != 0]
        ordered: Array = steps[np.argsort(np.abs(steps), kind="stable")]
        return ordered

    def change(self, steps: int) -> ProposedChange:
        """The change of the horizontal field of view by so many steps."""
        present = field_of_view(self.camera)
        view = radians(round(degrees(present + steps * LENS_STEP), 2))
        scale = tan(0.5 * present) / tan(0.5 * view)
        K = self.camera.matrix.copy()
        K[0, 0], K[0, 1], K[1, 1] = scale * K[0, 0], scale * K[0, 1], scale * K[1, 1]
        return ProposedChange(
            kind="lens",
            target=self.camera.name,
            values=(view - present,),
            size=abs(view - present),
            unit="rad",
            camera=replace(self.camera, matrix=read_only(K)),
            aim=self.aim,
        )


def placed(
    camera: Camera, eye: Array, aim: Aim, *, kind: Kind, values: Array, size: float, unit: Unit, like: str = ""
) -> ProposedChange:
    """A camera that then stands at a place (3,) and looks at its aim; for the others see `ProposedChange`."""
    X_FC = read_only(looking_at(eye[None], aim.point[None], aim.up)[0])
    return ProposedChange(
        kind=kind,
        target=camera.name,
        values=_floats(values),
        size=size,
        unit=unit,
        like=like,
        camera=replace(camera, X_FC=X_FC),
        aim=aim,
    )


def field_of_view(camera: Camera) -> float:
    """The horizontal angle of a camera's image without distortion [rad]."""
    return 2.0 * atan(0.5 * camera.width / float(camera.matrix[0, 0]))


def whole(vector: Array) -> Array:
    """A place or an offset in whole millimetres."""
    rounded: Array = np.round(vector / MILLIMETRE) * MILLIMETRE
    return np.round(rounded, 6)


def _turn(camera: Camera, now: ProposedChange) -> float:
    """The angle between a camera's optical axes before and after a change of it [rad]."""
    assert now.camera is not None  # noqa: S101 - it is about one
    apart = float(np.linalg.norm(now.camera.X_FC[:3, 2] - camera.X_FC[:3, 2]))
    return float(2 * np.arcsin(min(1.0, 0.5 * apart)))


def _floats(values: Array) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
