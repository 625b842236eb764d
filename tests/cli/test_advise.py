"""`sqrp advise`: its document, what it writes, and its exit codes; checked with `rank`, `score` and a brute force."""

from __future__ import annotations

import json
import shutil
import signal
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cli.commands.tasks import write_change
from sqrp_cli.errors import InputError, bad_option
from sqrp_cli.geometry import look_at
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import plan_branches
from sqrp_cli.search import advise
from sqrp_cli.sight.observer import Observer
from sqrp_cli.study.analysis import analyse
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.timeline import observe
from sqrp_cli.task.grips import grips
from sqrp_cli.task.task import read_task
from tests.cells import copied, edit
from tests.cli.browser import Opened, carried
from tests.cli.conftest import press_ctrl_c
from tests.cli.test_document_schemas import assert_no_other_key_fits, validate

ROOT = Path(__file__).parents[2]
TABLETOP = ROOT / "workspaces" / "tabletop"
TASK = "pickup g1"


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The tabletop with its first three cameras, and all that it names."""
    return copied(tmp_path_factory.mktemp("cells"), camera="cam4")


@pytest.fixture
def own(small, tmp_path):
    """A copy of that, to be changed."""
    return shutil.copytree(small.parents[1], tmp_path, dirs_exist_ok=True) / "workspaces" / "tabletop"


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A folder of searches, for tests that are not about a search: a copy of the cell has the same digest."""
    return tmp_path_factory.mktemp("searches") / "kept"


@pytest.fixture(scope="module")
def advised(sqrp, small, kept):
    """The advice about g1 with its motion fixed."""
    kinds = ("--ways", "fastest", "--kinds", "way,aim,position")
    outcome = sqrp("advise", small, TASK, *kinds, "--json", "--jobs", 1, "--out", kept)
    assert outcome.code == 0
    return outcome.document


@pytest.fixture(scope="module")
def aims(kept):
    """The options of a command about other aims alone, which are searched for once."""
    return ("--ways", "fastest", "--kinds", "aim", "--jobs", 1, "--out", kept)


def test_the_document_says_what_was_asked_and_what_meets_it_the_least_changes_first(advised, sqrp, small):
    # The document says what was asked and what meets it.
    assert list(advised)[:8] == ["schema", "document", "workspace", "task", "want", "candidate", "way", "met"]
    assert (advised["workspace"], advised["task"]) == ("tabletop", TASK)
    assert advised["want"] == {"q_eoi": 1.0, "q_avg": None, "time": None, "delay": None}
    ranked = sqrp("rank", small, TASK, "--ways", "fastest", "--json").document["candidates"][0]
    assert {name: advised["before"][name] for name in ("q_eoi", "q_avg", "time")} == {
        name: ranked[name] for name in ("q_eoi", "q_avg", "time")
    }
    assert advised["before"]["delay_worst"] == max(fault["delay_worst"] for fault in ranked["faults"].values())
    for one in advised["advice"]:
        assert one["q_eoi"] == 1.0
        assert one["time"] == advised["before"]["time"]
        assert one["margin"]["more"] > 0
        assert set(one["worse"]) <= {task["task"] for task in one["tasks"]}
    assert advised["nearest"] is None
    kinds = {kind["kind"]: kind for kind in advised["kinds"]}
    assert kinds["way"]["why"] == "not tried, as the way is fixed"
    # Sizes are those of the changes and the least come first.
    for kind in ("aim", "position"):
        found = [one for one in advised["advice"] if one["kind"] == kind]
        assert found
        sizes = [one["size"] for one in found]
        assert sizes == sorted(sizes)
        for one in found:
            assert one["unit"] == {"aim": "rad", "position": "m"}[kind]
            assert np.linalg.norm(one["change"]) == pytest.approx(one["size"], rel=1e-6)
    # Cam1 moves at most as far as the best of many random offsets.
    cam1 = next(one for one in advised["advice"] if (one["kind"], one["target"]) == ("position", "cam1"))
    assert cam1["size"] <= 0.157


def test_what_it_costs_is_what_rank_says_of_the_changed_workspace(advised, sqrp, own):
    """Every figure of every changed candidate, from the workspace with the patch."""
    number = next(n for n, one in enumerate(advised["advice"]) if one["worse"])
    one = advised["advice"][number]
    apply_patch(own, one["patch"])
    effect = next(task for task in one["tasks"] if task["task"] == "pickup green")
    ranked = sqrp("rank", own, "pickup green", "--ways", "fastest", "--json").document
    now = {name(candidate): candidate for candidate in ranked["candidates"] if candidate["feasible"]}
    assert effect["candidates"]
    for changed in effect["candidates"]:
        for figure in ("q_eoi", "q_avg", "time"):
            assert changed["after"][figure] == pytest.approx(now[changed["candidate"]][figure], abs=1e-9)
    assert next(iter(now)) == effect["first_after"]


def name(candidate: dict) -> str:
    return candidate["parameters"]["object"]


def apply_patch(own: Path, patch: str) -> None:
    """Apply a patch with our own few lines, so that nothing of the package is in the way."""
    file = own / "workspace.yaml"
    text = file.read_text(encoding="utf-8")
    lines = [line for line in patch.splitlines()[2:] if line[0] in "+-"]
    old = "\n".join(line[1:] for line in lines if line[0] == "-")
    new = "\n".join(line[1:] for line in lines if line[0] == "+")
    if not old:  # something is added after the line that the patch shows last before it
        shown = patch.splitlines()
        old = shown[next(n for n, line in enumerate(shown) if n > 1 and line[0] == "+") - 1][1:]
        new = f"{old}\n{new}"
    assert text.count(old) >= 1
    file.write_text(new.join(text.rsplit(old, 1)), encoding="utf-8")


def test_alone_the_patch_is_of_the_first_change_that_has_one(small, tmp_path):
    found = open_cell(small).advise("pickup g3", ways="fastest", kinds=["aim"])
    first, *others = found.advice
    why = bad_option("the file of cam6 would have to say 1, 2 and 3")
    unwritten = replace(first, content=why, patch="", unwritten=why.problems[0].message)
    found = replace(found, advice=(unwritten, *others))
    file = tmp_path / "advice.patch"
    assert write_change(found, small, None, file) == f"change 2 is in {file}"
    assert file.read_text().endswith(found.advice[1].patch)
    with pytest.raises(InputError, match="would have to say"):
        write_change(found, small, 1, file)
    assert "No patch: the file of cam6 would have to say 1, 2 and 3." in str(replace(found, advice=(unwritten,)))


def test_where_the_time_is_missed_the_limit_is_the_motion(sqrp):
    """The figure from the document of `explain`, whose longest part it is."""
    command = ("advise", TABLETOP, "pickup g3", "--want", "time 5 s", "--kinds", "way", "--json")
    nearest = sqrp(*command).document["nearest"]
    way = [f"{name}={value}" for name, value in nearest["change"].items() if name not in ("object", "lift", "speed")]
    primitives = sqrp("explain", TABLETOP, f"pickup g3 {' '.join(way)}", "--json").document["primitives"]
    longest = max(primitives, key=lambda one: one["end"] - one["start"])
    seconds = longest["end"] - longest["start"]
    assert nearest["limit"] == f"its motion takes that long, {seconds:.1f} s of it {longest['does']}"


def test_the_number_of_processes_changes_nothing(sqrp, small, aims):
    command = ("advise", small, TASK, "--ways", "fastest", "--kinds", "aim", "--jobs", 2, "--json")
    assert sqrp("advise", small, TASK, *aims, "--json").out == sqrp(*command).out


def test_with_the_motion_free_another_way_comes_first_and_can_be_stated(sqrp, own, kept):
    outcome = sqrp("advise", own, TASK, "--kinds", "way", "--out", kept, "--json", "--apply", 1)
    assert outcome.code == 0
    document = outcome.document
    assert document["before"]["q_eoi"] == 0.0
    ranked = sqrp("rank", own, TASK, "--json").document["candidates"][0]
    for figure in ("q_eoi", "q_avg", "time"):
        assert document["best"][figure] == pytest.approx(ranked[figure], abs=1e-9)
    (way,) = document["advice"]
    assert (way["kind"], way["target"], way["q_eoi"], way["margin"]) == ("way", "g1", 1.0, None)
    stated = load_workspace(own).tasks
    assert stated[0].task == "pickup green"
    assert stated[1].min_q_eoi == 1.0
    assert "shoulder=left" in stated[1].task
    assert "lift" not in stated[1].task
    (only,) = sqrp("rank", own, stated[1].task, "--json").document["candidates"]
    for figure in ("q_eoi", "q_avg", "time"):
        assert only[figure] == pytest.approx(way[figure], abs=1e-9)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """Where the page about `others` is."""
    return tmp_path_factory.mktemp("advice") / "page.html"


@pytest.mark.trial
def test_a_delay_that_only_other_cameras_decide_has_an_answer(sqrp, tabletop):
    """The others see all of the event: the bound has nothing that the camera alone must see."""
    outcome = sqrp("advise", tabletop, "pickup g2", "--want", "delay 0.3 s", "--kinds", "lens", "--ways", "fastest")
    assert (outcome.code, "Nothing is enough; " in outcome.out) == (1, True)


def test_a_way_is_found_for_a_delay(sqrp):
    ways = all_ways("pickup g3")
    least = min(one.delay_worst for one in ways)
    goal = round(least + 0.001, 3)
    command = ("advise", TABLETOP, "pickup g3", "--kinds", "way", "--json", "--want")
    (way,) = sqrp(*command, f"delay {goal} s").document["advice"]
    assert way["delay_worst"] <= goal
    assert way["time"] == pytest.approx(min(one.time for one in ways if one.delay_worst <= goal), abs=1e-6)
    none = sqrp(*command, f"delay {least - 0.001} s")
    assert none.code == 1
    assert none.document["kinds"][0]["why"] == "none of 32 is enough"


def all_ways(task: str) -> list[CandidateResult]:
    """The figures of every way of the only candidate of a task of the tabletop, from its grips and branches."""
    cell = Cell.load(load_workspace(TABLETOP))
    (candidate,) = read_task(task, cell.workspace).candidates
    found = []
    for grip in grips(cell, candidate, cell.initial_world):
        branches = plan_branches(grip, cell.initial_world, cell.collision, cell.seed)
        for branch, _ in branches.feasible:
            way = replace(grip, branch=branch)
            found.append(analyse(cell, way, cell.initial_world, Adaptive(), full=False).result)
    return found


@pytest.fixture(scope="module")
def others(sqrp, small, page):
    """What else would let g3 be seen, with its page."""
    command = ("advise", small, "pickup g3", "--ways", "fastest", "--kinds", "object,lens,camera", "--json")
    outcome = sqrp(*command, "--jobs", 1, "--report", page)
    assert outcome.code == 0
    assert outcome.err.endswith(f"open {page} in a browser\n")
    return outcome.document


@pytest.mark.parametrize("kind", ["object", "lens", "camera", "aim", "position"])
def test_every_kind_of_change_meets_the_goal_once_it_is_in_the_file(sqrp, advised, others, own, kind):
    """Ranked again with the patch; ways and paths are, too, where they are stated below."""
    document = advised if kind in ("aim", "position") else others
    one = next(one for one in document["advice"] if one["kind"] == kind)
    apply_patch(own, one["patch"])
    task = ("rank", own, document["task"], "--ways", "fastest", "--json")
    (candidate,) = sqrp(*task).document["candidates"]
    for figure in ("q_eoi", "q_avg", "time"):
        assert candidate[figure] == pytest.approx(one[figure], abs=1e-6)
    assert candidate["q_eoi"] == 1.0
    assert sqrp("check", own).code == 0


def test_documents_fit_their_schema_and_a_moved_part_stays_on_its_table(advised, others):
    # Documents of every kind of change fit their schema.
    for document in (advised, others):
        validate(document, "advise")
        assert_no_other_key_fits(document, "advise")
    # A moved part stays on its table.
    one = next(one for one in others["advice"] if one["kind"] == "object")
    assert (one["target"], one["change"][2]) == ("g3", 0.0)
    assert np.linalg.norm(one["change"]) == pytest.approx(one["size"])


def test_the_page_has_a_row_as_it_is_and_one_for_each_change(others, page):
    overview = carried(page, "overview")
    assert overview["title"] == "What would help: pickup g3 in tabletop"
    count = len(others["advice"])
    assert overview["summary"] == f"g3 is to have critical time seen 100 %: {count} changes meet it, each on its own."
    rows = overview["entries"]
    assert [row["labels"] for row in rows] == [
        {"change": "as it is", "kind": ""},
        *({"change": one["words"], "kind": one["kind"]} for one in others["advice"]),
    ]
    assert [row["mark"] for row in rows] == ["", *(f"#{number}" for number in range(1, count + 1))]
    assert rows[0]["reasons"] == [f"critical time seen {100 * others['before']['q_eoi']:.1f} %, not 100 %"]
    for row, one in zip(rows, [others["before"], *others["advice"]], strict=True):
        for figure in ("q_eoi", "q_avg", "time"):
            assert row["candidate"][figure] == pytest.approx(one[figure], abs=1e-6)
        assert row["candidate"]["verdict"]
        worst = max(fault["delay_worst"] for fault in row["candidate"]["faults"].values())
        assert worst == pytest.approx(one["delay_worst"], abs=1e-6)
    for row, one in zip(rows[1:], others["advice"], strict=True):
        assert len(row["reasons"]) == len(one["worse"])
        for reason, task in zip(row["reasons"], one["worse"], strict=True):
            assert reason.startswith("makes worse: ")
            assert reason.endswith(f" in {task}")


LOOK_AT_OF_CAM6 = "look_at: [0.334, 0.25, 0.421]"
TOO_LITTLE = "look_at: [0.334, 0.252, 0.4014]"
"""Turned by 1.0 degrees: enough for g3 by the samples of `rank`, but not by the finer ones of `explain`."""


@pytest.mark.slow
def test_no_command_contradicts_an_advice(sqrp, own):
    """Where a smaller turn of cam6 would satisfy `rank` alone."""
    command = ("rank", own, "pickup g3", "--ways", "fastest", "--json")
    explain = ("explain", own, "pickup g3", "--ways", "fastest", "--json")
    file = own / "workspace.yaml"
    shutil.copy(TABLETOP / "workspace.yaml", file)
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace(LOOK_AT_OF_CAM6, TOO_LITTLE), encoding="utf-8")
    assert sqrp(*command).document["candidates"][0]["q_eoi"] == 1.0
    assert sqrp(*explain).document["q_eoi"] < 1.0
    task = "{task: pickup g3, min_q_eoi: 1.0}"
    file.write_text(text.replace("{task: pickup green, min_q_eoi: 0.5}", task), encoding="utf-8")
    advise = ("advise", own, "pickup g3", "--ways", "fastest", "--kinds", "aim", "--json", "--jobs", 1)
    first = sqrp(*advise, "--apply", 1).document["advice"][0]
    assert first["target"] == "cam6"
    assert np.degrees(first["size"]) < 1.2
    assert sqrp(*command).document["candidates"][0]["q_eoi"] == 1.0
    assert sqrp(*explain).document["q_eoi"] == 1.0
    assert sqrp("score", own, "--jobs", 1).code == 0


def test_the_page_says_where_its_finer_timeline_misses_a_goal_that_is_met(sqrp, own, tmp_path):
    """Against the share of the timeline that the page plays."""
    page = tmp_path / "page.html"
    shutil.copy(TABLETOP / "workspace.yaml", own)
    edit(own, LOOK_AT_OF_CAM6, TOO_LITTLE)
    outcome = sqrp("advise", own, "pickup g3", "--ways", "fastest", "--want", "q_eoi 100 %", "--report", page)
    assert "nothing has to change" in outcome.out
    (row,) = carried(page, "overview")["entries"]
    share = carried(page, "detail-0")["q_eoi"]
    assert share < 1
    reason = f"critical time seen {100 * share:.1f} %, not 100 %, if sampled as finely as the timeline below"
    assert row["reasons"] == [reason]


@pytest.mark.parametrize("kind", [None, "object", "lens", "camera"])
def test_every_row_of_the_page_plays_in_the_cell_that_the_patch_makes(sqrp, others, page, own, kind):
    """Cameras, and where objects are as it begins, against the workspace with the patch."""
    row = 0
    if kind is not None:
        row = 1 + [one["kind"] for one in others["advice"]].index(kind)
        apply_patch(own, others["advice"][row - 1]["patch"])
    cell = sqrp("show", own, "--json").document
    overview, played = carried(page, "overview"), carried(page, f"detail-{row}")
    cameras = overview["scenes"][overview["entries"][row]["scene"]]["cameras"]
    assert list(cameras) == list(cell["cameras"]) == list(played["cameras"])
    for camera in cameras:
        for field in ("pose", "K"):
            np.testing.assert_allclose(cameras[camera][field], cell["cameras"][camera][field], rtol=1e-6, atol=2e-6)
    starts = {**played["still"], **played["samples"][0]["objects"]}
    for thing, pose in starts.items():
        np.testing.assert_allclose(pose, cell["objects"][thing]["pose"], atol=2e-6)
    assert carried(page, f"model-{overview['entries'][row]['scene']}") == carried(page, "model-0")


def test_the_page_shows_the_changed_camera_and_the_moved_part(browser, others, page):
    opened = Opened(browser, page)
    assert opened.texts("#name") == ["as it is"]
    assert opened.texts("#views button") == ["look around", "cam1", "cam2", "cam3"]
    for one in others["advice"]:
        opened.page.locator("#ranking button", has_text=one["words"]).click()
        opened.page.wait_for_function(
            "words => document.querySelector('#name').textContent === words && sqrp.motion", arg=one["words"]
        )
        added = [one["target"]] if one["kind"] == "camera" else []
        assert opened.texts("#views button") == ["look around", "cam1", "cam2", "cam3", *added]
        assert opened.page.locator("#view canvas").count() == 1
        assert opened.texts("#place") == [opened.texts("#ranking tr[aria-selected=true] .mark")[0]]
    assert opened.complaints == []
    assert opened.requests == [page.as_uri()]
    opened.context.close()


@pytest.mark.usefixtures("heeded_ctrl_c")
def test_an_interrupted_search_goes_on_with_the_kinds_that_are_missing(sqrp, watch, tmp_path, monkeypatch):
    """With the same bytes as without; damaged files are searched again, and other goals are others."""
    searched, search = [], advise._outcome
    stop: list[str] = ["lens"]

    def watched(question, kind):
        if kind in stop:
            signal.raise_signal(signal.SIGINT)
        searched.append(kind)
        return search(question, kind)

    monkeypatch.setattr(advise, "_outcome", watched)
    command = ("advise", watch, "watch behind", "--kinds", "object,aim,lens", "--json", "--out", tmp_path / "kept")
    first = sqrp(*command)
    assert (first.code, searched) == (130, ["object", "aim"])
    assert [one["kind"] for one in first.document["kinds"]] == ["object", "aim"]
    stop.clear()
    second = sqrp(*command)
    assert (second.code, searched) == (0, ["object", "aim", "lens"])
    again = sqrp(*command)
    assert again.out == second.out
    assert searched == ["object", "aim", "lens"]
    files = sorted((tmp_path / "kept").glob("*/*.json"))
    assert len(files) == 3
    files[0].write_text("[]", encoding="utf-8")
    files[1].write_text(files[1].read_text(encoding="utf-8").replace("behind", "cube"), encoding="utf-8")
    files[2].write_bytes(files[2].read_bytes()[:-40])
    searched.clear()
    assert sqrp(*command).out == second.out
    assert searched == ["object", "aim", "lens"]
    searched.clear()
    assert sqrp(*command, "--want", "q_eoi 99 %", "--kinds", "object").code == 0
    assert searched == ["object"]


@pytest.mark.slow
def test_ways_paths_and_what_comes_nearest_are_kept_to_the_last_digit(sqrp, tmp_path, monkeypatch):
    """The same output and page, with nothing searched; the page plays the kept path."""
    page = tmp_path / "page.html"
    command = ("advise", TABLETOP, "pickup g4", "--want", "q_avg 95 %", "--kinds", "way,path", "--json")
    command = (*command, "--jobs", 1, "--out", tmp_path / "kept", "--report", page)
    first, written = sqrp(*command), page.read_bytes()
    assert [one["found"] for one in first.document["kinds"]] == [0, 1]
    assert first.document["kinds"][0]["nearest"]["missing"]
    assert carried(page, "detail-1")["q_avg"] >= 0.95
    monkeypatch.setattr(advise, "_outcome", lambda *_: pytest.fail("it is searched again"))
    assert sqrp(*command).out == first.out
    assert page.read_bytes() == written
    assert len(list((tmp_path / "kept").glob("*/*.json"))) == 2


@pytest.mark.usefixtures("heeded_ctrl_c")
def test_ctrl_c_while_the_page_is_written_keeps_the_advice_and_writes_nothing(sqrp, own, tmp_path, monkeypatch):
    monkeypatch.setattr("sqrp_cli.show.pages.search_pages.write_advice", press_ctrl_c)
    page, before = tmp_path / "page.html", (own / "workspace.yaml").read_bytes()
    outcome = sqrp("advise", own, TASK, "--kinds", "way", "--report", page, "--apply", 1)
    assert outcome.code == 130
    assert "Do g1 (shoulder left, wrist flipped)." in outcome.out
    assert outcome.err.endswith(f"interrupted before {page} was written\n")
    assert not page.exists()
    assert (own / "workspace.yaml").read_bytes() == before


@pytest.mark.slow
def test_paths_that_keep_sight_are_stated_by_the_task(sqrp, own):
    shutil.copy(TABLETOP / "workspace.yaml", own / "workspace.yaml")
    command = ("advise", own, "pickup g4", "--want", "q_avg 95 %", "--kinds", "path", "--json", "--apply", 1)
    outcome = sqrp(*command)
    assert outcome.code == 0
    (path,) = outcome.document["advice"]
    assert path["kind"] == "path"
    assert path["q_avg"] >= 0.95
    stated = load_workspace(own).tasks[1]
    assert stated.task == "pickup g4 path=seen"
    (only,) = sqrp("rank", own, stated.task, "--json").document["candidates"]
    assert only["q_avg"] == pytest.approx(path["q_avg"], abs=1e-9)


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.trial)])
def test_no_point_of_a_fine_grid_is_nearer(advised, every):
    """Brute force: the exact timeline with cam1 at every so manieth point of a 1 cm grid, its aim kept."""
    cam1 = next(one for one in advised["advice"] if (one["kind"], one["target"]) == ("position", "cam1"))
    cell = Cell.load(load_workspace(TABLETOP))
    found = analyse(cell, read_task(TASK, cell.workspace).candidates[0], cell.initial_world, Adaptive(), full=False)
    camera = cell.workspace.cameras["cam1"]
    others = [other for other in cell.observer.cameras if other.name != "cam1"]
    nearer = []
    for step in product(range(-16, 17, every), repeat=3):
        offset = 0.01 * np.array(step, dtype=float)
        if 0 < np.linalg.norm(offset) <= 0.95 * cam1["size"]:
            X_FC = look_at(camera.X_FC[:3, 3] + offset, (-0.31, -0.027, 0.245))
            observer = Observer((replace(camera, X_FC=X_FC), *others), cell.observer.solids)
            timeline = observe(replace(found.planned, faults={}), observer, Adaptive(), full=False)
            if timeline.qualities.q_eoi == 1.0:
                nearer.append(offset.tolist())
    assert not nearer, json.dumps(nearer)
