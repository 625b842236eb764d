"""Recordings of ROS that are made to upset their reader: messages, times, images, topics and files."""

from __future__ import annotations

import bz2
import os
import sqlite3
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from functools import partial
from itertools import count, starmap
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

import numpy as np

from sqrp_cli.ros.bag import Bag, BagWriter, Packed, written
from tests.damage.bombs import ELSEWHERE, TABLE, Bomb, edited, text_of, whole
from tests.damage.record_bombs import png
from tests.recording.datasets import packed

STATES, IMAGE = "/joint_states", "/cam1/image_raw/compressed"
COMPRESSED, RAW = "sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image"
Change = Callable[[Any, int], Any]
"""What a message, the number of which on its topic is known, becomes; None for nothing."""


def _rewritten(name: str, topic: str, change: Change, more: Callable[[BagWriter], None] | None = None) -> Bomb:
    """A bomb that is other messages on a topic, and more messages than there are."""

    def place(path: Path, _random: Random) -> None:
        numbers, other = count(), path.with_name(f"other{path.suffix}")
        with Bag(path) as bag, written(other) as writer:
            for one in bag.messages({topic.name for topic in bag.topics}):
                message = bag.read(one)
                if one.topic == topic:
                    message = change(message, next(numbers))
                if message is not None:
                    writer.add(one.topic, one.t, message)
            if more is not None:
                more(writer)
        other.replace(path)

    return Bomb(name, place)


def _state(title: str, **fields: object) -> Bomb:
    """A bomb in every joint state from the tenth on."""
    return _rewritten(f"state-{title}", STATES, lambda message, n: _with(message, fields) if n >= 10 else message)


def _image(title: str, **fields: object) -> Bomb:
    """A bomb in one image."""
    return _rewritten(f"image-{title}", IMAGE, lambda message, n: _with(message, fields) if n == 1 else message)


def _with(message: Any, fields: dict[str, object]) -> Any:
    """The message with other fields; what takes long to make is a function."""
    for name, field in fields.items():
        value = field() if callable(field) else field
        if isinstance(value, list):
            value = np.array(value, dtype=float) if name == "position" else [text_of(one) for one in value]
        setattr(message, name, np.frombuffer(value, np.uint8) if isinstance(value, bytes) else value)
    return message


def _stamped(name: str, topic: str, change: Callable[[int, int], int]) -> Bomb:
    """A bomb in the stamps of a topic, as nanoseconds of a message with a number."""

    def edit(message: Any, number: int) -> Any:
        stamp = message.header.stamp
        ns = change(stamp.sec * 1_000_000_000 + stamp.nanosec, number)
        stamp.sec, stamp.nanosec = ns // 1_000_000_000, ns % 1_000_000_000
        return message

    return _rewritten(f"stamp-{name}", topic, edit)


def _raw(title: str, **fields: object) -> Bomb:
    """A bomb that is an image pixel by pixel on a topic of its own, in place of all others of the camera."""

    def more(writer: BagWriter) -> None:
        whole_image = {"encoding": "rgb8", "width": 96, "height": 72, "step": 288, "data": bytes(288 * 72)}
        image = _with(writer.types.make(RAW, header=writer.types.header(2_000_000_000)), {**whole_image, **fields})
        writer.add("/cam1/image_raw", 2_000_000_000_000_000_000, image)

    return _rewritten(f"raw-{title}", IMAGE, lambda _message, _number: None, more)


def _said(title: str, topic: str, kind: str, *, keep: bool = False, **fields: object) -> Bomb:
    """A bomb that is a message of another type on a topic; keep: in addition to those that are there."""

    def more(writer: BagWriter) -> None:
        writer._of_topic.pop(topic, None)
        writer.add(topic, 2_000_000_000_000_000_000, writer.types.make(kind, **fields))

    return _rewritten(title, topic, lambda message, _number: message if keep else None, more)


def _topics(writer: BagWriter) -> None:
    for number in range(1000):
        writer.add(f"/x{number}/image", 1_500_000_000_000_000_000, writer.types.make(COMPRESSED))


def _bytes(name: str, topic: str, change: Callable[[bytes], bytes]) -> Bomb:
    """A bomb that is other bytes in place of a message."""

    def place(path: Path, random: Random) -> None:
        kept: list[Packed] = []
        with Bag(path) as bag:
            kept += bag.messages({one.name for one in bag.topics})
            types = bag.types
        at = random.choice([index for index, one in enumerate(kept) if one.topic == topic])
        path.unlink()
        with mock.patch.object(types, "encode", lambda data: bytes(data.data)), written(path) as writer:
            for index, one in enumerate(kept):
                data = change(bytes(one.data)) if index == at else bytes(one.data)
                message = types.store.types[one.type]
                writer.add(one.topic, one.t, mock.Mock(data=data, __msgtype__=message.__msgtype__))

    return Bomb(f"bytes-{name}", place)


def jpeg(width: int, height: int) -> bytes:
    """A JPEG whose header says how large it is, and that has nothing else."""
    frame = struct.pack(">BBHBHHB", 0xFF, 0xC0, 17, 8, height, width, 3) + bytes([1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1])
    return b"\xff\xd8\xff\xe0\x00\x10JFIF\0\1\1\0\0\1\0\1\0\0" + frame + bytes(1000) + b"\xff\xd9"


MESSAGES = (
    *(_state(name, **fields) for name, fields in TABLE["joint states"].items()),
    _state("100000-positions", position=np.zeros(100_000)),
    _rewritten("states-missing", STATES, lambda _message, _number: None),
    _rewritten("state-alone", STATES, lambda message, n: message if n == 5 else None),
    _rewritten("states-rare", STATES, lambda message, n: message if n % 40 == 0 else None),
    _stamped("zero", STATES, lambda _ns, _n: 0),
    _stamped("equal", STATES, lambda _ns, _n: 1_000_000_005_000_000_000),
    _stamped("reversed", STATES, lambda _ns, n: 1_000_000_009_000_000_000 - n * 40_000_000),
    _stamped("far", STATES, lambda ns, n: 2**31 * 10**9 - 1 if n == 3 else ns),
    _stamped("in-1970", STATES, lambda ns, n: 7 if n == 3 else ns),
    _stamped("images-zero", IMAGE, lambda _ns, _n: 0),
    _stamped("images-equal", IMAGE, lambda _ns, _n: 1_000_000_003_000_000_000),
    _stamped("images-far", IMAGE, lambda ns, _n: ns + 10**18),
    _stamped("images-in-1970", IMAGE, lambda ns, _n: ns % 10**9),
    _image("empty", data=b""),
    _image("zeros", data=bytes(50_000_000)),
    _image("format-of-signs", data=b"", format="\x1b[2J\u202e" + "x" * 100_000),
    *(_image(f"jpeg-{w}x{h}", data=jpeg(w, h)) for w, h in ((0, 0), (96, 72), (65_535, 65_535))),
    _image("jpeg-cut", data=b"\xff\xd8\xff" + bytes(100)),
    _image("jpeg-end", data=b"\xff\xd8\xff\xd9"),
    *(_image(f"png-{w}x{h}", data=png(w, h, rows=b"\0" * 1000)) for w, h in ((1, 1), (96, 72), (100_000, 100_000))),
    _image("png-of-a-gigabyte", data=lambda: png(96, 72, rows=bytes(300_000_000))),
    *(_raw(name, **fields) for name, fields in TABLE["images pixel by pixel"].items()),
    _raw("encoding-of-signs", encoding="\x1b[2J" * 10_000),
    _raw("short", data=bytes(1000)),
    _raw("empty", data=b"", height=0, width=0, step=0),
    _said("no-joint-states", STATES, "std_msgs/msg/String", data="x"),
    _said("no-images", IMAGE, "std_msgs/msg/Float64", data=1.0),
    _said("two-types", STATES, "std_msgs/msg/String", keep=True, data="x"),
    _rewritten("1000-topics", IMAGE, lambda _message, _n: None, _topics),
    _said("topic-of-signs", "/\x1b[2J\u202e/image", COMPRESSED),
    *(_bytes(f"{name}-{where}", topic, change) for name, change in (
        ("none", lambda _data: b""), ("cut", lambda data: data[: len(data) // 2]),
        ("ones", lambda data: b"\xff" * len(data)),
        ("long", lambda data: data + bytes(1_000_000)),
        ("count", lambda data: data[:16] + b"\xff\xff\xff\x7f" + data[20:]),
    ) for where, topic in (("state", STATES), ("image", IMAGE))),
)  # fmt: skip
"""Whole recordings, other messages."""


def _sparse(content: bytes, size: int) -> Bomb:
    """A file of a size that takes no room on the disk."""

    def place(path: Path, _random: Random) -> None:
        path.unlink()
        path.write_bytes(content)
        os.truncate(path, size)

    return Bomb(f"sparse-{len(content)}-{size:.0e}", place)


FILES = (
    *ELSEWHERE,
    edited("half", lambda content, _: content[: len(content) // 2]),
    edited("without-last-byte", lambda content, _: content[:-1]),
    edited("twice", lambda content, _: content + content),
    whole("empty", b""),
    whole("text", b"hello\n"),
    whole("gzip", b"\x1f\x8b" + bytes(1000)),
    whole("other-sqlite", lambda: _database("CREATE TABLE x(y)")),
)
"""Files that are none."""


SIZES = ((100, 6, np.nan), (0, 6, 0.0), (100, 7, 0.0), (4_000_000, 6, 0.0), (2, 20_000_000, 0.0))
PARQUET = (*FILES, *(whole(f"{rows}x{width} of {value}", partial(packed, rows, width, value))
                     for rows, width, value in SIZES))  # fmt: skip
"""Frames of datasets: how many, of how many joints, and where these are."""


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


_MAGIC = b"\x89MCAP0\r\n"
_BEGIN = _MAGIC + _record(1, _text(b"ros2") + _text(b""))


def _chunk(size: int, kind: bytes, content: bytes) -> bytes:
    return _record(6, struct.pack("<QQQI", 1, 2, size, 0) + _text(kind) + struct.pack("<Q", len(content)) + content)


def _mcap(*records: bytes) -> bytes:
    return _BEGIN + b"".join(records) + _record(2, struct.pack("<QQI", 0, 0, 0)) + _MAGIC


def mcap_of_zeros(size: int, *, said: int | None = None) -> bytes:
    """An MCAP with a chunk of so many zeros, packed; said: how many it says that it has, if not as many."""
    from backports import zstd

    return _mcap(_chunk(size if said is None else said, b"zstd", zstd.compress(bytes(size))))


MCAP = (
    *FILES,
    *MESSAGES,
    _sparse(_BEGIN, 8 << 30),
    whole("no-records", lambda: _mcap()),
    whole("other-profile", lambda: _mcap().replace(b"ros2", b"ros9")),
    whole("zstd-of-a-gigabyte", lambda: mcap_of_zeros(1 << 30)),
    whole("zstd-says-less", lambda: mcap_of_zeros(1 << 28, said=100)),
    whole("zstd-broken", lambda: _mcap(_chunk(100, b"zstd", b"\xff" * 100))),
    whole("packed-as-x", lambda: _mcap(_chunk(100, b"x", b"\xff" * 100))),
    whole("chunk-of-2^63", lambda: _mcap(struct.pack("<BQ", 6, 2**63) + bytes(100))),
    whole("message-of-2^63", lambda: _mcap(struct.pack("<BQ", 5, 2**63) + bytes(100))),
    whole("record-255", lambda: _mcap(_record(255, b"x") * 100_000)),
    whole("channels", lambda: _mcap(*(_record(4, struct.pack("<HH", n, 0) + _text(b"/x" * 9) + _text(b"cdr") + bytes(4))
                                      for n in range(60_000)))),
)  # fmt: skip


def _fields(**values: bytes | int | str) -> bytes:
    """The header of a record of ROS 1; whole numbers have four bytes."""
    plain = {name: struct.pack("<I", one) if isinstance(one, int) else one for name, one in values.items()}
    texts = {name: one.encode() if isinstance(one, str) else one for name, one in plain.items()}
    return b"".join(_text(name.encode() + b"=" + one) for name, one in texts.items())


def _ros1(chunk: bytes, packed_as: str, size: int) -> bytes:
    """A bag with one chunk, and an index that says that it has a message of a connection."""
    begin, time = b"#ROSBAG V2.0\n", struct.pack("<II", 1, 0)
    about = _fields(topic=STATES, type="sensor_msgs/JointState", md5sum="0" * 32, message_definition="")
    at = len(begin) + 4096 + 8
    chunks = _text(_fields(op=b"\5", compression=packed_as, size=size)) + _text(chunk)
    index = _text(_fields(op=b"\4", ver=1, conn=0, count=1)) + _text(time + bytes(4))
    connection = _text(_fields(op=b"\7", conn=0, topic=STATES)) + _text(about)
    header = _fields(op=b"\6", ver=1, chunk_pos=struct.pack("<Q", at), start_time=time, end_time=time, count=1)
    info = _text(header) + _text(struct.pack("<II", 0, 1))
    index_at = struct.pack("<Q", at + len(chunks) + len(index))
    header = _fields(op=b"\3", index_pos=index_at, conn_count=1, chunk_count=1)
    return begin + _text(header) + _text(b" " * (4096 - len(header))) + chunks + index + connection + info


ROS1 = (
    *FILES,
    *MESSAGES,
    _sparse(b"#ROSBAG V2.0\n", 8 << 30),
    whole("bz2-of-a-gigabyte", lambda: _ros1(bz2.compress(bytes(1 << 29)), "bz2", 1 << 29)),
    whole("bz2-broken", lambda: _ros1(b"\xff" * 100, "bz2", 100)),
    whole("packed-as-x", lambda: _ros1(b"\xff" * 100, "x", 100)),
    whole("chunk-of-zeros", lambda: _ros1(bytes(100), "none", 100)),
    whole("old", b"#ROSBAG V1.2\n" + bytes(10_000)),
    whole("not-indexed", lambda: _ros1(bytes(100), "none", 100).replace(b"index_pos=", b"index_pox=")),
)


def _database(*statements: str) -> bytes:
    with closing(sqlite3.connect(":memory:")) as database:
        for statement in statements:
            database.execute(statement)
        return database.serialize()


def _sql(name: str, statements: Sequence[str]) -> Bomb:
    """A bomb that is a change of a database."""

    def place(path: Path, _random: Random) -> None:
        kept = path.read_bytes()
        path.unlink()
        path.write_bytes(kept)
        with closing(sqlite3.connect(path)) as database:
            for statement in statements:
                database.execute(statement)
            database.commit()

    return Bomb(f"sql-{name}", place)


SQLITE = (*FILES, *starmap(_sql, TABLE["sql"].items()))
