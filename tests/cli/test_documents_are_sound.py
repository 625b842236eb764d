"""Every figure of every document is finite and every pose has a rotation, whatever the cameras look along."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.random_cell import Crowd, random_cell

AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]


def values(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and every 4x4 matrix of a document, with where it stands."""
    if isinstance(node, list) and len(node) == 4 and all(isinstance(row, list) and len(row) == 4 for row in node):
        yield path, np.array(node)
    elif isinstance(node, dict | list):
        for key, child in node.items() if isinstance(node, dict) else enumerate(node):
            yield from values(child, f"{path}.{key}")
    elif isinstance(node, float):
        yield path, node


def assert_sound(document: dict[str, Any]) -> None:
    found = list(values(document))
    assert found
    for path, value in found:
        if isinstance(value, float):
            assert math.isfinite(value), path
        else:
            R = value[:3, :3]
            np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9, err_msg=path)
            assert np.linalg.det(R) > 0, path
            assert value[3].tolist() == [0, 0, 0, 1], path


def assert_all_sound(sqrp: Callable[..., Any], cell: Path, task: str) -> list[dict[str, Any]]:
    documents = []
    for command in (("show", cell), ("rank", cell, task), ("explain", cell, task, "--all")):
        outcome = sqrp(*command, "--json")
        assert outcome.code in (0, 1), outcome.err
        assert_sound(outcome.document)
        documents.append(outcome.document)
    return documents


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (1, 2))])
def test_every_figure_of_a_random_cell_is_finite_and_every_rotation_orthonormal(
    sqrp: Callable[..., Any], tmp_path: Path, seed: int
) -> None:
    cell = random_cell(tmp_path / "cell", Crowd(seed, objects=3, cameras=4))
    rng = np.random.default_rng(seed)
    file = cell / "workspace.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    for camera in content["cameras"].values():
        # Cameras along the axes and, as often, with `up` along them, which is where a direction across both is lost.
        axis = AXES[rng.integers(6)]
        place = (np.array([0.4, 0.0, 0.1]) - rng.uniform(0.5, 1.5) * np.array(axis)).tolist()
        up = AXES[rng.integers(6)] if rng.random() < 0.5 else axis
        camera["pose"] = {"position": place, "look_at": [0.4, 0.0, 0.1], "up": up}
    for thing in content["objects"].values():
        if True in thing:
            thing["on"] = thing.pop(True)  # this reader takes the key `on` for a truth value
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    assert_all_sound(sqrp, cell, "pickup")


@pytest.mark.parametrize("bend", [0.0, -0.01])
def test_a_camera_along_any_axis_with_any_up_covers_only_what_its_image_holds(
    sqrp: Callable[..., Any], own_watch: Path, bend: float
) -> None:
    file = own_watch / "workspace.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    eye = content["cameras"].pop("eye")
    eye["image"]["distortion"] = {"model": "plumb_bob", "coefficients": [bend, 0, 0, 0, 0]}
    middle = np.array([2.0, 0.3, 1.0])
    for number, (axis, up) in enumerate(itertools.product(AXES, AXES)):
        pose = {"position": (middle - 2 * np.array(axis)).tolist(), "look_at": middle.tolist(), "up": up}
        content["cameras"][f"cam{number}"] = {**eye, "pose": pose}
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")

    show, _, explained = assert_all_sound(sqrp, own_watch, "watch cube")

    covered = 0
    boxes = [
        box
        for candidate in explained["candidates"]
        for sample in candidate.get("samples", ())[:1]
        for literal in sample["literals"].values()
        for box in literal["boxes"]
    ]
    for box, name in itertools.product(boxes, show["cameras"]):
        if box["cameras"][name]["covered"]:
            camera, X_WC = show["cameras"][name], np.array(show["cameras"][name]["pose"])
            corners_C = (np.array(box["corners"]) - X_WC[:3, 3]) @ X_WC[:3, :3]
            pixels = (corners_C / corners_C[:, 2:] @ np.array(camera["K"]).T)[:, :2]  # the lens moves none by 2 pixels
            assert (np.abs(pixels - [320, 240]) <= np.array([320.5, 240.5]) + 2).all()
            covered += 1
    assert covered >= len(AXES)
