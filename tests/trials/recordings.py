"""Recordings of a cell that is not quite as its workspace says, made without the code that runs programs.

The robot follows the program exactly; images are drawn four times as large, made smaller, blurred, changed in colour
and light, and packed as JPEG, so that edges are not where the pixels of a renderer end. Joint states and images have
noise, objects stand a little beside their places, cameras have clocks of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sqrp_cli import open_cell, open_program
from sqrp_cli.ask.values import silent
from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.audit.bag_footage import BagFootage
from sqrp_cli.field.audit.report import AuditedCamera
from sqrp_cli.field.audit.survey import survey
from sqrp_cli.geometry import axis_rotation, inverse, matrix_to_quaternion, pose
from sqrp_cli.program.record import Program
from sqrp_cli.ros.bag import BagWriter
from sqrp_cli.run.cell.mujoco_model import build_model
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import placed_objects
from sqrp_cli.run.monitor.nominal_step import NominalStep, planned_joints
from sqrp_cli.run.robot_body import RobotBody
from tests.conftest import TABLETOP

EPOCH = 1_700_000_000
FINER = 2
_BRIGHTER = (255.0 * (np.arange(256) / 255.0) ** 0.9).astype(np.float32)
"""What each value of a pixel becomes."""

MISPLACED, QUALITY = 5e-4, 85
"""Standard deviation of the places of movable objects [m]; quality of the JPEG, of 100."""

REST = 1.0
"""The robot stands before and after each step [s]."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """How the cell really is."""

    seed: int = 0
    """Of noise, places and looks."""
    moved: Mapping[str, np.ndarray] = field(default_factory=dict)
    """X_CC', of each camera that is not where the workspace says, (4, 4)."""
    offsets: Mapping[str, float] = field(default_factory=dict)
    """By how much clocks of cameras are ahead [s]."""
    rate: float = 5.0
    """Images per second."""


class CellPictures:
    """Draws a cell with another look than the simulation gives it."""

    def __init__(self, program: Program, workspace: Workspace, look: int) -> None:
        """look: a number for colours and lights."""
        self.program, self.workspace = program, workspace
        self.body = RobotBody.load(workspace.robot)
        self.nominal = [NominalStep(step, program.joints, self.body) for step in program.steps]
        self.objects = placed_objects(program.steps[0].before)
        self._model = build_model(workspace, self.objects)
        rng = np.random.default_rng(look)
        for geom in range(self._model.ngeom):
            if self._model.geom_matid[geom] < 0:
                rgb = self._model.geom_rgba[geom, :3]
                self._model.geom_rgba[geom, :3] = np.clip(rgb * rng.uniform(0.85, 1.15) + rng.uniform(0.0, 0.08), 0, 1)
        self._model.light_dir[0] = (*rng.uniform(-0.6, 0.6, 2), -1.0)
        self._model.light_diffuse[0] = rng.uniform(0.3, 0.5)
        self._model.vis.headlight.diffuse[:] = rng.uniform(0.1, 0.3)
        self._cameras = dict[str, Camera]()
        for name, camera in workspace.cameras.items():
            K = np.array(camera.matrix)
            K[:2] *= FINER
            K[:2, 2] += (FINER - 1) / 2
            self._cameras[name] = replace(camera, width=camera.width * FINER, height=camera.height * FINER, matrix=K)
        self._renderer = Renderer(self._model, list(self._cameras.values()), look)

    def picture(self, camera: str, index: int, tau: float, truth: Truth) -> np.ndarray:
        """What a camera sees at a time from the beginning of a step [s], by its index."""
        model, step, own = self._model, self.program.steps[index], self._cameras[camera]
        at, q = float(np.clip(tau, 0.0, step.time)), np.array(model.qpos0)
        for name, position in zip(self.program.joints, planned_joints(step, np.array([at]))[0], strict=True):
            q[model.joint(name).qposadr[0]] = position
        places = np.random.default_rng((3, truth.seed // 10))
        for name, X_WO in self.nominal[index].object_poses(at).items():
            X = X_WO @ pose(axis_rotation(2, places.normal(0.0, 0.003)), (*places.normal(0.0, MISPLACED, 2), 0.0))
            if name in self.objects and model.body(name).jntnum[0]:
                first = model.joint(name).qposadr[0]
                x, y, z, w = matrix_to_quaternion(X[:3, :3])
                q[first : first + 7] = *X[:3, 3], w, x, y, z
        self._renderer._cameras[camera] = replace(own, X_FC=own.X_FC @ truth.moved.get(camera, np.eye(4)))
        self._renderer._gl.make_current()  # a survey may have drawn since
        self._renderer.move(q)
        size = (own.width // FINER, own.height // FINER)
        smaller = cv2.resize(self._renderer.image(camera, 0.0), size, interpolation=cv2.INTER_AREA)
        return cv2.GaussianBlur(smaller, (0, 0), 0.7)

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._renderer.close()


def record(path: Path, pictures: CellPictures, truth: Truth, cache: dict[object, np.ndarray]) -> None:
    """Write a recording. cache: of pictures that do not depend on what the truth says of noise and clocks."""
    program, rng, messages, begin = pictures.program, np.random.default_rng((7, truth.seed)), [], REST
    writer = BagWriter(path)
    types = writer.types
    for index, step in enumerate(program.steps):
        t = np.arange(-REST, step.time + REST, 0.01)
        q = planned_joints(step, np.clip(t, 0.0, step.time))
        q = q + rng.normal(0.0, 1e-4, q.shape)
        for time, positions in zip(t, q, strict=True):
            stamp, names = EPOCH * 1_000_000_000 + round((begin + time) * 1e9), list(program.joints)
            header = types.header(stamp)
            state = types.make("sensor_msgs/msg/JointState", header=header, name=names, position=positions)
            messages.append((stamp, "/joint_states", state))
        for name in pictures.workspace.cameras:
            phase = rng.uniform(0.0, 1.0 / truth.rate)
            for tau in np.arange(-REST + phase, step.time + REST, 1.0 / truth.rate):
                tau = round(float(tau) * 1000) / 1000  # few instants, so that recordings share pictures
                key = name, index, tau, truth.moved.get(name, np.eye(4)).tobytes(), truth.seed // 10
                if key not in cache:
                    cache[key] = pictures.picture(name, index, tau, truth)
                noisy = _BRIGHTER[cache[key]] + 2.0 * rng.standard_normal(cache[key].shape, np.float32)
                shown = cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR)
                data = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].ravel()
                stamp = EPOCH * 1_000_000_000 + round((begin + tau + truth.offsets.get(name, 0.0)) * 1e9)
                header = types.header(stamp, "camera")
                image = types.make("sensor_msgs/msg/CompressedImage", header=header, format="jpeg", data=data)
                messages.append((stamp, f"/{name}/image_raw/compressed", image))
        begin += step.time + 2 * REST
    for stamp, topic, message in sorted(messages, key=lambda one: one[:2]):
        writer.add(topic, stamp, message)
    writer.close()


def random_move(rng: np.random.Generator, turned: bool) -> np.ndarray:
    """A camera that was turned by 0.5 degrees about any axis, or moved by 5 mm in any direction, X_CC' (4, 4)."""
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    if not turned:
        return pose(position=5e-3 * axis)
    R, _ = cv2.Rodrigues(np.radians(0.5) * axis)
    return pose(R)


NAMED, TURN, SHIFT, CLOCK = 38 / 40, 0.1, 1e-3, 5e-3
"""Asked: share of moved cameras that are named; median errors of their poses [deg, m]; largest error of clocks [s]."""


def prepare(shared: Path) -> None:
    """Write the program that is recorded."""
    open_cell(TABLETOP).rank("pickup g2").write(shared / "pick.yaml")


def recordings(number: int, folder: Path) -> dict[str, Any]:
    """What is found of a recording with a camera that has moved, and of one that is alike but for that.

    The images of the other cameras are the same bytes in both: they are drawn once, and surveyed once.
    """
    opened = open_program(folder.parent / "pick.yaml")
    stated, rng = opened.workspace.cameras, np.random.default_rng((0, number))
    name = list(stated)[number % len(stated)]
    offsets = {one: float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.5)) for one in rng.permutation(list(stated))[:2]}
    still = Truth(seed=number, offsets=offsets)
    moved = replace(still, moved={name: random_move(rng, number % 2 == 0)})
    known, drawn, named = dict[str, AuditedCamera](), dict[object, np.ndarray](), dict[str, list[str]]()
    errors, clocks, wrong_named = [], [], 0
    with closing(CellPictures(opened.program, opened.workspace, number)) as pictures:
        for what, truth in (("moved", moved), ("still", still)):
            record(folder / "run.mcap", pictures, truth, drawn)
            footage = BagFootage(opened.program, opened.workspace, folder / "run.mcap", {})
            footage.frames = [frame for frame in footage.frames if frame.camera not in known]
            cameras = {**known, **survey(opened.program, opened.workspace, footage, silent)}
            known = {camera: one for camera, one in cameras.items() if camera not in truth.moved}
            named[what] = [camera for camera, one in cameras.items() if one.moved]
            timed = {camera: one.clock.offset for camera, one in cameras.items() if one.clock.offset is not None}
            clocks += [abs(offset - truth.offsets.get(camera, 0.0)) for camera, offset in timed.items()]
            wrong = {camera for camera, one in cameras.items() if one.clock.wrong}
            wrong_named += wrong == {camera for camera in truth.offsets if camera in timed}
            if what == "moved":
                one, X_FC = cameras[name], stated[name].X_FC
                X = inverse(truth.moved[name]) @ inverse(X_FC) @ (X_FC if one.pose is None else np.array(one.pose.pose))
                turn = float(np.degrees(np.linalg.norm(cv2.Rodrigues(X[:3, :3])[0])))
                errors = [turn, float(np.linalg.norm(X[:3, 3]))]
    return {
        "said": f"{name} moved: named {named['moved']}, and {named['still']} where none has", "errors": errors,
        "named": named["moved"] == [name], "false": bool(named["still"]), "clock": max(clocks), "wrong": wrong_named,
    }  # fmt: skip


def recordings_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    named, n = sum(one["named"] for one in found), len(found)
    yield f"the camera that has moved, and no other, is named in {named} of {n}", named >= NAMED * n
    false = sum(one["false"] for one in found)
    yield f"a camera is named in {false} of {n} recordings in which none has moved", not false
    turn, shift = np.median([one["errors"] for one in found], axis=0)
    good = bool(turn <= TURN and shift <= SHIFT)
    yield f"poses are mended to {turn:.3f} deg and {1e3 * shift:.2f} mm (median)", good
    clock, right = max(one["clock"] for one in found), sum(one["wrong"] for one in found)
    yield f"clocks are found to {1e3 * clock:.1f} ms; wrong ones named in {right} of {2 * n}", clock <= CLOCK
