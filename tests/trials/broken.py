"""Random cells broken by a known change, which `sqrp advise` must mend by no more.

A camera is moved, turned or narrowed, or the part is moved. Advice of the same kind is asked for with the motion fixed;
then the least one is applied, and `score` and `explain`, with its finer samples, must find the wish met.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli import open_cell
from sqrp_cli.cell.edits import stated_look_at, with_camera, with_pose
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import read_workspace_document
from sqrp_cli.geometry import Array, look_at
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import read_task
from tests.random_cell import Crowd, random_cell

SIZES = {
    "position": (0.05, 0.1, 0.2, 0.35, 0.5),
    "aim": tuple(np.radians([4.0, 8.0, 14.0, 22.0, 35.0])),
    "lens": tuple(np.radians([4.0, 8.0, 14.0, 20.0])),
    "object": (0.03, 0.06, 0.12, 0.2),
}
"""What is broken, in turn, and how much, less before more [m or rad]."""


def broken(number: int, folder: Path) -> dict[str, Any] | None:
    """Break a random cell, ask for advice, apply the first, and score; None if nothing that was tried breaks it."""
    cell = random_cell(folder / "cell", Crowd(number, objects=4 + number % 4, cameras=2 + number % 3))
    rng, file, workspace = np.random.default_rng(number), cell / "workspace.yaml", load_workspace(cell)
    names = [name for name, obj in workspace.objects.items() if not obj.fixed]
    quality, name = max(((_quality_of(workspace, name), name) for name in names), key=lambda pair: pair[0])
    if quality < 0.3:
        return None
    threshold = float(np.floor(100 * quality) / 100) if quality < 1 else 1.0
    text, task, kind = file.read_text(encoding="utf-8"), f"pickup {name}", list(SIZES)[number % len(SIZES)]
    asked = f"\ntasks:\n  - {{task: {task}, min_q_eoi: {threshold}}}\n"
    file.write_text(text[: text.index("\ntasks:")] + asked, encoding="utf-8")
    workspace = load_workspace(cell)
    tried = (change for size in SIZES[kind] for change in _changes(workspace, kind, name, size, rng))
    loaded = ((target, content, load_workspace(file, content)) for target, content in tried)
    broke = next((one for one in loaded if 0.0 <= _quality_of(one[2], name) < threshold), None)
    if broke is None:
        return None
    target, content, after = broke
    file.write_bytes(content)
    size = _known_size(kind, target, workspace, after)
    found = open_cell(cell).advise(task, kinds=[kind], ways="fastest")
    what, sizes = f"{kind} {target} by {size:.3f}", [advice.size for advice in found.advice]
    if not sizes:
        return {"said": f"{what}: no advice", "ratio": np.inf, "passed": False}
    found.apply(1)
    (explained,) = open_cell(cell).explain(task, ways="fastest").candidates
    passed, ratio = open_cell(cell).score().passed and (explained.q_eoi or 0.0) >= threshold, float(min(sizes) / size)
    return {"said": f"{what}: {ratio:.2f} of it, {len(sizes)} found", "ratio": ratio, "passed": passed}


def broken_asked(found: Sequence[dict[str, Any]]) -> Iterator[tuple[str, bool]]:
    ratios, passed = [one["ratio"] for one in found], sum(one["passed"] for one in found)
    yield f"{passed} of {len(found)} pass once they are mended", passed == len(found)
    yield f"advice over known change: mean {np.mean(ratios):.2f}, most {max(ratios):.2f}", max(ratios) <= 1.0


def _quality_of(workspace: Workspace, name: str) -> float:
    """Q_eoi of picking up an object in its fastest way; -1 if that cannot be done."""
    cell = Cell.load(workspace)
    candidate = first_grip(read_task(f"pickup {name}", workspace).candidates[0])
    found = analyse(cell, candidate, cell.initial_world, Adaptive(), full=False)
    return (found.result.q_eoi or 0.0) if isinstance(found, Analysis) else -1.0


def _changes(
    workspace: Workspace, kind: str, name: str, size: float, rng: np.random.Generator
) -> Iterator[tuple[str, bytes]]:
    """Changes of a size, each with the content of the workspace's file: some of every camera, or of the object."""
    document = read_workspace_document(workspace.path)
    if kind == "object":
        for _ in range(6):
            angle = rng.uniform(-np.pi, np.pi)
            X_WO = np.array(workspace.objects[name].X_WO)
            X_WO[:2, 3] = np.round(X_WO[:2, 3] + size * np.array([np.cos(angle), np.sin(angle)]), 3)
            yield name, with_pose(document, ("objects", name, "pose"), X_WO)
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
                eye = np.round(eye + size * _direction(rng), 3)
                if eye[2] < 0.2:
                    continue
            else:
                ray = point - eye
                across = np.cross(ray, _direction(rng))
                across *= np.linalg.norm(ray) / np.linalg.norm(across)
                point = np.round(eye + np.cos(size) * ray + np.sin(size) * across, 3)
            yield camera, with_camera(document, present, replace(present, X_FC=look_at(eye, point)), point)


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _known_size(kind: str, target: str, before: Workspace, after: Workspace) -> float:
    """The size of a change as the files say it, which are rounded."""
    if kind == "object":
        first, second = (np.array(cell.objects[target].X_WO)[:3, 3] for cell in (before, after))
        return float(np.linalg.norm(second - first))
    one, other = before.cameras[target], after.cameras[target]
    if kind == "position":
        return float(np.linalg.norm(other.X_FC[:3, 3] - one.X_FC[:3, 3]))
    if kind == "aim":
        return float(np.arccos(np.clip(other.X_FC[:3, 2] @ one.X_FC[:3, 2], -1, 1)))
    views = [2 * np.arctan(0.5 * camera.width / camera.matrix[0, 0]) for camera in (one, other)]
    return float(abs(views[1] - views[0]))
