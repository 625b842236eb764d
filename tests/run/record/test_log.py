"""Logs from outside: whatever is wrong with one is said, with its line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.run.record.events import VERSION, PrimitiveBegan, RunBegan, RunReported
from sqrp_cli.run.record.log import LogWriter, Track, read_log
from sqrp_cli.run.record.report import FaultRecord, RunReport, StepRecord
from sqrp_cli.show.pages.run_page import RunCell, write_run
from sqrp_cli.show.terminal.run_view import print_run

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
BOXES = {"hold(g)": [{"frame": "tool0", "size": [0.1, 0.1, 0.1], "pose": IDENTITY}]}
SHOWN = {"hold(g)": {"value": "blind", "true": True, "asked": True, "cameras": {"cam1": "false"}}}
BEGAN = RunBegan(t=0.0, sqrp_log=VERSION, workspace="cell", digest="d", cameras=["cam1"])
REPORT = RunReport(
    outcome="stopped",
    reason="the fault was seen",
    time=0.3,
    steps=[StepRecord("pickup", {"object": "g"}, "pickup g", 0.0)],
    faults=[FaultRecord("slip", 0.1)],
)
LOG: list[dict[str, Any]] = [
    {"t": 0.0, "event": "run", "sqrp_log": 1, "workspace": "cell", "digest": "d", "cameras": ["cam1"],
     "rates": {"cam1": 10.0}},
    {"t": 0.0, "event": "step", "number": 1, "boxes": BOXES},
    {"t": 0.0, "event": "state", "joints": ["a", "b"], "q": [0.0, 1.0], "held": None, "objects": {"g": [0.0] * 7}},
    {"t": 0.05, "event": "primitive", "name": "a1"},
    {"t": 0.1, "event": "evidence", "exposed": 0.0, "literals": SHOWN},
    {"t": 0.1, "event": "injected", "fault": "slip@0.1"},
    {"t": 0.12, "event": "state", "q": [0.5, 1.0], "objects": {"g": [0.0] * 7}},
    {"t": 0.2, "event": "retry", "attempt": 1, "of": 2},
    {"t": 0.3, "event": "report", **asdict(REPORT)},
]  # fmt: skip


def read(path: Path, log: list[dict[str, Any]]) -> RunReport:
    """The report of a log with these lines."""
    path.write_text("".join(json.dumps(line) + "\n" for line in log))
    return report_in(path)


def report_in(path: Path) -> RunReport:
    *_, last = read_log(path)
    assert isinstance(last, RunReported)
    return last.report


def damaged() -> Iterator[tuple[int, str, list[dict[str, Any]]]]:
    """The log with one field left out or of another kind, its line and the field."""
    for number, line in enumerate(LOG):
        for field in set(line) - {"event", "number", "sqrp_log"}:
            for value in (None, -3, "x", [], ["x"], {}, {"x": 1}):
                if value != line[field] and not (value is None and field in {"held", "reason"}):
                    yield number + 1, field, [*LOG[:number], {**line, field: value}, *LOG[number + 1 :]]


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe\x00", "no log of `sqrp run --log`: it is not UTF-8 text"),
        (b"", "this log is empty"),
        (b"[1]\n", "this line is no event"),
        (b'{"t": 1e300, "event": "run"}\n', "`t` is `1e[+]?300`, expected a number of seconds"),
        (b'{"t": 0, "event": "start"}\n', "or one of another version"),
        (
            b'{"t": 0, "event": "state", "sqrp_log": 1, "workspace": "w", "digest": "", "cameras": []}\n',
            "this is no log",
        ),
    ],
)
def test_what_is_no_log_is_refused_in_words(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_log(path))


@pytest.mark.parametrize(
    "content", ["#!/usr/bin/env -S sqrp run --sim\nsqrp_program: 1\n", '{\n  "t": 0\n}\n', "[1]\n"]
)
def test_a_file_of_another_kind_is_no_log_and_it_is_said_how_one_is_made(tmp_path: Path, content: str) -> None:
    path = tmp_path / "visit.yaml"
    path.write_text(content)
    with pytest.raises(InputError) as caught:
        list(read_log(path))
    (problem,) = caught.value.problems
    assert "no JSON: " not in problem.message
    assert problem.code == "no-log"
    assert problem.mend == "make one: sqrp run PROGRAM --sim --log FILE"


def test_what_has_happened_is_in_the_file_at_once(tmp_path: Path) -> None:
    path = tmp_path / "log"
    writer = LogWriter(path, BEGAN)
    writer(PrimitiveBegan(t=0.25, name="a1"))
    assert [event.event for event in read_log(path)] == ["run", "primitive"]
    writer.finish(REPORT)
    writer.close()
    assert report_in(path) == REPORT


def test_what_is_read_from_a_damaged_log_can_be_shown_and_all_else_is_told_with_its_line(tmp_path: Path) -> None:
    path, page = tmp_path / "log", tmp_path / "page.html"
    assert read(path, LOG) == REPORT
    refused = set()
    for number, field, log in damaged():
        try:
            report = read(path, log)
        except InputError as error:
            (problem,) = error.problems
            assert problem.place is not None
            # That of the report is that of the whole log.
            assert problem.place.line in ({number} if number < len(LOG) else {number, None})
            refused.add((number, field))
            continue
        header, *events, _ = read_log(path)
        Track.of(events)
        assert isinstance(header, RunBegan)
        cell = RunCell(header.workspace, header.cameras, header.digest, None)
        write_run(cell, report, events, page, [])
        print_run(replace(report, workspace="cell"))
    # Nothing is kept of how long it took.
    assert {(number, field) for number, field, _ in damaged()} - refused == {(len(LOG), "wall")}


@pytest.mark.parametrize(
    ("number", "change", "says"),
    [
        (2, {"boxes": {"hold(g)": [{"frame": "f", "size": [1.0, 1.0], "pose": IDENTITY}]}}, r"\[0\].size"),
        (3, {"q": [0.0]}, "1 positions `q` of 2 joints"),
        (5, {"literals": {"hold(g)": {"value": "perhaps", "asked": True, "cameras": {}}}}, "literals.*value"),
        (7, {"q": [0.0, 1.0, 2.0]}, "3 positions `q` of 2 joints"),
        (7, {"objects": {"g": [0.0] * 6}}, "objects.g"),
        (5, {"exposed": float("nan")}, "`exposed`: found `NaN`, expected a finite number"),
        (8, {"t": 0.05}, "before that of the line above"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_an_event_is_said(tmp_path: Path, number: int, change: dict[str, Any], says: str) -> None:
    log = [*LOG[: number - 1], {**LOG[number - 1], **change}, *LOG[number:]]
    with pytest.raises(InputError, match=says) as caught:
        read(tmp_path / "log", log)
    (problem,) = caught.value.problems
    assert problem.place is not None
    assert problem.place.line == number


def test_a_log_tells_the_camera_of_a_fault_where_it_has_one(tmp_path: Path) -> None:
    path = tmp_path / "log"
    writer = LogWriter(path, BEGAN)
    faults = [FaultRecord("slip", 0.1), FaultRecord("camera-loss", 0.1, camera="cam1")]
    writer.finish(RunReport(time=0.3, faults=faults))
    writer.close()
    last = json.loads(path.read_text(encoding="utf-8").splitlines()[-1])
    assert ["camera" in fault for fault in last["faults"]] == [False, True]
    assert report_in(path).faults == faults
