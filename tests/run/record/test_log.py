"""Events and the log: an event is its line, and whatever is wrong with a log from outside is said, with its line."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import jsonschema
import pytest
from pydantic import ValidationError

from sqrp_cli.errors import InputError
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.ground_truth import _changes
from sqrp_cli.run.record.events import KINDS, MODELS, VERSION, AskedBox, Event, ProgramStep, ShownAtom, event
from sqrp_cli.run.record.log import LogWriter, Track, read_log
from sqrp_cli.run.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.documents.schemas import schema_of
from sqrp_cli.show.pages.run_page import RunCell, write_run
from sqrp_cli.show.terminal.run_view import print_run

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
BOX = AskedBox(frame="tip", size=[0.1, 0.2, 0.3], pose=IDENTITY)
ATOMS = {
    "held": ShownAtom(value=Truth.UNKNOWN, true=True, predicted=False, asked=True,
                      cameras={"cam1": Truth.TRUE, "cam2": Truth.FALSE}),
    "open": ShownAtom(value=Truth.FALSE, true=None, predicted=True, asked=False, cameras={}),
}  # fmt: skip
WHOLE = {"joints": ["a"], "q": [0.0], "held": None, "objects": {"g": [0.0] * 7, "table": [1.0] * 7}}
REPORT = RunReport(
    outcome="stopped", reason="it was seen", time=0.5, wall={"all": 1.0},
    steps=[StepRecord("pickup", {"object": "g", "speed": 0.1}, "pickup g", 0.0, unseen={"open": None})],
    faults=[FaultRecord("slip", 0.1), FaultRecord("camera-loss", 0.1, camera="cam1")],
    prediction=[{"held": {"cam1": Confusion(1, 2, 3, 4)}}], usual=[{"held": {"cam1": Confusion(3, 2, 0, 1)}}],
    disagreements=[Disagreement(1, 0.1, "held", "cam1", True, "blind", True, 0.5, "lighting")],
)  # fmt: skip
STEPS = [ProgramStep(skill="pickup", parameters={"object": "g", "speed": 0.1}, time=1.5)]
RUN = [
    event("run", 0.0, sqrp_log=VERSION, workspace="cell", digest="d", seed=3, cameras=["cam1"], rates={"cam1": 10.0},
          faults=["slip@a4"], steps=STEPS),
    event("step", 0.0, number=1, skill="pickup", parameters={"object": "g"}, time=1.5,
          boxes={"held": [BOX], "open": []}),
    event("state", 0.0, **WHOLE),
    event("primitive", 0.0, name="a1"),
    event("evidence", 0.1, exposed=0.05, step_time=None, literals=ATOMS),
    event("injected", 0.1, fault="slip@a4"),
    event("happened", 0.11, fault="slip"),
    event("state", 0.12, held=None),
    event("fault", 0.2, name="slip", text="the fault `slip` was seen", response="retry"),
    event("moving on", 0.2, to_see="obj_on_table(g)", cameras=["cam1"], until=0.3),
    event("stopping", 0.3, reason="the fault `slip` was seen"),
    event("contact", 0.35, force=5.2),
    event("retry", 0.4, attempt=1, of=2, step="pickup", time=1.4),
    event("stopped", 0.5, reason="it was seen"),
    event("report", 0.5, report=replace(REPORT, wall={})),
]  # fmt: skip


def test_a_run_with_all_kinds_of_events_is_read_from_its_log_as_it_was_written_at_once(tmp_path: Path) -> None:
    assert {type(one) for one in RUN} == set(MODELS)
    path = tmp_path / "log"
    writer = LogWriter(path, RUN[0])
    for number, one in enumerate(RUN[1:-1], 1):
        writer(one)
        assert len(list(read_log(path))) == number + 1
    writer.close(REPORT)
    assert list(read_log(path)) == RUN
    assert ["camera" in fault for fault in RUN[-1].line()["faults"]] == [False, True]
    assert path.read_text(encoding="utf-8").splitlines() == [json.dumps(one.line()) for one in read_log(path)]


def read(path: Path, log: list[dict[str, Any]]) -> list[Event]:
    path.write_text("".join(json.dumps(line) + "\n" for line in log), encoding="utf-8")
    return list(read_log(path))


def test_a_log_that_knows_of_no_usual_images_has_none(tmp_path: Path) -> None:
    *_, reported = read(tmp_path / "log", [RUN[0].line(), {**RUN[-1].line(), "usual": []}])
    assert reported.report.usual == [{"held": {"cam1": Confusion(tn=2, fn=4)}}]
    with pytest.raises(InputError, match="has other literals under `usual`"):
        read(tmp_path / "log", [RUN[0].line(), {**RUN[-1].line(), "usual": [{"held": {}}]}])


@pytest.mark.parametrize("found", RUN, ids=lambda one: type(one).__name__)
def test_a_line_begins_with_its_time_and_kind_and_no_other_key_fits_its_schema(found: Event) -> None:
    line, schema = found.line(), schema_of("log")
    assert list(line)[:2] == ["t", "event"]
    for entry in schema["$defs"].values():
        entry["additionalProperties"] = False
    jsonschema.validate(line, schema, cls=jsonschema.Draft202012Validator)
    kindless = {key: value for key, value in line.items() if key != "event"}
    for other in ({**line, "another": 1}, {**line, "event": "other"}, kindless):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(other, schema, cls=jsonschema.Draft202012Validator)


def test_an_event_of_a_kind_that_is_not_known_is_passed_over_but_has_its_time(tmp_path: Path) -> None:
    lines = [RUN[0].line(), {"t": 0.1, "event": "later", "x": 1}, event("primitive", 0.2, name="a1").line()]
    assert [found.event for found in read(tmp_path / "log", lines)] == ["run", "primitive"]


@pytest.mark.parametrize(
    ("later", "told"),
    [
        ({}, {}),
        ({"q": [0.1]}, {"q": [0.1]}),
        ({"held": "g"}, {"held": "g"}),
        ({"objects": {"g": [0.5] * 7, "table": [1.0] * 7}}, {"objects": {"g": [0.5] * 7}}),
    ],
)
def test_a_state_tells_what_is_not_as_it_was(later: dict[str, object], told: dict[str, object]) -> None:
    assert _changes({**WHOLE, **later}, WHOLE) == told
    assert event("state", 1.0, **told).line() == {"t": 1.0, "event": "state", **told}


def test_a_state_tells_that_nothing_is_held_any_more_and_no_objects_where_there_are_none() -> None:
    changed = event("state", 0.0, **_changes(WHOLE, {**WHOLE, "held": "g"}))
    assert changed.line() == {"t": 0.0, "event": "state", "held": None}
    assert _changes({**WHOLE, "objects": {}}, None).keys() == {"joints", "q", "held"}


def test_what_is_no_event_cannot_be_published() -> None:
    with pytest.raises(ValidationError, match="finite"):
        event("primitive", float("nan"), name="a1")
    with pytest.raises(TypeError, match="an event `primitive` has no nam"):
        event("primitive", 0.0, name="a1", nam="a")
    with pytest.raises(ValidationError, match="Input should be 'true', 'false' or 'blind'"):
        ShownAtom.model_validate({"value": "perhaps", "asked": True, "cameras": {}})
    assert set(KINDS) >= {found.event for found in RUN}


@pytest.mark.parametrize(("truth", "word"), [(Truth.TRUE, "true"), (Truth.FALSE, "false"), (Truth.UNKNOWN, "blind")])
def test_a_truth_value_has_one_word(truth: Truth, word: Literal["true", "false", "blind"]) -> None:
    assert truth.word == word
    atom = ShownAtom.model_validate({"value": word, "asked": True, "cameras": {"cam1": word}})
    assert (atom.value, atom.cameras) == (truth, {"cam1": truth})
    assert atom.model_dump(exclude_unset=True)["value"] == word


BOXES = {"hold(g)": [{"frame": "tool0", "size": [0.1, 0.1, 0.1], "pose": IDENTITY}]}
SHOWN = {"hold(g)": {"value": "blind", "true": True, "asked": True, "cameras": {"cam1": "false"}}}
SEEN = RunReport(
    "stopped", "the fault was seen", 0.3, [StepRecord("pickup", {"object": "g"}, "pickup g", 0.0)],
    [FaultRecord("slip", 0.1)],
)  # fmt: skip
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
    {"t": 0.3, "event": "report", **asdict(SEEN)},
]  # fmt: skip


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
        (b"#!/usr/bin/env -S sqrp run --sim\nsqrp_program: 1\n", "its first line is no JSON"),
        (b'{\n  "t": 0\n}\n', "its first line is no JSON"),
    ],
)
def test_what_is_no_log_is_refused_in_words_and_it_is_said_how_one_is_made(
    tmp_path: Path, content: bytes, says: str
) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says) as caught:
        list(read_log(path))
    (problem,) = caught.value.problems
    assert (problem.code, problem.mend) == ("no-log", "make one: sqrp run PROGRAM --sim --log FILE")
    assert "no JSON: " not in problem.message


def damaged() -> Iterator[tuple[int, str, list[dict[str, Any]]]]:
    """The log with one field left out or of another kind, its line and the field."""
    for number, line in enumerate(LOG):
        for field in set(line) - {"event", "number", "sqrp_log"}:
            for value in (None, -3, "x", [], ["x"], {}, {"x": 1}):
                if value != line[field] and not (value is None and field in {"held", "reason"}):
                    yield number + 1, field, [*LOG[:number], {**line, field: value}, *LOG[number + 1 :]]


def test_what_is_read_from_a_damaged_log_can_be_shown_and_all_else_is_told_with_its_line(tmp_path: Path) -> None:
    path, page = tmp_path / "log", tmp_path / "page.html"
    assert read(path, LOG)[-1].report == SEEN
    refused, shown = set(), set()
    for number, field, log in damaged():
        try:
            header, *events, last = read(path, log)
        except InputError as error:
            (problem,) = error.problems
            assert problem.place is not None
            # That of the report is that of the whole log.
            assert problem.place.line in ({number} if number < len(LOG) else {number, None})
            refused.add((number, field))
            continue
        Track.of(events)
        print_run(replace(last.report, workspace="cell"))
        if (number, field) not in shown:  # a page takes its time
            shown.add((number, field))
            write_run(RunCell(header.workspace, header.cameras, header.digest, None), last.report, events, page, [])
    # Nothing is kept of how long it took.
    assert {(number, field) for number, field, _ in damaged()} - refused == {(len(LOG), "wall")}


@pytest.mark.parametrize(
    ("number", "change", "says"),
    [
        (2, {"boxes": {"hold(g)": [{"frame": "f", "size": [1.0, 1.0], "pose": IDENTITY}]}}, r"\[0\].size"),
        (1, {"rates": {"slow": 0.0}}, "`rates.slow`: input should be greater than 0"),
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
