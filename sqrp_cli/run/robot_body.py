"""Solid parts as silhouettes in images are drawn from, and the robot of such parts as its encoders say it stands."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.files.packages import resolve_mesh
from sqrp_cli.geometry import Array, transform
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import JointTree
from sqrp_cli.robot.robot import Fingers, Robot
from sqrp_cli.shapes import Mesh, Part, surface

OPEN_SHARE = 0.25  # Fingers count as open while they are closed by no more than this share of their way
_SIDES = 24
"""Corners of the polygons that stand for circles in outlines.

They are inscribed, and half as many as those that sight is computed with: outlines are drawn anew for every image, and
that of a part 4 cm wide and 0.5 m away is within a quarter of a pixel for a focal length of 600 pixels.
"""
MANY, MANY_OF_A_LINK = 20_000, 2_000
"""Triangles above which the mesh of an object and of a link is coarsened: a link's mask is drawn a pixel wider."""
_DETAIL, CELL = 64, 0.002
"""Cells along the longest side of a mesh in which vertices then become one, and their largest size in a link [m]."""


@dataclass(frozen=True, eq=False)
class Surface:
    """The surface of a solid part of a link or an object."""

    parent: str  # The link or object
    vertices: Array  # In the frame of the parent [m], shape (V, 3)
    triangles: NDArray[np.int64] | None
    """Indices into the vertices, shape (F, 3); None for a convex part, whose outline is the hull of its vertices."""

    @classmethod
    def of(cls, part: Part) -> Surface:
        """The surface of a part. Raises InputError for a mesh file that cannot be used."""
        if isinstance(part.shape, Mesh):
            mesh = read_mesh(part.shape.path, part.shape.scale)
            return cls(part.parent, transform(part.X_PG, mesh.vertices), mesh.faces)
        corners = surface(part.shape, _SIDES, enclosing=False).vertices
        return cls(part.parent, transform(part.X_PG, corners), None)

    def coarsened(self, many: int = MANY, largest: float = np.inf) -> Surface:
        """The same with some thousand triangles if it has many, so that it is quickly drawn in every image.

        Vertices of a finer mesh that are close to each other become one: it moves by up to 1 / `_DETAIL` of its size,
        and by no more than `largest` [m].
        """
        if self.triangles is None or len(self.triangles) <= many:
            return self
        cell = min(np.ptp(self.vertices, axis=0).max() / _DETAIL, largest)
        cells = np.floor(self.vertices / cell).astype(np.int64)
        _, first, merged = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        a, b, c = np.unique(np.sort(merged.reshape(-1)[self.triangles], axis=1), axis=0).T
        whole, count = (a != b) & (b != c), len(first)
        sides = [one[whole] * count + other[whole] for one, other in ((a, b), (b, c), (a, c))]
        # What has become a line is part of a triangle, except on a wire that is thinner than a cell.
        line = ~whole & (a != c) & ~np.isin(a * count + c, np.concatenate(sides))
        triangles = np.column_stack([a, b, c])[whole | line]
        return Surface(self.parent, self.vertices[first], triangles)


@dataclass(frozen=True, eq=False)
class RobotBody:
    """A robot with its tool, placed in the world."""

    tree: JointTree
    rest: Mapping[str, float]  # Position of joints that no encoder reports and that follow no other one [rad or m]
    surfaces: tuple[Surface, ...]
    tool_frame: str  # The link that grasps
    fingers: Fingers | None  # Of its gripper; None if it has none that move

    @classmethod
    def load(cls, robot: Robot) -> RobotBody:
        """Read the meshes. Raises InputError for those that cannot be used."""
        resolve = partial(resolve_mesh, robot.package_roots)
        parts = [part for urdf in robot.urdfs for part in urdf.parts(robot.geometry, resolve)]
        return cls(
            tree=JointTree.of(robot),
            rest=robot.rest,
            surfaces=tuple(Surface.of(part) for part in parts),
            tool_frame=robot.tool_frame,
            fingers=robot.fingers,
        )

    def link_poses(self, joints: Mapping[str, float]) -> dict[str, Array]:
        """World pose X_WL of every link, shape (4, 4), at joint positions [rad or m]; others are at rest."""
        return {link: X[0] for link, X in self.poses_over({name: np.array([q]) for name, q in joints.items()}).items()}

    def with_fingers(self, joints: Mapping[str, float], fingers: Mapping[str, float]) -> dict[str, float]:
        """Positions of the joints with others for the fingers, and for what mimics them."""
        leading = {joint.name for joint in self.tree.joints if joint.mimic is None}
        return {**{name: q for name, q in joints.items() if name in leading}, **fingers}

    def closure(self, joints: Mapping[str, float]) -> float:
        """How far the fingers are closed: 0 open, 1 closed; 0 without fingers."""
        if self.fingers is None:
            return 0.0
        opened, closed = self.fingers.open, self.fingers.closed
        shares = [(joints[name] - opened[name]) / (closed[name] - opened[name]) for name in opened if name in joints]
        return float(np.mean(shares)) if shares else 0.0

    def poses_over(self, joints: Mapping[str, Array]) -> dict[str, Array]:
        """World poses X_WL of every link, shape (m, 4, 4), for m positions of each joint, shape (m,)."""
        count = max((len(values) for values in joints.values()), default=1)
        known = [index for index, joint in enumerate(self.tree.joints) if joint.name in joints]
        q = np.array([joints[self.tree.joints[index].name] for index in known]).reshape(len(known), count).T
        return self.tree.link_poses(self.tree.driven_by(known, self.rest).positions(q))
