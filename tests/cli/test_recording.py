"""A recording of a run in the simulated cell, and what an audit says of it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.api.program import open_program
from sqrp_cli.ros.bag import Bag
from tests.cli.slip_run import SlipRun


@pytest.fixture(scope="module")
def audited(sqrp: Callable[..., Any], slip_run: SlipRun) -> Any:
    return sqrp("audit", slip_run.cell.program, slip_run.cell.folder / "run.mcap", "--json")


def test_a_recording_has_every_image_and_the_joints(slip_run: SlipRun) -> None:
    images = slip_run.outcome.document["images"]
    with Bag(slip_run.cell.folder / "run.mcap") as bag:
        counts = {topic.name: topic.count for topic in bag.topics}
        ends = [one.t * 1e-9 for one in bag.messages(["/joint_states"])]
    assert sum(count for name, count in counts.items() if name.endswith("compressed")) == images
    assert counts["/joint_states"] == counts["/tf"] >= 25 * slip_run.outcome.document["time"]
    assert ends[-1] - ends[0] == pytest.approx(slip_run.outcome.document["time"], abs=2e-3)


def test_an_audit_finds_in_it_what_it_finds_in_the_frames(
    sqrp: Callable[..., Any], slip_run: SlipRun, audited: Any
) -> None:
    frames = sqrp("audit", slip_run.cell.program, slip_run.cell.folder / "frames", "--json").document
    assert audited.document["skipped"] > 0  # those of the retry
    for step, other in zip(audited.document["prediction"], frames["prediction"], strict=True):
        for literal, cameras in step.items():
            for camera, counts in cameras.items():
                kept = other[literal][camera]
                assert abs(counts["tp"] - kept["tp"]) <= 1, (literal, camera)  # packed as JPEG
                assert counts["fn"] == kept["fn"], (literal, camera)


def test_a_slip_shows_as_predictions_that_did_not_come_true(audited: Any) -> None:
    # Frames tell when the plan was given up; of a recording it is known only when the robot left the path.
    assert audited.code == 1
    wrong = [one["atom"] for one in audited.document["disagreements"]]
    assert {"hold(g2)", "obj_on_table(g2)"} <= set(wrong)


def test_topics_with_other_names_are_named(sqrp: Callable[..., Any], slip_run: SlipRun) -> None:
    program, recording = slip_run.cell.program, slip_run.cell.folder / "run.mcap"
    found = sqrp("audit", program, recording, "--topic", "cam3=/left")
    assert found.code == 2
    assert "there are no images on `/left`" in found.err
    assert sqrp("audit", program, recording, "--topic", "cam3").code == 2
    assert "no camera cam9" in sqrp("audit", program, recording, "--topic", "cam9=/left").err


def test_what_is_planned_is_exported_with_the_same_topics(
    sqrp: Callable[..., Any], slip_run: SlipRun, tmp_path: Path
) -> None:
    found = sqrp("program", slip_run.cell.program, "--export", tmp_path / "pick.mcap")
    assert found.code == 0, found.err
    with Bag(tmp_path / "pick.mcap") as plan, Bag(slip_run.cell.folder / "run.mcap") as run:
        images = {f"/{camera}/image_raw/compressed" for camera in ("cam3", "cam5")}
        assert {topic.name for topic in plan.topics} == {topic.name for topic in run.topics} - images
        first, *_, last = (plan.read(one) for one in plan.messages(["/joint_states"]))
        seen = [plan.read(one) for one in plan.messages(["/verdicts"])]
    step = open_program(slip_run.cell.program).program.steps[0]
    for state, world in ((first, step.before), (last, step.after)):
        positions = dict(zip(state.name, state.position, strict=True))
        assert positions == pytest.approx({name: world.joints[name] for name in positions}, abs=1e-6)
    assert {one.message for message in seen for one in message.status} >= {"true", "false"}
