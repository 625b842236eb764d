"""A recording of somebody's motion: joint positions over time, episode by episode, whatever the file is."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from sqrp_cli.errors import InputError, Place, bad_input, bad_option
from sqrp_cli.files.input_file import missing_file, open_input
from sqrp_cli.recording.bags import open_bag
from sqrp_cli.recording.episode import Episode, Recording
from sqrp_cli.recording.lerobot import open_dataset
from sqrp_cli.recording.texts import open_log, open_program, open_table, open_trajectory
from sqrp_cli.ros.bag import SUFFIXES, is_bag

_TRAJECTORY = re.compile(rb"^[ {]*(joint_names|joint_trajectory|trajectory|points) *:", re.MULTILINE)
_TABLE = re.compile(rb"(?:\s*[#%].*\n)*(?=[^\n]*[A-Za-z_])(?=[^\n]*[,;\t |])[^\n\0]*\n[^\0]*\Z")


class Reader(NamedTuple):
    """Opens recordings of a kind, given path, rate and signal; knows them by a path and the beginning of its file."""

    known_by: str
    knows: Callable[[Path, bytes], object]
    open: Callable[[Path, float | None, str | None], Recording]


READERS = (
    Reader("a dataset of LeRobot, `meta/info.json`", lambda at, _: (at / "meta/info.json").is_file(), open_dataset),
    Reader("a ROS bag", lambda at, _: is_bag(at) or at.suffix in (".db3", *SUFFIXES), open_bag),
    Reader("a program", lambda _, head: b"sqrp_program:" in head, open_program),
    Reader("a log of a run", lambda _, head: b'"sqrp_log"' in head, open_log),
    Reader("YAML with `joint_names` and `points`", lambda _, head: _TRAJECTORY.search(head), open_trajectory),
    Reader("a table below a line of names", lambda _, head: _TABLE.match(head), open_table),
)
"""The readers; the first one that knows a file reads it."""


def open_recording(path: Path, *, signal: str | None = None, rate: float | None = None) -> Recording:
    """The recording at a path; of a folder of files each is an episode with the names of the first, ordered by name.

    signal: which one of several: of a dataset the feature, by default `observation.state`; of a bag the topic, by
    default all with joint states. rate: of the states [Hz], if their times are not to count. Raises InputError for
    what is no recording, and for damaged ones.
    """
    if not path.is_dir() and not path.is_file():
        raise InputError(missing_file(path))
    if (reader := _reader_of(path)) is not None:
        if signal is not None and reader.open not in (open_dataset, open_bag):
            raise bad_option(f"found the signal `{signal}`; expected none of {reader.known_by}", Place(path))
        return reader.open(path, rate, signal)
    files = [one for one in sorted(path.iterdir()) if one.name[0] != "." and _reader_of(one)] if path.is_dir() else []
    suffixes = Counter(one.suffix for one in files).most_common(1)  # a README may look like a table
    files = [one for one in files if (one.suffix, suffixes[0][1]) == suffixes[0]]
    if not files:
        expected = f"expected {', '.join(reader.known_by for reader in READERS)}, or a folder of such"
        raise bad_input("no-recording", f"there is no recording that can be read; {expected}", Place(path))
    first = open_recording(files[0], signal=signal, rate=rate)

    def read(episode: int) -> Episode:
        one = open_recording(files[episode], signal=signal, rate=rate)
        lacking = [name for name in first.names if name not in one.names]
        if lacking or len(one.episodes) > 1:
            what = f"lacks `{lacking[0]}`" if lacking else f"has {len(one.episodes):,} episodes"
            message = f"this {one.kind} {what}; expected one as {files[0].name}"
            raise bad_input("wrong-columns", message, Place(one.path))
        found = one.read(0)
        return replace(found, values=found.values[:, [one.names.index(name) for name in first.names]])

    names = tuple(file.stem for file in files)
    return Recording(path, first.kind, first.names, read, first.units, names)


def _reader_of(path: Path) -> Reader | None:
    head = b""
    if path.is_file():
        with open_input(path, 1 << 50) as file:
            head = file.read(1 << 16)
    return next((reader for reader in READERS if reader.knows(path, head)), None)
