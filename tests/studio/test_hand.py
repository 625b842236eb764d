"""What a hand does in the picture: figures follow, and what is saved is what the commands write."""

from __future__ import annotations

import json
import shlex

import pytest

from sqrp_cli import open_cell
from sqrp_cli.cli.main import run
from tests.cli.browser import walk
from tests.studio.conftest import TASK
from tests.studio.hand import Hand

pytestmark = pytest.mark.slow

POSES = "sqrp.scene.cameras.map(({ node }) => node.matrix.elements.map((x) => +x.toFixed(9)))"
EXACT = f"[document.querySelector('#figures').textContent, {POSES}]"
"""Where cameras are drawn, also with what is shown of the chosen candidate."""


@pytest.fixture(scope="module")
def hand(browser, studio):
    """A page of the studio; every test leaves it without unsaved changes."""
    return Hand(browser, studio.address)


@pytest.fixture(autouse=True)
def quiet(hand):
    """No test leaves a complaint in the console, or an unsaved change."""
    yield
    undo_all(hand)
    assert hand.complaints == []


def figures(candidates):
    """All that a document says of candidates but their other ways, which the studio does not seek."""
    return [{key: value for key, value in one.items() if key != "ways"} for one in candidates]


def undo_all(hand: Hand) -> None:
    while hand.js("sqrp.state.undo !== null"):
        before = hand.js("sqrp.state.undo")
        hand.page.click("#undo")
        hand.wait("return sqrp.state.undo !== x || !sqrp.state.dirty", before)


def test_a_dragged_camera_moves_verdicts_at_once_and_the_ranking_when_it_rests(hand, cell):
    file = cell / "workspace.yaml"
    before = file.read_bytes()
    hand.take("camera", "cam5")
    x, y = hand.js("sqrp.gizmo.target.move.position.slice(0, 2)")
    covered = hand.js("document.querySelector('#figures').textContent")
    hand.drag("x", 90, 20, steps=6, leave=True)
    hand.wait("return sqrp.latencies.length > 0")
    hand.page.mouse.up()
    hand.wait("return sqrp.state.dirty")
    moved_x, moved_y = hand.js("sqrp.state.handles.camera.cam5.position.slice(0, 2)")
    assert moved_x != x
    assert moved_y == y
    assert file.read_bytes() == before
    shown = hand.ranked()
    hand.page.click("#save")
    hand.page.click("#save-now")
    hand.wait("return !sqrp.state.dirty")
    document = json.loads(open_cell(cell).rank(TASK).to_json())
    assert figures(shown) == figures(document["candidates"])
    assert covered != ""
    # The line that was shown does the same to the file as it was.
    line = hand.js("sqrp.state.lines.find(({ what }) => what.startsWith('cam5')).line")
    saved = file.read_bytes()
    file.write_bytes(before)
    hand.wait("return sqrp.state.undo === null && sqrp.settled")
    assert run(shlex.split(line)[1:]) == 0
    hand.wait("return sqrp.state.handles.camera.cam5.position[0] !== x", x)
    assert file.read_bytes() == saved
    assert b"# A UR5 with a suction cup" in saved
    hand.wait("return sqrp.settled")


HEARD = """() => {
  const hear = sqrp.hear.bind(sqrp), body = document.body.classList;
  sqrp.told = [];
  sqrp.hear = (message) => {
    hear(message);
    const now = document.querySelector('#now').textContent;
    sqrp.told.push([sqrp.settled, body.contains('old'), body.contains('old-figures'), body.contains('old-time'), now]);
  };
}"""

SHIFT = """() => {
  const [now, advise] = ['#now', '#advise'].map((id) => document.querySelector(id));
  const empty = advise.offsetTop;
  now.textContent = 'Ranking …';
  const full = advise.offsetTop;
  now.textContent = '';
  return full - empty;
}"""
"""By how much a button moves when nothing is computed any more [pixels]."""


def test_what_is_of_before_is_dimmed_and_what_is_computed_is_said(hand):
    hand.ranked()
    hand.js(HEARD)
    hand.take("camera", "cam5")
    hand.drag("x", 60, 10, steps=6, leave=True)
    hand.wait("return sqrp.told.length > 0 && sqrp.sketchShown")
    held = hand.js("[sqrp.told.at(-1), getComputedStyle(document.querySelector('#ranking')).opacity]")
    assert held[0][1:4] == [True, False, False]
    assert "≈" in held[0][4]
    assert float(held[1]) < 0.6
    hand.page.mouse.up()
    hand.wait("return sqrp.state.dirty && sqrp.settled && sqrp.detailShown")
    told = hand.js("sqrp.told")
    assert all(settled != old for settled, old, *_ in told)
    assert any(old_figures and now.startswith(f"Ranking {TASK} …") for _, _, old_figures, _, now in told)
    assert any(now.endswith("over time …") and old_time for *_, old_time, now in told)
    assert told[-1] == [True, False, False, False, ""]
    assert hand.js(SHIFT) == 0, "a click that began when the text went away would be lost"


FIRST = """window.said = []; new MutationObserver(() => {
  const table = document.querySelector('#ranking');
  if (table?.tBodies[0]?.rows.length) said.push(table.innerText);
}).observe(document, { childList: true, subtree: true });"""


def test_before_the_first_ranking_the_table_says_that_it_is_under_way(browser, studio):
    page = browser.new_page()
    page.add_init_script(FIRST)
    page.goto(studio.address)
    page.wait_for_selector("html[data-ready=true]")
    said = page.evaluate("said")
    page.close()
    assert " ".join(said[0].split()) == "candidate critical time seen time seen time [s] being ranked …"
    assert not [text for text in said if "undefined" in text]


def test_what_is_undone_is_as_it_was_and_what_is_redone_as_it_became(hand, cell):
    file = cell / "workspace.yaml"
    before = file.read_bytes()
    hand.take("object", "g2")
    at = hand.js("sqrp.state.handles.object.g2.position")
    hand.drag("y", 14, 10)
    hand.wait("return sqrp.state.dirty")
    hand.drag("turn", 20, -16)
    hand.wait("return sqrp.state.unsaved.length === 2")
    hand.page.click("#save")
    hand.wait("return document.querySelector('#difference').open")
    difference = hand.page.inner_text("#patch")
    hand.page.click("#save-not")
    assert (
        "-  g2: {type: cube, color: green, size: [4 cm, 4 cm, 4 cm], pose: {position: [0.48, 0.28, 0.02]}, on: table}"
        in difference
    )
    assert "rpy:" in difference
    hand.page.keyboard.press("Control+z")
    hand.page.keyboard.press("Control+z")
    hand.wait("return !sqrp.state.dirty")
    assert hand.js("sqrp.state.handles.object.g2.position") == at
    hand.page.keyboard.press("Control+y")
    hand.wait("return sqrp.state.unsaved.length === 1")
    assert file.read_bytes() == before


def test_numbers_can_be_typed_and_the_robot_moves_too(hand):
    hand.take("camera", "cam2")
    hand.type("view angle [deg]", "45")
    hand.wait("return sqrp.state.dirty")
    assert "'cameras.cam2.image.horizontal_fov=45 deg'" in hand.js("sqrp.state.lines.at(-1).line")
    hand.take("base", "")
    hand.type("position [m], x", "0.02")
    hand.wait("return sqrp.state.unsaved.length === 2 && sqrp.scene.scene.robot.base[0][3] === 0.02")
    assert "robot.base.position.0=0.02" in hand.js("sqrp.state.lines.at(-1).line")


SAID = "return document.querySelector('#notices').textContent.includes(x)"


def test_a_move_that_makes_no_cell_is_refused_until_something_else_is_done(hand):
    hand.wait("return sqrp.settled")
    hand.take("camera", "cam2")
    before = hand.js(POSES)
    hand.type("position [m], x", "1000")
    hand.wait(SAID, "expected at most")
    assert not hand.js("sqrp.state.dirty")
    assert hand.js(POSES) == before
    hand.js("sqrp.put({ ...sqrp.fields.move, look_at: sqrp.fields.move.position })")
    hand.wait(SAID, "cannot look at its own lens")
    hand.type("view angle [deg]", "40")
    hand.wait("return sqrp.state.undo?.includes('cam2') && !document.querySelector('#notices .refused')")
    hand.type("view angle [deg]", "400")
    hand.wait(SAID, "400 deg, expected 1 to 177 deg")


def test_esc_puts_everything_back_and_the_figures_are_exact_again(hand):
    hand.take("camera", "cam6")
    hand.wait("return sqrp.settled")
    before = hand.js(EXACT)
    hand.drag("z", 0, -20, leave=True)
    hand.wait("return document.querySelector('#figures .coarse')")
    hand.page.keyboard.press("Escape")
    hand.page.mouse.up()
    hand.wait("return sqrp.settled && !document.querySelector('#figures .coarse')")
    assert hand.js(EXACT) == before
    assert not hand.js("sqrp.state.dirty")


ABOVE = """['#undo', '#save', '#fields', '.overview'].map((id) => document.querySelector(id).getBoundingClientRect())
  .every(({ bottom }, k, all) => k === 3 || bottom < all[3].top)"""
"""Whether what moves and saves stands above the candidates, as on a narrow screen."""


def test_at_800_by_600_what_moves_and_saves_stands_above_the_candidates(hand):
    hand.page.set_viewport_size({"width": 800, "height": 600})
    assert hand.js(ABOVE)
    hand.page.set_viewport_size({"width": 1400, "height": 900})


@pytest.mark.trial
def test_a_second_tab_follows(hand, browser, studio):
    other = Hand(browser, studio.address, 800, 600)
    hand.take("camera", "cam1")
    hand.drag("aim", 30, 10)
    for tab in (hand, other):
        tab.wait("return sqrp.state.dirty && sqrp.settled")
    same = "[sqrp.state.handles.camera.cam1, sqrp.entries.map(({ candidate }) => candidate), sqrp.state.unsaved]"
    assert hand.js(same) == other.js(same)
    pose = "sqrp.scene.cameras[0].node.matrix.elements.map((x) => +x.toFixed(5))"
    assert hand.js(pose) == other.js(pose)
    other.page.click("#undo")
    hand.wait("return !sqrp.state.dirty")
    assert other.complaints == []
    other.context.close()


def test_a_syntax_error_outside_is_shown_and_recovered_from(hand, cell):
    file = cell / "workspace.yaml"
    good = file.read_bytes()
    hand.take("camera", "cam6")
    hand.drag("z", 0, -20)
    hand.wait("return sqrp.state.dirty && sqrp.settled")
    file.write_bytes(good.replace(b"robot:", b"robot: ["))
    hand.wait(SAID, "cannot be read")
    assert "workspace.yaml:" in hand.page.inner_text("#notices")
    hand.page.click("#save")
    hand.page.click("#save-now")
    hand.wait(SAID, "changed meanwhile")
    file.write_bytes(good.replace(b"rate: 10 Hz", b"rate: 20 Hz", 1))
    hand.wait(SAID, "new state")
    hand.wait("return sqrp.overview.scenes[0].cameras.cam1.rate === 20 && sqrp.settled")
    assert hand.js("sqrp.state.unsaved.length") == 1
    undo_all(hand)
    file.write_bytes(good)
    hand.wait("return sqrp.overview.scenes[0].cameras.cam1.rate === 10")


MORE = b"""\
  more:
    pose: {position: [1, 1, 1], look_at: [0, 0, 0]}
    image: {width: 640, height: 480, horizontal_fov: 60 deg}
    rate: 10 Hz
"""


@pytest.mark.parametrize("held", [False, pytest.param(True, marks=pytest.mark.trial)])
def test_a_camera_may_appear_outside_while_one_looks_through_another_or_holds_it(hand, cell, held):
    file = cell / "workspace.yaml"
    good = file.read_bytes()
    if held:
        hand.take("camera", "cam6")
        hand.drag("z", 0, -20, leave=True)
        hand.wait("return sqrp.held && sqrp.answered === sqrp.asked")
    else:
        hand.js("sqrp.look('cam1')")
    file.write_bytes(good.replace(b"  cam1:", MORE + b"  cam1:", 1))
    hand.wait("return sqrp.scene.cameras.length === 7 && sqrp.settled")
    if held:
        hand.page.mouse.up()
        assert not hand.js("sqrp.state.dirty")
    else:
        assert hand.js("sqrp.scene.through") == "cam1"
    file.write_bytes(good)
    hand.wait("return sqrp.scene.cameras.length === 6 && sqrp.settled")
    hand.js("sqrp.look(null)")


def test_a_task_is_asked_for_by_words_and_by_motion_parameters(hand):
    hand.type("#task", "pickup blue")
    hand.wait("return sqrp.state.task === 'pickup blue' && sqrp.settled")
    assert [one["parameters"]["object"] for one in hand.ranked()] == ["b1"]
    hand.page.click("#motion summary")
    shown = "(name) => [...document.querySelector(`[aria-label='${name}']`).options].map((one) => one.text)"
    assert hand.js(shown, "elbow") == ["any", "fastest", "up", "down"]
    assert hand.js(shown, "path") == ["direct", "seen", "any"]
    hand.page.select_option("[aria-label='elbow']", "fastest")
    hand.wait("return sqrp.state.task === 'pickup blue elbow=fastest' && sqrp.settled")
    hand.type("#task", "pickup purple")
    hand.wait("return document.querySelector('#notices .refused')")
    hand.type("#task", TASK)
    hand.wait("return sqrp.state.task === x && sqrp.settled", TASK)


def test_a_program_is_what_the_command_writes(hand, tmp_path, cell):
    ours, theirs = tmp_path / "ours.yaml", tmp_path / "theirs.yaml"
    hand.page.fill("#program", str(ours))
    hand.page.click("#write")
    hand.wait(SAID, "holds the program")
    line = shlex.split(hand.js("sqrp.state.lines.at(-1).line"))
    assert line[:2] == ["sqrp", "rank"]
    assert run([str(theirs) if word == str(ours) else word for word in line[1:]]) == 0
    assert ours.read_bytes() == theirs.read_bytes()
    hand.page.fill("#program", str(cell / "workspace.yaml"))
    before = (cell / "workspace.yaml").read_bytes()
    hand.page.click("#write")
    hand.wait("return document.querySelector('#notices .refused')")
    assert (cell / "workspace.yaml").read_bytes() == before


def test_advice_is_found_and_applied_as_the_command_does_it(hand, cell):
    file = cell / "workspace.yaml"
    before = file.read_bytes()
    hand.take("camera", "cam6")
    hand.type("position [m], x", "3")
    hand.wait("return sqrp.state.dirty && sqrp.settled")
    hand.page.click("#advise")
    hand.wait("return document.querySelector('#offers p')")
    assert not hand.js("document.querySelector('#offers').matches('.old')")
    undo_all(hand)
    assert hand.js("document.querySelector('#offers').matches('.old')")  # found in a cell that is no more
    assert file.read_bytes() == before


CUT = """[...document.querySelectorAll('.scroll, #studio, #candidate, #fields input')]
  .filter((e) => e.scrollWidth > e.clientWidth).map((e) => e.outerHTML.slice(0, 80))"""
"""What has a part that is reached only by scrolling sideways, or not at all."""
COLUMNS = "[...document.querySelectorAll('#ranking th')].map((one) => one.textContent)"


@pytest.mark.parametrize("size", [pytest.param((1400, 900), marks=pytest.mark.trial), (800, 600)])
def test_nothing_is_cut_off_and_every_stop_of_the_tab_key_is_in_sight(browser, studio, size):
    hand = Hand(browser, studio.address, *size)
    titles = "#, object, critical time seen, time seen, time [s], noticed after [s], at the latest"
    assert ", ".join(hand.js(COLUMNS)) == titles
    assert hand.js(CUT) == []
    walk(hand.page)
    assert hand.complaints == []


@pytest.mark.trial
def test_a_new_ranking_leaves_the_keyboard_where_it_is(browser, studio):
    hand = Hand(browser, studio.address)
    hand.ranked()
    hand.page.locator("#ranking tbody button").last.focus()
    name = hand.js("document.activeElement.textContent")
    hand.js("sqrp.tell({ do: 'reread' })")
    hand.wait("return sqrp.ranked > x", hand.js("sqrp.ranked"))
    hand.ranked()
    assert hand.js("document.activeElement.textContent") == name


def test_a_cell_that_is_drawn_anew_leaves_nothing_behind(hand):
    hand.ranked()
    hand.js("""() => {
      window.before = new WeakRef(sqrp.scene);
      sqrp.hear({ do: 'cell', scene: sqrp.overview.scenes[0], model: sqrp.model });
    }""")
    hand.wait("return !sqrp.scene.waiting")
    devtools = hand.context.new_cdp_session(hand.page)
    devtools.send("HeapProfiler.collectGarbage")
    devtools.detach()
    assert hand.js("window.before.deref() === undefined")


@pytest.mark.slow
def test_a_page_that_falls_behind_a_run_shows_the_newest_of_it(hand):
    shown = hand.js("""async () => {
      const images = [], states = [], seek = sqrp.scene.seek;
      sqrp.hear({ do: 'run-began', file: 'pick.yaml', cameras: ['cam1', 'cam2'], faults: [] });
      sqrp.scene.seek = () => states.push(sqrp.scene.motion.around(0)[0].held);
      for (const image of sqrp.runs.images.values())
        Object.defineProperty(image, 'src', { set: (data) => images.push(data.slice(-2)) });
      for (let k = 10; k < 60; k++) {
        sqrp.hear({ do: 'run-state', q: {}, objects: {}, held: `g${k}` });
        for (const camera of ['cam1', 'cam2']) sqrp.hear({ do: 'run-image', camera, data: `${k}` });
      }
      await new Promise(requestAnimationFrame);
      sqrp.scene.seek = seek;
      sqrp.hear({ do: 'job-ended' });
      document.querySelector('#running').hidden = true;
      return [images, states];
    }""")
    assert shown == [["59", "59"], ["g59"]]
