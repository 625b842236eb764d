"""The log of a run, one JSON document per line, and reading it again. It holds no wall time: same run, same bytes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.knowledge.text.input_file import open_input
from sqrp_cli.knowledge.text.json_file import json_name, parse_json
from sqrp_cli.knowledge.text.source import describe
from sqrp_cli.knowledge.text.units import LARGEST
from sqrp_cli.platform.files import naming
from sqrp_cli.runtime.record.events import KINDS, VERSION, Event, RunBegan, RunReported, State, StateChanged, WholeState
from sqrp_cli.runtime.record.report import Confusion, Prediction, RunReport

MAX_BYTES = 200_000_000
"""Largest log that is read; with six cameras a second of a run takes some 7 kB, so this is eight hours."""

MAX_LINE, MAX_LINES = 10_000_000, 1_000_000
"""Most bytes of a line of a log that is read, and most lines."""

SLACK = 0.01
"""Largest step back between events [s], since the simulation's clock is discrete."""


class LogWriter:
    """Writes the events of a run as they happen."""

    def __init__(self, path: Path, header: RunBegan) -> None:
        """header: what was run and how."""
        self._path = path
        with naming(path):  # line by line, so that nothing is lost where a run is interrupted
            self._file = path.open("w", encoding="utf-8", buffering=1)
        self(header)

    def __call__(self, event: Event) -> None:
        """Write an event. Raises InputError where that is not possible."""
        with naming(self._path):
            self._file.write(json.dumps(event.line(), allow_nan=False) + "\n")

    def finish(self, report: RunReport) -> None:
        """Write the report as the last line."""
        self(RunReported(t=report.time, report=report))

    def close(self) -> None:
        """Write nothing more."""
        with naming(self._path):
            self._file.close()


def read_log(path: Path) -> Iterator[Event]:
    """The events of known kinds in a log, its header first.

    Raises InputError, with the line, for anything but a log.
    """
    before, joints, number = 0.0, None, 0
    for number, text in _lines(path):
        place = Place(path, number)
        try:
            line = _line(text, place)
        except InputError as error:
            if number > 1 and not text.endswith("\n") and error.problems[0].code == "json-syntax":
                return  # cut off as it was written
            raise
        if number == 1 and (line.kind, line.fields.get("sqrp_log")) != ("run", VERSION):
            raise _no_log("this is no log of `sqrp run --log`, or one of another version", place)
        event = _event(line, place, first_state=joints is None)
        if isinstance(event, WholeState):
            joints = len(event.joints)
        if isinstance(event, State) and event.has("q") and len(event.q) != joints:
            raise _no_log(f"this state has {len(event.q)} positions `q` of {joints} joints", place)
        if line.t < before - SLACK:
            raise _no_log(f"this event is at {line.t:g} s, before that of the line above", place)
        before = max(before, line.t)
        if event is not None:
            yield event
    if number == 0:
        raise _no_log("this log is empty", Place(path))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a log, from 1, one at a time."""
    with open_input(path, MAX_BYTES) as file:
        for number, line in enumerate(iter(partial(file.readline, MAX_LINE + 1), b""), 1):
            if len(line) > MAX_LINE or number > MAX_LINES:
                message = f"this log is too large: the limit is {MAX_LINES:,} lines of {MAX_LINE:,} bytes"
                raise bad_input("file-too-large", message, Place(path, number))
            try:
                yield number, line.decode("utf-8")
            except UnicodeDecodeError as error:
                message = "this is no log of `sqrp run --log`: it is not UTF-8 text"
                raise _no_log(message, Place(path, number)) from error


@dataclass(frozen=True)
class _Line:
    """A line of a log."""

    t: float
    kind: str
    fields: Mapping[str, object]
    """With its time [s] and kind."""


def _line(text: str, place: Place) -> _Line:
    try:
        document = parse_json(place.file, text, place.line or 1)
    except InputError as error:
        if place.line != 1:
            raise
        raise _no_log("this is no log of `sqrp run --log`: its first line is no JSON", place) from error
    if not isinstance(document, dict):
        raise _no_log(f"this line is no event of a log: found {describe(document)}, expected a mapping", place)
    t, kind = document.get("t"), document.get("event")
    if isinstance(t, bool) or not isinstance(t, int | float) or abs(t) > LARGEST:
        raise _no_log(f"this line is no event of a log: `t` is {describe(t)}, expected a number of seconds", place)
    if not isinstance(kind, str):
        raise _no_log(f"this line is no event of a log: `event` is {describe(kind)}, expected its kind", place)
    return _Line(float(t), kind, document)


def _event(line: _Line, place: Place, *, first_state: bool) -> Event | None:
    """The event of a line, None for an unknown kind; first_state: whether no state came before."""
    model = KINDS.get(line.kind)
    if model is None:
        return None
    if model is RunReported:
        return RunReported(t=line.t, report=_report(line, place))
    if model is StateChanged and first_state:
        model = WholeState
    try:
        return model.model_validate(line.fields)
    except ValidationError as error:
        raise _no_log(f"this `{line.kind}` is no event of a log: {_first_words(error)}", place) from None


def _report(line: _Line, place: Place) -> RunReport:
    try:
        report = TypeAdapter(RunReport).validate_python({**line.fields, "wall": {}})
    except ValidationError as error:
        raise _no_log(f"the report at the end of this log is none: {_first_words(error)}", place) from None
    if report.prediction and not report.usual:  # of an earlier version, which knew of no usual images
        report.usual = [
            {atom: {name: Confusion(tn=one.tn, fn=one.fn) for name, one in of.items()} for atom, of in step.items()}
            for step in report.prediction
        ]
    if _asked(report.usual) != _asked(report.prediction):
        raise _no_log(
            "the report at the end of this log has other literals under `usual` than under `prediction`", place
        )
    return report


def _asked(predictions: Sequence[Prediction]) -> list[list[tuple[str, str]]]:
    """The atoms and cameras of each step."""
    return [[(atom, name) for atom, cameras in step.items() for name in cameras] for step in predictions]


def _first_words(error: ValidationError) -> str:
    """The first that is wrong, with the field."""
    first = error.errors()[0]
    place, message = json_name(first["loc"]), first["msg"]
    return f"`{place}`: {message[0].lower()}{message[1:]}"


def _no_log(message: str, place: Place) -> InputError:
    return bad_input("no-log", message, place, mend="make one: sqrp run PROGRAM --sim --log FILE")
