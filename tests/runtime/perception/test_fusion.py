"""Several cameras on one atom."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.runtime.perception.detections import BoxSight, Sighting
from sqrp_cli.runtime.perception.fusion import fuse
from tests.runtime.steps import box


def sighting(camera: str, *evidence: Truth, frozen: bool = False, t: float = 0.0) -> Sighting:
    boxes = tuple(BoxSight("box", found, 1.0, np.zeros((0, 2))) for found in evidence)
    return Sighting(camera, t, frozen, {"held": boxes})


def fused(cameras: int, *sightings: Sighting) -> Truth:
    return fuse("held", ProgramTarget(cameras=cameras, boxes=(box(),), seen={}), sightings).truth


def test_one_camera_needs_all_boxes_to_confirm_and_one_to_refute() -> None:
    seen, absent, blind = Truth.TRUE, Truth.FALSE, Truth.UNKNOWN
    assert sighting("a", seen, seen).truth("held") == Truth.TRUE
    assert sighting("a", seen, blind).truth("held") == Truth.UNKNOWN
    assert sighting("a", blind, absent).truth("held") == Truth.FALSE
    assert sighting("a").truth("held") == Truth.UNKNOWN
    assert sighting("a", seen, frozen=True).truth("held") == Truth.UNKNOWN


@given(st.lists(st.sampled_from(list(Truth)), max_size=6), st.integers(1, 3))
def test_most_cameras_decide_if_they_are_as_many_as_needed(votes: list[Truth], needed: int) -> None:
    yes, no = votes.count(Truth.TRUE), votes.count(Truth.FALSE)
    found = fused(needed, *(sighting(str(i), vote) for i, vote in enumerate(votes)))
    assert (found == Truth.TRUE) == (yes >= needed and yes > no)
    assert (found == Truth.FALSE) == (no >= needed and no > yes)


def test_cameras_that_contradict_each_other_at_the_same_time_are_a_conflict() -> None:
    target = ProgramTarget(cameras=1, boxes=(box(),), seen={})
    assert fuse("held", target, [sighting("a", Truth.TRUE), sighting("b", Truth.FALSE)]).conflict
    assert not fuse("held", target, [sighting("a", Truth.TRUE), sighting("b", Truth.UNKNOWN)]).conflict
    later = fuse("held", target, [sighting("a", Truth.TRUE), sighting("b", Truth.FALSE, t=0.1)])
    assert not later.conflict
    assert later.votes == {"a": Truth.TRUE, "b": Truth.FALSE}
