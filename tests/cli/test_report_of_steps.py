"""The pages of tasks of several steps: one motion after the other, and which step is seen worst."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.browser import Opened
from tests.cli.pages import detail_in

CELL = Path(__file__).parents[1] / "cases" / "contact" / "peg.yaml"
TASK = "pickup peg2 then insert peg2 socket yaw=0"


@pytest.fixture(scope="module")
def written(sqrp, tmp_path_factory):
    """The page about the ranking, with a narrow view of the socket."""
    folder = tmp_path_factory.mktemp("report")
    text = CELL.read_text(encoding="utf-8").replace("36 deg", "16 deg")
    text = text.replace("../../../", f"{CELL.parents[3]}/").replace("skills/insert", f"{CELL.parent}/skills/insert")
    (folder / "peg.yaml").write_text(text, encoding="utf-8")
    page = folder / "page.html"
    assert sqrp("rank", folder / "peg.yaml", TASK, "--samples", 8, "--report", page, "--jobs", 1).code == 0
    return page


def test_the_page_of_a_ranking_plays_all_steps_and_says_which_is_seen_worst(written):
    detail = detail_in(written)
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


def test_the_page_shows_the_steps_above_their_timelines(browser, written):
    opened = Opened(browser, written)
    assert opened.complaints == []
    assert opened.texts("#steps button") == ["1: pickup peg2", "2: insert peg2 socket"]
    assert len(opened.texts("#steps .worst b")) == 1
    opened.page.click("#steps li:nth-child(2) button")
    assert opened.js("sqrp.time") == pytest.approx(detail_in(written)["played"][1]["start"])
