"""`--report`: one page that needs nothing else, and shows what the documents say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.browser import Opened, click_at_random, detail_in, walk
from tests.cli.hostile import hostile_cell
from tests.docs.words import COMPUTED, unexplained


@pytest.fixture(scope="module")
def written(tabletop_written):
    """The page about the tabletop."""
    return tabletop_written.page


@pytest.fixture(scope="module")
def opened(browser, written):
    """The tabletop's page, opened once; every test leaves it with `g1` at 12.4 s, seen from outside."""
    return Opened(browser, written)


@pytest.fixture
def shown(opened):
    """The page with the fourth candidate, `g1`, chosen."""
    opened.js("() => sqrp.select(3).then(() => { sqrp.look(null); sqrp.seek(12.4); })")
    return opened


def column(opened, number: int) -> list[str]:
    return opened.texts(f"#ranking tbody tr td:nth-child({number})")


# What is written


def test_a_page_is_opened_where_there_is_a_browser(sqrp, watch, tmp_path, monkeypatch):
    seen, page = [], tmp_path / "a page.html"
    command = ("rank", watch, "watch seen", "--report", page, "--open", "--json")
    monkeypatch.setattr("webbrowser.open", lambda address: seen.append(address) or len(seen) == 1)
    assert sqrp(*command).err == ""
    assert sqrp(*command).err == f"open {page} in a browser\n"
    assert seen == [page.as_uri()] * 2
    assert sqrp("rank", watch, "watch seen", "--open").err == "error: --open is about --report, which is missing\n"


def test_the_page_is_one_small_file_that_names_no_other_place(written):
    text = written.read_text(encoding="utf-8")
    # The page is small and names no other place.
    assert len(text) < 10e6
    without_library = re.sub(r"<script>/\*\*.*?</script>", "", text, flags=re.DOTALL)
    assert "Three.js" not in without_library
    places = set(re.findall(r"https?://[^\s\"'<>]+", without_library)) - {"http://www.w3.org/2000/svg"}
    assert places == set()
    assert not re.findall(r"<(?:link|iframe|img)\b|\bsrc=|@import|url\(", without_library)
    # A page with 200 candidates is below 25 megabytes.
    details = [len(found) for found in re.findall(r'id="detail-\d+">([^<]*)<', text)]
    assert len(details) == 5
    assert len(text) - sum(details) + 200 * max(details) < 25e6


# What it does in a browser


def test_only_of_a_fault_that_is_retried_the_page_says_when_all_is_done(browser, sqrp, own_watch, tmp_path):
    path = tmp_path / "page.html"
    skill = own_watch / "watch" / "skill.yaml"
    retried = skill.read_text(encoding="utf-8")
    for text, told in ((retried, True), (retried.replace("{retry: 1}", "stop"), False)):
        skill.write_text(text, encoding="utf-8")
        assert sqrp("rank", own_watch, "watch green", "--report", path).code == 0
        opened = Opened(browser, path)
        assert opened.complaints == []
        assert ["done after a retry" in opened.texts(f"#{table} th") for table in ("ranking", "faults")] == [told, told]
        assert opened.texts("#faults td")[0] == "moved happens (wait, w2)"
        assert opened.texts("#faults td code")[0] == "moved"
        opened.context.close()


@pytest.fixture(scope="module")
def scored(sqrp, tabletop, watch, tmp_path_factory):
    """The page about two cells, and a third one that cannot be read."""
    folder = tmp_path_factory.mktemp("scored")
    broken = folder / "broken" / "workspace.yaml"
    broken.parent.mkdir()
    broken.write_text("robot: {}\n")
    cells = (tabletop, watch, broken.parent)
    assert sqrp("score", *cells, "--samples", 3, "--report", folder / "page.html").code == 2
    return folder / "page.html"


def test_scores_show_the_best_of_each_task_in_its_own_cell(browser, scored):
    opened = Opened(browser, scored)
    assert opened.complaints == []
    marks = dict(zip(column(opened, 2), column(opened, 1), strict=True))
    assert marks == {"broken": "error", "tabletop": "passed", "watch": "passed"}
    for name, cameras in (
        ("watch", ["look around", "eye"]),
        ("tabletop", ["look around", *[f"cam{i}" for i in range(1, 7)]]),
    ):
        opened.page.locator("#ranking button", has_text=name).click()
        opened.page.wait_for_function(
            "name => document.querySelector('#name').textContent.startsWith(name) && sqrp.motion", arg=name
        )
        assert opened.texts("#views button") == cameras
        assert opened.page.locator("#view canvas").count() == 1
        opened.page.locator("#time").press("PageUp")
        assert opened.texts("#clock") != ["0.00 s"]
    assert opened.complaints == []
    opened.context.close()


@pytest.mark.parametrize("size", [pytest.param((1400, 900), marks=pytest.mark.trial), (800, 600)])
def test_every_stop_of_the_tab_key_on_the_page_about_cells_is_in_sight(browser, scored, size):
    opened = Opened(browser, scored)
    opened.page.set_viewport_size({"width": size[0], "height": size[1]})
    walk(opened.page)
    assert opened.complaints == []
    opened.context.close()


@pytest.mark.parametrize(("kind", "seed"), [("written", 1), pytest.param("scored", 2, marks=pytest.mark.trial)])
def test_however_fast_one_clicks_the_last_click_is_what_is_shown(browser, request, kind, seed):
    opened = Opened(browser, request.getfixturevalue(kind))
    name = click_at_random(opened, seed)
    assert opened.complaints == []
    assert opened.texts("#name") == [name]
    (chosen,) = opened.page.locator("#ranking tr[aria-selected=true] button").all()
    assert chosen.get_attribute("aria-label") == name
    entry = opened.js("sqrp.entries.find((entry) => entry.name === document.querySelector('#name').textContent)")
    assert opened.js("sqrp.entries[sqrp.selected].name") == name
    assert opened.page.locator("#study").is_visible() is entry["moves"]
    if entry["moves"]:
        assert opened.js("sqrp.motion.time") == pytest.approx(entry["candidate"]["time"], abs=1e-5)
        assert opened.js("sqrp.scene.motion === sqrp.motion && sqrp.timeline.motion === sqrp.motion")
        assert opened.texts("#views button")[1:] == opened.js(
            "i => Object.keys(sqrp.overview.scenes[i].cameras)", entry["scene"]
        )
    assert opened.page.locator("#view canvas").count() == 1
    opened.context.close()


def test_the_page_says_what_was_computed_and_shows_it_in_the_order_of_the_ranking(
    opened, written, asked, tabletop, ranked
):
    # The page asks for nothing and complains about nothing.
    assert opened.requests == [written.as_uri()]
    assert opened.complaints == []
    # The page says what was computed.
    about = dict(zip(opened.texts("#about dt"), opened.texts("#about dd"), strict=True))
    assert about["command"].startswith("sqrp rank ")
    assert f"--report {written}" in about["command"]
    assert about["digest"] == asked("show", tabletop, "--json").document["digest"]
    assert about["accuracy"].startswith("Sampled every 10 mm and 50 ms or closer")
    # The table shows the figures in the order of the ranking.
    candidates = ranked.document["candidates"]
    assert column(opened, 2) == [candidate["parameters"]["object"] for candidate in candidates]
    q_eoi = [f"{100 * candidate['q_eoi']:.1f} %" for candidate in candidates if candidate["feasible"]]
    assert column(opened, 4)[:-1] == q_eoi
    assert column(opened, 3)[0] == "shoulder left, tool turned 90 deg", "the way of g2"
    assert column(opened, 1)[-1] == "✕"
    assert column(opened, 4)[-1] == f"cannot be done: {candidates[-1]['why'][0]}"
    assert candidates[-1]["why"] == ["out of reach by 0.10 m (approach)"]


def test_the_page_has_no_technical_word_that_the_page_of_words_does_not_explain(opened):
    assert [*unexplained(opened.page.inner_text("main").partition(COMPUTED)[0], "tabletop")] == []


def test_the_table_is_sorted_by_a_click_on_a_title_and_filtered_by_words(opened, ranked):
    # A click on a title sorts and another one turns the order.
    button = opened.page.locator("#ranking th", has_text="time [s]").locator("button")
    button.click()
    times = [float(text) for text in column(opened, 6)]
    assert times == sorted(times)
    assert opened.page.locator("#ranking th[aria-sort=ascending]").inner_text().startswith("time")
    button.press("Enter")
    assert [float(text) for text in column(opened, 6)] == times[::-1]
    assert column(opened, 2)[-1] == "g6", "without a figure, last in either order"
    opened.page.locator("#ranking th button").first.click()
    assert column(opened, 1)[0].startswith("1")
    # The filter keeps what has its words.
    opened.page.fill("#filter", "g4 lift=0.1")
    assert column(opened, 2) == ["g4"]
    assert opened.texts("#shown") == ["1 of 6"]
    opened.page.fill("#filter", "")
    opened.page.check("#feasible-only")
    assert len(column(opened, 2)) == 5
    opened.page.uncheck("#feasible-only")
    opened.page.check("#pareto-only")
    optimal = [c["parameters"]["object"] for c in ranked.document["candidates"] if c["pareto"]]
    assert 0 < len(optimal) < 5
    assert column(opened, 2) == optimal
    opened.page.uncheck("#pareto-only")


def test_a_candidate_is_chosen_in_table_and_plot_by_mouse_and_by_key(opened, ranked):
    by_name = {c["parameters"]["object"]: c for c in ranked.document["candidates"]}
    page = opened.page
    choices = {
        "g4": lambda: page.locator("#ranking tbody tr", has_text="g4").click(),
        "g3": lambda: page.locator("#plot .dot[aria-label^='g3:']").click(),
        "g5": lambda: page.locator("#plot .dot[aria-label^='g5:']").press("Enter"),
        "g1": lambda: page.locator("#ranking button", has_text="g1").press("Enter"),
    }
    for name, choose in choices.items():
        choose()
        page.wait_for_function("name => document.querySelector('#name').textContent === name && sqrp.motion", arg=name)
        (said,) = opened.texts("#verdict")
        assert said.startswith("If it slips while it is lifted, you know after 0.")
        assert said.endswith(by_name[name]["verdict"].replace("`", ""))
        late = by_name[name]["faults"]["slip"]
        assert (late["why"]["words"].replace("`", "") in said) is (late["delay_worst"] > 1.0) is (name == "g3")
        assert opened.texts("#ranking tr[aria-selected=true] button") == [name]
        assert page.locator("#plot .dot[aria-pressed=true]").get_attribute("aria-label").startswith(f"{name}:")
    page.locator("#plot .dot[tabindex='0']").focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press(" ")
    later = [one for one in by_name.values() if one["feasible"] and one["time"] > by_name["g1"]["time"]]
    next_name = min(later, key=lambda one: one["time"])["parameters"]["object"]
    page.wait_for_function("name => document.querySelector('#name').textContent === name && sqrp.motion", arg=next_name)
    page.locator("#ranking button", has_text="g6").click()
    assert opened.texts("#reasons li") == by_name["g6"]["why"] == ["out of reach by 0.10 m (approach)"]
    assert not page.locator("#study").is_visible()


def test_the_slider_playback_and_words_go_together(shown):
    # The slider moves robot and cursor and words together.
    def state():
        return shown.js(
            """() => [sqrp.time, document.querySelector('#cursor i').style.left,
                 ...['tool', 'clock'].map((id) => document.getElementById(id).textContent)]"""
        )

    before = state()
    assert float(before[1].rstrip("%")) / 100 == pytest.approx(12.4 / shown.js("sqrp.motion.time"))
    shown.page.locator("#time").press("PageUp")
    shown.page.locator("#time").press("ArrowRight")
    after = state()
    assert after[0] == pytest.approx(13.5)
    assert float(after[1].rstrip("%")) / 100 == pytest.approx(13.5 / shown.js("sqrp.motion.time"))
    assert after[2] != before[2]
    assert after[3] == "13.50 s"
    assert shown.texts(".row.axis .now")[0] == "lift"
    shown.js("() => sqrp.seek(5.2)")
    assert shown.texts("#hiding") == [f"red, in the way: {', '.join(shown.js('[...sqrp.scene.culprits]'))}"]
    assert "forearm_link" in shown.texts("#hiding")[0]
    # A tool at hardly less than zero is at zero.
    at = "x => { sqrp.scene.toolPosition = () => [x, -0.36, 0.1]; sqrp.seek(12.4); delete sqrp.scene.toolPosition; }"
    shown.js(at, -0.0004)
    assert shown.texts("#tool")[0].startswith("tool at 0.000, -0.360, 0.100 m")
    shown.js(at, -0.0006)
    assert shown.texts("#tool")[0].startswith("tool at -0.001, -0.360, 0.100 m")
    # Play goes on and stops.
    shown.page.select_option("#speed", "4")
    shown.page.click("#play")
    shown.page.wait_for_function("() => sqrp.time > 12.6")
    shown.page.press("#play", "Enter")
    time = shown.js("sqrp.time")
    shown.page.wait_for_timeout(100)
    assert shown.js("sqrp.time") == time


def test_boxes_and_pixels_are_where_the_documents_say(shown, explained, asked, tabletop):
    # Robot objects and boxes are where the documents say.
    # The page computes the corners of boxes from joint values; `explain --json` gives them.
    document = next(c for c in explained.document["candidates"] if c["parameters"]["object"] == "g1")
    samples = document["samples"]
    checked = 0
    for sample in samples[:: len(samples) // 12]:
        alone = sum(abs(other["t"] - sample["t"]) < 1e-9 for other in samples) == 1
        for literal, found in sample["literals"].items() if alone else ():
            shown.js("t => sqrp.seek(t)", sample["t"])
            corners = shown.js("atom => sqrp.scene.corners(atom, 0)", literal.removeprefix("not "))
            assert np.abs(np.array(corners) - found["boxes"][0]["corners"]).max() < 1e-5
            checked += 1
    assert checked > 10
    # Looking through a camera uses its intrinsics.
    camera = asked("show", tabletop, "--json").document["cameras"]["cam2"]
    X_CW = np.linalg.inv(np.array(camera["pose"]))
    for point in ([0.0, 0.0, 0.3], [-0.3, -0.2, 0.1], [0.5, 0.4, 0.0]):
        u, v, w = np.array(camera["K"]) @ (X_CW @ [*point, 1.0])[:3]
        assert shown.js("point => sqrp.scene.pixel('cam2', point)", point) == pytest.approx([u / w, v / w], abs=1e-3)

    # A click on a camera changes the view.
    def picture():
        return shown.js("() => { sqrp.scene.render(); return sqrp.scene.renderer.domElement.toDataURL(); }")

    outside = picture()
    shown.page.locator("#labels button", has_text="cam2").click()
    assert shown.texts("#views button[aria-pressed=true]") == ["cam2"]
    through = picture()
    assert through != outside
    shown.page.locator("#views button", has_text="cam4").press("Enter")
    assert picture() not in (outside, through)
    shown.page.locator("#views button").first.click()
    assert picture() == outside


def test_the_timeline_tells_cause_and_culprit_and_is_as_long_as_the_document_says(shown, explained):
    # The timeline tells cause and culprit to pointer and keyboard.
    run = shown.page.locator(".run[aria-label^='cam2, the tool holds g1'][aria-label*='behind upper_arm_link']").last
    run.hover()
    assert run.get_attribute("aria-label") in shown.texts("#tip")[0]
    shown.page.mouse.move(5, 5)
    assert not shown.page.locator("#tip").is_visible()
    shown.page.locator(".run[tabindex='0']").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowDown", "End", "Home", "ArrowRight"):
        shown.page.keyboard.press(key)
    focused = shown.js("document.activeElement.getAttribute('aria-label')")
    assert focused.startswith("cam2, the tool holds g1, ")
    assert focused in shown.texts("#tip")[0]
    shown.page.keyboard.press("Enter")
    start = float(re.search(r", ([\d.]+) s to", focused)[1])
    assert shown.js("sqrp.time") == pytest.approx(start, abs=0.006)
    # The timeline is as long as the document says.
    # Share of the time that each camera's runs cover, against the samples of `explain --json`.
    document = next(c for c in explained.document["candidates"] if c["parameters"]["object"] == "g1")
    samples = document["samples"]
    t = np.array([sample["t"] for sample in samples])
    for name in ("cam2", "cam6"):
        seen = [any(v["cameras"][name]["covered"] for k, v in s["literals"].items() if "hold" in k) for s in samples]
        covered = float(np.diff(t)[np.array(seen[:-1]) & np.array(seen[1:])].sum())
        lengths = shown.js(
            """name => [...document.querySelectorAll(`.run.covered[aria-label^='${name}, the tool holds g1']`)]
                 .reduce((sum, run) => sum + parseFloat(run.style.width) / 100 * sqrp.motion.time, 0)""",
            name,
        )
        assert lengths == pytest.approx(covered, abs=0.1)


def test_everything_that_can_be_operated_has_a_name_and_can_be_reached(shown):
    nameless = shown.js(
        """() => [...document.querySelectorAll('button, input, select, [role=button], [role=img], table')]
             .filter((e) => !(e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length))
             .map((e) => e.outerHTML)"""
    )
    assert nameless == []
    reached = set()
    shown.js("document.activeElement.blur()")
    for _ in range(60):
        shown.page.keyboard.press("Tab")
        reached.add(shown.js("document.activeElement.id || document.activeElement.closest('[id]')?.id"))
    assert {"filter", "ranking", "plot", "view", "views", "time", "play", "timeline", "theme"} <= reached


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_text_stands_out_from_its_ground(opened, scheme):
    """At least 4.5 to 1, as WCAG 2.2 asks for text (success criterion 1.4.3); the page follows the browser's scheme."""
    opened.page.emulate_media(color_scheme=scheme)
    opened.page.wait_for_function("scheme => document.documentElement.dataset.theme === scheme", arg=scheme)
    causes = ["covered", "hidden", "out", "range", "angle"]
    names = ["ink", "faint", "accent", "star", "card", "ground", "sky", "accent-soft", *causes]
    look_up = "name => getComputedStyle(document.documentElement).getPropertyValue('--' + name).trim()"
    colors = {name: opened.js(look_up, name) for name in names}
    pairs = [(ink, "card") for ink in ("ink", "faint", "accent", "star", *causes)]
    pairs += [("ink", "ground"), ("faint", "ground"), ("ink", "sky"), ("ink", "accent-soft")]
    for ink, ground in pairs:
        assert contrast(colors[ink], colors[ground]) >= 4.5, (ink, ground)
    sign = "#ffffff" if scheme == "light" else "#10161c"
    for ground in causes:
        assert contrast(sign, colors[ground]) >= 4.5, ground


def contrast(first: str, second: str) -> float:
    """Ratio of luminances of two colours, as WCAG defines it."""

    def luminance(color: str) -> float:
        digits = color.lstrip("#")
        digits = "".join(2 * digit for digit in digits) if len(digits) == 3 else digits
        parts = np.array([int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)])
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    bright, dark = sorted((luminance(first), luminance(second)), reverse=True)
    return (bright + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("command", ["rank", "score"])
def test_a_cell_with_hostile_files_has_pages_that_work(browser, sqrp, watch, tmp_path, command):
    path, cell = tmp_path / "page.html", hostile_cell(watch, tmp_path)
    assert sqrp(command, cell, *(["watch cube"] if command == "rank" else []), "--report", path).code == 0
    opened = Opened(browser, path)
    assert "evil" in opened.js("document.title + document.body.innerText")
    click_at_random(opened, 5, 10)
    assert opened.complaints == []
    assert opened.requests == [path.as_uri()]
    assert opened.page.locator("img, a[href]:not(.skip), b:has-text('evil')").count() == 0
    opened.context.close()


# Tasks of several steps: one motion after the other, and which step is seen worst

CELL = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"
TASK = "pickup peg2 then insert peg2 socket yaw=0"


@pytest.fixture(scope="module")
def of_steps(sqrp, tmp_path_factory):
    """The page about the ranking, with a narrow view of the socket."""
    folder = tmp_path_factory.mktemp("report")
    text = CELL.read_text(encoding="utf-8").replace("36 deg", "16 deg")
    text = text.replace("../../../", f"{CELL.parents[3]}/").replace("skills/insert", f"{CELL.parent}/skills/insert")
    (folder / "peg.yaml").write_text(text, encoding="utf-8")
    page = folder / "page.html"
    assert sqrp("rank", folder / "peg.yaml", TASK, "--samples", 8, "--report", page, "--jobs", 1).code == 0
    return page


def test_the_page_of_a_ranking_plays_all_steps_and_says_which_is_seen_worst(of_steps):
    detail = detail_in(of_steps)
    first, second = detail["played"]
    assert (first["name"], second["name"]) == ("1: pickup peg2", "2: insert peg2 socket")
    assert (first["start"], first["end"], second["end"]) == pytest.approx((0.0, second["start"], detail["time"]))
    assert second["q_eoi"] < first["q_eoi"] < 1.0
    assert [first["seen_worst"], second["seen_worst"]] == [False, True]
    names = [primitive["name"] for primitive in detail["primitives"]]
    assert names[0] == "1.a1"
    assert names[-1].startswith("2.")
    assert {name for sample in detail["samples"] for name in sample["literals"]} >= {"1.hold(peg2)", "2.inserted(peg2)"}
    assert detail["samples"][-1]["t"] == pytest.approx(detail["time"])
    # Nothing is said twice: corners of boxes, and objects that never move.
    boxes = [box for one in detail["samples"] for literal in one["literals"].values() for box in literal["boxes"]]
    assert {*boxes[0]} == {"cameras"}
    assert {"socket"} <= {*detail["still"]}
    assert all({*one["objects"]} == {"peg2"} for one in detail["samples"])
    named = [one["literals"] for one in detail["formulas"]] + [[one["fault"] or ""] for one in detail["formulas"]]
    assert {name.removeprefix("not ")[:2] for names in named for name in names} <= {"1.", "2.", ""}


def test_the_page_shows_the_steps_above_their_timelines(browser, of_steps):
    opened = Opened(browser, of_steps)
    assert opened.complaints == []
    assert opened.texts("#steps button") == ["1: pickup peg2", "2: insert peg2 socket"]
    assert len(opened.texts("#steps .worst b")) == 1
    opened.page.click("#steps li:nth-child(2) button")
    assert opened.js("sqrp.time") == pytest.approx(detail_in(of_steps)["played"][1]["start"])
