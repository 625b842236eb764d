"""Lights drawn at random: what is told of boxes in their light against simulated images.

`python -m tests.light.lamps [CELLS [FIRST]]`, 40 by default; FIRST is the first seed. In each cell the arm takes a
random pose. Of every part that is visible enough, the share of its pixels that have its colour for a detector of
colours says whether it can be told. Exit code 1 where less than 98 % of the verdicts agree.
"""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

os.environ.setdefault("MUJOCO_GL", "egl")
os.environ["LP_NUM_THREADS"] = "0"

import numpy as np

from sqrp_cli.camera.light import hue_of
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.geometry import Array, pose
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.run.cell.renderer import Renderer
from sqrp_cli.run.cell.simulated_cell import Physics
from sqrp_cli.run.perception.vision import color_mask
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import SoughtBox, Target
from tests.light.cells import coloured_cell

AGREE = 0.98
"""Asked: of the verdicts."""

MOST_LAMPS, TELLS, FEW = 2, 0.5, 60
"""How many lights a cell has at most besides that of the room; share of a part that must be told; pixels that are too
few to say."""


class Seen(NamedTuple):
    """A part before a camera: the verdict on it, and what an image shows."""

    what: str
    cause: Cause
    told: float
    """Share of its silhouette that has its colour in the image."""

    @property
    def agrees(self) -> bool:
        """Whether the verdict is that of the image."""
        return (self.cause is Cause.NONE) == (self.told >= TELLS)


def light_up(folder: Path, seed: int) -> None:
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


def lit_boxes(seed: int) -> Iterator[Seen]:
    """The parts of a cell with lights, as its cameras see them while the arm stands somewhere."""
    with tempfile.TemporaryDirectory() as folder:
        coloured_cell(Path(folder) / "cell", seed)
        light_up(Path(folder) / "cell", seed)
        cell = Cell.load(load_workspace(Path(folder) / "cell"))
    workspace, home = cell.workspace, cell.workspace.robot.home
    joints = dict(zip(home, np.random.default_rng(seed).normal(list(home.values()), 0.5).tolist(), strict=True))
    q = np.array([[joints[name] for name in cell.model.arm]])
    X_WO = {name: obj.X_WO[None] for name, obj in workspace.objects.items() if obj.X_WO is not None}
    states = SceneStates(1, {**cell.model.link_poses(q), "world": pose()[None], **X_WO})
    parts = [obj for obj in workspace.objects.values() if not obj.fixed and hue_of(obj.color) is not None]
    found = cell.observer.verdicts([_target(cell, obj) for obj in parts], states)
    model = Physics(workspace, cell.initial_world).model
    positions = Physics(workspace, cell.initial_world).positions
    for name, value in joints.items():
        positions[model.joint(name).qposadr[0]] = value
    renderer = Renderer(model, tuple(workspace.cameras.values()), 0)
    renderer.move(positions)
    for index, camera in enumerate(workspace.cameras.values()):
        image, bodies = renderer.image(camera.name, 0.0), renderer.solids(camera.name, camera.X_FC).body
        for obj, (verdict,) in zip(parts, found, strict=True):
            cause, visible = Cause(int(verdict.cause[0, index])), float(verdict.visible[0, index])
            shown = bodies == model.body(obj.name).id
            if cause in (Cause.NONE, Cause.TOO_DARK, Cause.TOO_BRIGHT) and shown.sum() >= FEW:
                told = visible * float(color_mask(image, obj.color or "")[shown].mean())
                yield Seen(f"{seed} {camera.name} {obj.color} {obj.name}", cause, told)
    renderer.close()


def _target(cell: Cell, obj: SceneObject) -> Target:
    """The object in its place, for the detector of colours."""
    box = SoughtBox(
        name=obj.name, detector="color", frame=obj.name, size=obj.size, X_FB=pose(), normal=None, encloses=(obj.name,),
        limits=cell.workspace.detectors["color"], seeks=obj.name, color=obj.color,
    )  # fmt: skip
    return Target(Atom.of(f"seen({obj.name})"), 1, (box,))


def main(arguments: Sequence[str]) -> int:
    """Print what does not agree, and how much does."""
    cells, first = (int(value) for value in (*arguments, *("40", "2000")[len(arguments) :]))
    counts = Counter[tuple[str, bool]]()
    for seed in range(first, first + cells):
        for seen in lit_boxes(seed):
            counts[seen.cause.name, seen.told >= TELLS] += 1
            if not seen.agrees:
                print(f"{seen.what}: {seen.cause.words}, but {100 * seen.told:.0f} % has its colour", flush=True)
    agree = sum(number for (cause, told), number in counts.items() if (cause == "NONE") == told)
    told = sum(number for (_, told), number in counts.items() if told)
    share = 100 * agree / max(counts.total(), 1)
    print(f"{agree} of {counts.total()} verdicts agree ({share:.2f} %); without regard to light {told}")
    return 0 if agree >= AGREE * counts.total() else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
