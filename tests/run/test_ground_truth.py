"""What is told of where everything really is, and when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from sqrp_cli.geometry import axis_rotation, pose, quaternion_to_matrix
from sqrp_cli.program.record import ProgramTarget
from sqrp_cli.run.cell.simulated_cell import CellState
from sqrp_cli.run.ground_truth import step_began
from sqrp_cli.run.lockstep import Lockstep
from sqrp_cli.run.record.events import Event, EventPublisher, event
from sqrp_cli.run.record.log import Track
from tests.run.steps import box, step

BEGAN = event("primitive", 0.0, name="a1")


@dataclass
class Falling:
    """A cell with a joint that turns at 1 rad/s until 0.1 s, and a thing that is lost at 0.05 s and sinks at 1 m/s."""

    t: float = 0.0
    asked: tuple[float, ...] = ()

    def advance(self, t: float, _: Any) -> None:
        self.t = t
        self.asked = (*self.asked, t)

    def truth(self) -> Any:
        height = 1.0 - max(0.0, self.t - 0.05)
        thing = pose(axis_rotation(2, 0.3), (0.0, 0.0, height))
        still = pose(position=(1.0, 2.0, 3.0))
        held = "thing" if self.t < 0.05 else None
        return CellState(self.t, {"thing": thing, "table": still}, held, {"a": min(self.t, 0.1), "b": 0.0})


@pytest.fixture
def told() -> tuple[Falling, list[Event]]:
    """What is told of 0.17 s that pass in steps of which none is as long as another."""
    events: list[Event] = []
    cell = Falling()
    program, robot, publisher = MagicMock(steps=[step([], {})], joints=()), MagicMock(), EventPublisher([events.append])
    witness = Lockstep(program, robot, cell, MagicMock(), MagicMock(), publisher, states=True)  # type: ignore[arg-type]
    for t in (0.0, 0.013, 0.041, 0.16, 0.17):
        witness.advance(t)
    witness.publish_state()
    return cell, events


def test_states_are_told_at_a_fixed_rate_and_at_the_end_and_time_passes_as_without_a_witness(told) -> None:
    cell, events = told
    assert [event.t for event in events] == pytest.approx([0.0, 0.04, 0.08, 0.12, 0.16, 0.17])
    assert list(cell.asked) == sorted(cell.asked)
    assert {0.0, 0.013, 0.041, 0.16, 0.17} <= set(cell.asked)


def test_only_what_has_changed_is_told_again(told: tuple[Falling, list[Event]]) -> None:
    first, *others = ({k: v for k, v in event.line().items() if k not in {"t", "event"}} for event in told[1])
    assert first.keys() == {"joints", "q", "held", "objects"}
    assert first["objects"].keys() == {"thing", "table"}
    assert others[0] == {"q": [0.04, 0.0]}
    assert others[1].keys() == {"q", "held", "objects"}
    assert others[1]["objects"].keys() == {"thing"}
    assert others[3].keys() == {"objects"}


def test_a_track_has_all_of_it_at_all_times(told: tuple[Falling, list[Event]]) -> None:
    track = Track.of([BEGAN, *told[1]])
    assert track is not None
    assert track.joints == ("a", "b")
    np.testing.assert_allclose(track.q[:, 0], [0.0, 0.04, 0.08, 0.1, 0.1, 0.1], atol=1e-5)
    assert track.held == ("thing", "thing", None, None, None, None)
    assert [index for index, _ in track.poses["table"]] == [0]
    for index, (x, y, z, *turn) in track.poses["thing"]:
        assert (x, y) == (0.0, 0.0)
        assert z == pytest.approx(1.0 - max(0.0, track.t[index] - 0.05), abs=1e-5)
        np.testing.assert_allclose(quaternion_to_matrix(turn), axis_rotation(2, 0.3), atol=2e-5)
    assert Track.of([BEGAN]) is None


def test_boxes_are_where_images_are_searched_for_things() -> None:
    """Those of the robot move with it, those of where an object was stay, those of what is carried are left out."""
    X_WO, X_OB = pose(axis_rotation(2, 0.5), (1.0, 2.0, 0.0)), pose(position=(0.1, 0.0, 0.05))
    frames = {"in_tool": "tip", "in_place": "cube@start", "beside": "cube", "on_tray": "tray", "fixed": "world"}
    plain = step([], {atom: {} for atom in frames})
    targets = {
        atom: ProgramTarget(cameras=1, boxes=(replace(box(), frame=frame, X_FB=X_OB),), seen={})
        for atom, frame in frames.items()
    }
    before = replace(plain.before, X_WO={"cube": X_WO, "tray": X_WO})
    (primitive,) = plain.primitives
    carrying = primitive.model_copy(update={"held": "cube"})
    moved = {"targets": targets, "before": before, "primitives": (carrying,)}
    found = step_began(plain.model_copy(update=moved), 1)["boxes"]
    assert found["beside"] == []
    for atom, (frame, X) in {
        "in_tool": ("tip", X_OB),
        "in_place": ("world", X_WO @ X_OB),
        "on_tray": ("world", X_WO @ X_OB),
        "fixed": ("world", X_OB),
    }.items():
        (only,) = found[atom]
        assert (only.frame, only.size) == (frame, [0.04, 0.04, 0.04])
        np.testing.assert_allclose(only.pose, X, atol=1e-5)
