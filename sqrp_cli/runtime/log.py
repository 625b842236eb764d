"""The log of a run, one JSON document per line, and reading it again. It holds no wall time: same run, same bytes."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.source import missing_file
from sqrp_cli.paths_as_text import json_line
from sqrp_cli.runtime.log_events import first_words, wrong_field
from sqrp_cli.runtime.outcome import STATE, Event, RunReport

VERSION = 1
"""Of the log's fields."""

SLACK = 0.01
"""By how much an event may be earlier than the one before it, as the simulation's clock goes in steps [s]."""


class LogWriter:
    """Writes the events of a run as they happen."""

    def __init__(self, path: Path, header: Event) -> None:
        """header: what was run and how."""
        # Line by line, so that nothing is lost where a run is interrupted.
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self(Event(header.t, header.kind, {"sqrp_log": VERSION, **header.fields}))

    def __call__(self, event: Event) -> None:
        """Write an event."""
        line = {"t": event.t, "event": event.kind, **event.fields}
        self._file.write(json_line(line) + "\n")

    def finish(self, report: RunReport) -> None:
        """Write the report as the last line."""
        document = {key: value for key, value in asdict(report).items() if key != "wall"}
        for fault in document["faults"]:
            if fault["camera"] is None:  # as in the logs of earlier versions
                del fault["camera"]
        self(Event(report.time, "report", document))

    def close(self) -> None:
        """Write nothing more."""
        self._file.close()


def read_log(path: Path) -> Iterator[Event]:
    """The events of a log, its header first. Raises InputError, with the line, for what is no log."""
    if not path.is_file():
        raise InputError(missing_file(path))
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        raise _no_log("this is no log of `sqrp run --log`: it is not UTF-8 text", Place(path)) from error
    except OSError as error:
        message = f"this log cannot be read: {error.strerror or error}"
        raise InputError(Problem("unreadable", message, Place(path))) from error
    before, joints = 0.0, -1
    for number, line in enumerate(lines, 1):
        place = Place(path, number)
        event = _event(line, place)
        if number == 1 and event.fields.get("sqrp_log") != VERSION:
            raise _no_log("this is no log of `sqrp run --log`, or one of another version", place)
        first_state = event.kind == STATE and joints < 0
        kind = "run" if number == 1 else "first state" if first_state else event.kind
        if (wrong := wrong_field(kind, event.fields)) is not None:
            raise _no_log(f"this `{event.kind}` is no event of a log: {wrong}", place)
        if first_state:
            joints = len(event.fields["joints"])
        if event.kind == STATE and len(event.fields.get("q", range(joints))) != joints:
            raise _no_log(f"this state has {len(event.fields['q'])} positions `q` of {joints} joints", place)
        if event.t < before - SLACK:
            raise _no_log(f"this event is at {event.t:g} s, before that of the line above", place)
        before = max(before, event.t)
        yield event
    if not lines:
        raise _no_log("this log is empty", Place(path))


def _event(line: str, place: Place) -> Event:
    try:
        document = json.loads(line, parse_float=_finite, parse_constant=_finite)
        event = Event(float(document.pop("t")), str(document.pop("event")), document)
    except (ValueError, KeyError, TypeError, AttributeError):
        raise _no_log("this line is no event of a log", place) from None
    return event


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError
    return number


def _no_log(message: str, place: Place) -> InputError:
    return InputError(Problem("no-log", message, place))


def report_of(path: Path, fields: dict[str, Any]) -> RunReport:
    """The report that the last line of the log at `path` holds. Raises InputError for one that is none."""
    try:
        return TypeAdapter(RunReport).validate_python({**fields, "wall": {}})
    except ValidationError as error:
        raise _no_log(f"the report at the end of this log is none: {first_words(error)}", Place(path)) from None
