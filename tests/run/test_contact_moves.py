"""Cells in which the robot touches things: peg in hole, screwing, wiping; in physics alone, and with images."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.program import open_program
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.geometry import Array, pose
from sqrp_cli.program.file import load_program
from sqrp_cli.program.record import Program
from sqrp_cli.run.arm_motion import ArmMotion
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from tests.cells import ROOT

pytestmark = pytest.mark.slow

CELLS = ROOT / "tests" / "cases" / "contact"
LOOK = 0.004


@dataclass(frozen=True)
class Played:
    """The end of a primitive in physics."""

    name: str
    force: float
    """The greatest during it [N]."""
    contact: float | None
    """When the guarded move met something, after its start [s]."""
    held: str | None
    objects: dict[str, Array]


def ranked(name: str, task: str, folder: Path) -> tuple[Workspace, Program]:
    """A cell, and the program of the best candidate of a task in it."""
    file = folder / f"{name}.yaml"
    cell = open_cell(CELLS / f"{name}.yaml")
    for text in task.split(" then "):
        cell.rank(text, ways="fastest", after=file if file.exists() else None).write(file)
    return cell.workspace, load_program(file)


def played(workspace: Workspace, program: Program, world: World) -> Iterator[Played]:
    """The program as a run commands it, with the force at the tool looked at as often."""
    physics, robot, joints = SimulatedCell(workspace, world), workspace.robot, program.joints
    limits, stops = [robot.limits[name] for name in joints], [robot.stop_limits[name] for name in joints]
    motion, start = ArmMotion(joints, limits, stops, np.array([world.joints[name] for name in joints])), 0.0
    for step in program.steps:
        motion.play(step.primitives, start)
        for primitive in step.primitives:
            peak, contact, now, end = 0.0, None, start + primitive.start, start + primitive.end
            if primitive.action == "Grasp":
                physics.grasp()
            elif primitive.action == "Release" and robot.fingers is not None:
                physics.release()
            while now < end - 1e-9:
                now = min(now + LOOK, end)
                physics.advance(now, motion)
                peak = max(peak, force := physics.tool_force())
                if (limit := motion.force_limit(now)) is not None and force >= limit:
                    motion.halt_primitive(now)
                    contact = now - start - primitive.start
            if primitive.action == "Release":
                physics.release()
            yield Played(primitive.name, peak, contact, physics.held(), physics.truth().X_WO)
        start += step.time


@pytest.fixture(scope="module")
def wiping(tmp_path_factory: pytest.TempPathFactory) -> tuple[Workspace, Program]:
    return ranked("wipe", "wipe sponge panel pace=0.1", tmp_path_factory.mktemp("wipe"))


@pytest.mark.parametrize("lower", [-0.004, 0.003])
def test_a_guarded_move_ends_on_a_surface_that_is_not_where_it_should_be(
    wiping: tuple[Workspace, Program], lower: float
) -> None:
    """The sponge then lies on it through lines, arc and circle."""
    workspace, program = wiping
    before = program.steps[0].before
    panel = before.X_WO["panel"] @ pose(position=(0.0, 0.0, -lower))
    world = replace(before, X_WO={**before.X_WO, "panel": panel})
    found = {one.name: one for one in played(workspace, program, world)}
    assert found["a2"].contact is not None
    assert [name for name, one in found.items() if one.contact is not None] == ["a2"]
    top = panel[2, 3] + 0.01
    for name in ("a2", "a3", "a4", "a5"):
        height = found[name].objects["sponge"][2, 3] - 0.02
        assert height == pytest.approx(top, abs=1e-3), name
    assert found["a2"].force < 40.0
    assert found["a7"].held == "sponge"


def test_a_guarded_move_that_meets_nothing_ends_where_it_says(wiping: tuple[Workspace, Program]) -> None:
    workspace, program = wiping
    before = program.steps[0].before
    lost = before.X_WO["panel"] @ pose(position=(0.0, 0.0, -0.019))
    found = {one.name: one for one in played(workspace, program, replace(before, X_WO={**before.X_WO, "panel": lost}))}
    assert {one.contact for one in found.values()} == {None}
    assert found["a2"].objects["sponge"][2, 3] - 0.02 == pytest.approx(0.02 - 0.005, abs=3e-4)
    # The planned motion stops where the sponge touches, and keeps the time.
    guarded = program.steps[0].primitives[1]
    assert guarded.guard is not None
    assert guarded.guard.force == 5.0
    assert guarded.guard.trajectory.duration == pytest.approx(guarded.end - guarded.start)
    assert all(one.guard is None for one in program.steps[0].primitives if one.name != "a2")


def test_a_peg_ends_up_in_its_hole(tmp_path: Path) -> None:
    workspace, program = ranked("peg", "pickup peg1 then insert peg1", tmp_path)
    *_, contact, _, _, end = played(workspace, program, program.steps[0].before)
    assert contact.contact is not None
    assert end.held is None
    seat = workspace.objects["socket"].X_WO
    assert seat is not None
    np.testing.assert_allclose(end.objects["peg1"][:3, 3], seat[:3, 3] + [0, 0, 0.025], atol=1.5e-3)
    np.testing.assert_allclose(end.objects["peg1"][2, :3], [0, 0, 1], atol=0.01)


def test_a_screw_is_taken_with_half_open_fingers_and_turned_into_its_block(tmp_path: Path) -> None:
    workspace, program = ranked("screw", "drive screw1 block yaw=0", tmp_path)
    step = program.steps[0]
    width = step.primitives[1].trajectory.positions([9.0])[0][list(program.joints).index("left_finger_joint")]
    assert width == pytest.approx(0.025)
    found = {one.name: one for one in played(workspace, program, step.before)}
    before, after = found["a7"].objects["screw1"], found["a8"].objects["screw1"]
    assert after[2, 3] - before[2, 3] == pytest.approx(-0.002, abs=3e-4)
    last = list(program.joints).index("wrist_3_joint")
    turn = step.primitives[7].trajectory.path
    assert abs(turn.end[last] - turn.positions([0.0])[0][last]) == pytest.approx(2 * np.pi, abs=0.02)
    assert found["a11"].held is None
    np.testing.assert_allclose(found["a11"].objects["screw1"][:2, 3], [0.5, 0.0], atol=2e-3)


@pytest.mark.parametrize(
    ("name", "task"),
    [
        pytest.param("peg", "pickup peg1 then insert peg1 socket yaw=0", marks=pytest.mark.trial),
        pytest.param("screw", "drive screw1 block yaw=0", marks=pytest.mark.trial),
        ("wipe", "wipe sponge panel pace=0.1"),
    ],
)
def test_a_cell_with_contact_is_done_and_what_was_promised_is_seen(name: str, task: str, tmp_path: Path) -> None:
    """With a fifth of the images, of half the size: this is not about how small or how soon a part can be seen."""
    cells, file, frames = tmp_path / "contact", tmp_path / "program.yaml", tmp_path / "frames"
    shutil.copytree(CELLS, cells)
    path, words = cells / f"{name}.yaml", {"../../../": f"{ROOT}/", "rate: 10 Hz": "rate: 2 Hz"}
    text = path.read_text(encoding="utf-8")
    for old, new in (words | {"width: 1280, height: 960": "width: 640, height: 480"}).items():
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    open_cell(path).rank(task).write(file)
    program, audited = open_program(file), name == "peg"  # one of them, as an audit takes as long as a run
    run = program.run(frames=frames if audited else None)
    assert run.done, run.reason
    assert (run.total.precision or 0.0) >= 0.98
    assert not audited or program.audit(frames, threshold=0.98).passed
