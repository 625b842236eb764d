"""Where outcomes are kept, whatever is in the place of one; they count as long as the program is the same."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sqrp_cli
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.score.kept import Outcome, Results, program_digest
from sqrp_cli.study.pipeline import RankJob
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

KEY = "ab" * 32

IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nowhere": lambda path: path.symlink_to("nowhere"),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a pipe": os.mkfifo,
    "an empty folder": Path.mkdir,
    "noise": lambda path: path.write_bytes(b"\xff\0"),
}


@pytest.mark.parametrize("what", IN_THE_WAY)
def test_what_is_in_the_place_of_a_result_is_replaced(what: str, tmp_path: Path) -> None:
    file = Results.path(tmp_path, KEY)
    file.parent.mkdir()
    IN_THE_WAY[what](file)
    with closing(Results(tmp_path)) as results:
        assert results.get(KEY) is None
        results.keep(KEY, "text")
    with closing(Results(tmp_path)) as results:
        assert results.get(KEY) == "text"


def test_a_kept_outcome_has_the_way_behind_its_figures(tabletop: Workspace) -> None:
    cell = Cell.load(tabletop)
    candidate = read_task("pickup g4 approach_yaw=-90deg shoulder=left elbow=up", tabletop).candidates[0]
    found = RankJob(FixedCount(3), cell=cell, world=cell.initial_world).assess(candidate)
    result = replace(found, best_way=replace(found.way, vias={"a1": np.array([[0.1, -1.2, 0.3, 0.0, 1.5, 2.0]])}))
    text = Outcome(result, None).to_text()
    again = Outcome.from_text(text, candidate).result
    assert again.ways == result.ways
    assert again.way.parameters == result.way.parameters
    vias, kept = ({name: via.tolist() for name, via in one.way.vias.items()} for one in (result, again))
    assert vias == kept != {}
    assert Outcome(again, None).to_text() == text


PACKAGE = Path(sqrp_cli.__file__).parent


def test_kept_results_count_while_the_program_is_the_same_wherever_its_parts_lie(tmp_path: Path) -> None:
    ignored = shutil.ignore_patterns("__pycache__")
    package = Path(shutil.copytree(PACKAGE, tmp_path / "package", ignore=ignored))
    same = program_digest(PACKAGE)
    assert program_digest(package) == same
    code = sorted(package.rglob("*.py"))
    for file in code[:: len(code) // 5]:
        content = file.read_bytes()
        file.write_bytes(content + b"\n")
        program_digest.cache_clear()
        assert program_digest(package) != same, file
        file.write_bytes(content)
    moved = (package / "study").rename(package / "planning")
    program_digest.cache_clear()
    renamed = program_digest(package)
    assert renamed != same
    (moved / "quality.py").write_text("")
    program_digest.cache_clear()
    assert program_digest(package) != renamed
