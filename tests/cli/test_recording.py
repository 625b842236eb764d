"""A recording of a run in the simulated cell, and what an audit says of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.ask.api.program import open_program
from sqrp_cli.field.audit.frame_audit import audit, frames_of
from sqrp_cli.field.calibrating.labelled import of_program
from sqrp_cli.ros.bag import Bag, written
from sqrp_cli.run.record.bag_recorder import AS_PLANNED

pytestmark = pytest.mark.slow

JOINTS, CAM3, CAM5 = "/joint_states", "/cam3/image_raw/compressed", "/cam5/image_raw/compressed"


@pytest.fixture(scope="module")
def audited(asked, slip_run):
    return asked("audit", slip_run.cell.program, slip_run.cell.folder / "run.mcap", "--json")


@pytest.fixture
def rewritten(slip_run, tmp_path):
    """Writes messages of the recording anew: of these topics, as `change` gives them, under the topics that it says."""

    def write(topics: set[str], change: Callable[[str, Any], Iterable[tuple[str, Any]]]) -> Path:
        path = tmp_path / "rewritten.mcap"
        with Bag(slip_run.cell.folder / "run.mcap") as bag, written(path) as writer:
            for one in bag.messages(topics):
                for topic, message in change(one.topic, bag.read(one)):
                    writer.add(topic, one.t, message)
        return path

    return write


def test_a_recording_has_what_frames_have_and_an_audit_and_a_detector_learn_the_same_from_it(slip_run, asked, audited):
    # A recording has every image and the joints.
    images = slip_run.outcome.document["images"]
    with Bag(slip_run.cell.folder / "run.mcap") as bag:
        counts = {topic.name: topic.messages for topic in bag.topics}
        ends = [one.t * 1e-9 for one in bag.messages(["/joint_states"])]
    assert sum(count for name, count in counts.items() if name.endswith("compressed")) == images
    assert counts["/joint_states"] == counts["/tf"] >= 25 * slip_run.outcome.document["time"]
    assert ends[-1] - ends[0] == pytest.approx(slip_run.outcome.document["time"], abs=2e-3)
    # An audit finds in it what it finds in the frames.
    frames = asked("audit", slip_run.cell.program, slip_run.cell.folder / "frames", "--json").document
    assert audited.document["images"] == frames["images"]
    assert audited.document["skipped"] == frames["skipped"] > 0  # from the slip on, with those of the retry
    for step, other in zip(audited.document["prediction"], frames["prediction"], strict=True):
        for literal, cameras in step.items():
            for camera, counts in cameras.items():
                kept = other[literal][camera]
                assert abs(counts["tp"] - kept["tp"]) <= 1, (literal, camera)  # packed as JPEG
                assert abs(counts["fn"] - kept["fn"]) <= 1, (literal, camera)
    # It tells how far images are compared.
    footage = (opened := open_program(slip_run.cell.program)).footage(slip_run.cell.folder / "run.mcap", {})
    last = max(frames_of(footage, 0, opened.program.steps[0], {}).values())
    assert audited.document["until"] == [pytest.approx(last, abs=1e-3)]
    assert last < opened.program.steps[0].time - 0.3  # the part fell
    # A detector learns the same from it as from the frames.
    opened, folder = open_program(slip_run.cell.program), slip_run.cell.folder
    looks = []
    for source in (folder / "frames", folder / "run.mcap"):
        labelled = of_program(opened.program, opened.workspace, opened.footage(source, {}))
        looks.append([(one.frame.camera, sorted(one.holds.items())) for step in labelled for one in step.images])
    assert looks[0] == looks[1] != []


def test_of_a_recording_that_does_not_tell_images_count_while_the_arm_does_as_planned(slip_run, rewritten):
    opened, told = open_program(slip_run.cell.program), slip_run.cell.folder / "run.mcap"
    with Bag(told) as bag:
        topics = {topic.name for topic in bag.topics} - {AS_PLANNED}
    untold = rewritten(topics, lambda topic, message: [(topic, message)])
    ours, foreign = (opened.footage(path, {}) for path in (told, untold))
    counted = [frames_of(one, 0, opened.program.steps[0], {}) for one in (ours, foreign)]
    assert set(counted[0].values()) < set(counted[1].values())
    report = audit(opened.program, opened.workspace, foreign, {}, 0.97, lambda: None)
    assert "hold(g2)" in {one.atom for one in report.lost}
    assert all(one.t >= max(counted[0].values()) for one in report.lost)


@pytest.mark.parametrize("topics", [["cam5=/cam3/image_raw/compressed"], ["cam3=/a", "cam5=/a"]])
def test_images_are_never_taken_from_one_camera_for_another(sqrp, slip_run, rewritten, topics):
    recording = slip_run.cell.folder / "run.mcap"
    if len(topics) == 2:
        recording = rewritten({JOINTS, CAM3}, lambda topic, message: [("/a" if topic == CAM3 else topic, message)])
    given = [text for topic in topics for text in ("--topic", topic)]
    found = sqrp("audit", slip_run.cell.program, recording, *given)
    assert found.code == 2
    assert "would be the images of cam3 and of cam5" in " ".join(found.err.split())


def test_what_is_planned_is_exported_with_the_same_topics(sqrp, slip_run, tmp_path):
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


def test_a_camera_without_images_is_named_with_the_topics_that_may_be_its(sqrp, slip_run, rewritten, monkeypatch):
    seen = Counter[str]()

    def every_fifth(topic: str, message: Any) -> Iterable[tuple[str, Any]]:
        seen[topic] += 1
        return [(topic.replace("cam5", "left"), message)] if topic == JOINTS or seen[topic] % 5 == 0 else []

    recording = rewritten({JOINTS, CAM3, CAM5}, every_fifth)
    monkeypatch.setenv("COLUMNS", "200")
    found = open_program(slip_run.cell.program).audit(recording, threshold=0.0)
    assert repr(found).endswith("predicted images showed it, passed)")
    assert "There are no images of cam5: what was predicted of it is left out." in str(found)
    assert "--topic cam5=/left/image_raw/compressed" in str(found)
    assert (found.missing, found.other_topics) == (["cam5"], ["/left/image_raw/compressed"])
    asked = sqrp("audit", slip_run.cell.program, recording, "--threshold", "0%", "--json")
    assert found.to_json() == asked.out.rstrip("\n")


def test_images_that_are_damaged_are_left_out_and_counted(sqrp, slip_run, rewritten):
    seen, kept = Counter[str](), Counter[str]()

    def every_third(topic: str, message: Any) -> Iterable[tuple[str, Any]]:
        seen[topic] += 1
        if topic == CAM3 and seen[topic] in (3, 9):
            message.data = message.data[: len(message.data) // 2]
        if topic == CAM3 and seen[topic] % 3:
            return []
        kept[topic] += 1
        return [(topic, message)]

    found = sqrp("audit", slip_run.cell.program, rewritten({JOINTS, CAM3}, every_third), "--json").document
    assert found["damaged"] == 2
    assert found["images"] + found["skipped"] + 2 == kept[CAM3]


def test_of_several_streams_with_the_name_of_a_camera_one_is_asked_for(sqrp, slip_run, rewritten):
    others = ["/cam3/aligned_depth/image_raw/compressed", "/cam3/depth/image_raw/compressedDepth"]
    recording = rewritten(
        {JOINTS, CAM3}, lambda topic, message: [(one, message) for one in [topic, *(others if topic == CAM3 else [])]]
    )
    found = sqrp("audit", slip_run.cell.program, recording, columns=200)
    assert found.code == 2
    assert f"there are images of cam3 on `{others[0]}`, `{CAM3}`; which are they?" in found.err
    footage = open_program(slip_run.cell.program).footage(recording, {"cam3": CAM3})
    assert {one.camera for one in footage.frames} == {"cam3"}
    assert footage.other_topics == []


def test_a_camera_whose_clock_is_another_one_is_named(sqrp, slip_run, rewritten):
    seen = Counter[str]()

    def late(topic: str, message: Any) -> Iterable[tuple[str, Any]]:
        seen[topic] += 1
        message.header.stamp.sec += 60 if topic == CAM5 else 0
        return [(topic, message)] if topic == JOINTS or seen[topic] % 3 == 0 else []

    recording = rewritten({JOINTS, CAM3, CAM5}, late)
    found = sqrp("audit", slip_run.cell.program, recording, "--threshold", "0%", "--json")
    assert found.code == 1
    time = open_program(slip_run.cell.program).program.steps[0].time
    assert found.document["apart"] == {"cam5": pytest.approx(60.0 - time, abs=0.3)}
