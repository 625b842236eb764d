"""Random cells that are broken by a known change: what `sqrp advise` must find a way back from."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sqrp_cli.cell.edits import stated_look_at, with_camera, with_object
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.geometry import Array, look_at
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study.assessment import Study, study
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import read_task
from tests.random_cell import Crowd, random_cell

KINDS = ("position", "aim", "lens", "object")
"""What is broken, in turn."""

SIZES = {
    "position": (0.05, 0.1, 0.2, 0.35, 0.5),
    "aim": tuple(np.radians([4.0, 8.0, 14.0, 22.0, 35.0])),
    "lens": tuple(np.radians([4.0, 8.0, 14.0, 20.0])),
    "object": (0.03, 0.06, 0.12, 0.2),
}
"""How much, less before more, in m or rad."""


@dataclass(frozen=True)
class Broken:
    """A cell that met a threshold until something was changed."""

    folder: Path
    task: str
    kind: str
    """What was changed, as advice calls it."""
    target: str
    """Of what."""
    size: float
    """By how much [m or rad]."""
    threshold: float
    """Of Q_eoi."""


def broken_cell(folder: Path, seed: int) -> Broken | None:
    """A random cell, broken; None if nothing that was tried breaks it."""
    random_cell(folder, Crowd(seed, objects=4 + seed % 4, cameras=2 + seed % 3))
    rng = np.random.default_rng(seed)
    name, quality = best_seen(load_workspace(folder))
    if quality < 0.3:
        return None
    threshold = np.floor(100 * quality) / 100 if quality < 1 else 1.0
    file = folder / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    tasks = text.index("\ntasks:")
    file.write_text(f"{text[:tasks]}\ntasks:\n  - {{task: pickup {name}, min_q_eoi: {threshold}}}\n", encoding="utf-8")
    kind = KINDS[seed % len(KINDS)]
    workspace = load_workspace(folder)
    for size in SIZES[kind]:
        for target, content in changes(workspace, kind, name, size, rng):
            after = load_workspace(file, content)
            if 0.0 <= quality_of(after, name) < threshold:
                file.write_bytes(content)
                known = known_size(kind, target, workspace, after)
                return Broken(folder, f"pickup {name}", kind, target, known, float(threshold))
    return None


def best_seen(workspace: Workspace) -> tuple[str, float]:
    """The object that is seen best as it is picked up, and its Q_eoi."""
    names = [name for name, obj in workspace.objects.items() if not obj.fixed]
    return max(((name, quality_of(workspace, name)) for name in names), key=lambda pair: pair[1])


def quality_of(workspace: Workspace, name: str) -> float:
    """Q_eoi of picking up an object in its fastest way; -1 if that cannot be done."""
    cell = Cell.load(workspace)
    candidate = first_grip(read_task(f"pickup {name}", workspace).candidates[0])
    found = study(cell, candidate, cell.initial_world, Adaptive(), full=False)
    return (found.assessment("").q_eoi or 0.0) if isinstance(found, Study) else -1.0


def changes(
    workspace: Workspace, kind: str, name: str, size: float, rng: np.random.Generator
) -> Iterator[tuple[str, bytes]]:
    """Changes of a size, each with the content of the workspace's file: some of every camera, or of the object."""
    document = read_workspace_document(workspace.path)
    if kind == "object":
        for _ in range(6):
            angle = rng.uniform(-np.pi, np.pi)
            X_WO = np.array(workspace.objects[name].X_WO)
            X_WO[:2, 3] = np.round(X_WO[:2, 3] + size * np.array([np.cos(angle), np.sin(angle)]), 3)
            yield name, with_object(document, name, X_WO)
        return
    for camera in rng.permutation(list(workspace.cameras)).tolist():
        present = workspace.cameras[camera]
        aim = stated_look_at(workspace, camera)
        assert aim is not None
        for _ in range(3):
            if kind == "lens":
                K = np.array(present.matrix)
                view = 2 * np.arctan(0.5 * present.width / K[0, 0])
                K[:2, :2] *= np.tan(0.5 * view) / np.tan(0.5 * (view - size))
                yield camera, with_camera(document, present, replace(present, matrix=K), aim[0])
                continue
            eye, point = present.X_FC[:3, 3], aim[0]
            if kind == "position":
                eye = np.round(eye + size * direction(rng), 3)
                if eye[2] < 0.2:
                    continue
            else:
                ray = point - eye
                across = np.cross(ray, direction(rng))
                across *= np.linalg.norm(ray) / np.linalg.norm(across)
                point = np.round(eye + np.cos(size) * ray + np.sin(size) * across, 3)
            yield camera, with_camera(document, present, replace(present, X_FC=look_at(eye, point)), point)


def direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def known_size(kind: str, target: str, before: Workspace, after: Workspace) -> float:
    """The size of a change as the files say it, which are rounded."""
    if kind == "object":
        first, second = (np.array(cell.objects[target].X_WO)[:3, 3] for cell in (before, after))
        return float(np.linalg.norm(second - first))
    first_camera, second_camera = before.cameras[target], after.cameras[target]
    match kind:
        case "position":
            return float(np.linalg.norm(second_camera.X_FC[:3, 3] - first_camera.X_FC[:3, 3]))
        case "aim":
            cosine = float(np.clip(second_camera.X_FC[:3, 2] @ first_camera.X_FC[:3, 2], -1, 1))
            return float(np.arccos(cosine))
    views = [2 * np.arctan(0.5 * one.width / one.matrix[0, 0]) for one in (first_camera, second_camera)]
    return float(abs(views[1] - views[0]))
