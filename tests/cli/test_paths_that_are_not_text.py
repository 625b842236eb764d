"""Folders whose names are not UTF-8: every command works in them, and JSON says their names in one defined way."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def odd(watch, tmp_path_factory) -> Path:
    """A copy of the cell in such a folder."""
    folder = Path(os.fsdecode(os.fsencode(tmp_path_factory.mktemp("odd")) + b"/w\xff\xe9"))
    return Path(shutil.copytree(watch, folder))


@pytest.mark.parametrize(
    "words",
    [
        ["check", "ODD"],
        ["check", "ODD", "watch", "--json"],
        ["rank", "ODD", "watch turned"],
        ["rank", "ODD", "watch turned", "--report", "ODD/page.html"],
        ["rank", "ODD", "watch turned", "--program", "ODD/program.yaml"],
        ["explain", "ODD", "watch turned", "--json"],
        ["explain", "ODD", "watch turned", "--images", "ODD/pictures"],
        ["show", "ODD"],
        ["diff", "ODD", "ODD"],
        ["score", "ODD", "--json"],
        ["score", "ODD", "--save-baseline", "ODD/baseline.json", "--junit", "ODD/junit.xml", "--report", "ODD/s.html"],
    ],
    ids=" ".join,
)
def test_no_command_takes_a_path_that_is_not_utf8_for_a_fault_of_its_own(sqrp, odd, words):
    outcome = sqrp(*(word.replace("ODD", str(odd)) for word in words))
    assert outcome.code in (0, 1, 2), outcome.err
    assert "internal error" not in outcome.err
    if "--json" in words:
        assert json.loads(outcome.out)["schema"] == 1


def test_json_spells_out_a_path_so_that_it_is_found_again(sqrp, odd):
    document = json.loads(sqrp("show", odd, "--json").out)
    assert document["workspace"] == r"w\xff\xe9"
    assert os.fsencode(document["robot"]["urdf"]) == os.fsencode(odd / "arm.urdf")


def test_a_program_in_another_folder_finds_a_workspace_whose_path_is_not_utf8(sqrp, odd, tmp_path):
    program = tmp_path / "program.yaml"
    assert sqrp("rank", odd, "watch turned", "--program", program).code == 0
    assert json.loads(sqrp("program", program, "--json").out)["stale"] is False
