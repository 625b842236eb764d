"""Recordings: rosbag2 (a folder, `.mcap` or `.db3`) and ROS 1 (`.bag`), read and written message by message."""

from __future__ import annotations

import os
import shlex
import shutil
import tempfile
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from sqrp_cli.errors import InputError, Place, bad_input, needed
from sqrp_cli.platform.files import naming
from sqrp_cli.ros.messages import Message, MessageError, Ros, message_types, nanoseconds

METADATA = "metadata.yaml"  # The file of a rosbag2 folder that tells what is in it
_MCAP = b"\x89MCAP0\r\n"  # How files of MCAP begin and end
_ROS1, _ROS2 = b"#ROSBAG V", (_MCAP[:5], b"SQLite format 3\0")
"""How recordings begin."""
SUFFIXES = (".mcap", ".bag")  # Of the files that `BagWriter` writes: MCAP as ROS 2 does, and bags of ROS 1
_INSTALL = "pip install 'sqrp[bags]'"
_KINDS = {".mcap": "MCAP file", ".bag": "bag of ROS 1", ".db3": "file of rosbag2 (SQLite)"}
"""What a file is by the end of its name."""
_LARGEST_CHUNK, _LARGEST_METADATA = 1 << 28, 1_000_000
"""Bytes that a chunk of a recording may have unpacked (recorders make them of a megabyte); characters of metadata."""
_DEEPEST_METADATA = 100  # Mappings and lists of metadata that may be within one another


def is_bag(path: Path) -> bool:
    """Whether a path is a recording, or the metadata of one."""
    if not path.is_file():
        return (path / METADATA).is_file()
    with naming(path, "this file cannot be read"), path.open("rb") as file:
        head = file.read(1000)
    return head.startswith((_ROS1, *_ROS2)) or (path.name == METADATA and b"rosbag2_bagfile_information" in head)


def check_kind(path: Path) -> None:
    """Raises InputError for what is named as a recording and is none, and for pipes and devices, also in its folder."""
    for part in (path, *(path.iterdir() if path.is_dir() else ())):
        if part.exists() and not part.is_file() and not part.is_dir():
            raise bad_input("unreadable-file", f"{part.name} is neither a file nor a folder", Place(path))
    kind = _KINDS.get(path.suffix.lower())
    if path.is_file() and kind is not None and not is_bag(path):
        what = "it is empty" if not path.stat().st_size else "it begins otherwise"
        message = f"this is no {kind}: {what}; expected a recording that was closed and is whole"
        raise bad_input("unreadable-file", message, Place(path))
    if path.is_dir() and not is_bag(path) and (parts := sorted([*path.glob("*.mcap"), *path.glob("*.db3")])):
        message = f"this folder has {parts[0].name}, but no {METADATA}: its recorder was not ended as it should be"
        raise bad_input("unreadable-file", message, Place(path), mend=f"ros2 bag reindex {shlex.quote(str(path))}")


class RecordedTopic(NamedTuple):
    """A topic of a recording: its type, such as `sensor_msgs/msg/Image`, and how many messages are on it."""

    name: str
    type: str
    messages: int


class Packed(NamedTuple):
    """A message of a recording, as it was received; t: when [ns]."""

    topic: str
    type: str
    t: int
    data: bytes


class Bag(AbstractContextManager["Bag"]):
    """A recording that is open for reading; a context manager. Messages are read one by one, as often as asked for."""

    def __init__(self, path: Path) -> None:
        """Raises InputError for what is no recording, or one that cannot be read."""
        with needed("reading a recording needs the package rosbags", _INSTALL, Place(path)):
            from rosbags import rosbag1, rosbag2
        self.path = path
        _limit()
        head = b""
        if path.is_file():
            with naming(path, "this file cannot be read"), path.open("rb") as file:
                head = file.read(20)
        self.ros: Ros = 1 if head.startswith(_ROS1) else 2
        self.types = message_types(self.ros)
        at = path.parent if path.name == METADATA else path
        for start, suffix in zip(_ROS2, (".mcap", ".db3"), strict=True):
            if head.startswith(start) and at.suffix != suffix:
                message = f"this is a {_KINDS[suffix]}, whose name has to end in {suffix}"
                mend = shlex.join(["mv", str(at), str(at.with_suffix(suffix))])
                raise bad_input("unreadable-file", message, Place(at), mend=mend)
        with self._reading():
            self._reader: Any = rosbag1.Reader(at) if self.ros == 1 else rosbag2.Reader(at)
            self._reader.open()

    @property
    def topics(self) -> tuple[RecordedTopic, ...]:
        """All topics, by name."""
        found = (RecordedTopic(one.topic, one.msgtype, one.msgcount) for one in self._reader.connections)
        return tuple(sorted(found))

    def messages(self, topics: Collection[str], types: Collection[str] = ()) -> Iterator[Packed]:
        """The messages on some topics, in the order in which they were received; types: only of these, if any is given.

        Raises InputError for damage.
        """
        wanted = [
            one for one in self._reader.connections if one.topic in topics and (not types or one.msgtype in types)
        ]
        if not wanted:  # no connection would mean all of them
            return
        with self._reading():
            for connection, t, data in self._reader.messages(wanted):
                yield Packed(connection.topic, connection.msgtype, t, data)

    def stamped(
        self, topics: Collection[str], types: Collection[str], most: int, what: str
    ) -> Iterator[tuple[Packed, Message, int]]:
        """Messages with what they say and their stamp [ns], 0 of one without; what: how the error calls them.

        Raises InputError for damage, and for more messages than `most`.
        """
        for number, packed in enumerate(self.messages(topics, types)):
            if number >= most:
                message = f"this recording has more than {most:,} {what}; cut it to the motion that matters"
                raise bad_input("file-too-large", message, Place(self.path))
            read = self.read(packed)
            yield packed, read, nanoseconds(read.header.stamp) if hasattr(read, "header") else 0

    def read(self, packed: Packed) -> Message:
        """What a message says. Raises InputError for one that is not of its type."""
        try:
            return self.types.decode(packed.type, packed.data)
        except (MessageError, KeyError) as error:
            message = f"a message on `{packed.topic}` is no {packed.type}"
            raise bad_input("unreadable-file", message, Place(self.path)) from error

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        with suppress(Exception):  # of a damaged file, which was told already
            self._reader.close()

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Turns what libraries say of a damaged recording into an InputError."""
        try:
            yield
        except (InputError, GeneratorExit):
            raise
        except Exception as error:  # every library below has its own
            told = str(error).splitlines()[0].rstrip(".") if str(error) else type(error).__name__
            if isinstance(error, MemoryError):
                told = "a part of it is, as it says, larger than the memory"
            message = f"this recording cannot be read: {told}; expected one that was closed and is whole"
            mend, path = None, self.path  # the command that saves what is there of one that was not closed
            if path.suffix == ".bag":
                mend = shlex.join(["rosbag", "reindex", str(path)])
            elif path.suffix == ".mcap" and path.is_file():
                with path.open("rb") as file:
                    start = file.read(17)  # the last 8 bytes are the length of the header
                    size = file.seek(0, os.SEEK_END)
                    file.seek(max(size - 37, 0))
                    footer = file.read()
                has_index = footer[:1] == b"\x02" and footer.endswith(_MCAP) and any(footer[9:17])
                has_more = start.startswith(_MCAP) and 17 + int.from_bytes(start[9:], "little") < size
                if has_more and not has_index:
                    saved = str(path.with_stem(f"{path.stem}-recovered"))
                    mend = shlex.join(["mcap", "recover", str(path), "-o", saved])
            raise bad_input("unreadable-file", message, Place(path), mend=mend) from error


@cache
def _limit() -> None:
    """Let rosbags unpack no chunk that is larger than it may be: a few bytes can be packed gigabytes.

    It reads YAML by libyaml, too: its own reader takes 30 s for a megabyte.
    """
    from bz2 import BZ2Decompressor

    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import metadata, storage_mcap
    from rosbags.rosbag2 import reader as folder_reader

    quick = type("Quick", (vars(metadata)["YAML"],), {"load": lambda _, text: _metadata(text)})
    for module in (metadata, folder_reader):
        setattr(module, "YAML", quick)  # noqa: B010 # it is no public name
    mcap: Any = storage_mcap  # it has the zstd that this Python has
    lz4 = partial(_unpacked, LZ4FrameDecompressor)
    reader.decompressors |= {"bz2": partial(_unpacked, BZ2Decompressor), "lz4": lz4}
    mcap.DECOMPRESSORS |= {"zstd": partial(_unpacked, mcap.zstd.ZstdDecompressor), "lz4": lz4}


def _unpacked(decompressor: Callable[[], Any], packed: bytes, _size: int = 0) -> bytes:
    machine = decompressor()
    found: bytes = machine.decompress(packed, _LARGEST_CHUNK)
    if not machine.eof:
        raise ValueError(f"a chunk is cut off, or has more than {_LARGEST_CHUNK >> 20} MB")
    return found


def _metadata(text: str) -> object:
    """What a metadata.yaml says, or a part of it that is YAML in its turn. Raises ValueError."""
    if len(text) > _LARGEST_METADATA:
        raise ValueError(f"{METADATA} has more than {_LARGEST_METADATA:,} characters")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        depth = 0
        for event in yaml.parse(text, loader):  # as composing recurses in C, without a limit of its own
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            if depth > _DEEPEST_METADATA:
                raise ValueError(f"{METADATA} is nested more than {_DEEPEST_METADATA} deep")
        return yaml.load(text, loader)  # noqa: S506 # both are safe
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise ValueError(f"{METADATA}{line}: {error.problem}") from error


class BagWriter:
    """Writes a recording, `.mcap` or `.bag`; it appears under its name when it is closed, as a whole or not at all."""

    def __init__(self, path: Path) -> None:
        """Raises InputError without `rosbags`, and where nothing can be written."""
        with needed("writing a recording needs the package rosbags", _INSTALL, Place(path)):
            from rosbags import rosbag1, rosbag2
        self._path, self._of_topic = path, dict[str, Any]()
        ros: Ros = 1 if path.suffix.lower() == ".bag" else 2
        self.types = message_types(ros)
        self._writer: Any
        with naming(path):
            self._folder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
            if ros == 1:
                self._file = self._folder / f"{path.stem}.bag"
                self._writer = rosbag1.Writer(self._file)
            else:
                inside, mcap = self._folder / path.stem, rosbag2.StoragePlugin.MCAP
                self._file = inside / f"{path.stem}.mcap"
                self._writer = rosbag2.Writer(inside, version=8, storage_plugin=mcap)
            self._writer.open()

    def add(self, topic: str, t: int, message: Message, *, latched: bool = False) -> None:
        """Append a message that was received at `t` [ns]; latched: for those who listen later, too."""
        from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

        with naming(self._path):
            if topic not in self._of_topic:
                options: Mapping[str, object] = {"latching": 1} if latched else {}
                if self.types.ros == 2:
                    qos = Qos(
                        history=QosHistory.KEEP_LAST,
                        depth=1 if latched else 10,
                        reliability=QosReliability.RELIABLE,
                        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
                        deadline=(forever := QosTime(0, 0)),
                        lifespan=forever,
                        liveliness=QosLiveliness.AUTOMATIC,
                        liveliness_lease_duration=forever,
                        avoid_ros_namespace_conventions=False,
                    )
                    options = {"offered_qos_profiles": [qos]}
                kind, store = message.__msgtype__, self.types.store
                self._of_topic[topic] = self._writer.add_connection(topic, kind, typestore=store, **options)
            self._writer.write(self._of_topic[topic], t, self.types.encode(message))

    def close(self) -> None:
        """Finish the recording and give it its name. Raises InputError where that fails."""
        try:
            with naming(self._path):
                self._writer.close()
                self._file.replace(self._path)
        finally:
            self.discard()

    def discard(self) -> None:
        """Leave nothing behind."""
        with suppress(Exception):  # it is closed already
            self._writer.abort()
        shutil.rmtree(self._folder, ignore_errors=True)


@contextmanager
def written(path: Path) -> Iterator[BagWriter]:
    """A recording to write, which appears under its name if all goes well."""
    with ExitStack() as failing:
        writer = BagWriter(path)
        failing.callback(writer.discard)
        yield writer
        writer.close()
