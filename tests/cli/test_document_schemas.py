"""`sqrp schema COMMAND` describes what `COMMAND --json` prints: documents fit their schemas, and no other key does."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from sqrp_cli.show.documents.schemas import DOCUMENTS, NAMES, RECORDS, schema_of

CELLS = Path(__file__).parents[2] / "workspaces"
TABLETOP, TOWER = CELLS / "tabletop", CELLS / "tower"
WATCH = Path(__file__).parents[1] / "cases" / "watch"


@pytest.mark.parametrize("name", NAMES)
def test_every_name_has_a_schema(sqrp, name):
    jsonschema.Draft202012Validator.check_schema(json.loads(sqrp("schema", name).out))


@pytest.mark.parametrize("name", [*DOCUMENTS, *RECORDS])
def test_every_field_of_every_document_is_described(name):
    schema = schema_of(name)
    undescribed = [
        f"{record['title']}.{field}"
        for record in (schema, *schema.get("$defs", {}).values())
        for field, found in record.get("properties", {}).items()
        if not found.get("description")
    ]
    assert not undescribed


def test_inherited_fields_are_described_as_where_they_are_declared():
    explained = schema_of("explain")["$defs"]
    assert explained["CandidateStudy"]["properties"]["t_eoi"]["description"].startswith("T_eoi, ")
    assert explained["Explanation"]["properties"]["task"]["description"] == "As it was asked for."
    assert explained["Qualities"]["properties"]["q_avg"]["description"].startswith("Q_avg in 0..1")


COMMANDS = [
    ("check", TABLETOP),
    ("check", TOWER, "pickup blue"),
    ("rank", TABLETOP, "pickup object=g1,g6", "--samples", "3"),
    ("rank", TABLETOP, "pickup g2", "--samples", "3", "--calibration", "5 mm, 0.5 deg"),
    ("rank", TABLETOP, "pickup g2", "--dt", "0.5"),
    ("explain", TABLETOP, "pickup g2", "--samples", "3"),
    ("explain", TABLETOP, "pickup object=g2,g6", "--samples", "3", "--all"),
    ("explain", TABLETOP, "pickup g6"),
    ("advise", TABLETOP, "pickup g3", "--kinds", "aim", "--ways", "fastest", "--want", "time 5 s"),
    ("rules",),
    ("rules", "wrong-unit"),
    ("show", TABLETOP),
    ("show", CELLS / "screws"),
    ("show", TOWER),
    ("score", WATCH, "--samples", "3"),
    ("score", WATCH, "--samples", "3", "--vary", "cameras.eye.near=0.5:0.6:2"),
    ("diff", WATCH, WATCH, "--samples", "3"),
]


@pytest.mark.parametrize("command", COMMANDS, ids=[" ".join(Path(str(w)).name for w in c) for c in COMMANDS])
def test_documents_fit_their_schemas(sqrp, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    document = sqrp(*command, "--json").document
    validate(document, command[0])
    assert_no_other_key_fits(document, command[0])


def test_documents_of_new_workspaces_and_of_programs_fit_their_schemas(sqrp, started, tmp_path):
    validate(started[1].document, "init")
    program = tmp_path / "pick.yaml"
    sqrp("rank", TABLETOP, "pickup g2", "--samples", "3", "--program", program)
    validate(sqrp("program", program, "--json").document, "program")


def test_documents_of_runs_and_audits_and_every_line_of_a_log_fit_their_schemas(asked, slip_run):
    folder = slip_run.cell.folder
    validate(slip_run.outcome.document, "run")
    lines = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    assert {"run", "step", "state", "evidence", "fault", "retry", "report"} <= {line["event"] for line in lines}
    log_lines = jsonschema.Draft202012Validator(strict(schema_of("log")))
    for line in lines:
        log_lines.validate(line)
    for line in {line["event"]: line for line in lines}.values():
        assert_no_other_key_fits(line, "log")
    validate(asked("audit", slip_run.cell.program, folder / "frames", "--json").document, "audit")


def validate(document: dict, name: str) -> None:
    jsonschema.validate(document, strict(schema_of(name)), cls=jsonschema.Draft202012Validator)


def assert_no_other_key_fits(document: dict, name: str) -> None:
    with pytest.raises(jsonschema.ValidationError):
        validate({**document, "another": 1}, name)


def strict(schema: dict) -> dict:
    """The schema, where keys that it does not describe are errors."""
    for entry in schema.get("$defs", {}).values():
        if "properties" in entry:
            entry["additionalProperties"] = False
    if "properties" in schema:
        schema["additionalProperties"] = False
    return schema


def test_the_documents_are_those_of_the_commands_that_print_json():
    assert set(DOCUMENTS) == {
        "rank", "explain", "advise", "place", "check", "program", "run", "audit", "score", "diff", "show", "init",
        "rules", "calibrate",
    }  # fmt: skip
