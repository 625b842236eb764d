"""Who is in the way of a target that never moves, and what is to be moved first."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.show.pictures import pictures
from sqrp_cli.show.sentences import part_shares_in_words, what_to_move
from sqrp_cli.sight.limits import Cause
from sqrp_cli.study.analysis import Analysis, analyse
from sqrp_cli.study.in_the_way import HiddenViews, hidden_views, in_the_way, to_move
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task

WATCH = Path(__file__).parents[1] / "cases" / "watch"
BAR = "  bar: {type: wall, size: [2 cm, 4 cm, 80 cm], pose: {position: [1.25, -0.45, 1]}, fixed: true}\n"
"""Before the middle of what the wall hides, half way from the camera."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    copy = Path(shutil.copytree(WATCH, tmp_path_factory.mktemp("way") / "watch"))
    text = (copy / "workspace.yaml").read_text(encoding="utf-8")
    (copy / "workspace.yaml").write_text(text.replace("  stray:", f"{BAR}  stray:"), encoding="utf-8")
    return copy


@pytest.fixture(scope="module")
def cell(folder: Path) -> Cell:
    return Cell.load(load_workspace(folder))


def watched(cell: Cell, task: str) -> Analysis:
    found = analyse(cell, read_task(task, cell.workspace).candidates[0], cell.initial_world, FixedCount(3), full=True)
    assert isinstance(found, Analysis)
    return found


@pytest.fixture(scope="module")
def behind(cell: Cell) -> Analysis:
    return watched(cell, "watch behind")


@pytest.fixture(scope="module")
def views(cell: Cell, behind: Analysis) -> HiddenViews:
    return hidden_views(cell, behind)


def test_each_hidden_box_has_the_parts_that_hide_it(cell: Cell, behind: Analysis, views: HiddenViews) -> None:
    observation = behind.timeline.observation
    hidden = {
        (column, number, *at)
        for column, boxes in enumerate(observation.full_matrix)
        for number, box in enumerate(boxes)
        for at in np.argwhere(observation.required[:, [column]] & (box.cause == Cause.HIDDEN)).tolist()
    }
    assert hidden == set(views)
    assert {tuple(part.name for part in parts) for view, parts in views.items() if view[0] == 0} == {("bar", "wall")}
    row = next(iter(views))[2]
    assert hidden_views(cell, behind, np.array([row])) == {view: hid for view, hid in views.items() if view[2] == row}


def test_the_bar_takes_its_share_from_the_wall_behind_it(cell: Cell, behind: Analysis, views: HiddenViews) -> None:
    for found in in_the_way(cell, behind, views):
        bar, wall = found.parts
        assert (bar.name, wall.name, found.camera) == ("bar", "wall", "eye")
        assert found.hidden == bar.share + wall.share == pytest.approx(1.0)
        # As slopes across: the bar's edges at 1.24 m and 1.26 m, those of the box without its skin likewise.
        width = 0.949 / 2.451 - 0.851 / 2.549
        if found.literal.startswith("in_place"):
            assert bar.share == pytest.approx((0.47 / 1.24 - 0.43 / 1.26) / width, abs=0.01)
        assert (bar.alone, wall.alone) == (0.0, pytest.approx(wall.share))


def test_the_object_is_to_be_moved_first_without_which_most_would_be_seen(
    cell: Cell, behind: Analysis, views: HiddenViews
) -> None:
    wall, bar = to_move(cell, behind, views)
    assert (wall.name, bar.name) == ("wall", "bar")
    assert wall.share + bar.share == pytest.approx(1.0)
    assert (wall.share, bar.alone) == (pytest.approx(wall.alone), 0.0)
    assert f"move wall first: of what is hidden meanwhile, {100 * wall.alone:.1f} % would" in what_to_move([wall, bar])
    assert what_to_move([bar]) == ""
    objects = cell.workspace.objects
    shelf = {**objects, "wall": replace(objects["wall"], fixed=True), "bar": replace(objects["bar"], on="wall")}
    on_a_shelf = replace(cell, workspace=replace(cell.workspace, objects=shelf))
    assert [one.name for one in to_move(on_a_shelf, behind, views)] == ["bar"]
    assert what_to_move([]) == ""
    seen = watched(cell, "watch seen")
    none = hidden_views(cell, seen)
    assert (none, in_the_way(cell, seen, none), to_move(cell, seen, none)) == ({}, (), ())


def test_explain_tells_it_in_text_document_and_pictures(
    folder: Path, cell: Cell, behind: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    explained = open_cell(folder).explain("watch behind")
    text = str(explained)
    assert "`in_place(behind)` holds  eye     100.0 %  bar " in text
    (first, _) = explained.to_move
    assert first.name == "wall"
    assert f"{100 * first.alone:.1f} % would be seen without it." in text.replace("\n", " ")
    lines: list[str] = []
    framed = pictures.framed
    monkeypatch.setattr(pictures, "framed", lambda *given: lines.extend(text for text, _ in given[1]) or framed(*given))
    pictures.write_pictures(cell, behind, tmp_path / "pictures")
    assert any(line.startswith("hidden 100.0 %: bar ") for line in lines)


def test_parts_beyond_the_third_count_together(views: HiddenViews) -> None:
    wall = next(iter(views.values()))[0]
    parts = [replace(wall, name=f"p{number}", share=0.1) for number in range(5)]
    assert part_shares_in_words(parts[:4]) == "p0 10.0 %, p1 10.0 %, p2 10.0 %, 1 other 10.0 %"
    assert part_shares_in_words(parts).endswith("2 others 20.0 %")
