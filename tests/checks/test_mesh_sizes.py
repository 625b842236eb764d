"""Meshes in the wrong unit are doubted, others are not."""

from __future__ import annotations

import itertools
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.checks.mesh_sizes import doubtful_meshes
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.arm.kinematics import RobotModel
from sqrp_cli.shapes import Mesh, Part


def written_stl(path: Path, side: float) -> Path:
    """A tetrahedron in a cube of this side, as a binary STL."""
    corners = side * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1]])
    faces = [
        b"".join(struct.pack("<3f", *p) for p in (np.zeros(3), *corners[list(three)])) + b"\0\0"
        for three in itertools.combinations(range(4), 3)
    ]
    path.write_bytes(bytes(80) + struct.pack("<I", len(faces)) + b"".join(faces))
    return path


@pytest.mark.parametrize(("side", "scale"), [(40, "0.001"), (4e-5, "1000"), (0.04, None)])
def test_a_mesh_in_the_wrong_unit_is_doubted(
    tabletop: Workspace, ur5: RobotModel, tmp_path: Path, side: float, scale: str | None
) -> None:
    mesh = Mesh(written_stl(tmp_path / "cube.stl", side))
    g1 = replace(tabletop.objects["g1"], parts=(Part("g1/0", "g1", mesh, np.eye(4)),))
    of_object = list(doubtful_meshes(replace(tabletop, objects={"g1": g1}), ur5))
    big = replace(ur5, parts=(Part("forearm_link", "forearm_link", mesh, np.eye(4)),))
    of_robot = list(doubtful_meshes(replace(tabletop, objects={}), big))
    if scale is None:
        assert of_object == of_robot == []
    else:
        for (problem,), name in ((of_object, "`g1`"), (of_robot, "`forearm_link`")):
            assert problem.severity == "warning"
            assert name in problem.message
            assert f"`scale` of {scale}" in (problem.mend or "")


def test_the_meshes_of_the_shipped_robot_are_not_doubted(tabletop: Workspace, ur5: RobotModel) -> None:
    assert list(doubtful_meshes(tabletop, ur5)) == []
