"""`sqrp show FILE`: the table of a saved result, as its command printed it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sqrp_cli import read_result
from sqrp_cli.show.documents import KINDS
from sqrp_cli.show.documents.schemas import DOCUMENTS

WATCH = Path(__file__).parents[1] / "cases" / "watch"


@pytest.mark.parametrize(
    "command",
    [
        ("rules",),
        ("rules", "wrong-unit"),
        ("check", WATCH),
        ("check", WATCH, "watch cube"),
        ("rank", WATCH, "watch green", "--samples", "3"),
        ("rank", WATCH, "watch green", "--dt", "0.5", "--ways", "all", "--calibration", "5 mm, 0.5 deg"),
        ("explain", WATCH, "watch seen"),
        ("explain", WATCH, "watch cube", "--all"),
        ("score", WATCH, "--samples", "3"),
        ("score", WATCH, "--samples", "3", "--vary", "cameras.eye.near=0.5:0.6:2"),
        ("diff", WATCH, WATCH, "--samples", "3"),
    ],
    ids=lambda command: " ".join(map(str, command)).replace(str(WATCH), "watch"),
)
def test_a_saved_result_is_shown_as_its_command_showed_it(sqrp, tmp_path, command, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "result.json"
    file.write_text(sqrp(*command, "--json").out, encoding="utf-8")
    # A hint how to go on is about this very command.
    shown = sqrp(*command).out.partition("\n\nHow much of that is enough")[0]
    assert sqrp("show", file).out == shown
    assert sqrp("show", file, "--json").out == file.read_text(encoding="utf-8")
    assert str(read_result(file)) in sqrp(*command).out


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"schema": 1, "workspace": "cell"}', "does not say which command wrote it"),
        ('{"schema": 1, "document": "paint"}', "is of `paint`"),
        ('{"schema": 1, "document": "rules", "rules": [{"code": 3}]}', "rules[0].code"),
        ('{"schema": 1, "document": "rules"', "no JSON"),
    ],
)
def test_a_file_without_a_result_of_this_version_is_refused_with_its_place(sqrp, tmp_path, text, said):
    file = tmp_path / "result.json"
    file.write_text(text, encoding="utf-8")
    outcome = sqrp("show", file)
    assert (outcome.code, outcome.out) == (2, "")
    assert str(file) in outcome.err
    assert said in outcome.err


def test_every_document_says_which_command_wrote_it(sqrp):
    assert {kind.split()[0] for kind in KINDS} == set(DOCUMENTS)
    assert json.loads(sqrp("rules", "--json").out)["document"] == "rules"
