"""`sqrp set`: what is written is a workspace that every other command takes."""

from __future__ import annotations


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
