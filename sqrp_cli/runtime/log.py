"""The log of a run, one JSON document per line, and reading it again. It holds no wall time: same run, same bytes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.files import naming
from sqrp_cli.knowledge.input_file import open_input
from sqrp_cli.knowledge.json_file import parse_json
from sqrp_cli.knowledge.source import describe
from sqrp_cli.runtime.log_events import first_words, wrong_field
from sqrp_cli.runtime.outcome import STATE, Event, RunReport

VERSION = 1
"""Of the log's fields."""

MAX_BYTES = 200_000_000
"""Largest log that is read; with six cameras a second of a run takes some 7 kB, so this is eight hours."""

MAX_LINE, MAX_LINES = 10_000_000, 1_000_000
"""Most bytes of a line of a log that is read, and most lines."""

SLACK = 0.01
"""By how much an event may be earlier than the one before it, as the simulation's clock goes in steps [s]."""


class LogWriter:
    """Writes the events of a run as they happen."""

    def __init__(self, path: Path, header: Event) -> None:
        """header: what was run and how."""
        self._path = path
        with naming(path):  # line by line, so that nothing is lost where a run is interrupted
            self._file = path.open("w", encoding="utf-8", buffering=1)
        self(Event(header.t, header.kind, {"sqrp_log": VERSION, **header.fields}))

    def __call__(self, event: Event) -> None:
        """Write an event. Raises InputError where that is not possible."""
        line = {"t": event.t, "event": event.kind, **event.fields}
        with naming(self._path):
            self._file.write(json.dumps(line, allow_nan=False) + "\n")

    def finish(self, report: RunReport) -> None:
        """Write the report as the last line."""
        document = {key: value for key, value in asdict(report).items() if key != "wall"}
        for fault in document["faults"]:
            if fault["camera"] is None:  # as in the logs of earlier versions
                del fault["camera"]
        self(Event(report.time, "report", document))

    def close(self) -> None:
        """Write nothing more."""
        with naming(self._path):
            self._file.close()


def read_log(path: Path) -> Iterator[Event]:
    """The events of a log, its header first. Raises InputError, with the line, for what is no log."""
    before, joints, number = 0.0, -1, 0
    for number, line in _lines(path):
        place = Place(path, number)
        event = _event(line, place)
        if number == 1 and (event.kind, event.fields.get("sqrp_log")) != ("run", VERSION):
            raise _no_log("this is no log of `sqrp run --log`, or one of another version", place)
        first_state = event.kind == STATE and joints < 0
        kind = "run" if number == 1 else "first state" if first_state else event.kind
        if (wrong := wrong_field(kind, event.fields)) is not None:
            raise _no_log(f"this `{event.kind}` is no event of a log: {wrong}", place)
        if event.kind == "report":
            report_of(path, dict(event.fields), number)
        if first_state:
            joints = len(event.fields["joints"])
        if event.kind == STATE and len(event.fields.get("q", range(joints))) != joints:
            raise _no_log(f"this state has {len(event.fields['q'])} positions `q` of {joints} joints", place)
        if event.t < before - SLACK:
            raise _no_log(f"this event is at {event.t:g} s, before that of the line above", place)
        before = max(before, event.t)
        yield event
    if number == 0:
        raise _no_log("this log is empty", Place(path))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a log, from 1, one at a time."""
    with open_input(path, MAX_BYTES) as file:
        for number, line in enumerate(iter(partial(file.readline, MAX_LINE + 1), b""), 1):
            if len(line) > MAX_LINE or number > MAX_LINES:
                message = f"this log is too large: the limit is {MAX_LINES:,} lines of {MAX_LINE:,} bytes"
                raise InputError(Problem("file-too-large", message, Place(path, number)))
            try:
                yield number, line.decode("utf-8")
            except UnicodeDecodeError as error:
                message = "this is no log of `sqrp run --log`: it is not UTF-8 text"
                raise _no_log(message, Place(path, number)) from error


def _event(line: str, place: Place) -> Event:
    document = parse_json(place.file, line, place.line or 1)
    if not isinstance(document, dict):
        raise _no_log(f"this line is no event of a log: found {describe(document)}, expected a mapping", place)
    t, kind = document.pop("t", None), document.pop("event", None)
    if isinstance(t, bool) or not isinstance(t, int | float):
        raise _no_log(f"this line is no event of a log: `t` is {describe(t)}, expected a number of seconds", place)
    if not isinstance(kind, str):
        raise _no_log(f"this line is no event of a log: `event` is {describe(kind)}, expected its kind", place)
    return Event(float(t), kind, document)


def _no_log(message: str, place: Place) -> InputError:
    return InputError(Problem("no-log", message, place))


def report_of(path: Path, fields: dict[str, Any], line: int | None = None) -> RunReport:
    """The report that the last line of the log at `path` holds. Raises InputError for one that is none."""
    try:
        return TypeAdapter(RunReport).validate_python({**fields, "wall": {}})
    except ValidationError as error:
        raise _no_log(f"the report at the end of this log is none: {first_words(error)}", Place(path, line)) from None
