"""Recordings are read as their own writers wrote them, and what is wrong with one is told in one message."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2

from sqrp_cli.errors import InputError
from sqrp_cli.recording.recording import open_recording
from sqrp_cli.ros.messages import message_types
from tests.cells import read_cases
from tests.recording.datasets import CUT, write_dataset

TEXTS = read_cases("recordings.yaml")
NAMES = ["shoulder_pan.pos", "gripper.pos"]
JOINTS = "sensor_msgs/msg/JointState"


@pytest.mark.parametrize("case", TEXTS["read"].values(), ids=TEXTS["read"])
def test_text_is_read_as_it_is_meant(case: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "file").write_text(case["text"], encoding="utf-8")
    found = open_recording(tmp_path / "file", rate=case.get("rate"))
    episode = found.read(found.episodes.index(case.get("episode", found.episodes[0])))
    np.testing.assert_allclose(episode.times, case["times"], atol=case.get("to", 1e-9))
    np.testing.assert_array_equal(episode.values, case["values"])
    assert list(found.names) == case.get("names", list(found.names))
    assert {found.units.get(name, "") for name in found.names} == {case.get("units", "")}
    assert episode.told[:1] == ((case["told"],) if "told" in case else ())


@pytest.mark.parametrize("case", TEXTS["refused"].values(), ids=TEXTS["refused"])
def test_text_that_is_wrong_is_refused(case: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "file").write_text(case["text"], encoding="utf-8")
    refused(tmp_path / "file", case)


def refused(path: Path, case: dict[str, Any]) -> None:
    """In one message, with the code, the line and words of the case."""
    with pytest.raises(InputError) as caught:  # noqa: PT012 - of one of both
        found = open_recording(path, signal=case.get("signal"))
        [found.read(episode) for episode in range(len(found.episodes))]
    (problem,) = caught.value.problems
    assert (problem.code, problem.place.line) == (case["code"], case.get("line"))
    assert case["says"] in problem.message


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_datasets_have_their_states_episode_by_episode(version: str, tmp_path: Path) -> None:
    states = np.random.default_rng(0).normal(0, 50, (2, 5, 2)).astype(np.float32)
    write_dataset(tmp_path, states, NAMES, version)
    for signal, more in ((None, 0), ("action", 1)):
        found = open_recording(tmp_path, signal=signal)
        assert (found.names, found.episodes) == (tuple(NAMES), ("0", "1"))
        for number in (1, 0):
            np.testing.assert_array_equal(found.read(number).values, states[number] + np.float32(more))
            np.testing.assert_allclose(found.read(number).times, np.arange(5) / 30, atol=1e-7)
            np.testing.assert_array_equal(found.read(number).frames, CUT + np.arange(5))


def test_episodes_and_states_keep_their_own_numbers(tmp_path: Path) -> None:
    write_dataset(tmp_path / "part", [np.zeros((2, 2))] * 8, NAMES, "v2.1")
    for number in {*range(8)} - {3, 7}:
        (tmp_path / f"part/data/chunk-000/episode_{number:06d}.parquet").unlink()
    assert open_recording(tmp_path / "part").numbers == (3, 7)
    (tmp_path / "table.csv").write_text("t,a\n0,1\n2,5\n1.99,4\n2,6\n3,7\n")
    found = open_recording(tmp_path / "table.csv")
    assert (found.numbers, found.read(0).frames.tolist()) == ((0,), [0, 2, 1, 4])


@pytest.mark.parametrize("case", TEXTS["datasets"].values(), ids=TEXTS["datasets"])
def test_damaged_datasets_are_told(case: dict[str, Any], tmp_path: Path) -> None:
    size = case.get("episodes", 2), case.get("frames", 5), case.get("width", 2)
    states = np.full(size, case.get("fill", 0), np.float32)
    write_dataset(tmp_path, states, NAMES, case.get("version", "v3.0"), case.get("shape"))
    for file in tmp_path.glob("data/*/*"):
        file.write_bytes(file.read_bytes()[: -case.get("cut", 0) or None])
    refused(tmp_path, case)


def bag(path: Path, form: str, states: list[tuple[str, float, float, dict[str, float]]]) -> Path:
    """A bag of joint states by the writers of rosbags, or an MCAP alone by the writer of MCAP; "" has no position."""
    types = message_types(1 if form == "ros1" else 2)
    messages = []
    for topic, t, stamp, positions in states:
        values = np.array([value for name, value in positions.items() if name])
        fields = {"header": types.header(round(stamp * 1e9)), "name": [*positions], "position": values}
        messages.append((topic, round(t * 1e9), types.encode(types.make(JOINTS, **fields))))
    topics = dict.fromkeys(topic for topic, _, _ in messages)
    if form == "mcap alone":
        writer = Writer(str(path / "alone.mcap"), compression=CompressionType.LZ4)
        writer.start(profile="ros2")
        definition = types.store.generate_msgdef(JOINTS, ros_version=2)[0].encode()
        schema = writer.register_schema(JOINTS, "ros2msg", definition)
        channels = {topic: writer.register_channel(topic, "cdr", schema) for topic in topics}
        for topic, t, data in messages:
            writer.add_message(channels[topic], t, data, t)
        writer.finish()
        return path / "alone.mcap"
    path = path / (f"{form}.bag" if form == "ros1" else form)
    plugin = getattr(rosbag2.StoragePlugin, form.upper(), None)
    with rosbag1.Writer(path) if form == "ros1" else rosbag2.Writer(path, version=8, storage_plugin=plugin) as writer:
        ways = {topic: writer.add_connection(topic, JOINTS, typestore=types.store) for topic in topics}
        for topic, t, data in messages:
            writer.write(ways[topic], t, data)
    return path


@pytest.mark.parametrize("case", TEXTS["bags"].values(), ids=TEXTS["bags"])
def test_bags_have_the_states_of_all_topics_on_one_clock(case: dict[str, Any], tmp_path: Path) -> None:
    for form in case.get("forms", ["mcap"]):
        path = bag(tmp_path, form, case["states"])
        if "says" in case:
            refused(path, case)
            continue
        found = open_recording(path, signal=case.get("signal"))
        episode = found.read(0)
        assert list(found.names) == case["names"]
        np.testing.assert_allclose(episode.times, case["times"], atol=1e-9)
        np.testing.assert_allclose(episode.values, case["values"], atol=1e-9)
        assert list(episode.told) == case.get("told", [])


def test_a_folder_of_files_has_an_episode_in_each(tmp_path: Path) -> None:
    for number, names in enumerate(("t,a,b", "t,b,a", "t,b,c")):
        (tmp_path / f"take{number}.csv").write_text(f"{names}\n0,1,2\n1,3,4\n")
    (tmp_path / "README.md").write_text("# Takes, of Monday\n\nThe first, the second, and one that differs.\n")
    found = open_recording(tmp_path)
    assert found.episodes == ("take0", "take1", "take2")
    np.testing.assert_array_equal(found.read(1).values, [[2, 1], [4, 3]])
    with pytest.raises(InputError, match=r"take2\.csv: this table lacks `a`; expected one as take0\.csv"):
        found.read(2)
