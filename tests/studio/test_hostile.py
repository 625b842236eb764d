"""Names in files that want to be more than shown."""

from __future__ import annotations

import pytest

from tests.cli.hostile import hostile_cell
from tests.studio.hand import ROOT, Hand, Started


@pytest.mark.slow
def test_hostile_names_run_nothing(browser, tmp_path):
    cell = hostile_cell(ROOT / "tests" / "cases" / "watch", tmp_path)
    started = Started(cell)
    hand = Hand(browser, started.address)
    hand.wait("return sqrp.settled")
    made = "[...document.querySelectorAll('b, a, img')].filter((one) => one.textContent === 'evil' || one.src).length"
    assert hand.js(made) == 0
    assert "\\u{202e}" in hand.page.input_value("#task")
    for kind in ("camera", "object", "base"):
        name = hand.js("(kind) => Object.keys(sqrp.state.handles[kind])[0]", kind)
        hand.take(kind, name)
        hand.drag("x", 30, 10)
        hand.wait("return sqrp.settled")
    assert hand.complaints == []
    assert all(character.isprintable() for character in hand.page.inner_text("#lines").replace("\n", ""))
    code, err = started.closed()
    assert code == 0
    assert "Traceback" not in err
