"""`run --report`: what really happened and what the images showed of it, on the run's clock."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sqrp_cli.geometry import Array, transform
from sqrp_cli.run.record.events import Event, ShownAtom, event
from sqrp_cli.run.record.report import Confusion, FaultRecord, RunReport, StepRecord
from sqrp_cli.show.pages.run_page import write_run
from tests.cli.browser import Opened, carried, click_at_random
from tests.cli.slip_run import Moment

pytestmark = pytest.mark.slow

HOSTILE = (
    "<img src=x onerror=alert(1)>\"'`</script><script>alert(2)</script>\u202egnp.\u2066-->]]>&lt;javascript:alert(3)"
    "`${alert(4)}`\x1b]0;x\x07\r\n\x9b\u2028\u200b\ud800!"
)
SPELLED_OUT = (
    "<img src=x onerror=alert(1)>\"'`</script><script>alert(2)</script>\\u{202e}gnp.\\u{2066}-->]]>&lt;"
    "javascript:alert(3)`${alert(4)}`\\u{1b}]0;x\\u{7}\\u{d}\\u{a}\\u{9b}\\u{2028}\\u{200b}\\u{d800}!"
)


def evidence(t: float, value: str, **cameras: str) -> Event:
    atom = ShownAtom(value=value, asked=True, cameras=cameras, true=t < 1.45)
    other = ShownAtom(value="true", asked=False, cameras={})
    return event("evidence", t + 0.05, exposed=t, literals={"hold(g1)": atom, "open": other})


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory):
    """A run of 4 s: `hold(g1)` is true for 2 s, lost at 2 s, then unseen by all for 1 s."""
    path = tmp_path_factory.mktemp("run") / "page.html"
    events = [event("primitive", 0.0, name="a1"), event("primitive", 1.0, name="a2")]
    events += [evidence(0.1 * i, "true", cam1="true", cam2="true") for i in range(21)]
    events += [evidence(0.1 * i, "false", cam1="false") for i in range(21, 31)]
    events += [evidence(0.1 * i, "blind") for i in range(31, 41)]
    fault = FaultRecord("slip", 2.0, 2.0, 2.15, 2.5, None, predicted_delay=0.25)
    step, came_true = StepRecord("pickup", {"object": "g1"}, "pickup g1", 0.0), {"cam1": Confusion(tp=30, fp=10)}
    report = RunReport("stopped", "hold(g1) should be seen", 4.0, [step], [fault], [{"hold(g1)": came_true}])
    began = event("run", 0.0, sqrp_log=1, workspace="cell", digest="0123", cameras=["cam1", "cam2"])
    write_run(began, report, events, path, ["run", "pick.yaml", "--sim", "--report", str(path)])
    return Opened(browser, path)


def test_the_page_says_in_words_and_timelines_how_the_run_went(opened):
    # The page says how the run went.
    assert opened.complaints == []
    assert opened.texts("#title") == ["pickup g1 in cell: stopped"]
    assert opened.texts("#summary") == ["Slip at 2.00 s, noticed after 0.15 s, stopped at 4.00 s."]
    assert opened.js("sqrp.time") == 2.0, "it opens at the event"
    assert opened.texts("#reasons li") == ["hold(g1) should be seen"]
    assert not opened.page.locator(".overview").is_visible()
    told = dict(zip(opened.texts("#figures dt"), opened.texts("#figures dd"), strict=True))
    assert told["predicted images that showed it"] == "75.0 %"
    assert told["slip noticed after"] == "0.15 s"
    # The timeline shows what the images showed.
    labels = opened.js("[...document.querySelectorAll('.run')].map((run) => run.getAttribute('aria-label'))")
    own = [label.removeprefix("hold(g1), ") for label in labels if label.startswith("hold(g1), ")]
    assert own == [
        "0.00 s to 2.10 s: images show: true",
        "2.10 s to 3.10 s: images show: false",
        "3.10 s to 4.00 s: no image shows it",
    ]
    assert {
        "cam2, hold(g1), 2.10 s to 4.00 s: does not show it",
        "in truth, hold(g1), 0.00 s to 1.50 s: true",
        "in truth, hold(g1), 1.50 s to 4.00 s: false",
    } <= set(labels)
    assert not any("open" in label for label in labels)
    # A fault is marked from when it happens until something is done.
    marks = opened.js("[...document.querySelectorAll('.lane .mark')].map((mark) => parseFloat(mark.style.left))")
    assert marks == pytest.approx([50.0, 53.75])
    assert {"fault not noticed yet", "fault noticed, robot responds"} <= set(opened.texts("#legend span"))
    # The time is told in words and what an image shows counts from when it was taken.
    for t, shown in ((2.09, "true"), (2.11, "false"), (2.5, "false")):
        opened.js("t => sqrp.seek(t)", t)
        assert opened.texts(".row.literal .now") == ["images show all", f"images show: {shown}"]
    assert opened.texts("#clock") == ["2.50 s"]
    assert opened.texts(".row.axis .now") == ["a2", ""]
    assert not opened.page.locator("#view").is_visible()
    (note,) = opened.texts("#note")
    assert note == "There is no playback in three dimensions: this log does not say where everything was."


def test_a_log_with_hostile_names_has_a_page_on_which_nothing_runs(browser, tmp_path):
    path, atom = tmp_path / "page.html", f"hold({HOSTILE})"
    shown = ShownAtom(value="true", asked=True, cameras={HOSTILE: "true"}, true=True)
    events = [event("primitive", 0.0, name=HOSTILE)]
    events += [event("evidence", t, exposed=t, literals={atom: shown}) for t in (0.1, 1.0, 2.0)]
    fault = FaultRecord(HOSTILE, 1.0, 1.0, 1.5, 1.6, None, predicted_delay=0.25)
    step = StepRecord(HOSTILE, {"object": HOSTILE}, HOSTILE, 0.0)
    report = RunReport("stopped", HOSTILE, 2.0, [step], [fault], [{atom: {HOSTILE: Confusion(tp=1)}}])
    began = event("run", 0.0, sqrp_log=1, workspace=HOSTILE, digest=HOSTILE, cameras=[HOSTILE])
    write_run(began, report, events, path, ["run", HOSTILE])
    opened = Opened(browser, path)
    opened.page.locator(".run").first.hover()
    opened.js("() => sqrp.seek(1.2)")
    assert (opened.complaints, opened.requests) == ([], [path.as_uri()])
    assert opened.texts("#reasons li") == [SPELLED_OUT.replace("`", "", 2)], "between two backticks, it is code"
    assert opened.page.locator("img").count() == 0
    opened.context.close()


# A run of the simulated cell


@dataclass(frozen=True)
class Played:
    """A run with a slip in the lift, and the page about it. moments: what the simulation says, apart from all that."""

    folder: Path
    document: dict[str, Any]
    moments: list[Moment]
    opened: Opened

    def at(self, t: float) -> None:
        """Have the page show a time [s]."""
        self.opened.js("t => sqrp.seek(t)", t)

    def tool(self) -> Array:
        return np.array(self.opened.js("sqrp.scene.toolPosition()"))

    def thing(self) -> Array:
        return np.array(self.opened.js("sqrp.scene.objectPose('g2')"))


@pytest.fixture(scope="module")
def played(slip_run, browser):
    assert slip_run.outcome.code == 0, slip_run.outcome.err
    folder = slip_run.cell.folder
    opened = Opened(browser, folder / "page.html")
    yield Played(folder, slip_run.outcome.document, slip_run.moments, opened)
    opened.context.close()


def test_everything_is_where_the_simulation_and_the_log_say(played):
    # Tool and object are where the simulation says.
    """Where a state was told to micrometres; between two, where the arm is quick, to what a straight line leaves."""
    told = [found for found in played.moments if abs(25 * found.t - round(25 * found.t)) < 1e-6]
    between = [found for found in played.moments if abs(25 * found.t - round(25 * found.t)) > 0.05]
    for moments, tolerance in ((told, 2e-4), (between, 4e-3)):
        assert len(moments) > 40
        for found in moments[:: len(moments) // 40]:
            played.at(found.t)
            assert np.abs(played.tool() - found.tool).max() < tolerance, found.t
            assert np.abs(played.thing()[:3, 3] - found.thing).max() < tolerance, found.t
            assert np.abs(played.thing()[:3, :3] - found.turn).max() < 20 * tolerance, found.t
    assert np.ptp([found.tool for found in between], axis=0).max() > 0.1
    # Before the slip the object is in the tool and then on the table.
    (fault,) = played.document["faults"]
    begin = fault["injected"]
    for t in (begin - 0.2, begin - 0.05):
        played.at(t)
        assert np.linalg.norm(played.thing()[:3, 3] - played.tool()) == pytest.approx(0.02, abs=0.003)
        assert played.thing()[2, 3] > 0.025
        assert "holds g2" in played.opened.texts("#tool")[0]
    heights = []
    for t in np.linspace(begin, fault["detected"], 9):
        played.at(t)
        heights.append(played.thing()[2, 3])
    assert max(np.diff(heights)) < 1e-3, "it falls and does not rise"
    played.at(fault["detected"] + 0.1)
    assert played.thing()[2, 3] == pytest.approx(0.02, abs=0.001)
    assert np.linalg.norm(played.thing()[:3, 3] - played.tool()) > 0.03
    assert "holds" not in played.opened.texts("#tool")[0]
    played.at(played.document["time"])
    assert np.linalg.norm(played.thing()[:3, 3] - played.tool()) == pytest.approx(0.02, abs=0.003)
    assert played.thing()[2, 3] > 0.1
    # Boxes are where the thing is looked for in the colour of what images show.
    evidence = [event for event in events_of(played) if event["event"] == "evidence"]
    names = {"true": "covered", "false": "out", "blind": "hidden", "nothing": "nothing"}
    look_up = """name => {
        const text = getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim();
        return new THREE.Color(text).convertSRGBToLinear().getHex();
    }"""
    colors = {shown: played.opened.js(look_up, name) for shown, name in names.items()}
    for t in (fault["injected"] - 0.1, fault["detected"] + 0.05):
        played.at(t)
        hold, place = (
            np.array(played.opened.js("atom => sqrp.scene.corners(atom, 0)", atom)).mean(axis=0)
            for atom in ("hold(g2)", "obj_on_table(g2)")
        )
        assert np.linalg.norm(hold - played.tool()) == pytest.approx(0.02, abs=0.002)
        np.testing.assert_allclose(place, played.moments[0].thing, atol=2e-3)
        taken = [event for event in evidence if event["exposed"] <= t][-1]["literals"]
        shown = played.opened.js(
            """() => sqrp.scene.sights.filter((sight) => sight.edges.visible).map((sight) => {
                const lines = sight.lines.map(({ camera, mesh }) => [camera.name, mesh.material.color.getHex()]);
                return [sight.atom, sight.edges.material.color.getHex(), Object.fromEntries(lines)];
            })"""
        )
        assert {atom for atom, _, _ in shown} == {"hold(g2)", "obj_on_table(g2)"}
        for atom, box, lines in shown:
            assert box == colors[taken[atom]["value"]]
            assert lines == {name: colors[taken[atom]["cameras"].get(name, "nothing")] for name in ("cam3", "cam5")}
    # A second attempt has a box where the object was found.
    second = [event for event in events_of(played) if event["event"] == "step"][1]
    (box,) = second["boxes"]["obj_on_table(g2)"]
    assert box["frame"] == "world"
    played.at(fault["acted"] + 0.5)
    shown = played.opened.js("() => sqrp.scene.sights.filter((s) => s.edges.visible).map((s) => [s.atom, s.corners()])")
    (corners,) = [np.array(corners) for atom, corners in shown if atom == "obj_on_table(g2)"]
    half = np.array(box["size"]) / 2
    np.testing.assert_allclose(np.abs(transform(np.linalg.inv(box["pose"]), corners)), np.tile(half, (8, 1)), atol=1e-5)
    # The page of a run says what is true and who does not know it.
    opened = played.opened
    assert opened.complaints == []
    assert "The monitors do not know that: they judge by images alone." in opened.texts("#note")[0]
    texts = opened.texts("#moments button")
    assert texts[0] == f"{fault['happened']:.2f} s slip happens"
    assert texts[-1] == f"{fault['recovered']:.2f} s the step is done"
    assert texts[1].startswith(f"{fault['detected']:.2f} s slip is seen")
    opened.page.locator("#moments button").nth(1).click()
    assert opened.js("sqrp.time") == pytest.approx(fault["detected"])
    assert opened.texts(".row.truth .now")[0] == "false"
    assert opened.texts("#legend span")[-1] == "nothing has to be seen"
    # A run is seen through its cameras and from near the tool.
    played.at(played.document["faults"][0]["detected"])

    def picture():
        return opened.js("() => { sqrp.scene.render(); return sqrp.scene.renderer.domElement.toDataURL(); }")

    outside = picture()
    opened.page.locator("#views button", has_text="cam3").click()
    assert picture() != outside
    opened.page.locator("#views button").first.click()
    assert picture() == outside
    opened.page.check("#follow")
    np.testing.assert_allclose(opened.js("sqrp.scene.orbit.target.toArray()"), played.tool(), atol=1e-9)
    opened.page.uncheck("#follow")
    assert picture() == outside
    assert opened.complaints == []


def events_of(played: Played) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (played.folder / "run.jsonl").read_text(encoding="utf-8").splitlines()]


def test_robot_and_rows_are_on_one_screen_and_fast_clicks_leave_the_page_as_it_was(played, browser):
    opened = Opened(browser, played.folder / "page.html")
    opened.page.set_viewport_size({"width": 1400, "height": 900})
    shown = "[...document.querySelectorAll('#summary, #moments, #view, .row')]"
    bottoms = opened.js(f"{shown}.map((e) => e.getBoundingClientRect().bottom)")
    assert len(bottoms) > 8
    assert 0 < max(bottoms) <= 900
    assert opened.js("sqrp.time") == pytest.approx(played.document["faults"][0]["happened"], abs=1e-6)
    click_at_random(opened, 3)
    assert opened.complaints == []
    assert opened.page.locator("#view canvas").count() == 1
    assert opened.js("sqrp.scene.motion === sqrp.motion && sqrp.timeline.motion === sqrp.motion")
    opened.context.close()


def test_a_log_and_its_program_give_the_same_page_again_and_no_program_is_overwritten(sqrp, played):
    again, program, log = (played.folder / name for name in ("again.html", "pick.yaml", "run.jsonl"))
    before = program.read_bytes()
    assert log.stat().st_size < 10_000 * played.document["time"], "it stays small"
    run = sqrp("run", program, "--replay", log, "--report", again)
    assert run.code == 0, run.err
    for name in ("detail-0", "model-0"):
        assert carried(again, name) == carried(played.folder / "page.html", name)
    assert sqrp("run", program, "--replay", log, "--report", program).code == 2
    assert program.read_bytes() == before
    refused = sqrp("run", played.folder / "pik.yaml", "--replay", log, "--json")
    assert (refused.code, refused.out) == (2, "")
    assert "pick.yaml" in refused.err


def test_a_log_alone_or_with_another_workspace_gives_a_flat_page_that_says_why(sqrp, played, browser, tmp_path):
    log, page = tmp_path / "run.jsonl", tmp_path / "page.html"
    first, rest = (played.folder / "run.jsonl").read_text(encoding="utf-8").split("\n", 1)
    changed = json.dumps({**json.loads(first), "digest": "0" * 64})
    log.write_text(f"{changed}\n{rest}", encoding="utf-8")
    now = tmp_path / played.folder.name
    now.mkdir()
    for name in ("pick.yaml", "workspace.yaml", "run.jsonl"):
        shutil.copy(played.folder / name, now)
    cell = now / "workspace.yaml"
    cell.write_text(cell.read_text(encoding="utf-8").replace("8.0 Hz", "9.0 Hz"), encoding="utf-8")
    for arguments, why in (
        ((now / "pick.yaml", "--replay", now / "run.jsonl"), "the workspace of this program is not as it was in the"),
        (("--replay", log), "a log has no shapes; sqrp run PROGRAM --replay LOG --report FILE takes them from the"),
        ((played.folder / "pick.yaml", "--replay", log), "the workspace of this program is not as it was in the run."),
    ):
        assert sqrp("run", *arguments, "--report", page).code == 0
        assert 'id="model-0"' not in page.read_text(encoding="utf-8")
        opened = Opened(browser, page)
        assert opened.complaints == []
        assert why in opened.texts("#note")[0]
        assert not opened.page.locator("#view").is_visible()
        assert opened.texts("#moments button")[0].endswith("slip happens")
        opened.context.close()
