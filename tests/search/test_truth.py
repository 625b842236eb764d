"""What mounts see agrees with an independent renderer: MuJoCo's depth images during a motion of `tabletop`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sqrp_cli import open_cell
from sqrp_cli.geometry import inverse
from sqrp_cli.search.placing_problem import Requirements
from tests.search.test_place import TABLETOP, placer
from tests.sight.renderer import MujocoScene
from tests.sight.test_truth import picture_of

RESOLUTION = 120

SIX = """
mounts:
  ceiling: {points: [[-0.5, -1.1, 1.6], [0.3, 0.3, 1.6], [1.1, 0.1, 1.4]]}
  low: {points: [[0.0, 1.15, 0.5], [0.9, -1.15, 0.3], [-0.9, 0.6, 0.25]]}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}
"""


@pytest.mark.slow
def test_six_cameras_see_what_a_renderer_shows(tmp_path: Path) -> None:
    cell = open_cell(TABLETOP)
    asked = placer(cell, tmp_path, SIX, Requirements(most=2))
    asked.place()
    (way,), (sees,) = asked.table.ways, asked.table.sees
    scene, states = way.scene, way.states
    objects = cell.workspace.objects
    carried = scene.candidate.binding["object"]
    fixed = [part for name, obj in objects.items() if name != carried for part in _placed(obj)]
    (held,) = objects[carried].parts
    stage = MujocoScene(cell.workspace.robot, fixed, held, RESOLUTION)
    q = scene.stage.positions(way.samples)
    boxes = [box for target in scene.targets for box in target.boxes]
    assert len(boxes) == len(scene.targets)
    agree: list[bool] = []
    shown = 0
    for option, there in enumerate(asked.table.options):
        camera = there.camera("here")
        sample, target = way.items
        (within,) = cell.cell.observer.seen_from(
            [camera], there.X_FC[None], scene.targets, states, sample, target, limits_only=True
        )[0]
        assert not sees[option][~within].any()
        for item in np.flatnonzero(within).tolist():
            state, box = int(sample[item]), boxes[int(target[item])]
            stage.move(dict(zip(scene.motion.joint_names, q[state], strict=True)))
            stage.place(held.parent, _at(states.X_WF[carried], state))
            stage.show([i for i, name in enumerate(stage.names) if name in box.encloses])
            share = _share(stage, there.X_FC, _at(states.box_poses(box), state), box)
            agree.append((share >= box.limits.min_visible) == bool(sees[option][item]))
            shown += share >= box.limits.min_visible
    stage.close()
    assert len(agree) > 200
    assert 0.1 < shown / len(agree) < 0.99, "else a wrong verdict would hardly show"
    assert np.mean(agree) >= 0.999


def _placed(obj):
    from dataclasses import replace

    return [replace(part, parent="world", X_PG=obj.X_WO @ part.X_PG) for part in obj.parts]


def _at(poses, state):
    return poses[state if len(poses) > 1 else 0]


def _share(stage, X_WC, X_WB, box) -> float:
    """The share of the silhouette of a box without its skin along which nothing lies before its far side."""
    picture, leaves, _ = picture_of(stage, inverse(X_WC) @ X_WB, X_WC, box)
    inside = leaves > 0
    return 1.0 - float((inside & (picture.depth < leaves)).sum() / inside.sum())
