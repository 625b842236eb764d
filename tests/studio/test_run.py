"""A program that runs in the studio, with a fault by a click: the same run as the command's."""

from __future__ import annotations

import shlex

import pytest

from sqrp_cli import open_cell, open_program
from tests.studio.conftest import TASK
from tests.studio.hand import Hand

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cell(cell):
    """That copy with fewer cameras and images, and small ones, as what they show is not what this is about."""
    file = cell / "workspace.yaml"
    text = file.read_text()
    text = text[: text.index("  cam4:")] + text[text.index("skills:") :]
    for old, new in (
        ("width: 640, height: 480", "width: 320, height: 240"),
        ("pixels: 12", "pixels: 6"),
        ("10 Hz", "3 Hz"),
    ):
        text = text.replace(old, new)
    file.write_text(text)
    return cell


CLICK_IN_THE_LIFT = """() => new MutationObserver(() => {
  if (document.querySelector('#run-doing').textContent === 'lift') document.querySelector('#run-slip').click();
}).observe(document.querySelector('#run-doing'), { childList: true })"""
"""The page clicks by itself, as soon as it is told: the run goes on while a hand from outside finds the button."""


def test_a_part_that_is_dropped_by_a_click_is_a_fault_of_the_command(browser, studio, cell, tmp_path):
    program = tmp_path / "pick.yaml"
    open_cell(cell).rank(TASK).write(program)
    hand = Hand(browser, studio.address)
    hand.page.fill("#program", str(program))
    hand.js(CLICK_IN_THE_LIFT)
    hand.page.click("#run")
    hand.page.wait_for_selector("#run-images img[src]")
    hand.wait("return !sqrp.runs.going")
    line = shlex.split(hand.js("sqrp.state.lines.at(-1).line"))
    assert line[:4] == ["sqrp", "run", str(program), "--sim"]
    assert line[4] == "--fault"
    shown = hand.js("sqrp.runs.report")
    report = open_program(program).run([line[5]])
    assert report.outcome == shown["outcome"] == "done"
    assert report.time == shown["time"]
    assert [[one.name, one.happened, one.detected, one.recovered] for one in report.faults] == [
        [one["name"], one["happened"], one["detected"], one["recovered"]] for one in shown["faults"]
    ]
    assert len(shown["faults"]) == 1
    assert hand.complaints == []
    assert hand.js("[...sqrp.runs.images.keys()]") == list(open_cell(cell).workspace.cameras)
