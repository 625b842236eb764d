"""The same question gets the same answer, byte for byte, whatever the process, its hash seed or its helpers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from sqrp_cli.show.pages.assembly import tidy
from tests.cells import copied, edit
from tests.random_cell import Crowd, random_cell

ROOT = Path(__file__).parents[2]
TASK = "pickup green"
OPTIONAL = ("PIL", "cv2", "distributed", "embreex", "fast_simplification", "mujoco", "trimesh", "unified_planning")
WITHOUT_EXTRAS = f"import sys\nsys.modules.update(dict.fromkeys({OPTIONAL}))  # importing one raises ImportError"


@pytest.fixture
def held_by_two_facts(tmp_path):
    """The tower's cell where facts alone say what the tool holds, by two words for it that two skills make true."""
    cell = (ROOT / "workspaces" / "tower" / "workspace.yaml").read_text(encoding="utf-8")
    folder = tmp_path / "held"
    pinch = folder / "pinch"
    pinch.mkdir(parents=True)
    for name in ("skill.yaml", "pickup.pddl"):
        text = (ROOT / "skills" / "pickup" / name).read_text(encoding="utf-8")
        (pinch / name.replace("pickup", "pinch")).write_text(
            text.replace("pickup", "pinch").replace("(hold ?", "(pinched ?").replace("hold", "pinched"),
            encoding="utf-8",
        )
    held = "pose: {held: +z}}"
    assert held in cell
    for old, new in {
        "../../skills/pickup,": "../../skills/pickup, pinch,", held: "pose: unknown}", "../../": f"{ROOT}/",
        "  - hold(red)": "  - pinched(red)\n  - hold(red)", "../robots": f"{ROOT}/workspaces/robots",
    }.items():  # fmt: skip
        cell = cell.replace(old, new)
    (folder / "workspace.yaml").write_text(cell, encoding="utf-8")
    return folder


@pytest.fixture
def place_first(tmp_path):
    """The tabletop with two of its cameras and a task that needs others first."""
    folder = copied(tmp_path, camera="cam3")
    edit(folder, "{task: pickup green, min_q_eoi: 0.5}", "{task: place g2 tray, feasible: false}")
    return folder


@pytest.mark.slow
def test_everything_is_the_same_bytes_whatever_order_sets_have(held_by_two_facts, place_first, tmp_path):
    tasks = [held_by_two_facts, "pickup blue", place_first, "place g2 tray"]
    tasks += [random_cell(tmp_path / "random", Crowd(4, objects=2, cameras=3)), "pickup"]
    program = [sys.executable, "-m", "tests.cli.all_output", *map(str, tasks)]
    said = [
        json.loads(
            subprocess.run(
                program, cwd=ROOT, env=os.environ | {"PYTHONHASHSEED": seed}, capture_output=True, check=True
            ).stdout
        )
        for seed in ("0", "1")
    ]
    assert len(said[0]) == 18
    command = f"explain {held_by_two_facts} pickup blue --all --json --samples 4 --jobs 1 --ways fastest"
    held, *_ = json.loads(said[0][command][1])["candidates"]
    assert held
    for name, found in said[0].items():
        assert found[0] < 3, (name, found)
        assert said[1][name] == found, name


def test_another_process_with_another_hash_seed_and_no_optional_libraries_prints_the_same_bytes(
    sqrp, sqrp_process, tabletop
):
    command = ("rank", tabletop, "pickup object=g2,g6", "--json")
    outcome, here = sqrp_process(*command, prelude=WITHOUT_EXTRAS, PYTHONHASHSEED="2"), sqrp(*command)
    assert (outcome.code, here.code, outcome.err) == (0, 0, here.err)
    assert outcome.out == here.out


@pytest.fixture
def rank_changed(sqrp, tabletop_cell, tmp_path):
    """Ranks the tabletop's task after a change of its file; gives the candidates by object."""

    def rank_it(change) -> dict[str, Any]:
        change(tabletop_cell)
        text = yaml.safe_dump(tabletop_cell, sort_keys=False)
        (tmp_path / "workspace.yaml").write_text(text, encoding="utf-8")
        document = sqrp("rank", tmp_path, TASK, "--json", "--samples", 20, "--ways", "fastest").document
        return {candidate["parameters"]["object"]: candidate for candidate in document["candidates"]}

    return rank_it


def test_the_order_of_cameras_and_objects_changes_no_figure(rank_changed):
    def reverse(cell: dict[str, Any]) -> None:
        for section in ("cameras", "objects"):
            cell[section] = dict(reversed(cell[section].items()))

    before, after = rank_changed(lambda _: None), rank_changed(reverse)
    assert {name: before[name]["rank"] for name in before} == {name: after[name]["rank"] for name in after}
    for name, candidate in before.items():
        for figure in ("time", "q_avg", "q_eoi", "faults", "states", "reasons", "pareto"):
            assert tidy(after[name][figure], 12) == tidy(candidate[figure], 12), (name, figure)


def test_an_object_that_is_only_named_otherwise_changes_no_figure(sqrp, own_watch, watched):
    file = own_watch / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("turned", "abc").replace("wall:", "shield:"), encoding="utf-8")
    renamed = sqrp("explain", own_watch, "watch cube", "--all", "--json").document["candidates"]
    figures = ("time", "q_avg", "q_eoi", "t_total", "t_eoi", "states", "faults")
    by_name = {c["parameters"]["object"]: [c[figure] for figure in figures] for c in renamed}
    for candidate in json.loads(watched.out.replace("`wall`", "`shield`"))["candidates"]:
        name = candidate["parameters"]["object"]
        assert by_name[{"turned": "abc"}.get(name, name)] == [candidate[figure] for figure in figures]
