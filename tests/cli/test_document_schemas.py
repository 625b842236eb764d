"""`sqrp schema COMMAND` describes what `COMMAND --json` prints: documents fit their schemas, and no other key does."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

from sqrp_cli import read_result
from sqrp_cli.checks.registry import rules
from sqrp_cli.show.documents import KINDS
from sqrp_cli.show.documents.schemas import DOCUMENTS, NAMES, RECORDS, schema_of
from tests.cells import command_lines
from tests.random_cell import Crowd, random_cell

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
    assert explained["ExplainedCandidate"]["properties"]["t_eoi"]["description"].startswith("T_eoi, ")
    assert explained["Explanation"]["properties"]["task"]["description"] == "As it was asked for."
    assert explained["Qualities"]["properties"]["q_avg"]["description"].startswith("Q_avg in 0..1")
    side = schema_of("skill")["$defs"]["GraspWaypoint"]["properties"]["side"]
    assert side["description"].startswith("Outward axis"), "what the field means, not what its type does"


@pytest.mark.parametrize("command", command_lines("schemas"), ids=lambda words: " ".join(Path(w).name for w in words))
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


@pytest.mark.slow
def test_documents_of_runs_and_audits_and_lines_of_every_kind_of_a_log_fit_their_schemas(asked, slip_run):
    folder = slip_run.cell.folder
    validate(slip_run.outcome.document, "run")
    lines = [json.loads(line) for line in (folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]
    assert {"run", "step", "state", "evidence", "fault", "retry", "report"} <= {line["event"] for line in lines}
    log_lines = jsonschema.Draft202012Validator(strict(schema_of("log")))
    kinds = {line["event"]: line for line in lines}.values()
    for line in (*lines[::12], *kinds):
        log_lines.validate(line)
    for line in kinds:
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


AXES = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]]


def values(node: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every number and every 4x4 matrix of a document, with where it stands."""
    if isinstance(node, list) and len(node) == 4 and all(isinstance(row, list) and len(row) == 4 for row in node):
        yield path, np.array(node)
    elif isinstance(node, dict | list):
        for key, child in node.items() if isinstance(node, dict) else enumerate(node):
            yield from values(child, f"{path}.{key}")
    elif isinstance(node, float):
        yield path, node


def assert_sound(document: dict[str, Any]) -> None:
    found = list(values(document))
    assert found
    for path, value in found:
        if isinstance(value, float):
            assert math.isfinite(value), path
        else:
            R = value[:3, :3]
            np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9, err_msg=path)
            assert np.linalg.det(R) > 0, path
            assert value[3].tolist() == [0, 0, 0, 1], path


def assert_all_sound(sqrp: Callable[..., Any], cell: Path, task: str) -> list[dict[str, Any]]:
    documents = []
    for command in (("show", cell), ("rank", cell, task), ("explain", cell, task, "--all")):
        outcome = sqrp(*command, "--json")
        assert outcome.code in (0, 1), outcome.err
        assert_sound(outcome.document)
        documents.append(outcome.document)
    return documents


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.trial) for seed in (1, 2))])
def test_every_figure_of_a_random_cell_is_finite_and_every_rotation_orthonormal(sqrp, tmp_path, seed):
    cell = random_cell(tmp_path / "cell", Crowd(seed, objects=3, cameras=4))
    rng = np.random.default_rng(seed)
    file = cell / "workspace.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    for camera in content["cameras"].values():
        # Cameras along the axes and, as often, with `up` along them, which is where a direction across both is lost.
        axis = AXES[rng.integers(6)]
        place = (np.array([0.4, 0.0, 0.1]) - rng.uniform(0.5, 1.5) * np.array(axis)).tolist()
        up = AXES[rng.integers(6)] if rng.random() < 0.5 else axis
        camera["pose"] = {"position": place, "look_at": [0.4, 0.0, 0.1], "up": up}
    for thing in content["objects"].values():
        if True in thing:
            thing["on"] = thing.pop(True)  # this reader takes the key `on` for a truth value
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    assert_all_sound(sqrp, cell, "pickup")


@pytest.mark.parametrize("bend", [0.0, -0.01])
def test_a_camera_along_any_axis_with_any_up_covers_only_what_its_image_holds(sqrp, own_watch, bend):
    file = own_watch / "workspace.yaml"
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    eye = content["cameras"].pop("eye")
    eye["image"]["distortion"] = {"model": "plumb_bob", "coefficients": [bend, 0, 0, 0, 0]}
    middle = np.array([2.0, 0.3, 1.0])
    for number, (axis, up) in enumerate(itertools.product(AXES, AXES)):
        pose = {"position": (middle - 2 * np.array(axis)).tolist(), "look_at": middle.tolist(), "up": up}
        content["cameras"][f"cam{number}"] = {**eye, "pose": pose}
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")

    show, _, explained = assert_all_sound(sqrp, own_watch, "watch cube")

    covered = 0
    boxes = [
        box
        for candidate in explained["candidates"]
        for sample in candidate.get("samples", ())[:1]
        for literal in sample["literals"].values()
        for box in literal["boxes"]
    ]
    for box, name in itertools.product(boxes, show["cameras"]):
        if box["cameras"][name]["covered"]:
            camera, X_WC = show["cameras"][name], np.array(show["cameras"][name]["pose"])
            corners_C = (np.array(box["corners"]) - X_WC[:3, 3]) @ X_WC[:3, :3]
            pixels = (corners_C / corners_C[:, 2:] @ np.array(camera["K"]).T)[:, :2]  # the lens moves none by 2 pixels
            assert (np.abs(pixels - [320, 240]) <= np.array([320.5, 240.5]) + 2).all()
            covered += 1
    assert covered >= len(AXES)


@pytest.mark.parametrize("command", command_lines("saved"), ids=lambda words: " ".join(Path(w).name for w in words))
def test_a_saved_result_is_shown_as_its_command_showed_it(sqrp, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "result.json"
    file.write_text(sqrp(*command, "--json").out, encoding="utf-8")
    # A hint how to go on is about this very command.
    shown = sqrp(*command).out.partition("\n\nHow much of that is enough")[0]
    assert sqrp("show", file).out == shown
    assert sqrp("show", file, "--json").out == file.read_text(encoding="utf-8")
    assert str(read_result(file)) in sqrp(*command).out


def test_every_document_says_which_command_wrote_it(sqrp):
    printing = "rank explain advise place check program run audit score diff show init rules calibrate"
    assert {kind.split()[0] for kind in KINDS} == set(DOCUMENTS) == set(printing.split())
    assert json.loads(sqrp("rules", "--json").out)["document"] == "rules"


def test_every_finding_has_a_row_under_its_subject_and_an_entry(sqrp):
    # Every finding has a row under its subject.
    outcome = sqrp("rules")
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = {line.split()[0] for line in lines if line[:1].strip()}
    assert rows >= set(rules())
    for rule in rules().values():
        assert any(line.startswith(rule.subject) for line in lines)
    # The document has what the registry has.
    document = sqrp("rules", "--json").document
    assert document["schema"] == 1
    assert [entry["code"] for entry in document["rules"]] == list(rules())
    (both,) = sqrp("rules", "overlapping-objects", "--json").document["rules"]
    assert both["severity"] == ["error", "warning"]
