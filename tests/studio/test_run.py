"""A program that runs in the studio, with a fault by a click: the same run as the command's."""

from __future__ import annotations

import shlex

import pytest

from sqrp_cli import open_cell, open_program
from tests.studio.conftest import TASK
from tests.studio.hand import Hand

pytestmark = pytest.mark.slow

CLICKED_IN_THE_LIFT = """() => {
  const lifts = document.querySelector('#run-doing').textContent === 'lift';
  if (lifts) document.querySelector('#run-slip').click();
  return lifts;
}"""
"""The page clicks by itself: the run goes on while a hand from outside finds the button, which may be too late."""

TRIES = 4
"""A run waits for no browser: where it is over before a page on a busy computer has clicked, it is run again."""


def test_a_part_that_is_dropped_by_a_click_is_a_fault_of_the_command(browser, studio, cell, tmp_path):
    program = tmp_path / "pick.yaml"
    open_cell(cell).rank(TASK).write(program)
    hand = Hand(browser, studio.address)
    hand.page.fill("#program", str(program))
    for _ in range(TRIES):
        hand.page.click("#run")
        hand.page.wait_for_selector("#run-images img[src]")
        hand.page.wait_for_function(CLICKED_IN_THE_LIFT)
        hand.page.wait_for_function("() => !sqrp.runs.going")
        if hand.js("sqrp.runs.report.faults.length"):
            break
    line = shlex.split(hand.js("sqrp.state.lines.at(-1).line"))
    assert line[:4] == ["sqrp", "run", str(program), "--sim"]
    assert line[4] == "--fault"
    shown = hand.js("sqrp.runs.report")
    report = open_program(program).run([line[5]]).report
    assert report.outcome == shown["outcome"] == "done"
    assert report.time == shown["time"]
    assert [[one.name, one.happened, one.detected, one.recovered] for one in report.faults] == [
        [one["name"], one["happened"], one["detected"], one["recovered"]] for one in shown["faults"]
    ]
    assert len(shown["faults"]) == 1
    assert hand.complaints == []
    assert hand.js("[...sqrp.runs.images.keys()]") == list(open_cell(cell).workspace.cameras)
