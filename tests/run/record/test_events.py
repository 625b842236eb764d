"""Events as records and as lines of the log: one is the other."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import jsonschema
import pytest
from pydantic import ValidationError

from sqrp_cli.errors import InputError
from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.record import events
from sqrp_cli.run.record.events import Event, PrimitiveBegan, RunBegan, RunReported, ShownAtom, WholeState
from sqrp_cli.run.record.log import LogWriter, read_log
from sqrp_cli.run.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.documents.schemas import schema_of

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
BOX = events.AskedBox(frame="tip", size=[0.1, 0.2, 0.3], pose=IDENTITY)
VOTES = {"cam1": Truth.TRUE, "cam2": Truth.FALSE}
ATOMS = {
    "held": ShownAtom(value=Truth.UNKNOWN, true=True, predicted=False, asked=True, cameras=VOTES),
    "open": ShownAtom(value=Truth.FALSE, true=None, predicted=True, asked=False, cameras={}),
}
WHOLE = WholeState(t=0.0, joints=["a"], q=[0.0], held=None, objects={"g": [0.0] * 7, "table": [1.0] * 7})
REPORT = RunReport(
    outcome="stopped",
    reason="it was seen",
    time=0.5,
    steps=[StepRecord("pickup", {"object": "g", "speed": 0.1}, "pickup g", 0.0, unseen={"open": None})],
    faults=[FaultRecord("slip", 0.1), FaultRecord("camera-loss", 0.1, camera="cam1")],
    prediction=[{"held": {"cam1": Confusion(1, 2, 3, 4)}}],
    usual=[{"held": {"cam1": Confusion(3, 2, 0, 1)}}],
    disagreements=[Disagreement(1, 0.1, "held", "cam1", True, "blind", True, 0.5, "lighting")],
    wall={"all": 1.0},
)
RUN: list[Event] = [
    RunBegan(
        t=0.0,
        sqrp_log=events.VERSION,
        workspace="cell",
        digest="d",
        seed=3,
        cameras=["cam1"],
        rates={"cam1": 10.0},
        faults=["slip@a4"],
        steps=[events.ProgramStep(skill="pickup", parameters={"object": "g", "speed": 0.1}, time=1.5)],
    ),
    events.StepBegan(
        t=0.0, number=1, skill="pickup", parameters={"object": "g"}, time=1.5, boxes={"held": [BOX], "open": []}
    ),
    WHOLE,
    PrimitiveBegan(t=0.0, name="a1"),
    events.EvidenceSeen(t=0.1, exposed=0.05, step_time=None, literals=ATOMS),
    events.FaultInjected(t=0.1, fault="slip@a4"),
    events.FaultHappened(t=0.11, fault="slip"),
    events.StateChanged(t=0.12, held=None),
    events.FaultSeen(t=0.2, name="slip", text="the fault `slip` was seen", response="retry"),
    events.MovingOn(t=0.2, to_see="obj_on_table(g)", cameras=["cam1"], until=0.3),
    events.Stopping(t=0.3, reason="the fault `slip` was seen"),
    events.ContactFelt(t=0.35, force=5.2),
    events.Retrying(t=0.4, attempt=1, of=2, step="pickup", time=1.4),
    events.RunEnded(t=0.5, event="stopped", reason="it was seen"),
    RunReported(t=0.5, report=replace(REPORT, wall={})),
]


def test_a_run_with_all_kinds_of_events_is_read_from_its_log_as_it_was_written(tmp_path: Path) -> None:
    assert {type(event) for event in RUN} == set(get_args(Event))
    path = tmp_path / "log"
    assert isinstance(RUN[0], RunBegan)
    writer = LogWriter(path, RUN[0])
    for event in RUN[1:-1]:
        writer(event)
    writer.finish(REPORT)
    writer.close()
    assert list(read_log(path)) == RUN
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines == [json.dumps(event.line()) for event in read_log(path)]


def logged(path: Path, *lines: dict[str, object]) -> list[Event]:
    """The events of a log with these lines after the first."""
    path.write_text("".join(json.dumps(line) + "\n" for line in (RUN[0].line(), *lines)), encoding="utf-8")
    return list(read_log(path))


def test_a_log_that_knows_of_no_usual_images_has_none(tmp_path: Path) -> None:
    *_, reported = logged(tmp_path / "log", {**RUN[-1].line(), "usual": []})
    assert isinstance(reported, RunReported)
    assert reported.report.usual == [{"held": {"cam1": Confusion(tn=2, fn=4)}}]
    with pytest.raises(InputError, match="has other literals under `usual`"):
        logged(tmp_path / "log", {**RUN[-1].line(), "usual": [{"held": {}}]})


@pytest.mark.parametrize("event", RUN, ids=lambda event: type(event).__name__)
def test_a_line_begins_with_its_time_and_kind_and_no_other_key_fits_its_schema(event: Event) -> None:
    line = event.line()
    assert list(line)[:2] == ["t", "event"]
    assert issubclass(type(event), events.KINDS[event.event]) or isinstance(event, WholeState)
    schema = schema_of("log")
    for entry in schema["$defs"].values():
        entry["additionalProperties"] = False
    jsonschema.validate(line, schema, cls=jsonschema.Draft202012Validator)
    kindless = {key: value for key, value in line.items() if key != "event"}
    for other in ({**line, "another": 1}, {**line, "event": "other"}, kindless):
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(other, schema, cls=jsonschema.Draft202012Validator)


def test_an_event_of_a_kind_that_is_not_known_is_passed_over_but_has_its_time(tmp_path: Path) -> None:
    found = logged(tmp_path / "log", {"t": 0.1, "event": "later", "x": 1}, PrimitiveBegan(t=0.2, name="a1").line())
    assert [type(event) for event in found] == [RunBegan, PrimitiveBegan]


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
    line = WHOLE.model_copy(update={"t": 1.0, **later}).since(WHOLE).line()
    assert line == {"t": 1.0, "event": "state", **told}


def test_that_nothing_is_held_any_more_is_told() -> None:
    changed = WHOLE.since(WHOLE.model_copy(update={"held": "g"}))
    assert (changed.has("held"), changed.has("q")) == (True, False)
    assert changed.line() == {"t": 0.0, "event": "state", "held": None}


def test_the_first_state_of_a_cell_without_objects_has_none() -> None:
    assert "objects" not in WHOLE.model_copy(update={"objects": {}}).line()


def test_what_is_no_event_cannot_be_published() -> None:
    with pytest.raises(ValidationError, match="finite"):
        PrimitiveBegan(t=float("nan"), name="a1")
    with pytest.raises(ValidationError, match="Input should be 'true', 'false' or 'blind'"):
        ShownAtom.model_validate({"value": "perhaps", "asked": True, "cameras": {}})


@pytest.mark.parametrize(("truth", "word"), [(Truth.TRUE, "true"), (Truth.FALSE, "false"), (Truth.UNKNOWN, "blind")])
def test_a_truth_value_has_one_word(truth: Truth, word: Literal["true", "false", "blind"]) -> None:
    assert truth.word == word
    atom = ShownAtom.model_validate({"value": word, "asked": True, "cameras": {"cam1": word}})
    assert (atom.value, atom.cameras) == (truth, {"cam1": truth})
    assert atom.model_dump(exclude_unset=True)["value"] == word
