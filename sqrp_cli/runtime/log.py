"""The log of a run, one JSON document per line, and reading it again. It holds no wall time: same run, same bytes."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.source import missing_file
from sqrp_cli.runtime.outcome import (
    Confusion,
    Disagreement,
    Event,
    FaultRecord,
    RunReport,
    StepRecord,
)

VERSION = 1
"""Of the log's fields."""


class LogWriter:
    """Writes the events of a run as they happen."""

    def __init__(self, path: Path, header: Event) -> None:
        """header: what was run and how."""
        self._file = path.open("w", encoding="utf-8")
        self(Event(header.t, header.kind, {"sqrp_log": VERSION, **header.fields}))

    def __call__(self, event: Event) -> None:
        """Write an event."""
        line = {"t": event.t, "event": event.kind, **event.fields}
        self._file.write(json.dumps(line, ensure_ascii=False, allow_nan=False) + "\n")

    def close(self, report: RunReport) -> None:
        """Write the report as the last line."""
        document = {key: value for key, value in asdict(report).items() if key != "wall"}
        self(Event(report.time, "report", document))
        self._file.close()


def read_log(path: Path) -> Iterator[Event]:
    """The events of a log, its header first. Raises InputError, with the line, for what is no log."""
    if not path.is_file():
        raise InputError(missing_file(path))
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except UnicodeDecodeError as error:
        message = "this is no log of `sqrp run --log`: it is not UTF-8 text"
        raise InputError(Problem("no-log", message, Place(path))) from error
    except OSError as error:
        message = f"this log cannot be read: {error.strerror or error}"
        raise InputError(Problem("unreadable", message, Place(path))) from error
    for number, line in enumerate(lines, 1):
        try:
            document = json.loads(line)
            event = Event(float(document.pop("t")), str(document.pop("event")), document)
        except (ValueError, KeyError, TypeError, AttributeError):
            raise InputError(Problem("no-log", "this line is no event of a log", Place(path, number))) from None
        if number == 1 and event.fields.get("sqrp_log") != VERSION:
            message = "this is no log of `sqrp run --log`, or one of another version"
            raise InputError(Problem("no-log", message, Place(path, 1)))
        yield event
    if not lines:
        raise InputError(Problem("no-log", "this log is empty", Place(path)))


def report_of(path: Path, fields: dict[str, Any]) -> RunReport:
    """The report that the last line of the log at `path` holds. Raises InputError for one that is none."""
    nested = {"steps", "faults", "prediction", "disagreements"}
    try:
        return RunReport(
            **{key: value for key, value in fields.items() if key not in nested},
            steps=[StepRecord(**step) for step in fields["steps"]],
            faults=[FaultRecord(**fault) for fault in fields["faults"]],
            prediction=[
                {atom: {name: Confusion(**found) for name, found in cameras.items()} for atom, cameras in step.items()}
                for step in fields["prediction"]
            ],
            disagreements=[Disagreement(**entry) for entry in fields["disagreements"]],
        )
    except (KeyError, TypeError, AttributeError):
        raise InputError(Problem("no-log", "the report at the end of this log is none", Place(path))) from None
