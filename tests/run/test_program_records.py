"""A program file holds the records that planning and running use: what is written is what is read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from sqrp_cli.figures import FaultMetrics, LateReason
from sqrp_cli.geometry import axis_rotation, pose
from sqrp_cli.logic.literal import Atom
from sqrp_cli.program.file import load_program, save_program
from sqrp_cli.program.record import Program, Step
from tests.run.steps import step

X_WO = pose(axis_rotation(2, 0.3), (0.1, 0.2, 0.3))
SLIP = FaultMetrics(0.1, 0.3, 0.2, 0.0, 12.0)


def with_records() -> Step:
    plain = step([], {"seen": {"cam": [(0.0, 1.0)]}})
    facts = frozenset({Atom("on", ("cube", "tray")), Atom("hand_empty")})
    world = replace(plain.before, facts=facts, X_WO={"cube": X_WO}, held="cube", X_TO=np.eye(4))
    return plain.model_copy(update={"before": world, "faults": {"slip": SLIP}})


def program_of(step: Step) -> Program:
    return Program(workspace="w.yaml", digest="d", joints=("a",), steps=(step,))


def test_what_is_written_of_a_record_is_what_is_read_of_it() -> None:
    made = with_records()
    read = Program.model_validate(program_of(made).model_dump(mode="json", by_alias=True)).steps[0]
    assert read.faults == {"slip": SLIP}
    why = LateReason(kind="frame", camera=None, at=1.0, after=0.1, words="")
    late = with_records().model_copy(update={"faults": {"slip": replace(SLIP, why=why)}})
    assert late.model_dump() == with_records().model_dump()  # so that checksums of older programs stay
    assert (read.before.facts, read.before.held, read.before.joints) == (made.before.facts, "cube", {"a": 0.0})
    np.testing.assert_array_equal(read.before.X_WO["cube"], X_WO)
    np.testing.assert_array_equal(read.before.X_TO, np.eye(4))
    (box,), (first,) = read.targets["seen"].boxes, made.targets["seen"].boxes
    np.testing.assert_array_equal(box.X_FB, first.X_FB)
    assert replace(box, X_FB=first.X_FB).__dict__ == first.__dict__
    assert read.primitives[0].trajectory.to_numbers() == made.primitives[0].trajectory.to_numbers()
    assert not read.before.X_WO["cube"].flags.writeable


SPOILT: dict[str, Callable[[Step], Step]] = {
    "joint": lambda s: s.model_copy(update={"before": replace(s.before, joints={"a": float("nan")})}),
    "pose": lambda s: s.model_copy(update={"before": replace(s.before, X_WO={"cube": X_WO * float("inf")})}),
    "delay": lambda s: s.model_copy(update={"faults": {"slip": replace(SLIP, delay_mean=-1.0)}}),
}


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("what", SPOILT)
def test_a_figure_that_no_file_may_hold_is_not_written(tmp_path: Path, what: str) -> None:
    path = tmp_path / "program.yaml"
    with pytest.raises(ValidationError):
        save_program(program_of(SPOILT[what](with_records())), path)
    assert not path.exists()
    save_program(program_of(step([], {})), path)
    assert load_program(path).joints == ("a",)
