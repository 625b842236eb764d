"""`sqrp program`: what it lists, what it takes back, and what it refuses."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
import yaml

from sqrp_cli.program.file import load_program, save_program


@pytest.fixture(scope="module")
def made(sqrp, watch, tmp_path_factory) -> Path:
    """Two steps of 4 s each in the hand-worked cell: `seen` is seen all the time, `turned` at 60 % of it."""
    path = tmp_path_factory.mktemp("listing") / "program.yaml"
    for task in ("watch seen", "watch turned"):
        assert sqrp("rank", watch, task, "--program", path).code == 0
    return path


@pytest.fixture
def program(made, tmp_path) -> Path:
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


def test_the_table_fits_80_columns_and_shows_every_step(sqrp, program):
    outcome = sqrp("program", program)
    assert outcome.code == 0
    *table, command = outcome.out.splitlines()
    assert all(len(line) <= 80 for line in table)
    # What is to be copied is not folded.
    assert command.removeprefix("To add a step: ").endswith(f"TASK --program {program}")
    assert "1  watch seen" in outcome.out
    assert "2  watch turned" in outcome.out
    assert "in all" in outcome.out


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


def test_dropping_every_step_leaves_a_program_to_which_steps_can_be_added(sqrp, watch, program):
    for _ in range(2):
        assert sqrp("program", program, "--drop-last").code == 0
    outcome = sqrp("program", program)
    assert outcome.code == 0
    assert "0 steps" in outcome.out
    before = program.read_bytes()
    outcome = sqrp("program", program, "--drop-last")
    assert (outcome.code, outcome.out) == (2, "")
    assert "no step" in outcome.err
    assert program.read_bytes() == before
    assert sqrp("rank", watch, "watch turned", "--program", program).code == 0
    assert [step.short_task for step in load_program(program).steps] == ["watch turned"]


def test_a_stale_program_is_listed_with_a_warning_but_neither_shortened_nor_exported(sqrp, own_watch, tmp_path):
    program, export = tmp_path / "stale.yaml", tmp_path / "out.csv"
    assert sqrp("rank", own_watch, "watch seen", "--program", program).code == 0
    before = program.read_bytes()
    file = own_watch / "workspace.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("near: 50 cm", "near: 51 cm"), encoding="utf-8")
    listed = sqrp("program", program, "--json")
    assert listed.code == 0
    assert listed.document["stale"] is True
    assert "warning:" in listed.err
    assert "sqrp rank" in listed.err
    for option in (["--drop-last"], ["--export", export]):
        outcome = sqrp("program", program, *option)
        assert (outcome.code, outcome.out) == (2, "")
        assert outcome.err.startswith("error: ")
        assert "has changed" in outcome.err
    assert program.read_bytes() == before
    assert not export.exists()
    shutil.rmtree(own_watch)
    gone = sqrp("program", program)
    assert gone.code == 0
    assert "warning:" in gone.err


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--export", "{tmp}/out.txt"], ".csv"),
        (["--export", "{tmp}/out"], ".csv"),
        (["--export", "{tmp}/none/out.csv"], "mkdir -p"),
        (["--export", "{program}"], "not overwritten"),
        (["--export", "{tmp}/out.csv", "--rate", "0"], "--rate"),
        (["--export", "{tmp}/out.csv", "--rate", "nan"], "--rate"),
        (["--export", "{tmp}/out.csv", "--rate", "5 mm"], "a frequency"),
        (["--rate", "100"], "--export"),
        (["--export", "{tmp}/out.csv", "--drop-last"], "exclude"),
        (["{tmp}"], "one program"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_misuse_is_refused_and_changes_nothing(sqrp, program, tmp_path, options, word):
    before = program.read_bytes()
    filled = [option.format(tmp=tmp_path, program=program) for option in options]
    outcome = sqrp("program", program, *filled)
    assert (outcome.code, outcome.out) == (2, "")
    assert word in outcome.err
    assert program.read_bytes() == before
    assert list(tmp_path.iterdir()) == [program]


@pytest.mark.parametrize(
    ("asked", "there", "meant"),
    [
        ("nosuch.yaml", "ph.yaml", None),
        ("nosuch", "such.sh", None),
        ("steps.yaml", "stepps.json", None),
        ("steps", "stepps.yaml", "stepps.yaml"),
        ("steps.yaml", "stepps.yml", "stepps.yml"),
        ("steps.ymal", "steps.yaml", "steps.yaml"),
    ],
)
def test_only_a_near_name_of_its_kind_is_suggested_for_a_missing_program(sqrp, tmp_path, asked, there, meant):
    (tmp_path / there).touch()
    hint = f"; did you mean `{meant}`?" if meant else ""
    for command in (["run", tmp_path / asked, "--sim"], ["program", tmp_path / asked]):
        outcome = sqrp(*command)
        assert (outcome.code, outcome.out) == (2, "")
        assert f"{tmp_path / asked}: no such file or folder{hint}\n" in outcome.err


def test_a_program_that_could_not_be_read_again_is_not_written(sqrp, watch, program, monkeypatch):
    before = program.read_bytes()
    monkeypatch.setattr("sqrp_cli.program.file.MAX_BYTES", len(before))
    outcome = sqrp("rank", watch, "watch seen", "--program", program)
    assert outcome.code == 2
    assert "3 steps" in outcome.err
    assert f"--after {program}" in outcome.err
    assert program.read_bytes() == before


def test_no_alarm_is_promised_of_a_fault_that_no_image_shows(sqrp, watch, tmp_path):
    path = tmp_path / "program.yaml"
    assert sqrp("rank", watch, "watch behind", "--program", path).code == 0
    shown = " ".join(sqrp("program", path).out.split())
    assert "No alarm tells of moved in step 1, watch behind, at 100 % of the times at which it may happen" in shown
    assert "is noticed after" not in shown
    assert " never " in shown
    assert sqrp("program", path, "--json").document["total"]["delay_worst"] is None
