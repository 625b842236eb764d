"""The expected evidence of a motion, recomputed from the document that explains it."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise, product
from math import cos, exp, log, prod
from typing import Any

import numpy as np
import pytest

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.camera.detector import COEFFICIENTS, Curve, Detector
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.likelihood import at_least
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.robustness import expectation, expected_quality
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

SAMPLING = FixedCount(8)
CURVE = Curve(bias=-11.0, pixels=3.0, visible=4.0, blur=5.0, most=0.99)


def with_curve(workspace: Workspace, curve: Curve | None, exposure: float = 0.0) -> Workspace:
    detectors = {**workspace.detectors, "color": replace(workspace.detectors["color"], curve=curve)}
    cameras = {name: replace(camera, exposure=exposure) for name, camera in workspace.cameras.items()}
    return replace(workspace, detectors=detectors, cameras=cameras)


def expected(workspace: Workspace, task: str = "pickup g4") -> tuple[float | None, Analysis]:
    cell = Cell.load(workspace)
    found = analyse(cell, read_task(task, workspace).candidates[0], cell.initial_world, SAMPLING, full=True)
    assert isinstance(found, Analysis)
    return expected_quality(cell, found), found


@pytest.fixture(scope="module")
def document(tabletop: Workspace) -> dict[str, Any]:
    cell = OpenCell(tabletop.path, with_curve(tabletop, CURVE, 0.02))
    found = cell.explain("pickup g4", sampling=SAMPLING, ways="fastest")
    return json.loads(found.to_json())  # type: ignore[no-any-return]


def test_the_figure_follows_from_what_explain_says_of_every_box(document: dict[str, Any]) -> None:
    total = 0.0
    values = [state_probability(sample, document["targets"]) for sample in document["samples"]]
    for (sample, value), (other, after) in pairwise(zip(document["samples"], values, strict=True)):
        assert sample.get("expected") == pytest.approx(value)
        if value and after:
            total += 0.5 * (value + after) * (other["t"] - sample["t"])
    assert total / document["t_total"] == pytest.approx(document["q_expected"], abs=1e-9)
    assert 0.0 < document["q_expected"] < 0.99


def state_probability(sample: dict[str, Any], targets: dict[str, Any]) -> float | None:
    """By every choice of cameras that see or do not see each target; a literal and its negation are one."""
    atoms = {name.removeprefix("not "): name for name in sample["literals"]}
    found = []
    for name in atoms.values():
        boxes = sample["literals"][name]["boxes"]
        seen = [prod(of_curve(box["cameras"][camera]["sight"]) for box in boxes) for camera in boxes[0]["cameras"]]
        found.append(brute_force(seen, targets[name]["k"]))
    return prod(found) if found else None


def of_curve(sight: dict[str, float]) -> float:
    if sight["pixels"] is None:
        assert sight["probability"] == 0.0
        return 0.0
    z = -11.0 + 3.0 * log(sight["pixels"]) + 4.0 * sight["visible"] - 5.0 * sight["blur"] / sight["pixels"]
    assert sight["probability"] == pytest.approx(0.99 / (1.0 + exp(-z)))
    return sight["probability"]


def brute_force(seen: list[float], k: int) -> float:
    choices = product((True, False), repeat=len(seen))
    return sum(
        prod(p if sees else 1.0 - p for p, sees in zip(seen, choice, strict=True))
        for choice in choices
        if sum(choice) >= k
    )


def test_blur_is_how_far_a_box_moves_in_the_image_while_the_shutter_is_open(tabletop: Workspace) -> None:
    workspace = with_curve(tabletop, CURVE, 0.02)
    _, found = expected(workspace)
    cell = Cell.load(workspace)
    told = expectation(cell, found)
    assert told is not None
    samples, checked = found.timeline.samples, 0
    moved = replace(samples, t=samples.t + 1e-4)
    before, after = (found.planned.stage.states(some) for some in (samples, moved))
    primitives = [found.planned.motion.primitives[piece.primitive] for piece in found.planned.stage.pieces]
    start, end = np.array([(one.start, one.end) for one in primitives])[samples.piece].T
    inside = (samples.t - 0.01 >= start) & (samples.t + 0.01 <= end)
    for target, boxes in zip(found.planned.targets, told.boxes, strict=True):
        assert boxes[0].sights is not None
        blur = boxes[0].sights[COEFFICIENTS.index("blur")]
        for number, camera in enumerate(cell.observer.cameras):
            for row in np.flatnonzero(inside & ~np.isnan(blur[:, number])).tolist():
                pixels = []
                for states in (before, after):
                    X_WB = states.box_poses(target.boxes[0])
                    X_CB = np.linalg.inv(camera.X_FC) @ X_WB[row if len(X_WB) > 1 else 0]
                    pixels.append(camera.matrix @ (X_CB[:3, 3] / X_CB[2, 3]))
                speed = float(np.hypot(*(pixels[1] - pixels[0])[:2])) / 1e-4
                assert blur[row, number] == pytest.approx(0.02 * speed, rel=0.05, abs=0.05)
                checked += blur[row, number] > 0.5
    assert checked


def test_a_curve_as_steep_as_a_limit_gives_the_quality_of_the_limit(tabletop: Workspace) -> None:
    least = tabletop.detectors["color"].min_pixels
    step = Curve(bias=-1000.0 * log(least), pixels=1000.0)
    sure, found = expected(with_curve(tabletop, step))
    assert sure == pytest.approx(found.timeline.qualities.q_avg, abs=1e-6)


def test_a_longer_exposure_is_never_better_and_without_curves_nothing_is_computed(tabletop: Workspace) -> None:
    sharp, blurred = (expected(with_curve(tabletop, CURVE, exposure))[0] for exposure in (0.0, 0.1))
    assert sharp is not None and blurred is not None and blurred < sharp  # noqa: PT018
    assert expected(tabletop)[0] is None


def test_a_term_of_the_curve_replaces_the_limit_and_no_other() -> None:
    stated = Detector(kind="color", distance=(0.5, 2.0), max_incidence=1.0, min_pixels=12.0, min_visible=0.5)
    assert stated.hard_limits == stated
    hard_limits = replace(stated, curve=Curve(bias=0.0, pixels=1.0, incidence=1.0)).hard_limits
    assert (hard_limits.min_pixels, hard_limits.min_visible, hard_limits.distance) == (0.0, 0.5, (0.5, 2.0))
    assert cos(hard_limits.max_incidence) == -1.0


def test_enough_cameras_see_as_often_as_all_choices_say() -> None:
    probabilities = np.random.default_rng(0).uniform(size=(20, 3))
    for k in (1, 2, 3):
        assert at_least(probabilities, k) == pytest.approx([brute_force(row.tolist(), k) for row in probabilities])
