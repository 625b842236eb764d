"""A recording of a run in the simulated cell, and what an audit says of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

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
    assert ends[-1] - ends[0] == pytest.approx(slip_run.outcome.document["time"], abs=1e-6)


def test_an_audit_finds_in_it_what_it_finds_in_the_frames(
    sqrp: Callable[..., Any], slip_run: SlipRun, audited: Any
) -> None:
    frames = sqrp("audit", slip_run.cell.program, slip_run.cell.folder / "frames", "--json").document
    assert audited.code == 0, audited.err
    assert audited.document["images"] == frames["images"]
    assert audited.document["skipped"] == frames["skipped"]
    for step, other in zip(audited.document["prediction"], frames["prediction"], strict=True):
        for literal, cameras in step.items():
            for camera, counts in cameras.items():
                differ = {key: abs(counts[key] - other[literal][camera][key]) for key in counts}
                assert max(differ.values()) <= 2, (literal, camera)  # an image at the edge of sight, packed as JPEG


def test_topics_with_other_names_are_named(sqrp: Callable[..., Any], slip_run: SlipRun) -> None:
    program, recording = slip_run.cell.program, slip_run.cell.folder / "run.mcap"
    found = sqrp("audit", program, recording, "--topic", "cam3=/left")
    assert found.code == 2
    assert "there are no images on `/left`" in found.err
    assert sqrp("audit", program, recording, "--topic", "cam3").code == 2
    assert "no camera cam9" in sqrp("audit", program, recording, "--topic", "cam9=/left").err
