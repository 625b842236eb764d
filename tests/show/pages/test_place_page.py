"""The page of `sqrp place`: what it says of mounts and cameras is what the definitions give, and it shows it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli import open_cell
from sqrp_cli.ask.values import silent
from sqrp_cli.camera.camera import Camera
from sqrp_cli.files.entries import from_fields
from sqrp_cli.geometry import look_at
from sqrp_cli.show.pages.search_pages import write_placement
from sqrp_cli.sight.observer import Observer
from sqrp_cli.study.analysis import analyse
from sqrp_cli.study.sampling import Adaptive
from tests.cli.browser import Opened, carried

TABLETOP = Path(__file__).parents[3] / "workspaces" / "tabletop"

AIM = (0.35, 0.1, 0.15)
"""Where every camera looks: not quite at the middle, so that one is not enough [m]."""

MOUNTS = f"""
mounts:
  rail: {{rail: {{from: [-0.6, 0.9, 0.6], to: [0.6, 0.9, 0.6], step: 60 cm}}, aims: {{at: [{list(AIM)}]}}}}
  high: {{points: [[0.2, -0.3, 1.5], [0.6, -0.6, 0.9]], aims: {{at: [{list(AIM)}]}}}}
  inside: {{points: [[0, 0, -0.01]]}}
lenses:
  tele: {{image: {{width: 640, height: 480, horizontal_fov: 16 deg}}, near: 20 cm, far: 4 m, rate: 10 Hz, price: 100}}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("place")


@pytest.fixture(scope="module")
def placed(folder):
    """Two cameras for one candidate, and one that cannot be done."""
    (folder / "place.yaml").write_text(MOUNTS)
    cell = open_cell(TABLETOP)
    return cell.place("pickup g3", "pickup g6", cameras=2, ways="fastest", mounts=folder / "place.yaml")


@pytest.fixture(scope="module")
def written(placed, folder) -> Path:
    path = folder / "page.html"
    arguments = ["place", "tabletop", "--report", "page.html"]
    write_placement(placed, path, arguments=arguments, jobs=1, progress=silent)
    return path


@pytest.fixture(scope="module")
def overview(written) -> dict:
    return carried(written, "overview")


def test_every_mount_is_as_good_as_a_cell_with_one_camera_there(placed, overview):
    """Within what samples may miss."""
    found, shown = placed, {mount["name"]: mount for mount in overview["placement"]["mounts"]}
    mounts, (one,) = found.question.mounts, found.candidates
    lens = next(iter(mounts.lenses.values()))
    assert list(shown) == [site.name for site in mounts.sites]
    assert shown["inside"]["seen"] is None
    for site in mounts.sites[:-1]:
        camera = from_fields(
            Camera,
            lens,
            lens.image.intrinsics(),
            name="alone",
            frame="world",
            X_FC=look_at(site.position, AIM),
        )
        cell = replace(found.cell, observer=Observer((camera,), found.cell.observer.solids))
        exact = analyse(cell, one.found.way, found.question.world, Adaptive(), full=False).result
        assert shown[site.name]["seen"] == pytest.approx(np.mean([exact.q_eoi, exact.q_avg]), abs=0.01)
    seen = {round(mount["seen"], 1) for mount in overview["placement"]["mounts"][:-1]}
    assert len(seen) > 2, "else the comparison would say little"


def test_the_proof_stands_above_everything_and_the_cameras_are_those_of_the_document(placed, overview):
    document = placed
    assert document.proof in overview["summary"]
    shown = overview["placement"]["cameras"]
    assert [(one["name"], one["mount"]) for one in shown] == [(one.name, one.mount) for one in document.cameras]
    at = {mount["camera"]: mount["name"] for mount in overview["placement"]["mounts"] if mount["camera"]}
    assert at == {one.name: one.mount for one in document.cameras}
    assert set(overview["scenes"][0]["cameras"]) == set(at)


def test_rows_have_the_figures_of_the_document_and_say_what_cannot_be_done(placed, overview):
    done, not_done = overview["entries"]
    (figures,) = placed.candidates
    assert (done["candidate"]["q_eoi"], done["candidate"]["q_avg"]) == pytest.approx((figures.q_eoi, figures.q_avg))
    assert done["labels"] == {"candidate": "g3", "task": "pickup g3"}
    assert not done["candidate"]["pareto"]
    assert not not_done["moves"]
    assert not_done["reasons"][0].replace("approach (a1)", "a1") == placed.infeasible[0].reason


def test_playback_shows_the_chosen_cameras_and_their_coverage(placed, written):
    played = carried(written, "detail-0")
    assert set(played["cameras"]) == {one.name for one in placed.cameras}
    covered = [sample["covered"] for sample in played["samples"]]
    t = np.array([sample["t"] for sample in played["samples"]])
    runs = [b - a for a, b, x, y in zip(t, t[1:], covered, covered[1:], strict=False) if x and y]
    assert sum(runs) / placed.candidates[0].found.t_total == pytest.approx(placed.candidates[0].q_avg, abs=5e-3)


def test_a_placement_without_any_camera_has_a_page_too(folder, browser):
    file = folder / "blind.yaml"
    file.write_text(MOUNTS.replace("20 cm, far: 4 m", "1 cm, far: 2 cm"))
    blind = open_cell(TABLETOP).place("pickup g3", cameras=2, ways="fastest", mounts=file)
    assert not blind.cameras
    assert not blind.met
    assert blind.reason == "none of them would see anything that matters"
    page = folder / "blind.html"
    write_placement(blind, page, arguments=["place"], jobs=1, progress=silent)
    assert blind.reason in carried(page, "overview")["summary"]
    (entry,) = carried(page, "overview")["entries"]
    assert entry["candidate"]["q_avg"] == 0.0
    opened = Opened(browser, page)
    assert opened.texts("#cameras") == ["None: no camera on these mounts would help."]
    assert opened.complaints == []
    opened.context.close()


def test_a_browser_shows_mounts_cameras_and_coverage_and_says_what_a_mount_sees(written, overview, browser):
    opened = Opened(browser, written)
    names = [one["name"] for one in overview["placement"]["cameras"]]
    assert opened.texts("#cameras tbody tr td:first-child") == names
    assert opened.page.locator("#ranking .brief .run").count() > 0
    best = max(overview["placement"]["mounts"][:-1], key=lambda mount: mount["seen"])
    opened.page.locator("#view").scroll_into_view_if_needed()
    tip = opened.js(POINT_AT, best["name"])
    assert f"{100 * best['seen']:.1f} %" in tip
    assert "in the way" in opened.js(POINT_AT, "inside")
    opened.page.locator("#cameras tbody button").first.click()
    assert opened.js("sqrp.scene.through") == names[0]
    assert not opened.js("sqrp.scene.mounts.groups[0].mesh.visible")
    assert (opened.complaints, [url for url in opened.requests if not url.startswith(("file:", "blob:"))]) == (
        [],
        [],
    )
    opened.context.close()


POINT_AT = """(name) => {
  const { mounts, eye, host } = sqrp.scene, { left, top, width, height } = host.getBoundingClientRect();
  const place = mounts.positions()[mounts.places.findIndex((place) => place.name === name)].project(eye);
  return mounts.at(left + ((place.x + 1) / 2) * width, top + ((1 - place.y) / 2) * height);
}"""
"""What is said where a mount is drawn."""
