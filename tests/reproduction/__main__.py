"""The paper's two experiments, each figure beside the paper's: `python -m tests.reproduction [--without-runs]`.

Prints the tables and writes the same as a page with pictures to `build/reproduction`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from math import nan
from pathlib import Path

from tests.reproduction import cells, findings
from tests.reproduction.cells import EVERY_SECOND, GREEN, SAMPLINGS, SCREW, feasible, figures_of
from tests.reproduction.findings import DRAWS, Findings, failing
from tests.reproduction.page import Page
from tests.reproduction.paper import (
    COMPUTING_BY_SAMPLES,
    Q_AVG_BY_SAMPLES,
    REAL_WORLD,
    RETRY_EARLIER,
    SIMULATION,
    Figures,
)
from tests.reproduction.runs import SLIP, Run, earlier, runs_with_slip

FOLDER = Path("build/reproduction")


def main(arguments: list[str]) -> int:
    """Exit code 0 if all findings hold."""
    page, tabletop, screws = Page(FOLDER), cells.shipped(cells.TABLETOP), cells.shipped(cells.SCREWS)
    pick_green = cells.pick_green(tabletop)
    simulated, real = pick_green(tabletop), cells.pick_screws(screws)
    page.heading("Simulation: six ways to pick up a green object, 10 samples per primitive")
    _qualities(page, simulated.of, SIMULATION)
    page.text(f"g6: {simulated.why_not_g6}. First in the ranking: {simulated.first}.")
    page.heading("Samples per primitive: Q_avg of g1 and the time to compute it")
    g1, rows, timelines = cells.candidates(tabletop, GREEN)["g1"], [], {}
    for name, sampling in SAMPLINGS.items():
        began = time.perf_counter()  # the check of its preconditions is part of it
        q_avg = figures_of(found := feasible(tabletop, g1, sampling)).q_avg
        computing, timelines[name] = f"{time.perf_counter() - began:.3f}", found.timeline
        paper = Q_AVG_BY_SAMPLES.get(name, "-"), COMPUTING_BY_SAMPLES.get(name, "-")
        rows.append((name, f"{q_avg:.2f}", paper[0], computing, paper[1]))
    page.table(("samples", "Q_avg [%]", "paper", "computed in [s]", "paper"), rows)
    for name in ("5", "10"):
        asked = timelines[name].monitored
        coverage = timelines[name].samples.t[asked], timelines[name].covered[asked]
        page.timeline(f"Coverage of g1, {name} samples per primitive", coverage)
    page.pictures("tabletop", GREEN, "g1")
    page.pictures("tabletop", GREEN, "g5")
    page.heading("Real world: two screws, a sample every second")
    _qualities(page, real.of, REAL_WORLD)
    page.pictures("screws", SCREW, "red2", EVERY_SECOND)
    runs = {} if "--without-runs" in arguments else runs_with_slip(list(REAL_WORLD), FOLDER)
    if runs:
        page.heading(f"At run time: {SLIP} for both screws")
        _runs(page, runs)
    page.heading("Findings")
    held = [*_findings(page, findings.SIMULATED, simulated), *_findings(page, findings.REAL, real)]
    if runs:
        held += _findings(page, findings.AFTER_A_SLIP, runs)
    page.heading("The same with every camera moved by 2 mm and turned by 0.2 degrees, 20 times")
    counts = [
        sum(not failing(asked, compute(findings.moved(cell, draw))) for draw in range(DRAWS))
        for asked, cell, compute in (
            (findings.SIMULATED, tabletop, pick_green),
            (findings.REAL, screws, cells.pick_screws),
        )
    ]
    page.text(f"All findings hold {counts[0]} times in simulation and {counts[1]} times in the real world.")
    page.write()
    print(f"\n{sum(held)} of {len(held)} findings hold. With pictures: {page.file}")
    return 0 if all(held) else 1


def _qualities(page: Page, found: Mapping[str, Figures], paper: Mapping[str, Figures]) -> None:
    rows, none = [], Figures(nan, nan, nan)
    for name, reported in paper.items():
        pairs = [f"{value:.2f}" for pair in zip(found.get(name, none), reported, strict=True) for value in pair]
        rows.append((name, *pairs))
    page.table(("object", "Q_avg [%]", "paper", "Q_eoi [%]", "paper", "time [s]", "paper"), rows)


def _runs(page: Page, runs: dict[str, Run]) -> None:
    times = {name: (run.t_f, run.t_r, run.moved_on, run.t_redo, run.t_e) for name, run in runs.items()}
    page.table(
        ("object", "slips t_f", "seen t_r", "moves on for", "acts t_redo", "done t_e"),
        [(name, *("-" if t is None else f"{t:.2f}" for t in own)) for name, own in times.items()],
    )
    for name, run in runs.items():
        if run.reason is not None:
            page.text(f"{name} stopped: {run.reason}")
    by = earlier(runs)
    found = "-" if by is None else f"{by:.1f} s"
    page.text(f"red1 finishes the retry earlier than red2 by {found}; in the paper by {RETRY_EARLIER:g} s.")
    page.text("Prediction against detection, over all images:")
    page.table(
        ("object", "literal", "camera", "predicted", "of them seen", "not predicted", "but seen"),
        [(name, *row) for name, run in runs.items() for row in run.prediction],
    )


def _findings(page: Page, asked: Findings, outcome: object) -> list[bool]:
    lost = failing(asked, outcome)
    page.table(("holds", "finding"), [("NO" if text in lost else "yes", text) for text in asked])
    return [text not in lost for text in asked]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
