"""Lights drawn at random: what is told of boxes in their light against simulated images.

In each cell the arm takes a random pose. Of every part that is visible enough, the share of its pixels that have its
colour for a detector of colours says whether it can be told.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")
os.environ["LP_NUM_THREADS"] = "0"

import numpy as np

from sqrp_cli.camera.light import hue_of
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.geometry import Array, pose
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.perception.vision import color_mask
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox, Target
from tests.trials.light import coloured_cell

AGREE = 0.98
"""Asked: of the verdicts."""

MOST_LAMPS, TELLS, FEW = 2, 0.5, 60
"""How many lights a cell has at most besides that of the room; share of a part that must be told; pixels that are too
few to say."""


def _light_up(folder: Path, seed: int) -> None:
    """Add lights and gains to a workspace, depending on the seed alone."""
    rng = np.random.default_rng((seed, 28))
    lines = [f"  room: {{intensity: {rng.uniform(0.0, 0.3):.3f}}}"]
    for number in range(int(rng.integers(1, MOST_LAMPS + 1))):
        height, turn = np.radians(rng.uniform(25, 85)), rng.uniform(-np.pi, np.pi)
        way = np.array([np.cos(height) * np.cos(turn), np.cos(height) * np.sin(turn), np.sin(height)])
        strength = float(np.exp(rng.uniform(np.log(0.15), np.log(4.0))))
        if rng.random() < 0.6:
            lines.append(f"  sun{number}: {{intensity: {strength:.3f}, direction: {_list(-way)}}}")
            continue
        aim, away = np.array([rng.uniform(-0.3, 0.6), rng.uniform(-0.4, 0.4), 0.0]), rng.uniform(1.0, 2.0)
        place = f"position: {_list(aim + away * way)}, look_at: {_list(aim)}, beam: {rng.uniform(50, 120):.0f} deg"
        lines.append(f"  lamp{number}: {{intensity: {strength * away**2:.3f}, {place}}}")
    file = folder / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    text = re.sub(r"\n +rate: ", lambda rate: f"\n    gain: {np.exp(rng.uniform(-0.5, 0.5)):.3f}{rate[0]}", text)
    file.write_text(text.rstrip() + "\nlights:\n" + "\n".join(lines) + "\n", encoding="utf-8")


def _list(values: Array) -> str:
    return "[" + ", ".join(f"{value:.4f}" for value in values) + "]"


def lamps(seed: int, folder: Path) -> dict[str, Any]:
    """Of the parts before the cameras whether each is said to be told, and is, while the arm stands somewhere."""
    coloured_cell(folder / "cell", seed)
    _light_up(folder / "cell", seed)
    cell = Cell.load(load_workspace(folder / "cell"))
    workspace, home = cell.workspace, cell.workspace.robot.home
    joints = dict(zip(home, np.random.default_rng(seed).normal(list(home.values()), 0.5).tolist(), strict=True))
    q = np.array([[joints[name] for name in cell.model.arm]])
    X_WO = {name: obj.X_WO[None] for name, obj in workspace.objects.items() if obj.X_WO is not None}
    states = SceneStates(1, {**cell.model.link_poses(q), "world": pose()[None], **X_WO})
    parts = [obj for obj in workspace.objects.values() if not obj.fixed and hue_of(obj.color) is not None]
    boxes = [
        SoughtBox(
            name=obj.name, detector="color", frame=obj.name, size=obj.size, X_FB=pose(), normal=None,
            encloses=(obj.name,), limits=workspace.detectors["color"], seeks=obj.name, color=obj.color,
        ) for obj in parts
    ]  # fmt: skip
    found = cell.observer.verdicts([Target(Atom.of(f"seen({box.name})"), 1, (box,)) for box in boxes], states)
    simulated = SimulatedCell(workspace, cell.initial_world)
    model, positions = simulated.model, simulated.positions
    for name, value in joints.items():
        positions[model.joint(name).qposadr[0]] = value
    renderer = Renderer(model, tuple(workspace.cameras.values()), 0)
    renderer.move(positions)
    said, pairs = [], []
    for index, camera in enumerate(workspace.cameras.values()):
        image, bodies = renderer.image(camera.name, 0.0), renderer.solids(camera.name, camera.X_FC).body
        for obj, (verdict,) in zip(parts, found, strict=True):
            cause, visible = Cause(int(verdict.cause[0, index])), float(verdict.visible[0, index])
            shown = bodies == model.body(obj.name).id
            if cause in (Cause.NONE, Cause.TOO_DARK, Cause.TOO_BRIGHT) and shown.sum() >= FEW:
                told = visible * float(color_mask(image, obj.color or "")[shown].mean())
                pairs.append([cause is Cause.NONE, told >= TELLS])
                if pairs[-1][0] != pairs[-1][1]:
                    said.append(f"{camera.name} {obj.color} {obj.name}: {cause.words}, but {told:.0%} has its colour")
    renderer.close()
    return {"said": "; ".join(said), "pairs": pairs}


def lamps_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    pairs = [pair for one in found for pair in one["pairs"]]
    agree, told = sum(said == told for said, told in pairs), sum(told for _, told in pairs)
    yield f"{agree} of {len(pairs)} verdicts agree; without regard to light {told}", agree >= AGREE * len(pairs)
