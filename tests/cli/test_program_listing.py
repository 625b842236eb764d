"""`sqrp program`: what it lists, what it takes back, and what it refuses."""

from __future__ import annotations

import pytest
import yaml

from sqrp_cli.program.file import load_program, save_program


@pytest.fixture(scope="module")
def made(sqrp, watch, tmp_path_factory):
    """Two steps of 4 s each in the hand-worked cell: `seen` is seen all the time, `turned` at 60 % of it."""
    path = tmp_path_factory.mktemp("listing") / "program.yaml"
    for task in ("watch seen", "watch turned"):
        assert sqrp("rank", watch, task, "--program", path).code == 0
    return path


@pytest.fixture
def program(made, tmp_path):
    """A copy of it; a program names its workspace relative to itself."""
    path = tmp_path / "program.yaml"
    original = load_program(made)
    workspace = str((made.parent / original.workspace).resolve())
    save_program(original.model_copy(update={"workspace": workspace}), path)
    return path


def test_totals_weight_quality_with_time_and_name_the_worst_delay(sqrp, program):
    outcome = sqrp("program", program, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    document = outcome.document
    assert [step["parameters"]["object"] for step in document["steps"]] == ["seen", "turned"]
    assert [(step["start"], step["end"]) for step in document["steps"]] == [(0.0, 4.0), (4.0, 8.0)]
    assert document["total"]["time"] == 8.0
    # Both take 4 s, with Q_avg 1 and 0.6.
    assert document["total"]["q_avg"] == pytest.approx(0.8, abs=1e-9)
    assert document["total"]["delay_worst"] == pytest.approx(0.15, abs=1e-9)
    assert (document["stale"], document["tool"]) == (False, [])
    steps = yaml.safe_load(program.read_text(encoding="utf-8"))["steps"]
    for step, listed in zip(steps, document["steps"], strict=True):
        assert all(step[name] == listed[name] for name in ("task", "skill", "time", "q_avg", "faults"))


def test_a_saved_listing_is_shown_as_it_was_printed(sqrp, program, tmp_path):
    saved = tmp_path / "listing.json"
    saved.write_text(sqrp("program", program, "--json").out, encoding="utf-8")
    assert sqrp("show", saved).out == sqrp("program", program).out


def test_dropping_the_last_step_leaves_the_program_as_it_was_before_it(sqrp, watch, program):
    first = load_program(program).steps[0]
    outcome = sqrp("program", program, "--drop-last")
    assert outcome.code == 0
    assert "watch turned" in outcome.err
    (left,) = load_program(program).steps
    assert left.model_dump() == first.model_dump()
    assert sqrp("rank", watch, "watch turned", "--program", program).code == 0
    assert len(load_program(program).steps) == 2


def test_a_program_that_could_not_be_read_again_is_not_written(sqrp, watch, program, monkeypatch):
    before = program.read_bytes()
    monkeypatch.setattr("sqrp_cli.program.file.MAX_BYTES", len(before))
    outcome = sqrp("rank", watch, "watch seen", "--program", program)
    assert outcome.code == 2
    assert "3 steps" in outcome.err
    assert f"--after {program}" in outcome.err
    assert program.read_bytes() == before
