"""What is said of frames of recordings is what MuJoCo draws of them: shares, verdicts, windows and waits."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from sqrp_cli.ask.api.cell import OpenCell, open_cell
from sqrp_cli.ask.api.new_cell import new_cell
from sqrp_cli.geometry import BOX_SIGNS, Array, axis_rotation, inverse, matrix_to_quaternion, pose, transform
from sqrp_cli.shapes import Box, Part
from sqrp_cli.show.documents.frames import write_frames
from sqrp_cli.sight.sight_scene import SKIN
from sqrp_cli.task.task import read_task
from tests.sight.plain_geometry import through_box
from tests.sight.renderer import MujocoScene

pytestmark = pytest.mark.trial

FRAMES, RATE, RESOLUTION = 100, 10.0, 240
SIDE, HELD = 0.03, (3.0, 7.0)
"""Of the part [m]; from when to when it is held [s]."""
SENSING = {"near": 0.01, "far": 10.0, "rate": 10.0, "latency": 0.05}
TIMES = np.arange(FRAMES) / RATE


class Recorded:
    """A cell with a recorded random motion of an arm and three cameras, and the same as MuJoCo draws it.

    That has its own kinematics; the part is rigid in the tool while it is held, and fits between its fingers.
    """

    def __init__(self, folder: Path, arm: str, seed: int) -> None:
        rng, self.folder = np.random.default_rng(seed), folder
        new_cell(folder, robot=arm)
        first = yaml.safe_load((folder / "workspace.yaml").read_text())
        self.said = {key: first[key] for key in ("robot", "detectors")}
        self.said["robot"].pop("base", None)  # the renderer's robot stands at the origin
        table = {"type": "table", "size": [1.0, 1.0, 0.04], "pose": {"position": [0.3, 0.0, -0.02]}}
        self.said["objects"] = {"table": table}
        self.look(rng, [0.0, 0.0, 0.0], 1.0)
        model = self.write().cell.model
        home, span = np.array(model.home), np.clip(0.5 * (model.upper - model.lower), 0.0, 1.2)
        home = np.clip(home, model.lower + 0.6 * span, model.upper - 0.6 * span)
        knots = home + 0.55 * span * rng.uniform(-1.0, 1.0, (6, len(home)))
        moved = np.array([np.interp(TIMES, 2.0 * np.arange(6), column) for column in knots.T]).T
        q = np.column_stack([moved, np.tile(model.fingers.open, (FRAMES, 1))])
        self.positions = dict(zip(model.joints, q.T, strict=True))
        self.ahead = pose(position=(0.0, 0.0, 0.0 if model.fingers.joints else SIDE / 2))
        X_WT = model.tool_poses(moved)
        X_WO = X_WT[int(HELD[0] * RATE)] @ self.ahead
        at = {"position": X_WO[:3, 3].tolist(), "quaternion": matrix_to_quaternion(X_WO[:3, :3]).tolist()}
        part = {"size": [SIDE] * 3, "held": [*HELD], "pose": at}
        self.said["recordings"] = {"demo": {"file": "taught.csv", "objects": {"part": part}, "watch": ["part"]}}
        self.record()
        self.look(rng, X_WT[:, :3, 3].mean(axis=0).tolist(), float(np.linalg.norm(X_WT[:, :3, 3], axis=1).max()))
        self.cell = self.write()
        held = Part("part", "part", Box((SIDE,) * 3), pose())
        top = Part("table", "world", Box((1.0, 1.0, 0.04)), pose(position=(0.3, 0.0, -0.02)))
        self.scene = MujocoScene(self.cell.workspace.robot, [top], held, RESOLUTION)
        self.own = self.scene.names.index("part")
        self.begin = self.tool_pose(HELD[0]) @ self.ahead

    def look(self, rng: np.random.Generator, middle: list[float], reach: float) -> None:
        """Put three cameras around a point [m]."""
        self.said["cameras"] = {
            f"cam{number}": {
                "pose": {
                    "position": (middle + reach * np.array([1.3 * np.cos(a), 1.3 * np.sin(a), up])).tolist(),
                    "look_at": middle,
                },
                "image": {"width": 640, "height": 480, "horizontal_fov": float(rng.uniform(0.6, 1.1))},
                **SENSING,
            }
            for number, (a, up) in enumerate(
                zip(rng.uniform(2, 4, 3) * [1, 2, 3], rng.uniform(-0.1, 0.8, 3), strict=True)
            )
        }

    def write(self) -> OpenCell:
        (self.folder / "workspace.yaml").write_text(yaml.safe_dump(self.said, sort_keys=False))
        return open_cell(self.folder)

    def record(self, at: float = 0.0, wait: float = 0.0) -> None:
        """Write the recording, with a wait from a time on [s]."""
        times = np.union1d(TIMES, [at])
        q = np.array([np.interp(times, TIMES, column) for column in self.positions.values()]).T
        if wait:
            first, last = times <= at, times >= at
            times, q = np.append(times[first], times[last] + wait), np.concatenate([q[first], q[last]])
        self.said["recordings"]["demo"]["objects"]["part"]["held"] = [t + wait * (t > at) for t in HELD]
        rows = np.column_stack([times, q]).tolist()
        lines = [",".join(["time", *self.positions]), *(",".join(map(repr, row)) for row in rows)]
        (self.folder / "taught.csv").write_text("\n".join(lines))

    def tool_pose(self, t: float) -> Array:
        at = {name: float(np.interp(t, TIMES, column)) for name, column in self.positions.items()}
        at |= {"panda_finger_joint2": at["panda_finger_joint1"]} if "panda_finger_joint1" in at else {}
        self.scene.move(at)
        tool = self.said["robot"].get("tool", {})
        if "frame" not in tool:
            return self.scene.body_pose(self.cell.workspace.robot.tool_frame)
        turn = [float(np.radians(float(str(one).removesuffix(" deg")))) for one in tool["frame"].get("rpy", [0, 0, 0])]
        R = axis_rotation(2, turn[2]) @ axis_rotation(1, turn[1]) @ axis_rotation(0, turn[0])
        return self.scene.body_pose(tool["link"]) @ pose(R, tool["frame"]["position"])

    def seen(self, t: float, camera: str) -> tuple[float, bool, bool]:
        """Of the part at a time [s]: the share of its pixels that a camera sees of those that it would see of it alone,
        whether all of it is in the image, and whether something sticks in it, as can be in no true recording."""
        X_WT = self.tool_pose(min(t, HELD[1]))
        X_WO = self.begin if t < HELD[0] else X_WT @ self.ahead
        self.tool_pose(t)
        self.scene.place("part", X_WO)
        one = self.cell.workspace.cameras[camera]
        X_CO = inverse(one.X_FC) @ X_WO
        corners = transform(X_CO, BOX_SIGNS * SIDE / 2)
        image = corners[:, :2] / corners[:, 2:]
        low, high = image.min(axis=0), image.max(axis=0)
        side, pictures = 1.1 * float((high - low).max()), []
        for without in ([], [n for n in range(len(self.scene.names)) if n != self.own], [self.own]):
            self.scene.show(without)
            pictures.append(self.scene.picture(one.X_FC, (low + high - side) / 2, side, 0.01))
        whole, alone, bare = pictures
        rays = np.stack([bare.u, bare.v, np.ones_like(bare.u)], axis=-1).reshape(-1, 3)
        inner = through_box(np.zeros(3), rays, X_CO, np.full(3, SIDE / 2 - SKIN), np.zeros(3))
        enters, leaves = (each.reshape(bare.u.shape) for each in inner)
        pixels = transform(pose(one.matrix), np.column_stack([image, np.ones(8)]))[:, :2]
        inside = bool(((pixels >= -0.5) & (pixels <= [one.width - 0.5, one.height - 0.5])).all())
        share = float((whole.part == self.own).sum() / (alone.part == self.own).sum())
        return share, inside, bool(((enters < bare.depth) & (bare.depth < leaves)).any())


def test_shares_and_verdicts_of_frames_are_those_of_the_renderer(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    errors, wrong, judged = list[float](), list[str](), 0
    for arm in ("ur5", "panda", "so101"):
        made = Recorded(tmp_path / arm, arm, 1)
        task = read_task("demo episode=0", made.cell.workspace)
        write_frames(made.cell.cell, made.cell.cell.initial_world, task.candidates, tmp_path / "frames.parquet")
        for row in parquet.read_table(tmp_path / "frames.parquet").to_pylist():
            share, inside, pierced = made.seen(row["t"], row["camera"])
            if row["target"] == "part" and not pierced:
                judged += 1
                errors += [abs(row["visible"] - share)] if row["visible"] is not None else []
                if (row["cause"] is None) != (inside and share >= 0.5):
                    wrong.append(f"{arm}: {share:.3f} of frame {row['frame']} in the image of {row['camera']}: {row}")
        made.scene.close()
    assert judged > 600
    assert np.mean(errors) < 0.02
    assert len(wrong) <= 0.005 * judged, wrong


@pytest.mark.parametrize("seed", range(20))
def test_windows_are_those_of_the_renderer_and_a_wait_opens_one(seed: int, tmp_path: Path) -> None:
    made = Recorded(tmp_path / "cell", ("ur5", "panda", "so101")[seed % 3], 100 + seed)
    found, times = made.cell.explain("demo episode=0", windows=0.01), np.arange(0.0, TIMES[-1], 0.5 / RATE)
    for camera in found.free_views.longest:
        share, inside, pierced = np.array([made.seen(t, camera) for t in times]).T
        clear = (pierced == 0) & ((inside == 0) | (np.abs(share - 0.5) > 0.03))
        for one in (one for one in found.windows if one.cameras == (camera,)):
            clear &= np.minimum(np.abs(times - one.start), np.abs(times - one.end)) > 1 / RATE
        said = [any(one.start <= t <= one.end and one.cameras == (camera,) for one in found.windows) for t in times]
        assert not (clear & (said != (inside > 0) & (share >= 0.5))).any(), camera
    needed = max(found.free_views.longest.values()) + 0.5
    words = made.cell.explain("demo episode=0", windows=needed).free_views.words
    told = re.search(r"wait (\d+) ms at ([\d.]+) s, in view of camera `(\w+)`", words)
    assert told, words
    made.record(float(told[2]), float(told[1]) / 1000)
    opened = made.write().explain("demo episode=0", windows=needed - 0.001).windows  # ends are located to a millisecond
    assert (told[3],) in [one.cameras for one in opened]
    share, inside, pierced = made.seen(float(told[2]), told[3])
    assert pierced or (inside and share > 0.47)
