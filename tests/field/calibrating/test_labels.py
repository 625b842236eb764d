"""Files of labels: what they say, and what is said about those that are wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.calibrating.labelled import Label, of_labels, read_labels
from tests.trials.detectors import EXPOSURE, write_workspace

HEADER = "camera,file,object,detector,there,x,y,z,qx,qy,qz,qw,vx,vy,vz"
GOOD = "near,a.png,plate,aruco,yes,4,0,1,0,0,0,1,0.2,0,0"


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return write_workspace(tmp_path_factory.mktemp("cell"))


def labels(workspace: Workspace, folder: Path, *lines: str) -> list[Label]:
    (folder / "a.png").touch()
    (folder / "b.png").touch()
    (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    return list(read_labels(folder, workspace))


def test_a_row_says_what_stands_where(workspace: Workspace, tmp_path: Path) -> None:
    found, other = labels(workspace, tmp_path, HEADER, GOOD, "near,a.png,screen,,,4,0,2,0,0,1,0,,,")
    assert (found.camera, found.object, found.detector, found.there) == ("near", "plate", "aruco", True)
    assert found.X_WO[:3, 3].tolist() == [4.0, 0.0, 1.0]
    assert found.velocity.tolist() == [0.2, 0.0, 0.0]
    assert (other.detector, other.there) == (None, True)
    assert np.allclose(other.X_WO[:3, 0], [-1.0, 0.0, 0.0])


def test_what_has_no_label_stands_where_the_workspace_has_it(workspace: Workspace, tmp_path: Path) -> None:
    labels(workspace, tmp_path, HEADER, GOOD, GOOD.replace("a.png", "b.png").replace("yes", "no"))
    (together,) = of_labels(workspace, tmp_path)
    first, second = together.images
    assert (first.holds, second.holds) == ({"there(plate)": True}, {"there(plate)": False})
    assert np.array_equal(first.believed.X_WO["screen"], workspace.stated_world.X_WO["screen"])
    moved = first.closes.X_WO["plate"] - first.opens.X_WO["plate"]
    assert moved[:3, 3] == pytest.approx([0.2 * EXPOSURE, 0.0, 0.0])
    assert first.pose != second.pose
    (box,) = together.sought.targets["there(plate)"].boxes
    assert box.size[0] == 0.045
    assert box.normal == (0.0, 0.0, 1.0)
