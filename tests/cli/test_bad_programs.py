"""Programs that were damaged: each is refused with one clear message, by every command, and left as it was."""

from __future__ import annotations

import re
import shlex
import shutil
from typing import Any

import pytest
import yaml

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.program.file import check_program, load_program
from tests.cells import follow, read_cases

CASES = read_cases("bad_programs.yaml")


@pytest.fixture(scope="module")
def sound(sqrp, laying, holding):
    path = laying / "sound.yaml"
    shutil.copy(holding, path)
    assert sqrp("rank", laying, "lay g2", "--program", path).code == 0
    return path


def damaged(text: str, case: dict[str, Any]) -> str:
    for old, new in case.get("replace", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    for old, new in case.get("rename", {}).items():
        text = re.sub(rf"\b{old}\b", new, text)
    if "set" in case or "remove" in case:
        document = yaml.load(text, Loader=yaml.CSafeLoader)
        for path, value in case.get("set", {}).items():
            container, key = follow(document, path)
            container[key] = float("nan") if value == ".nan" else value
        for path in case.get("remove", []):
            container, key = follow(document, path)
            del container[key]
        text = yaml.dump(document, Dumper=yaml.CSafeDumper, sort_keys=False)
    return text


@pytest.fixture(scope="module")
def workspace(laying):
    return load_workspace(laying)


@pytest.mark.parametrize("case", CASES, ids=[case["case"] for case in CASES])
def test_a_damaged_program_is_refused_with_place_and_reason(laying, sound, workspace, case):
    path = laying / "damaged.yaml"
    path.write_text(damaged(sound.read_text(encoding="utf-8"), case), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        check_program(load_program(path), path, workspace)
    first = caught.value.problems[0]
    assert (first.code, first.severity, first.place.file) == (case["code"], "error", path)
    for fragment in case["says"]:
        assert fragment in first.message
    if "line" in case:
        assert case["line"] in path.read_text(encoding="utf-8").splitlines()[first.place.line - 1]
    path.unlink()


@pytest.mark.parametrize("case", CASES[::13], ids=[case["case"] for case in CASES[::13]])
def test_every_command_refuses_a_damaged_program_alike_and_leaves_it_as_it_was(sqrp, laying, sound, case):
    path = laying / "damaged.yaml"
    path.write_text(damaged(sound.read_text(encoding="utf-8"), case), encoding="utf-8")
    before = path.read_bytes()
    listed = sqrp("program", path)
    assert listed.err.startswith(f"error: {path}")
    assert "Traceback" not in listed.err
    commands = (["program", path, "--drop-last"], ["program", path, "--export", laying / "no.csv"])
    for arguments in (["program", path], *commands, ["rank", laying, "pickup g3", "--program", path]):
        outcome = sqrp(*arguments)
        assert (outcome.code, outcome.out, outcome.err) == (2, "", listed.err)
    assert path.read_bytes() == before
    assert not (laying / "no.csv").exists()
    path.unlink()


def test_a_program_that_is_laid_out_anew_or_moved_or_of_before_there_were_marks_is_the_same(sqrp, laying, sound):
    text = sound.read_text(encoding="utf-8")
    document = {**yaml.load(text, Loader=yaml.CSafeLoader), "workspace": "../workspace.yaml"}
    moved, before = laying / "elsewhere" / "moved.yaml", laying / "before.yaml"
    moved.parent.mkdir()
    moved.write_text("# mine\n" + yaml.dump(document, Dumper=yaml.CSafeDumper, sort_keys=True), encoding="utf-8")
    before.write_text(re.sub(r"^marks: .*\n", "", text, flags=re.MULTILINE), encoding="utf-8")
    assert "marks" not in before.read_text(encoding="utf-8")
    for path in (moved, before):
        outcome = sqrp("program", path)
        assert (outcome.code, outcome.err) == (0, "")
        path.unlink()


def test_what_makes_an_edited_program_anew_makes_the_same(sqrp, laying):
    path, task = laying / "fast.yaml", "pickup object=g1,g2 speed=0.5,60% lift=5cm,80mm elbow=any"
    sqrp("rank", laying, task, "--program", path, "--choose", "g2 lift=80mm speed=0.6")
    written = path.read_text(encoding="utf-8")
    path.write_text(re.sub(r"q_avg: [\d.]+", "q_avg: 0.99", written), encoding="utf-8")
    refused = sqrp("program", path).err
    _, _, *command = shlex.split(refused.split("to mend it: ")[1].split(" && ")[1])
    assert command[1] == "pickup g2 speed=60% lift=80mm elbow=any"
    path.unlink()
    assert sqrp("rank", *command).code == 0
    assert _without_tasks(path.read_text(encoding="utf-8")) == _without_tasks(written)
    path.unlink()


def _without_tasks(program: str) -> list[dict[str, Any]]:
    """The steps of a program, save for the words in which their tasks were given."""
    steps = yaml.load(program, Loader=yaml.CSafeLoader)["steps"]
    return [{key: value for key, value in step.items() if key != "task"} for step in steps]
