"""What is seen from parts of the ball of a camera's centres, against the exact verdicts from drawn poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sqrp_cli.geometry import Array, displacement
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.sensing.bounded.bounds import PoseBounds
from sqrp_cli.programming.sensing.bounded.centres import CentreParts
from sqrp_cli.programming.sensing.bounded.observer import BoundedObserver
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.sensing.scene_states import SceneStates, fixed_frame
from sqrp_cli.programming.targets import SoughtBox, Target
from tests.programming.sensing.bounded.test_bounded_observer import SMALL, occluders, poses_of_boxes
from tests.programming.sensing.views import make_box, make_camera, make_detector

WIDE = PoseBounds(0.02, np.radians(0.5))
STATES, DRAWS = 80, 60


def shares(size: float) -> SoughtBox:
    return make_box((size, size, size), frame="thing", detector=make_detector(min_visible=0.5))


@pytest.mark.parametrize("boxes", [(shares(0.05),), (shares(0.05), shares(0.08))], ids=["one box", "two boxes"])
@pytest.mark.parametrize("bounds", [SMALL, WIDE], ids=["small", "wide"])
def test_no_draw_sees_what_its_part_of_the_ball_excludes(boxes: tuple[SoughtBox, ...], bounds: PoseBounds) -> None:
    camera, solids = make_camera(), tuple(occluders())
    X_WB = poses_of_boxes(5, 0.3)[:STATES]
    states, target = SceneStates(STATES, {"world": fixed_frame(), "thing": X_WB}), Target(Atom("seen", ()), 1, boxes)
    seen = BoundedObserver((camera,), solids, bounds=bounds, surely=True).viewed(target, states)
    parts = CentreParts.whole(STATES, bounds)
    decided = []
    for _ in range(4):
        parts = parts.split(np.arange(len(parts.half)), seen, seen.within)
        decided.append(float((parts.sure | ~parts.possible)[:, seen.within].mean()))
    random, used = np.random.default_rng(6), set()
    for draw in range(DRAWS):
        error: Array = random.normal(size=(2, 3))
        error /= np.linalg.norm(error, axis=1, keepdims=True)
        error *= random.uniform(size=(2, 1)) ** (draw % 2)
        off = bounds.position * error[0]
        moved = replace(camera, X_FC=camera.X_FC @ displacement(off, bounds.rotation * error[1]))
        found = Observer((moved,), solids).coverage([target], states, [np.arange(STATES)])[0].covered
        here = np.flatnonzero((np.abs(parts.middle - seen.sides @ off) <= parts.half[:, None]).all(axis=1))
        assert len(here), "no part holds the centre"
        used.update(here.tolist())
        for part in here:
            assert not (parts.sure[part] & ~found).any(), f"sees less than surely from draw {draw}"
            assert not (found & ~parts.possible[part]).any(), f"sees more than possibly from draw {draw}"
    assert len(used) > 20  # the draws are spread over the parts
    assert decided == sorted(decided)
    assert decided[-1] > decided[0]  # smaller parts decide more
