"""Where a move ends that goes on until something is touched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import Array, pose
from sqrp_cli.motion.collision import CollisionScene
from sqrp_cli.motion.ground_primitives import _contact_share
from sqrp_cli.motion.tool_curve import tool_line
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Mesh, Part

CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]


def test_a_move_onto_a_mesh_ends_at_its_nearest_triangles(ur5: RobotModel, tmp_path: Path) -> None:
    """A stand is a small sheet above a large one, the arm holds a sheet; the surfaces meet after 10 cm of 28."""

    def sheets(name: str, *heights_and_halves: tuple[float, float]) -> Mesh:
        lines = [f"v {x * half} {y * half} {z}" for z, half in heights_and_halves for x, y in CORNERS]
        lines += [f"f {k} {k + 1} {k + 2}\nf {k} {k + 2} {k + 3}" for k in range(1, len(lines), 4)]
        (tmp_path / name).write_text("\n".join(lines))
        return Mesh(tmp_path / name)

    def of(name: str, mesh: Mesh, X_WO: Array | None) -> SceneObject:
        part = Part(name, name, mesh, np.eye(4))
        return SceneObject(name=name, type="thing", size=(1.0, 1.0, 1.0), pose=X_WO, fixed=True, parts=(part,))

    stand = of("stand", sheets("stand.obj", (0.0, 0.05), (-0.2, 0.5)), pose(position=(0.4, 0.0, 0.3)))
    scene = CollisionScene(ur5, [stand, of("held", sheets("held.obj", (0.0, 0.02)), None)])
    world = World(frozenset(), {"stand": stand.X_WO}, "held", pose(position=(0.0, 0.0, 0.2)), {})
    down = np.diag([1.0, -1.0, -1.0])
    line = tool_line(pose(down, (0.4, 0.0, 0.6)), pose(down, (0.4, 0.0, 0.32)))
    assert _contact_share(scene, world, line, "stand") == pytest.approx(0.1 / 0.28, abs=1e-4)
