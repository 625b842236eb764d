"""Laws of delays in cells made by seed, with cameras on the wrist and tasks of two steps among them."""

from __future__ import annotations

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import FaultMetrics
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import pose
from sqrp_cli.motion.cell import Cell
from sqrp_cli.study import drop_detection
from sqrp_cli.study.analysis import Analysis, analysed
from sqrp_cli.study.drop_detection import least_delays
from sqrp_cli.study.find import WantedWay, find_way
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.whole_analysis import WholeAnalysis, whole_analysis
from sqrp_cli.task.task import read_task
from tests.cells import read_cell, shipped_cell, write_cell
from tests.random_cell import Crowd, random_cell

CELLS = (3, 5, *(pytest.param(seed, marks=pytest.mark.trial) for seed in range(10, 30)))

HAND = {
    "frame": "flange", "pose": {"position": [0.12, 0.0, 0.0], "look_at": [0.0, 0.0, 0.14], "up": [1, 0, 0]},
    "image": {"width": 640, "height": 480, "horizontal_fov": "80 deg"}, "near": 0.03, "far": 2.0,
    "rate": 30, "latency": 0.2,
}  # fmt: skip


@pytest.fixture(scope="module", params=[*CELLS, "two steps"])
def studied(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Cell, list[Analysis]]:
    """A cell, and ways in it."""
    tmp_path = tmp_path_factory.mktemp("cells")
    if request.param == "two steps":
        document = shipped_cell("tabletop")
        document["cameras"]["cam2"].update(rate=25, latency=0.02)
        write_cell(document, tmp_path)
        cell = Cell.load(load_workspace(tmp_path))
        candidates = read_task("pickup g2 then place g2 crate along=0 across=0", cell.workspace).candidates
        whole = whole_analysis(cell, candidates[0], cell.initial_world, Adaptive(), full=False)
        assert isinstance(whole, WholeAnalysis)
        return cell, list(whole.steps)
    folder = random_cell(tmp_path / "cell", Crowd(request.param, 6, 3))
    document = read_cell(folder)
    rng = np.random.default_rng(request.param)
    for camera in document["cameras"].values():
        camera.update(rate=float(rng.choice([10, 25])), latency=float(rng.choice([0.02, 0.08])))
    document["cameras"]["hand"] = HAND
    write_cell(document, folder)
    cell = Cell.load(load_workspace(folder))
    return cell, _studies(cell, "pickup", 4)


def _studies(cell: Cell, task: str, most: int) -> list[Analysis]:
    candidates = read_task(task, cell.workspace).candidates[:most]
    found = [find_way(cell, one, cell.initial_world, Adaptive(), WantedWay(fastest=True)) for one in candidates]
    return [way.analysis for way in found if not isinstance(way, Infeasible)]


def figures(analysis: Analysis) -> dict[str, FaultMetrics]:
    return dict(analysis.result.faults)


def test_no_fault_is_noticed_sooner_than_the_fastest_camera_tells(studied: tuple[Cell, list[Analysis]]) -> None:
    cell, analyses = studied
    least = min(camera.latency for camera in cell.observer.cameras)
    assert any(figures(analysis) for analysis in analyses)
    for analysis in analyses:
        for fault, found in figures(analysis).items():
            assert found.delay_mean is None or found.delay_mean >= least
            assert found.delay_worst is None or found.delay_worst >= least
            for onset in analysis.onsets[fault]:
                assert (onset.shown >= onset.x).all()
                assert (onset.as_usual.shown >= onset.x).all()
            assert {one.lag for one in analysis.windows[fault]} <= {camera.latency for camera in cell.observer.cameras}


def test_what_hides_more_makes_no_delay_shorter(studied: tuple[Cell, list[Analysis]]) -> None:
    cell, analyses = studied
    others = {solid.part.parent for solid in cell.observer.solids if solid.movable}
    for analysis in analyses[:2]:
        with_all, handled = figures(analysis), set(analysis.planned.candidate.binding.values())
        for name in sorted(others - handled)[:4]:
            solids = tuple(one for one in cell.observer.solids if one.part.parent != name)
            freer = replace(cell, observer=replace(cell.observer, solids=solids))
            for fault, less in figures(analysed(freer, analysis.planned, Adaptive(), full=False)).items():
                more = with_all[fault]
                assert less.unseen <= more.unseen + 1e-6
                if more.delay_worst is not None and more.delay_mean is not None:
                    assert less.delay_worst is not None and less.delay_mean is not None  # noqa: PT018
                    assert less.delay_worst <= more.delay_worst + 2e-3  # instants at which sights change are bisected
                    assert less.delay_mean <= more.delay_mean + 2e-3


@pytest.mark.parametrize("at", [(0.4, 0.0, -0.5), (0.4, 0.0, 30.0)], ids=["below the table", "out of range"])
def test_a_camera_that_sees_nothing_changes_no_delay(
    studied: tuple[Cell, list[Analysis]], at: tuple[float, float, float]
) -> None:
    cell, analyses = studied
    down = np.diag([1.0, -1.0, -1.0])
    X_WC = pose(np.eye(3) if at[2] < 0 else down, np.array(at))
    blind = replace(cell.observer.cameras[0], name="blind", frame=WORLD, X_FC=X_WC, rate=2.0, latency=0.5)
    more = cell.with_cameras_of(replace(cell.workspace, cameras={**cell.workspace.cameras, "blind": blind}))
    for analysis in analyses[:2]:
        with_it = analysed(more, analysis.planned, Adaptive(), full=False)
        for fault, known in figures(analysis).items():
            found = figures(with_it)[fault]
            for name in ("delay_mean", "delay_worst", "unseen"):  # instants at which sights change are bisected
                assert getattr(found, name) == pytest.approx(getattr(known, name), abs=2e-3), name
            assert all(
                one.shown == pytest.approx(was.shown, abs=1e-6)
                for one, was in zip(with_it.onsets[fault], analysis.onsets[fault], strict=True)
            )


def test_no_delay_is_shorter_than_each_camera_needs_by_itself(studied: tuple[Cell, list[Analysis]]) -> None:
    """`place` looks at many cameras together of which few are chosen, of several rates."""
    observer, response = studied[0].observer, min(camera.response for camera in studied[0].observer.cameras)
    for analysis in studied[1][:2]:
        least = least_delays(analysis.planned, observer, response)
        worst = max(inf if one.delay_worst is None else one.delay_worst for one in figures(analysis).values())
        assert worst >= least.max() - 1e-9
        for camera, known in zip(observer.cameras, least, strict=True):
            with_slow = replace(observer, cameras=(camera, replace(camera, rate=0.5)))
            assert least_delays(analysis.planned, with_slow, response)[0] == pytest.approx(known, abs=1e-9)


def test_what_is_dropped_falls_onto_the_table_or_what_stands_there(
    studied: tuple[Cell, list[Analysis]], monkeypatch: pytest.MonkeyPatch
) -> None:
    drops, falling = [], drop_detection._falling
    monkeypatch.setattr(drop_detection, "_falling", lambda *a: drops.append(falling(*a)) or drops[-1])
    for analysis in studied[1]:
        analysed(studied[0], analysis.planned, Adaptive(), full=False)
    assert drops
    for drop in drops:
        assert drop[2].min() > 0.015  # tables end at z = 0, and no part is flatter than 3 cm
        assert (np.diff(drop[..., -10:], axis=2) == 0.0).all()


def test_no_drop_between_those_followed_is_shown_later_than_promised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this cell a camera sees the place of the part only at some times while it is lifted."""
    folder = random_cell(tmp_path / "cell", Crowd(13, 12, 4))
    document, rng = read_cell(folder), np.random.default_rng(13)
    for camera in document["cameras"].values():
        camera.update(rate=float(rng.choice([10, 25])), latency=0.05)
    document["cameras"] = {name: document["cameras"][name] for name in list(document["cameras"])[:1]} | {"hand": HAND}
    write_cell(document, folder)
    cell = Cell.load(load_workspace(folder))
    (analysis,) = _studies(cell, "pickup g3", 1)
    monkeypatch.setattr(drop_detection, "_STEP", 0.01)
    (promised,), (true,) = (
        analysis.onsets["slip"],
        analysed(cell, analysis.planned, Adaptive(), full=False).onsets["slip"],
    )
    x = np.linspace(promised.x[0], promised.x[-1], 400)
    assert (np.interp(x, promised.x, promised.shown) >= np.interp(x, true.x, true.shown) - 0.02).all()
