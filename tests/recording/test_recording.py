"""Recordings are read as their own writers wrote them, and what is wrong with one is told in one message."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import CompressionType, Writer
from rosbags import rosbag1, rosbag2

from sqrp_cli.errors import InputError
from sqrp_cli.recording.recording import open_recording
from sqrp_cli.ros.messages import message_types
from tests.cells import read_cases

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
    assert set(found.units.values()) == {case.get("units", "")}
    assert episode.told[:1] == ((case["told"],) if "told" in case else ())


@pytest.mark.parametrize("case", TEXTS["refused"].values(), ids=TEXTS["refused"])
def test_text_that_is_wrong_is_refused_in_one_message(case: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "file").write_text(case["text"], encoding="utf-8")
    refused(tmp_path / "file", case["code"], case["says"], case.get("line"), signal=case.get("signal"))


def refused(path: Path, code: str, says: str, line: int | None = None, signal: str | None = None) -> None:
    with pytest.raises(InputError) as caught:  # noqa: PT012 - of one of both
        found = open_recording(path, signal=signal)
        [found.read(episode) for episode in range(len(found.episodes))]
    (problem,) = caught.value.problems
    assert (problem.code, problem.place.line) == (code, line)
    assert says in problem.message


def dataset(folder: Path, version: str, states: list[np.ndarray], **changes: Any) -> Path:
    """A dataset as LeRobot lays it out: a file for each episode in v2, a group of rows for each in v3."""
    feature = {"dtype": "float32", "shape": [2], "names": NAMES} | changes
    features = {"observation.state": feature, "action": feature}
    info = {"codebase_version": version, "fps": 30, "total_episodes": len(states), "features": features}
    (folder / "meta/episodes/chunk-000").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(info))
    tables = []
    for number, values in enumerate(states):
        width = values.shape[1] if values.shape[1] != 1 else -1
        lists = [pa.array(one.tolist(), pa.list_(pa.float32(), width)) for one in (values, values + 1)]
        times = np.arange(len(values)) / 30
        columns = {"timestamp": pa.array(times, pa.float32()), "episode_index": np.full(len(values), number)}
        tables.append(pa.table({"observation.state": lists[0], "action": lists[1], **columns}))
    if version < "v3":
        for number, table in enumerate(tables):
            pq.write_table(table, folder / f"data/chunk-000/episode_{number:06d}.parquet")
        return folder
    with pq.ParquetWriter(folder / "data/chunk-000/file-000.parquet", tables[0].schema) as writer:
        for table in tables:
            writer.write_table(table)
    zeros = np.zeros(len(states), dtype=int)
    places = {"episode_index": np.arange(len(states)), "data/chunk_index": zeros, "data/file_index": zeros}
    pq.write_table(pa.table(places), folder / "meta/episodes/chunk-000/file-000.parquet")
    return folder


def random_states(count: int = 3, width: int = 2) -> list[np.ndarray]:
    random = np.random.default_rng(0)
    return [random.normal(0, 50, (5 + n, width)).astype(np.float32) for n in range(count)]


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_datasets_have_their_states_episode_by_episode(version: str, tmp_path: Path) -> None:
    states = random_states()
    path = dataset(tmp_path, version, states)
    for signal, more in ((None, 0), ("action", 1)):
        found = open_recording(path, signal=signal)
        assert (found.names, found.rate, found.episodes) == (tuple(NAMES), 30.0, ("0", "1", "2"))
        for number in (2, 0, 1):
            episode = found.read(number)
            np.testing.assert_array_equal(episode.values, states[number] + np.float32(more))
            np.testing.assert_allclose(episode.times, np.arange(5 + number) / 30, atol=1e-7)


def cut(path: Path) -> None:
    (file := next(path.glob("data/*/*.parquet"))).write_bytes(file.read_bytes()[:-20])


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        (lambda path: dataset(path, "v3.0", [np.full((3, 2), np.nan)]), "not-finite", "of state 1, `shoulder_pan.pos`"),
        (lambda path: dataset(path, "v2.1", random_states(width=3)), "wrong-columns", "a row has 3 numbers"),
        (lambda path: dataset(path, "v1.6", random_states()), "wrong-value", "of version `1.6`"),
        (lambda path: dataset(path, "v3.0", random_states(), shape=[2, 2]), "wrong-value", "a `shape` of one number"),
        (lambda path: dataset(path, "v3.0", [np.zeros((0, 2))]), "empty-recording", "episode 0 has no states"),
        (lambda path: dataset(path, "v2.1", []), "empty-recording", "has no episodes"),
        (lambda path: cut(dataset(path, "v3.0", random_states())), "unreadable-file", "numbers that is whole"),
    ],
)
def test_damaged_datasets_are_told(change: Callable[[Path], object], code: str, says: str, tmp_path: Path) -> None:
    change(tmp_path)
    refused(tmp_path, code, says)


def test_a_feature_that_is_not_there_is_told_with_those_that_are(tmp_path: Path) -> None:
    refused(dataset(tmp_path, "v3.0", random_states()), "no-joints", "`action`", signal="actions")


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
            refused(path, case["code"], case["says"], signal=case.get("signal"))
            continue
        found = open_recording(path, signal=case.get("signal"))
        episode = found.read(0)
        assert list(found.names) == case["names"]
        np.testing.assert_allclose(episode.times, case["times"], atol=1e-9)
        np.testing.assert_allclose(episode.values, case["values"], atol=1e-7)
        assert list(episode.told) == case.get("told", [])


def test_a_folder_of_files_has_an_episode_in_each(tmp_path: Path) -> None:
    for number, names in enumerate(("t,a,b", "t,b,a", "t,b,c")):
        (tmp_path / f"take{number}.csv").write_text(f"{names}\n0,1,2\n1,3,4\n")
    found = open_recording(tmp_path)
    assert found.episodes == ("take0", "take1", "take2")
    np.testing.assert_array_equal(found.read(1).values, [[2, 1], [4, 3]])
    with pytest.raises(InputError, match=r"take2\.csv: this table lacks `a`; .* one like take0\.csv"):
        found.read(2)
