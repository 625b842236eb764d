"""Events and the log: an event is its line, and whatever is wrong with a log or a folder of frames is told."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from pydantic import ValidationError

from sqrp_cli.errors import InputError
from sqrp_cli.run.ground_truth import changes
from sqrp_cli.run.record.events import KINDS, MODELS, VERSION, AskedBox, Event, ProgramStep, ShownAtom, event
from sqrp_cli.run.record.images import read_frames
from sqrp_cli.run.record.log import Track, read_log, written_log
from sqrp_cli.run.record.report import Confusion, Disagreement, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.documents.schemas import schema_of
from sqrp_cli.show.pages.run_page import write_run
from sqrp_cli.show.terminal.run_view import print_run
from tests.cells import refused

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
BOX = AskedBox(frame="tip", size=[0.1, 0.2, 0.3], pose=IDENTITY)
ATOMS = {
    "held": ShownAtom(value="blind", true=True, predicted=False, asked=True,
                      cameras={"cam1": "true", "cam2": "false"}),
    "open": ShownAtom(value="false", true=None, predicted=True, asked=False, cameras={}),
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
    with written_log(path, RUN[0]) as write:
        for number, one in enumerate(RUN[1:], 1):
            write(one)
            assert len(list(read_log(path))) == number + 1
    assert list(read_log(path)) == RUN
    assert ["camera" in fault for fault in RUN[-1].line()["faults"]] == [False, True]
    assert path.read_text(encoding="utf-8").splitlines() == [json.dumps(one.line()) for one in read_log(path)]


def read(path: Path, log: list[dict[str, Any]]) -> list[Event]:
    path.write_text("".join(json.dumps(line) + "\n" for line in log), encoding="utf-8")
    return list(read_log(path))


def test_a_report_counts_usual_images_of_what_it_counts_predicted_ones_of(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="has other literals under `usual`"):
        read(tmp_path / "log", [RUN[0].line(), {**RUN[-1].line(), "usual": [{"held": {}}]}])


def test_a_line_begins_with_its_time_and_kind_and_no_other_key_fits_its_schema() -> None:
    schema = schema_of("log")
    for entry in schema["$defs"].values():
        entry["additionalProperties"] = False
    fits = jsonschema.Draft202012Validator(schema).is_valid
    for line in (one.line() for one in RUN):
        assert list(line)[:2] == ["t", "event"]
        assert fits(line), line
        kindless = {key: value for key, value in line.items() if key != "event"}
        assert not any(map(fits, ({**line, "another": 1}, {**line, "event": "other"}, kindless)))


def test_an_event_of_a_kind_that_is_not_known_is_passed_over_but_has_its_time(tmp_path: Path) -> None:
    lines = [RUN[0].line(), {"t": 0.1, "event": "later", "x": 1}, event("primitive", 0.2, name="a1").line()]
    assert [found.event for found in read(tmp_path / "log", lines)] == ["run", "primitive"]


@pytest.mark.parametrize(
    ("later", "told"),
    [
        ({}, {}), ({"q": [0.1]}, {"q": [0.1]}), ({"held": "g"}, {"held": "g"}),
        ({"objects": {"g": [0.5] * 7, "table": [1.0] * 7}}, {"objects": {"g": [0.5] * 7}}),
    ],
)  # fmt: skip
def test_a_state_tells_what_is_not_as_it_was(later: dict[str, object], told: dict[str, object]) -> None:
    assert changes({**WHOLE, **later}, WHOLE) == told
    assert event("state", 1.0, **told).line() == {"t": 1.0, "event": "state", **told}
    assert changes(WHOLE, {**WHOLE, "held": "g"}) == {"held": None}
    assert changes({**WHOLE, "objects": {}}, None).keys() == {"joints", "q", "held"}


def test_what_is_no_event_cannot_be_published() -> None:
    with pytest.raises(ValidationError, match="finite"):
        event("primitive", float("nan"), name="a1")
    with pytest.raises(TypeError, match="an event `primitive` has no nam"):
        event("primitive", 0.0, name="a1", nam="a")
    with pytest.raises(ValidationError, match="Input should be 'true', 'false' or 'blind'"):
        ShownAtom.model_validate({"value": "perhaps", "asked": True, "cameras": {}})
    assert set(KINDS) >= {found.event for found in RUN}


def test_what_is_no_log_is_refused_with_how_one_is_made(tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(b"\xff\xfe\x00")
    problem = refused(lambda: list(read_log(tmp_path / "log")))
    assert problem.message == "this is no log of `sqrp run --log`: it is not UTF-8 text"
    assert (problem.code, problem.mend) == ("no-log", "make one: sqrp run PROGRAM --sim --log FILE")


def test_what_is_read_from_a_damaged_log_can_be_shown_and_all_else_is_told_with_its_line(tmp_path: Path) -> None:
    path, page, log = tmp_path / "log", tmp_path / "page.html", [one.line() for one in RUN]
    told, shown = set(), set()
    fields = [(number, field) for number, line in enumerate(log) for field in line if field != "event"]
    for (number, field), value in itertools.product(fields, (None, -3, "x", [], ["x"], {}, {"x": 1})):
        damaged = {**log[number], field: value}
        try:
            header, *events, last = read(path, [*log[:number], damaged, *log[number + 1 :]])
        except InputError as error:
            (problem,) = error.problems
            assert problem.place.line in (number + 1, None if number + 1 == len(log) else number + 1)
            told.add((number, field))
            continue
        Track.of(events)
        print_run(replace(last.report, workspace="cell"))
        if damaged != log[number] and (number, field) not in shown:  # a page takes its time
            shown.add((number, field))
            write_run(header, last.report, events, page, [])
    assert told == set(fields)


HEAD = "camera,file,step,t\n"


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("frames.csv", b"", "this file is no recording; expected an MCAP file, a bag of ROS, or a folder with frames"),
        ("nowhere", b"", "no such file or folder"),
        (".", b"\xff\xfe", "byte 0xff is not UTF-8 text"),
        (".", HEAD.encode() + b"cam1,link.png,1,0\n", "2: the file `link.png` is not in this folder"),
        (".", HEAD.encode() + b"cam1,out/secret.png,1,0\n", "2: the file `out/secret.png` is not in this folder"),
    ],
)
def test_what_is_no_folder_of_frames_is_refused_in_words(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    (tmp_path / "secret.png").touch()
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / "out").symlink_to(tmp_path)
    (folder / "frames.csv").write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_frames(folder / name, ["cam1"], 1))


def test_a_file_in_the_folder_may_be_reached_by_links_within_it(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "a.png").touch()
    (tmp_path / "link.png").symlink_to("below/a.png")
    (tmp_path / "frames.csv").write_text(f"{HEAD}cam1,link.png,1,0\ncam1,below/a.png,1,\n")
    entries = list(read_frames(tmp_path, ["cam1"], 1))
    assert [(file.name, t) for _, file, _, t in entries] == [("link.png", 0.0), ("a.png", None)]


def test_nothing_is_quoted_of_a_file_that_only_lies_where_the_index_should(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("root:x:0:0\n")
    (tmp_path / "frames.csv").symlink_to("secret")
    with pytest.raises(InputError) as caught:
        list(read_frames(tmp_path, ["cam1"], 1))
    assert "x:0" not in str(caught.value)
