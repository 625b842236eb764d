"""What a hand does in the picture: figures follow, and what is saved is what the commands write."""

from __future__ import annotations

import json
import shlex

import pytest

from sqrp_cli import open_cell
from sqrp_cli.cli.main import run
from tests.studio.conftest import TASK
from tests.studio.hand import Hand


@pytest.fixture(scope="module")
def hand(browser, studio):
    """A page of the studio; every test leaves it without unsaved changes."""
    return Hand(browser, studio.address)


@pytest.fixture(autouse=True)
def quiet(hand):
    """No test leaves a complaint in the console."""
    yield
    assert hand.complaints == []


def figures(candidate):
    """All that a document says of a candidate but its other ways, which the studio does not seek."""
    return {key: value for key, value in candidate.items() if key != "ways"}


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
    hand.drag("x", 90, 20, steps=6)
    assert hand.js("sqrp.latencies.length") > 0
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
    assert [figures(one) for one in shown] == [figures(one) for one in document["candidates"]]
    assert covered != ""
    # The line that was shown does the same to the file as it was.
    line = hand.js("sqrp.state.lines.find(({ what }) => what.startsWith('cam5')).line")
    saved = file.read_bytes()
    file.write_bytes(before)
    assert run(shlex.split(line)[1:]) == 0
    assert file.read_bytes() == saved
    assert b"# A UR5 with a suction cup" in saved
    hand.wait("return sqrp.settled")
