"""`sqrp place`: its document, its patch, which `score` agrees with, and its exit codes."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
MOUNTS = """
mounts:
  ceiling: {grid: {from: [-0.9, -1, 1.4], to: [0.6, 1, 1.4], step: 1 m}}
  rail: {rail: {from: [-0.9, 1.1, 0.5], to: [1.0, 1.1, 0.5], step: 50 cm}, price: 40}
lenses:
  tele: {image: {width: 640, height: 480, horizontal_fov: 12 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, price: 100}
  wide: {catalogue: realsense-d435-color, price: 300}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two candidates of `tabletop`, with few mounts."""
    folder = tmp_path_factory.mktemp("place")
    for name in ("workspaces", "skills"):
        shutil.copytree(ROOT / name, folder / name)
    cell = folder / "workspaces" / "tabletop"
    text = (cell / "workspace.yaml").read_text()
    (cell / "workspace.yaml").write_text(text.replace("{task: pickup green,", "{task: 'pickup object=g2,g3',"))
    (cell / "place.yaml").write_text(MOUNTS)
    return folder


@pytest.fixture(scope="module")
def cell(folder) -> Path:
    return folder / "workspaces" / "tabletop"


def test_score_of_the_patched_workspace_says_the_same(sqrp, cell, tmp_path, monkeypatch):
    monkeypatch.chdir(cell)
    patch = tmp_path / "cameras.patch"
    found = sqrp("place", cell, "--cameras", "2", "--patch", patch, "--json").document
    assert found["gap"] == 0
    assert found["proven"]
    assert found["mounts"] == 10
    assert found["bound"] == pytest.approx(found["objective"])
    target = tmp_path / "patched"
    shutil.copytree(cell.parents[1], target)
    there = target / "workspaces" / "tabletop"
    subprocess.run([shutil.which("patch") or "patch", "-p0", "-i", patch], cwd=there, check=True, capture_output=True)
    ranked = sqrp("rank", there, "pickup object=g2,g3", "--json").document["candidates"]
    by_name = {one["parameters"]["object"]: one for one in ranked}
    for one in found["candidates"]:
        for figure in ("q_eoi", "q_avg", "time"):
            assert one[figure] == pytest.approx(by_name[one["candidate"]][figure], abs=1e-9)
    shown = sqrp("show", there, "--json").document["cameras"]
    assert sorted(shown) == [camera["name"] for camera in found["cameras"]]
    for camera in found["cameras"]:
        assert np.allclose(shown[camera["name"]]["pose"], camera["pose"], atol=1e-6)


def test_the_answer_does_not_depend_on_processes_and_is_kept(sqrp, cell, tmp_path):
    one = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "1").out
    kept = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "2", "--out", tmp_path).out
    files = {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/*.json")}
    again = sqrp("place", cell, "--cameras", "2", "--json", "--jobs", "1", "--out", tmp_path).out
    assert one == kept == again
    assert files
    assert files == {file: file.stat().st_mtime_ns for file in tmp_path.glob("*/*.json")}


def test_the_table_of_a_saved_result_is_that_of_the_command(sqrp, cell, tmp_path):
    command = ("place", cell, "pickup g2", "--cameras", "2", "--survive", "1", "--ways", "fastest")
    saved = tmp_path / "place.json"
    saved.write_text(sqrp(*command, "--json").out)
    assert sqrp("show", saved).out == sqrp(*command).out


def test_a_camera_that_stays_is_not_moved(sqrp, cell):
    found = sqrp("place", cell, "--cameras", "1", "--keep", "cam2", "--json").document
    assert found["keep"] == ["cam2"]
    assert "-  cam1:" in found["patch"]
    assert "-  cam2:" not in found["patch"]


RAILS = """
mounts:
  left: {rail: {from: [-0.9, 1.15, 0.9], to: [0.9, 1.15, 0.9], step: 30 cm}}
  right: {rail: {from: [-0.9, -1.15, 0.9], to: [0.9, -1.15, 0.9], step: 30 cm}}
lenses:
  lens: {image: {width: 640, height: 480, horizontal_fov: 34 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, latency: 50 ms}
"""


@pytest.fixture
def occupied(tmp_path) -> Path:
    """`tabletop` with a camera on a rail that looks away."""
    for name in ("workspaces", "skills"):
        shutil.copytree(ROOT / name, tmp_path / name)
    file = tmp_path / "workspaces" / "tabletop" / "workspace.yaml"
    old = "position: [-0.099, 0.711, 1.162], look_at: [-0.31, -0.027, 0.245]"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, "position: [-0.112, 1.15, 0.9], look_at: [-0.112, 3, 0.9]"))
    (file.parent / "place.yaml").write_text(RAILS)
    return file.parent


@pytest.mark.parametrize("most", [3.0, 0.586])
def test_a_moved_camera_is_beside_those_that_stay_and_no_later_than_wished(sqrp, occupied, most):
    """The best place is that of the camera that stays; the next best shows a fault after 0.5866 s."""
    found = sqrp("place", occupied, "--keep", "cam1", "--want", f"q_avg 60 %, delay {most} s", "--json")
    assert found.code == 0
    for camera in found.document["cameras"]:
        assert np.linalg.norm(np.array(camera["pose"])[:3, 3] - [-0.112, 1.15, 0.9]) >= 0.08
    assert found.document["delay_worst"] <= most


def test_no_camera_is_put_where_one_stays(sqrp, occupied):
    (occupied / "place.yaml").write_text(
        RAILS[: RAILS.index("  left")] + "  p: {points: [[-0.112, 1.15, 0.9]]}\n" + RAILS[RAILS.index("lenses") :]
    )
    found = sqrp("place", occupied, "pickup g2", "--ways", "fastest", "--keep", "cam1", "--cameras", "1")
    assert found.code == 1
    assert "a camera there would touch `cam1`, which stays." in " ".join(found.out.split())


def test_where_the_least_stays_0_the_mean_is_said_to_have_decided(sqrp, occupied):
    found = sqrp("place", occupied, "--cameras", "2", "--ways", "fastest")
    assert "do better than a least Q of 0.0 %" in " ".join(found.out.split())
    assert "(gap 0), so that the mean decided." in " ".join(found.out.split())


@pytest.mark.parametrize("wish", [["--want", "q_eoi 100 %"], ["--cameras", "2"]])
def test_a_budget_below_the_cheapest_cameras_is_refused_before_anything_is_planned(sqrp, cell, monkeypatch, wish):
    monkeypatch.setattr("sqrp_cli.search.visibility_table.VisibilityTable.plan", None)
    poor = sqrp("place", cell, *wish, "--budget", "190", "--json")
    assert (poor.code, poor.out) == (2, "")
    assert "the cheapest two cameras cost 200, --budget is 190" in poor.err
    assert "--budget 200" in poor.err


def test_where_the_cameras_that_stay_may_be_enough_a_small_budget_has_a_result(sqrp, cell):
    keep = ["--keep", "cam1", "--keep", "cam2"]
    kept = sqrp(
        "place", cell, "pickup g2", *keep, "--want", "q_avg 1 %", "--ways", "fastest", "--budget", "10", "--json"
    )
    assert (kept.code, kept.document["cameras"]) == (1, [])


def test_fewer_cameras_than_a_skill_needs_are_refused(sqrp, cell):
    found = sqrp("place", cell, "--cameras", "1")
    assert (found.code, found.out) == (2, "")
    assert "`inspect` needs two at once" in found.err
    assert "--cameras 2" in found.err
    kept = sqrp("place", cell, "pickup g2", "--cameras", "1", "--keep", "cam2", "--ways", "fastest", "--json")
    assert kept.code == 0
    assert kept.document["floor"] == {"cameras": 1, "reason": "`inspect` needs two at once"}


def test_a_camera_that_only_makes_up_the_number_is_the_one_that_sees_most(sqrp, cell):
    found = sqrp("place", cell, "pickup g2", "--cameras", "2", "--ways", "fastest", "--json").document
    assert [camera["alone"] for camera in found["cameras"]] == pytest.approx([1.0, 1.0])
    assert "Fewer than two cannot be: `inspect` needs two at once." in found["proof"]
    assert "in the way with --ways fastest (gap 0)" in found["proof"]
    assert found["fewer"] is None
    (way,) = found["ways"].values()
    assert "any" not in way.values()


def test_what_cannot_be_chosen_is_said_with_its_figure(sqrp, cell, tmp_path):
    file = tmp_path / "large.yaml"
    file.write_text(MOUNTS.replace("price: 40}", "body: 5 m}").replace("step: 1 m}}", "step: 1 m}, body: 5 m}"))
    large = sqrp("place", cell, "pickup g2", "--cameras", "2", "--mounts", file, "--ways", "fastest")
    assert large.code == 1
    assert "all 10 mounts are in the way" in large.out
    assert "does better" not in large.out


def test_a_camera_may_fail_where_each_sees_everything(sqrp, cell):
    two = sqrp("place", cell, "pickup g2", "--survive", "1", "--cameras", "2", "--ways", "fastest", "--json").document
    assert two["objective"] == pytest.approx(1.0)
    assert [camera["alone"] for camera in two["cameras"]] == pytest.approx([1.0, 1.0])
    assert [camera["loss"] for camera in two["cameras"]] == pytest.approx([0.0, 0.0])
    assert two["without_spare"]["cameras"] == 2  # `inspect` needs two


def test_what_no_cameras_change_is_said(sqrp, cell):
    slow = sqrp("place", cell, "pickup g2", "--want", "time 2 s", "--ways", "fastest")
    assert slow.code == 1
    assert "No camera can be chosen: no candidate can be done in that time." in slow.out
    late = sqrp("place", cell, "pickup g2", "--want", "delay 0.01 s", "--ways", "fastest")
    assert late.code == 1
    assert (
        "a frame period and the latency of the fastest of these cameras are 0.03333 s at worst, and the time that tool "
        "and part take to part comes on top. The nearest is below."
    ) in " ".join(late.out.split())  # the quicker lens has 30 Hz


def test_a_written_patch_is_not_asked_for_again(sqrp, cell, tmp_path):
    command = ("place", cell, "pickup g2", "--cameras", "2", "--ways", "fastest")
    assert "To have it, add --patch FILE" in sqrp(*command).out
    assert "--patch" not in sqrp(*command, "--patch", tmp_path / "z.diff").out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--keep", "nocam"), "`cam1`, `cam2`"),
        (("--keep", "cam1,cam2"), "--keep cam1 --keep cam2"),
        (("--mounts", "nofile"), "--mounts"),
        (("--patch", "a.diff", "--patch", "b.diff"), "--patch is given 2 times: a.diff, b.diff"),
        (("--survive", "1", "--cameras", "1"), "needs two"),
    ],
)
def test_a_message_says_what_mends_it(sqrp, cell, options, message):
    found = sqrp("place", cell, *options)
    assert (found.code, found.out) == (2, "")
    assert message in found.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("mounts: {a: {points: [[0, 0, 1]], rail: {from: [0, 0, 1], to: [1, 0, 1], step: 0.1}}}", "exactly one of"),
        ("mounts: {a: {points: [[0, 0, 1]], frame: wirst}}", "a mount on a link needs `aims`"),
        ("mounts: {a: {points: [[0, 0, 1]], lenses: [wdie]}}", "wide"),
        ("mounts: {a: {grid: {from: [0, 0, 1], to: [9, 9, 9], step: 2 cm}}}", "expected at most 20,000"),
        ("mounts: {a: {points: [[0, 0, 1]], size: 3}}", "is no known key"),
        ("mounts: {a: {points: []}}", "at least 1 item"),
        ("mounts: {a: {points: [[0, 0, 1]], lenses: []}}", "at least 1 item"),
        ("mounts: {a: {points: [[1, 1, 1]], aims: {at: [[1, 1, 1]]}}}", "look at its own place"),
        ("mounts: {a: {points: [[1, 1, 1]], aims: {at: [[0, 0, 0]], up: [0, 0, 0]}}}", "`up` has length 0"),
    ],
)
def test_a_file_that_says_nothing_sensible_is_refused(sqrp, cell, tmp_path, text, message):
    file = tmp_path / "mounts.yaml"
    file.write_text(f"{text}\nlenses: {{wide: {{catalogue: realsense-d435-color}}}}\n")
    found = sqrp("place", cell, "--mounts", file)
    assert found.code == 2
    assert f"{file}:1" in found.err
    assert message in found.err


def test_without_mounts_the_message_says_what_to_write(sqrp):
    found = sqrp("place", ROOT / "tests" / "cases" / "cell")
    assert found.code == 2
    assert "place.yaml" in found.err


def test_a_wished_delay_is_met_by_the_delays_that_rank_says_not_by_those_of_the_search(sqrp, cell):
    arguments = ("place", cell, "pickup g2", "--ways", "fastest", "--cameras", "2")
    exact = sqrp(*arguments, "--json").document["delay_worst"]
    shorter = sqrp(*arguments, "--want", f"delay {exact - 0.02:.4f} s", "--json")
    longer = sqrp(*arguments, "--want", f"delay {exact + 0.02:.4f} s", "--json")
    assert shorter.document["met"] == (shorter.document["delay_worst"] <= exact - 0.02) == (shorter.code == 0)
    assert (longer.code, longer.document["met"]) == (0, True)
    assert longer.document["delay_worst"] <= exact + 0.02
    none = sqrp(*arguments, "--want", "delay 0.2 s")
    assert none.code == 1
    assert "No choice of these mounts reaches delay 0.2 s." in " ".join(none.out.split())


def test_a_search_that_may_end_early_says_so_and_names_its_bound(sqrp, cell, tmp_path):
    narrow = tmp_path / "narrow.yaml"
    narrow.write_text(MOUNTS.replace("  wide: {catalogue: realsense-d435-color, price: 300}\n", ""))
    arguments = ("place", cell, "pickup g2", "--cameras", "2", "--mounts", narrow, "--ways", "fastest")
    exact = sqrp(*arguments, "--json").document
    assert exact["proven"]
    assert exact["gap"] == 0
    loose = sqrp(*arguments, "--gap", "100", "--json").document
    assert loose["objective"] <= exact["objective"] + 5e-4
    assert loose["bound"] >= exact["objective"] - 5e-4
    hurried = sqrp(*arguments, "--time", "1 ms")
    assert "not proven" in " ".join(hurried.out.split()).lower()
    for option, value in (("--time", "0 s"), ("--time", "soon"), ("--gap", "-1")):
        refused = sqrp(*arguments, option, value)
        assert (refused.code, refused.out) == (2, "")
        assert option in refused.err
