from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.ros.bag import Bag, BagWriter, is_bag
from sqrp_cli.ros.messages import message_types


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
