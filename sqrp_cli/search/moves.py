"""Changes of a cell or a motion, as data: what changes, by how much, and what the cell is then; and moves of cameras.

A move of a camera, its position or its aim, is a vector, which stands for a pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import atan, degrees, radians, tan

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.search.aiming import Aim, looking_at, turned
from sqrp_cli.search.goal import Kind, Unit, shown_size
from sqrp_cli.skill.settings import MotionValue

LENS_STEP, LENS_STRIDE = radians(0.1), 10
"""Views are proposed in whole steps [rad]; first so many of them at once are tried."""

WIDEST, NARROWEST = radians(120), radians(2)
"""Horizontal fields of view that are proposed [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ProposedChange:
    """One change of a cell or a motion."""

    kind: Kind
    target: str
    """The candidate, object or camera that it is about."""
    values: tuple[float, ...] = ()
    """What changes: metres along x, y, z; angles to the right and up in the image, or of the view [rad]."""
    size: float = 0.0
    """How large it is, in `unit`."""
    unit: Unit = ""
    turn: float = 0.0
    """Angle between the optical axes before and after it [rad], of a camera that is moved or turned."""
    like: str = ""
    """Of a further camera: the one whose lens and sensing it has."""
    camera: Camera | None = None
    """As it then is."""
    aim: Aim | None = None
    """What it then looks at."""
    X_WO: Array | None = None
    """Where the object then is, shape (4, 4)."""
    parameters: Mapping[str, MotionValue] | None = None
    """Of the way."""
    said: str = ""
    """The way in a few words, such as `left, flipped`."""
    unwritten: str = ""
    """Why no workspace file says it; empty if one can."""

    def in_cell(self, cell: Cell) -> Cell:
        """The cell with it, as far as cameras are concerned; motions stay the same."""
        if self.camera is None:
            return cell
        cameras = {**cell.workspace.cameras, self.camera.name: self.camera}
        return cell.seen_by(replace(cell.workspace, cameras=cameras))

    def in_world(self, world: World) -> World:
        """The world with it."""
        return world if self.X_WO is None else replace(world, X_WO={**world.X_WO, self.target: self.X_WO})

    @property
    def placed(self) -> Camera:
        """The camera as it then is. Raises ValueError for a change of anything else."""
        if self.camera is None:
            raise ValueError(f"a change of kind {self.kind} has no camera")
        return self.camera

    @property
    def words(self) -> str:
        """It as an instruction, such as `move cam1 10.9 cm, mostly -z, and turn it 5.2 deg`."""
        size, values = shown_size(self.size, self.unit), self.values

        def mostly(forward: Sequence[str], back: Sequence[str]) -> str:
            axis = max(range(len(values)), key=lambda index: abs(values[index]))
            length = sum(value * value for value in values) ** 0.5
            word = (forward if values[axis] > 0 else back)[axis]
            return word if abs(values[axis]) > 0.98 * length else f"mostly {word}"

        match self.kind:
            case "way" | "path":
                return f"do {self.target} {self.said}"
            case "aim":
                return f"turn {self.target} {size}, {mostly(('right', 'up'), ('left', 'down'))}"
            case "lens":
                return f"{'widen' if values[0] > 0 else 'narrow'} the view of {self.target} by {size}"
            case "camera":
                return f"add {self.target} at {', '.join(f'{value:z.2f}' for value in values)} m"
            case _:
                turn = f", and turn it {shown_size(self.turn, 'rad')}" if self.turn else ""
                return f"move {self.target} {size}, {mostly(('+x', '+y', '+z'), ('-x', '-y', '-z'))}{turn}"


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraMove:
    """A way to change one camera, by vectors (d,)."""

    dimension: int
    """D."""
    step: float
    """Of the grid on which it is searched, in the unit of the vectors."""
    reaches: tuple[float, ...]
    """How far it is searched, one after the other, until something is found."""
    poses: Callable[[Array], Array]
    """The optical frame in the frame that carries it, for vectors (p, d); shape (p, 4, 4)."""
    change: Callable[[Array], ProposedChange]
    """The change that a vector (d,) stands for, in values that people can set; nearly the same one."""


def displaced(camera: Camera, aim: Aim) -> CameraMove:
    """Moving a camera in the frame that carries it [m]; it looks at its aim from everywhere."""
    eye = camera.X_FC[:3, 3]

    def poses(vectors: Array) -> Array:
        return looking_at(eye + vectors, np.tile(aim.point, (len(vectors), 1)), aim.up)

    def change(vector: Array) -> ProposedChange:
        moved = whole(vector)
        size = float(np.linalg.norm(moved))
        now = placed(camera, np.round(eye + moved, 6), aim, kind="position", values=moved, size=size, unit="m")
        return replace(now, turn=_turn(camera, now))

    return CameraMove(dimension=3, step=0.01, reaches=(0.3, 1.0), poses=poses, change=change)


def turning(camera: Camera, aim: Aim) -> CameraMove:
    """Turning a camera: angles to the right and up in its image [rad]."""
    eye = camera.X_FC[:3, 3]

    def poses(vectors: Array) -> Array:
        points = turned(aim, eye, vectors)
        return looking_at(np.tile(eye, (len(points), 1)), points, aim.up)

    def change(vector: Array) -> ProposedChange:
        there = replace(aim, point=read_only(whole(turned(aim, eye, vector[None])[0])))
        now = placed(camera, eye, there, kind="aim", values=vector, size=0.0, unit="rad")
        size = _turn(camera, now)
        values = vector * (size / max(float(np.linalg.norm(vector)), 1e-12))
        return replace(now, values=tuple(values.tolist()), size=size, turn=size)

    reaches = (radians(30), radians(90))
    return CameraMove(dimension=2, step=radians(0.5), reaches=reaches, poses=poses, change=change)


def lens_steps(camera: Camera, stride: int = 1) -> list[int]:
    """Numbers of `LENS_STEP` by which the field of view of a camera may differ, the least first."""
    present = field_of_view(camera)
    least, most = -(present - NARROWEST) / LENS_STEP, (WIDEST - present) / LENS_STEP
    steps = stride * np.arange(int(least / stride), int(most / stride) + 1)
    return sorted(steps[steps != 0].tolist(), key=abs)


def with_view(camera: Camera, aim: Aim, steps: int) -> ProposedChange:
    """The change of the horizontal field of view of a camera by so many `LENS_STEP`."""
    present = field_of_view(camera)
    view = radians(round(degrees(present + steps * LENS_STEP), 2))
    scale = tan(0.5 * present) / tan(0.5 * view)
    K = camera.matrix.copy()
    K[0, 0], K[0, 1], K[1, 1] = scale * K[0, 0], scale * K[0, 1], scale * K[1, 1]
    return ProposedChange(
        kind="lens",
        target=camera.name,
        values=(view - present,),
        size=abs(view - present),
        unit="rad",
        camera=replace(camera, matrix=read_only(K)),
        aim=aim,
    )


def placed(
    camera: Camera, eye: Array, aim: Aim, *, kind: Kind, values: Array, size: float, unit: Unit, like: str = ""
) -> ProposedChange:
    """A camera that then stands at a place (3,) and looks at its aim; for the others see `ProposedChange`."""
    X_FC = read_only(looking_at(eye[None], aim.point[None], aim.up)[0])
    return ProposedChange(
        kind=kind,
        target=camera.name,
        values=tuple(values.tolist()),
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
    """A place or an offset in whole millimetres [m]."""
    rounded: Array = np.round(np.round(vector / 1e-3) * 1e-3, 6)
    return rounded


def _turn(camera: Camera, now: ProposedChange) -> float:
    """The angle between a camera's optical axes before and after a change of it [rad]."""
    apart = float(np.linalg.norm(now.placed.X_FC[:3, 2] - camera.X_FC[:3, 2]))
    return float(2 * np.arcsin(min(1.0, 0.5 * apart)))
