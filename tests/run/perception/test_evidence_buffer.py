"""Several cameras on one atom."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.run.perception.detections import BoxDetection, Detection, fuse
from tests.run.steps import box


def detection(camera: str, *evidence: Truth, frozen: bool = False, t: float = 0.0) -> Detection:
    boxes = tuple(BoxDetection("box", found, 1.0, np.zeros((0, 2))) for found in evidence)
    return Detection(camera, t, frozen, {"held": boxes})


def fused(cameras: int, *detections: Detection) -> Truth:
    return fuse("held", ProgramTarget(cameras=cameras, boxes=(box(),), seen={}), detections).truth


def test_one_camera_needs_all_boxes_to_confirm_and_one_to_refute() -> None:
    seen, absent, blind = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
    assert detection("a", seen, seen).truth("held") == Truth.TRUE
    assert detection("a", seen, blind).truth("held") == Truth.UNKNOWN
    assert detection("a", blind, absent).truth("held") == Truth.FALSE
    assert detection("a").truth("held") == Truth.UNKNOWN
    assert detection("a", seen, frozen=True).truth("held") == Truth.UNKNOWN


@given(st.lists(st.sampled_from(list(Truth)), max_size=6), st.integers(1, 3))
def test_most_cameras_decide_if_they_are_as_many_as_needed(votes: list[Truth], needed: int) -> None:
    yes, no = votes.count(Truth.TRUE), votes.count(Truth.FALSE)
    found = fused(needed, *(detection(str(i), vote) for i, vote in enumerate(votes)))
    assert (found == Truth.TRUE) == (yes >= needed and yes > no)
    assert (found == Truth.FALSE) == (no >= needed and no > yes)


def test_cameras_that_contradict_each_other_at_the_same_time_are_a_conflict() -> None:
    target = ProgramTarget(cameras=1, boxes=(box(),), seen={})
    assert fuse("held", target, [detection("a", Truth.TRUE), detection("b", Truth.FALSE)]).conflict
    assert not fuse("held", target, [detection("a", Truth.TRUE), detection("b", Truth.UNKNOWN)]).conflict
    later = fuse("held", target, [detection("a", Truth.TRUE), detection("b", Truth.FALSE, t=0.1)])
    assert not later.conflict
    assert later.votes == {"a": Truth.TRUE, "b": Truth.FALSE}
