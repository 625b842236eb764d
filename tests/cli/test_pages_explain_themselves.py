"""What a first-time viewer needs of a page: words, legends, figures in sight, at two sizes, without mouse or colour."""

from __future__ import annotations

import pytest

from sqrp_cli.figures import FaultMetrics
from sqrp_cli.run.record.events import ShownAtom, event
from sqrp_cli.run.record.report import FaultRecord, RunReport, StepRecord
from sqrp_cli.show.pages.assembly import PageContent, PageRow, write_page
from sqrp_cli.show.pages.run_page import story, write_run
from sqrp_cli.study.result import CandidateResult
from tests.cli.browser import Opened, walk

SIZES = [(1400, 900), (800, 600)]

FAULTS = {"slip": (0.2, 0.5), "popped_out": (1.1, 4.4), "dropped": (0.3, 0.9)}
"""Mean and worst delay [s]."""


def figures(name: str, time: float) -> CandidateResult:
    faults = {
        fault: FaultMetrics(delay_mean=mean, delay_worst=worst, blind_longest=0.1, unseen=0.0, expected_time=2 * time)
        for fault, (mean, worst) in FAULTS.items()
    }
    known = dict.fromkeys(("t_total", "t_eoi", "states", "ways"), None)
    shown = {"parameters": {"object": name}, "feasible": True, "rank": 1, "reasons": (), "pareto": False, "verdict": ""}
    return CandidateResult(**known, **shown, time=time, q_avg=0.9, q_eoi=0.8, faults=faults)


def wide(tmp_path, labels: int):
    """A page of two candidates with several faults and many parameters."""
    names = {f"parameter_{number}": f"{10 * number} mm" for number in range(labels)}
    rows = [
        PageRow(name, f"{rank}", {"object": name, **names}, figures(name, time), [], None, None, retried=["slip"])
        for rank, (name, time) in enumerate([("g1", 9.0), ("g2", 12.0)], 1)
    ]
    path = tmp_path / "wide.html"
    write_page(PageContent("Wide", "", "Candidates", [("command", "sqrp " + 40 * "word ")], rows, []), path)
    return path


@pytest.fixture(scope="module")
def ranked(sqrp, watch, tmp_path_factory):
    """The page of a small ranking, and its document."""
    path = tmp_path_factory.mktemp("explains") / "page.html"
    assert sqrp("rank", watch, "watch green", "--report", path, "--jobs", 1).code == 0
    return path, sqrp("rank", watch, "watch green", "--json").document["candidates"]


@pytest.fixture(scope="module")
def opened(browser, ranked):
    return Opened(browser, ranked[0])


def resized(opened: Opened, size: tuple[int, int]) -> Opened:
    opened.page.set_viewport_size({"width": size[0], "height": size[1]})
    return opened


def too_wide(opened: Opened) -> list[str]:
    """Elements that reach beyond the window, and those whose content is cut off at their sides."""
    found = opened.js(
        """() => [...document.querySelectorAll('main *, header *')].filter((e) => {
            const { width, left, right } = e.getBoundingClientRect();
            const cut = e.matches('.scroll') && e.scrollWidth > e.clientWidth;
            return width && !e.closest('.unseen, #labels, #view') && (right > innerWidth + 0.5 || left < -0.5 || cut);
        }).map((e) => e.outerHTML.slice(0, 80))"""
    )
    assert isinstance(found, list)
    return found


@pytest.mark.parametrize("labels", [2, 9])
def test_the_worst_fault_is_in_sight_however_many_columns_there_are(browser, tmp_path, labels):
    opened = Opened(browser, wide(tmp_path, labels))
    for size in SIZES:
        assert too_wide(resized(opened, size)) == []
        cells = dict(zip(opened.texts("#ranking th"), opened.texts("#ranking tbody tr:first-child td"), strict=True))
        assert cells["worst fault"] == "popped_out"
        assert (cells["noticed after [s]"], cells["at the latest"]) == ("1.10", "4.40")
        assert ("with" in cells) is (labels > 4)
    assert opened.complaints == []
    opened.context.close()


@pytest.mark.parametrize("size", SIZES)
def test_nothing_is_wider_than_the_window_and_every_stop_of_the_tab_key_is_in_sight(opened, size):
    assert too_wide(resized(opened, size)) == []
    walk(opened.page)
    assert opened.complaints == []


def test_figures_are_those_of_the_document_and_it_is_said_why_the_first_is_the_best(opened, ranked):
    best = ranked[1][0]
    (name, fault), *_ = best["faults"].items()
    shown = dict(zip(opened.texts("#figures dt"), opened.texts("#figures dd"), strict=True))
    shares = {"critical time seen": f"{100 * best['q_eoi']:.1f} %", "time seen": f"{100 * best['q_avg']:.1f} %"}
    assert shown == {**shares, "time": f"{best['time']:.2f} s"}
    cells = [
        best["happens"][name].replace("`", ""),
        *(f"{fault[key]:.2f} s" for key in ("delay_mean", "delay_worst", "blind_longest")),
    ]
    assert opened.texts("#faults td")[:4] == cells
    (said,) = opened.texts("#summary")
    assert said.startswith("Take seen: if moved happens (wait, w2), you know after ")


def test_words_explain_themselves_and_the_legend_has_what_the_rows_have(opened):
    # Every word explains itself to the keyboard and in the list.
    words = opened.page.locator("dfn[tabindex='0'], #ranking th button")
    told = {}
    for index in range(words.count()):
        words.nth(index).focus()
        if opened.page.locator("#tip").is_visible():
            told[words.nth(index).inner_text()] = opened.texts("#tip")[0].strip("\u2068\u2069")
            assert words.nth(index).get_attribute("aria-describedby") == "tip"
    assert {"critical time seen", "time seen", "time", "at the latest", "longest time unseen"} <= set(told)
    listed = dict(zip(opened.texts("#words dt"), opened.texts("#words dd"), strict=True))
    assert {"fact", "seen", "critical time", "critical time seen"} <= set(listed)
    assert listed["critical time seen"] == told["critical time seen"]
    opened.page.keyboard.press("Escape")
    assert not opened.page.locator("#tip").is_visible()
    # The legend has what the rows have as it looks there.
    looks = """selector => [...document.querySelectorAll(selector)].map((e) => {
        const { backgroundImage, backgroundColor } = getComputedStyle(e);
        return `${backgroundColor} ${backgroundImage}`;
    })"""
    for candidate in range(2):
        opened.js("i => sqrp.select(i)", candidate)
        rows = set(opened.js(looks, "#timeline .run, #timeline .interest"))
        assert rows == set(opened.js(looks, "#legend .swatch:not(.lane)"))
    opened.js("() => sqrp.select(0)")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_causes_differ_by_pattern_or_sign_and_not_only_by_colour(opened, scheme):
    """Each style beside its patterns, without the colours in them; with the letters that stand in its runs."""
    opened.page.emulate_media(color_scheme=scheme)
    styles = {
        "covered": {"", "t"}, "missed": {"–"}, "hidden": {"h"}, "same": {"c"}, "out": {"o", "f"}, "range": {"f", "n"},
        "angle": {"a", "s"}, "nothing": {""},
    }  # fmt: skip
    found = opened.js(
        """names => names.map((name) => {
            const run = document.createElement('div');
            run.className = `run ${name}`;
            document.querySelector('.lane').append(run);
            const { backgroundImage, backgroundSize } = getComputedStyle(run);
            run.remove();
            return (backgroundImage + backgroundSize).replace(/(rgb|color)a?\\([^)]*\\)/g, '');
        })""",
        list(styles),
    )
    looks = {(pattern, sign) for pattern, signs in zip(found, styles.values(), strict=True) for sign in signs}
    assert len(looks) == sum(map(len, styles.values()))


def run_page(tmp_path, fault: FaultRecord | None, attempts: int = 1) -> tuple[RunReport, object]:
    shown = ShownAtom(value="true", asked=True, cameras={"cam1": "true"}, true=True)
    events = [event("primitive", 0.0, name="a4", does="lift")]
    events += [event("evidence", t, exposed=t, literals={"hold(g1)": shown}) for t in (0.0, 5.0, 10.0)]
    step = StepRecord("pickup", {"object": "g1"}, "pickup g1", 0.0, 18.15, attempts)
    report = RunReport("done", None, 18.15, [step], [] if fault is None else [fault])
    path = tmp_path / "run.html"
    began = event("run", 0.0, sqrp_log=1, workspace="cell", digest="0123", cameras=["cam1"])
    write_run(began, report, events, path, ["run"])
    return report, path


def test_a_run_begins_with_what_happened_and_opens_there(browser, tmp_path):
    report, path = run_page(tmp_path, FaultRecord("slip", 7.47, 7.47, 7.55, 8.0, 18.15), attempts=2)
    assert story(report) == "Slip at 7.47 s, noticed after 0.08 s, tried again, done at 18.15 s."
    opened = Opened(browser, path)
    assert opened.texts("#summary") == [story(report)]
    assert opened.js("sqrp.time") == 7.47
    assert opened.texts("#moments [aria-pressed=true]") == ["7.47 s slip happens"]
    assert opened.texts(".row.axis .now")[0] == "lift"
    # Nothing of a prediction is on the page.
    assert not {"critical time seen", "longest time unseen"} & set(opened.texts("#words dt"))
    for size in SIZES:
        assert too_wide(resized(opened, size)) == []
        walk(opened.page)
    opened.context.close()


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        (None, "No fault, done at 18.15 s."),
        (FaultRecord("slip", 7.0, 7.0), "Slip at 7.00 s, never noticed, done at 18.15 s."),
        (FaultRecord("slip", 7.0), "Slip injected, but it never came true, done at 18.15 s."),
        (FaultRecord("camera loss", 5.0, None, 5.3, 5.3, camera="cam2"), "Camera loss cam2 noticed at 5.30 s, done at"),
    ],
)
def test_a_run_is_told_in_one_sentence(tmp_path, fault, told):
    report, _ = run_page(tmp_path, fault)
    assert story(report).startswith(told)
