"""Where recorded objects begin: judged by rays through the meshes of jaws, and by tables at heights that need it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.new_cell import new_cell
from sqrp_cli.geometry import inverse, transform
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task
from tests.cells import write_cell

NAMES = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
GRASPING = [-9.77, 5.93, 42.3, 41.77, -96.98]  # the tool points down [deg]
OPEN, HELD = 52.0, 17.0  # of 100: jaws that touch both sides of a cube of 3 cm
SIDE = 0.03


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list[str], float]:
    """A workspace of an SO-101 that grasps where it stands: folder, file, what `init` said, height of the tool."""
    folder = tmp_path_factory.mktemp("so101")
    jaw = np.interp(np.arange(0.0, 4.0, 0.05), [1.0, 1.5, 3.0, 3.5], [OPEN, HELD, HELD, OPEN])
    rows = [",".join(map(str, [k / 20, *GRASPING, round(at, 2)])) for k, at in enumerate(jaw.tolist())]
    (folder / "taught.csv").write_text("\n".join([",".join(["timestamp", *NAMES]), *rows]) + "\n")
    made = new_cell(folder / "cell", robot="so101", recording=folder / "taught.csv")
    cell = yaml.safe_load((folder / "cell" / "workspace.yaml").read_text())
    model = open_cell(folder / "cell").cell.model
    return folder / "cell", cell, list(made.told), float(model.tool_pose(np.radians(GRASPING))[2, 3])


def motion_on(folder: Path, cell: dict[str, Any], top: float | None) -> tuple[Any, Motion]:
    """The motion of the episode, with the table's top at a height [m]; None without it."""
    table = {**cell["objects"]["table"], "pose": {"position": [0.2, 0.0, (top or 0.0) - 0.02]}}
    write_cell({**cell, "objects": {"table": table} if top is not None else {}}, folder)
    opened = open_cell(folder)
    (candidate,) = read_task("demo", opened.workspace).candidates
    motion = feasible_motion(opened.cell, candidate, opened.cell.initial_world)
    assert isinstance(motion, Motion)
    return opened, motion


def test_an_object_lies_beside_the_jaw_that_stands_still(begun):
    folder, cell, _, _ = begun
    opened, motion = motion_on(folder, cell, None)
    carry = next(one for one in motion.primitives if one.held)
    X_WL = opened.cell.model.link_poses(carry.trajectory.positions([0.0]))
    X_WT, X_WO = X_WL[opened.cell.model.tool_frame][0], motion.initial.X_WO["part"]
    free = {}
    for moves in (False, True):  # how far each jaw is from the middle of the cube, a little above the tips
        links = {"moving_jaw_so101_v1_link"} if moves else {"gripper_link"}
        solids = load_solids([part for part in opened.cell.model.parts if part.parent in links])
        body = trimesh.util.concatenate(
            [trimesh.Trimesh(transform(X_WL[s.part.parent][0], s.vertices), s.triangles) for s in solids]
        )
        way = X_WT[:3, 1] if moves else -X_WT[:3, 1]
        starts = X_WO[:3, 3] - np.linspace(0.002, 0.012, 6)[:, None] * X_WT[:3, 2]
        places, index, _ = body.ray.intersects_location(starts, np.tile(way, (6, 1)), multiple_hits=False)
        free[moves] = np.linalg.norm(places - starts[index], axis=1).min()
    assert free[False] == pytest.approx(SIDE / 2, abs=1.5e-3)
    assert free[True] == pytest.approx(SIDE / 2, abs=3e-3)
    assert (inverse(X_WT) @ X_WO)[[0, 2], 3] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("below", "lies", "inside"),
    [  # the table's top below the tool, the middle of the cube above the tool, how deep it is inside the table [m]
        (0.003, 0.012, None),  # it would be 12 mm inside
        (0.020, -0.005, None),  # 5 mm above
        (0.035, 0.0, None),  # 20 mm above, as if it were handed over
        (-0.020, 0.0, 0.035),  # wholly inside: a height that is not right
    ],
)
def test_it_stands_on_what_is_near_below_and_is_told_inside_something(begun, below, lies, inside):
    folder, cell, _, tool = begun
    _, motion = motion_on(folder, cell, tool - below)
    assert motion.initial.X_WO["part"][2, 3] - tool == pytest.approx(lies, abs=1e-6)
    told = [] if inside is None else [f"`part` begins {1000 * inside:.1f} mm inside `table`: state `pose`"]
    assert [one[: len(told[0])] if told else one for one in motion.remarks] == told


def test_what_init_guessed_of_the_table_is_told_and_the_place_is_the_recording_s(begun):
    folder, cell, told, tool = begun
    said = " ".join(told)
    assert f"the tool then goes {-100 * tool:.1f} cm into the table: check" in said
    assert "the height of the table, a guess" in said
    assert "episode 0: `part` begins" in said
    opened, _ = motion_on(folder, cell, tool + 0.02)
    assert ShowDocument.of(opened.cell).recorded == ["part"]
    assert "`part` begins 35.0 mm inside `table`" in " ".join(opened.check("demo").candidates[0].reasons)
