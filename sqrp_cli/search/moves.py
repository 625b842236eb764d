"""Changes of a cell or a motion, as data: what changes, by how much, and what the cell is then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import Kind, Unit, shown_size
from sqrp_cli.skill.settings import MotionValue


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
