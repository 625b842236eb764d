"""`sqrp set`: what is written is a workspace that every other command takes."""

from __future__ import annotations

import json

import yaml

from sqrp_cli.ask.api.cell import OpenCell


def test_a_value_is_written_and_comments_stay(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    file.write_text("# a comment\n" + file.read_text(encoding="utf-8"), encoding="utf-8")
    assert sqrp("set", own_watch, "cameras.eye.rate=20").code == 0
    assert file.read_text(encoding="utf-8").startswith("# a comment\n")
    assert sqrp("set", own_watch, "cameras.eye.rate=20").err.endswith("says so already; nothing was written\n")


def test_a_task_that_no_object_fits_is_refused_with_its_place_and_nothing_is_written(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    before = file.read_bytes()
    refused = sqrp("set", own_watch, "tasks.0.task=watch gren")
    assert refused.code == 2
    assert "no object that `watch` can use is called or described as `gren`; did you mean `green`?" in refused.err
    assert file.read_bytes() == before


def test_a_path_that_is_set_twice_is_refused_and_nothing_is_written(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    before = file.read_bytes()
    refused = sqrp("set", own_watch, "cameras.eye.rate=5", "cameras.eye.rate=6")
    assert refused.code == 2
    assert "`cameras.eye.rate` is set twice" in refused.err
    assert file.read_bytes() == before


def test_what_was_emptied_is_filled_again(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    before = yaml.safe_load(file.read_text(encoding="utf-8"))
    for values in (
        ("objects.seen.color=", "objects.seen.color=green"),
        ("tasks=[]", f"tasks={json.dumps(before['tasks'])}"),
    ):
        for value in values:
            assert sqrp("set", own_watch, value).code == 0, value
        assert yaml.safe_load(file.read_text(encoding="utf-8")) == before


def test_an_item_of_a_list_is_replaced(sqrp, own_watch):
    file = own_watch / "workspace.yaml"
    tasks = yaml.safe_load(file.read_text(encoding="utf-8"))["tasks"]
    assert sqrp("set", own_watch, "tasks.0={task: watch green, min_q_avg: 0.5}").code == 0
    assert yaml.safe_load(file.read_text(encoding="utf-8"))["tasks"] == [
        {"task": "watch green", "min_q_avg": 0.5},
        *tasks[1:],
    ]


def test_a_value_that_is_set_while_the_file_changes_loses_neither(sqrp, own_watch, monkeypatch):
    file, read, texts = own_watch / "workspace.yaml", OpenCell.read, []

    def slow(*arguments, **named):
        texts.append(f"{file.read_text()}# changed by another one\n")
        file.write_text(texts[-1])
        return read(*arguments, **named)

    monkeypatch.setattr(OpenCell, "read", slow)
    found = sqrp("set", own_watch, "cameras.eye.rate=20")
    assert found.code == 2
    assert "the workspace has changed meanwhile" in found.err
    assert file.read_text() == texts[0]
