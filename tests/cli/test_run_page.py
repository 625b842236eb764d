"""`run --report`: what the images showed, on the run's clock."""

from __future__ import annotations

import pytest

from sqrp_cli.cli.run_page import RunCell, write_run
from sqrp_cli.runtime.outcome import Confusion, Event, FaultRecord, RunReport, StepRecord
from tests.cli.browser import Opened, chromium


def evidence(t: float, value: str, **cameras: str) -> Event:
    literal = {"value": value, "asked": True, "cameras": cameras}
    other = {"value": "true", "asked": False, "cameras": {}}
    return Event(t + 0.05, "evidence", {"exposed": t, "literals": {"hold(g1)": literal, "open": other}})


@pytest.fixture(scope="module")
def opened(tmp_path_factory):
    """A run of 4 s: `hold(g1)` is true for 2 s, lost at 2 s, then unseen by all for 1 s."""
    path = tmp_path_factory.mktemp("run") / "page.html"
    events = [Event(0.0, "primitive", {"name": "a1"}), Event(1.0, "primitive", {"name": "a2"})]
    events += [evidence(0.1 * i, "true", cam1="true", cam2="true") for i in range(21)]
    events += [evidence(0.1 * i, "false", cam1="false") for i in range(21, 31)]
    events += [evidence(0.1 * i, "blind") for i in range(31, 41)]
    fault = FaultRecord("slip", 2.0, 2.0, 2.15, 2.5, None, predicted_delay=0.25)
    report = RunReport(
        "stopped", "hold(g1) should be seen", 4.0, [StepRecord("pickup", {"object": "g1"}, "pickup g1", 0.0)], [fault]
    )
    report.prediction = [{"hold(g1)": {"cam1": Confusion(tp=30, fp=10)}}]
    cell = RunCell("cell", ["cam1", "cam2"], "0123", None, "there is no workspace")
    write_run(cell, report, events, path, ["run", "pick.yaml", "--sim", "--report", str(path)])
    with chromium() as browser:
        yield Opened(browser, path)


def test_the_page_says_how_the_run_went(opened):
    assert opened.complaints == []
    assert opened.texts("#place") == ["stopped"]
    assert opened.texts("#reasons li") == ["hold(g1) should be seen"]
    told = dict(zip(opened.texts("#figures dt"), opened.texts("#figures dd"), strict=True))
    assert told["predicted to see, and did"] == "75.0 %"
    assert told["slip: seen after"] == "0.15 s"


def test_the_timeline_shows_what_the_images_showed(opened):
    labels = opened.js("[...document.querySelectorAll('.run')].map((run) => run.getAttribute('aria-label'))")
    own = [label.removeprefix("hold(g1), ") for label in labels if label.startswith("hold(g1), ")]
    assert own == [
        "0.00 s to 2.10 s: images show that it is true",
        "2.10 s to 3.10 s: images show that it is false",
        "3.10 s to 4.00 s: no image shows it",
    ]
    assert "cam2, hold(g1), 2.10 s to 4.00 s: no image shows it" in labels
    assert not any("open" in label for label in labels)


def test_a_fault_is_marked_from_when_it_happens_until_something_is_done(opened):
    marks = opened.js("[...document.querySelectorAll('.interest')].map((mark) => parseFloat(mark.style.left))")
    assert marks == pytest.approx([50.0, 53.75])


def test_the_time_is_told_in_words(opened):
    opened.js("() => sqrp.seek(2.5)")
    assert opened.texts(".now h4 span") == ["images show that it is false"]
    assert opened.texts("#now-time") == ["2.50 s, a2"]
    assert not opened.page.locator("#view").is_visible()
