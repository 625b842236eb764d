"""Recordings and their messages: whole without a word said, and whatever damages them is told."""

from __future__ import annotations

import os
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.ros.bag import Bag, BagWriter, check_kind, is_bag
from sqrp_cli.ros.messages import MessageError, message_types, nanoseconds
from tests.damage.recording_bombs import mcap_of_zeros


@pytest.fixture(scope="module", params=[".mcap", ".bag"])
def whole(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bag") / f"run{request.param}"
    writer = BagWriter(path)
    types = writer.types
    for number in range(200):
        writer.add("/said", number + 1, types.make("std_msgs/msg/String", data="x" * 1000))
    writer.close()
    return path


def test_messages_come_in_order_as_often_as_asked_for(whole: Path) -> None:
    assert is_bag(whole)
    with Bag(whole) as bag:
        for _ in range(2):
            assert [one.t for one in bag.messages(["/said"])] == list(range(1, 201))
        assert list(bag.messages(["/other"])) == []


@pytest.mark.parametrize("kept", [20, 0.3, 0.9, -1])
def test_a_recording_that_is_cut_off_is_told_in_one_message(whole: Path, tmp_path: Path, kept: float) -> None:
    content = whole.read_bytes()
    end = int(kept * len(content)) if isinstance(kept, float) else kept
    path = tmp_path / whole.name
    path.write_bytes(content[:end])
    with pytest.raises(InputError) as caught:
        read(path)
    (problem,) = caught.value.problems
    assert (problem.code, problem.place.file) == ("unreadable-file", path)
    if path.suffix == ".mcap":  # the header alone is nothing to save
        mend = f"mcap recover {path} -o {tmp_path / 'run-recovered.mcap'}"
        assert problem.mend == (None if kept == 20 else mend)


def test_bytes_that_are_damaged_are_told_or_give_other_messages(whole: Path, tmp_path: Path) -> None:
    content = bytearray(whole.read_bytes())
    path = tmp_path / whole.name
    for at in range(0, len(content), len(content) // 60):
        damaged = bytearray(content)
        damaged[at : at + 8] = b"\xff" * 8
        path.write_bytes(damaged)
        refused = None
        try:
            read(path)
        except InputError as error:
            refused = error
        assert refused is None or refused.problems[0].place.file == path
        if refused is not None and path.suffix == ".mcap" and at < len(content) - 45:
            assert refused.problems[0].mend is None, "its index is whole: `mcap recover` would not help"


def test_what_is_no_message_of_its_type_is_told(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = BagWriter(path)
    writer.add("/said", 1, message_types(2).make("std_msgs/msg/String", data="x"))
    writer._writer.write(writer._of_topic["/said"], 2, b"\0\1\0\0\xff\xff\xff\x7f")
    writer.close()
    with pytest.raises(InputError, match=r"a message on `/said` is no std_msgs/msg/String"):
        read(path)


def read(path: Path) -> None:
    """Read all that was said."""
    with Bag(path) as bag:
        for one in bag.messages(["/said"]):
            bag.read(one)


def test_a_chunk_that_unpacks_to_gigabytes_is_refused_before(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(mcap_of_zeros(1 << 30))
    tracemalloc.start()
    try:
        with pytest.raises(InputError, match="has more than 256 MB"):
            read(path)
        assert tracemalloc.get_traced_memory()[1] < 600_000_000
    finally:
        tracemalloc.stop()


def test_files_of_ros_2_are_told_by_their_beginning_and_pipes_are_not_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "run.bag2"
    path.write_bytes(b"SQLite format 3\0")
    with pytest.raises(InputError, match=r"whose name has to end in \.db3") as caught:
        read(path)
    assert caught.value.problems[0].mend == f"mv {path} {path.with_suffix('.db3')}"
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    os.mkfifo(tmp_path / "run.mcap")
    for piped in (tmp_path, tmp_path / "run.mcap"):
        with pytest.raises(InputError, match=r"run\.mcap is neither a file nor a folder"):
            check_kind(piped)
    assert is_bag(tmp_path / "run.mcap") is False


USED = (
    "sensor_msgs/msg/JointState", "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage",
    "sensor_msgs/msg/CameraInfo", "trajectory_msgs/msg/JointTrajectory", "trajectory_msgs/msg/JointTrajectoryPoint",
    "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Clock", "std_msgs/msg/Bool", "std_msgs/msg/String",
)  # fmt: skip


@pytest.mark.parametrize("ros", [1, 2])
@pytest.mark.parametrize("name", USED)
def test_an_empty_message_of_each_type_survives_its_bytes(ros: int, name: str) -> None:
    types = message_types(ros)
    assert types.encode(types.decode(name, types.encode(types.make(name)))) == types.encode(types.make(name))


@pytest.mark.parametrize("ros", [1, 2])
def test_bytes_that_are_no_such_message_are_refused(ros: int) -> None:
    types = message_types(ros)
    whole = types.encode(types.make("sensor_msgs/msg/Image", data=np.arange(100, dtype=np.uint8)))
    huge = whole[:-104] + b"\xff\xff\xff\x7f" + whole[-100:]
    for data in (b"", whole[:-40], huge, b"\x00" * 7):
        with pytest.raises(MessageError, match="no sensor_msgs/msg/Image"):
            types.decode("sensor_msgs/msg/Image", data)


def test_a_field_that_the_type_lacks_is_an_error_of_ours() -> None:
    with pytest.raises(TypeError, match="no field postition"):
        message_types(2).make("sensor_msgs/msg/JointState", postition=[])


def test_times_keep_their_nanoseconds() -> None:
    types = message_types(2)
    for ns in (0, 1_700_000_000_123_456_789, -1, -2_500_000_000):
        assert nanoseconds(types.make("builtin_interfaces/msg/Duration", **types.time(ns))) == ns
