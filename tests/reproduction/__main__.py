"""The paper's two experiments, each figure beside the paper's: `python -m tests.reproduction [--without-runs]`.

Prints the tables and writes the same as a page with pictures to `build/reproduction`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sqrp_cli.motion.cell import Cell
from sqrp_cli.study.sampling import FixedStep
from tests.reproduction.findings import DRAWS, REAL, SIMULATED, Finding, failing, moved
from tests.reproduction.page import Page
from tests.reproduction.paper import (
    COMPUTING_BY_SAMPLES,
    Q_AVG_BY_SAMPLES,
    REAL_WORLD,
    RETRY_EARLIER,
    SIMULATION,
    Reported,
)
from tests.reproduction.runs import AFTER_A_SLIP, SLIP, Run, earlier, runs_with_slip
from tests.reproduction.screws import Screws, pick_screws, screws_cell
from tests.reproduction.simulation import (
    SAMPLINGS,
    Picking,
    Simulation,
    computing_times,
    coverage_of_g1,
    simulate,
    tabletop,
)
from tests.reproduction.summary import Summary

FOLDER = Path("build/reproduction")


def main(arguments: list[str]) -> int:
    """Exit code 0 if all findings hold."""
    page = Page(FOLDER)
    cell = tabletop()
    simulated, real = simulate(cell), pick_screws(screws_cell())
    page.heading("Simulation: six ways to pick up a green object, 10 samples per primitive")
    _qualities(page, simulated.of, SIMULATION)
    page.text(f"g6: {simulated.why_not_g6}. First in the ranking: {simulated.first}.")
    page.heading("Samples per primitive: Q_avg of g1 and the time to compute it")
    _samples(page, simulated, computing_times(cell))
    for name in ("5", "10"):
        page.timeline(f"Coverage of g1, {name} samples per primitive", coverage_of_g1(cell, SAMPLINGS[name]))
    page.pictures("tabletop", "pickup green", "g1")
    page.pictures("tabletop", "pickup green", "g5")
    page.heading("Real world: two screws, a sample every second")
    _qualities(page, real.of, REAL_WORLD)
    page.pictures("screws", "pickup_two_finger screw", "red2", FixedStep(1.0))
    runs = {} if "--without-runs" in arguments else runs_with_slip(list(REAL_WORLD), FOLDER)
    if runs:
        page.heading(f"At run time: {SLIP} for both screws")
        _runs(page, runs)
    page.heading("Findings")
    held = [*_findings(page, SIMULATED, simulated), *_findings(page, REAL, real)]
    if runs:
        held += _findings(page, AFTER_A_SLIP, runs)
    page.heading("The same with every camera moved by 2 mm and turned by 0.2 degrees, 20 times")
    counts = _surviving(SIMULATED, cell, Picking.of(cell).seen_in), _surviving(REAL, screws_cell(), pick_screws)
    page.text(f"All findings hold {counts[0]} times in simulation and {counts[1]} times in the real world.")
    page.write()
    print(f"\n{sum(held)} of {len(held)} findings hold. With pictures: {page.file}")
    return 0 if all(held) else 1


def _surviving(findings: Sequence[Finding], cell: Cell, compute: Callable[[Cell], Any]) -> int:
    return sum(not failing(findings, compute(moved(cell, draw))) for draw in range(DRAWS))


def _qualities(page: Page, found: dict[str, Summary], paper: dict[str, Reported]) -> None:
    page.table(
        ("object", "Q_avg [%]", "paper", "Q_eoi [%]", "paper", "time [s]", "paper"),
        [
            (name, *_pairs(found[name], reported)) if name in found else (name, "-", "", "-", "", "-", "")
            for name, reported in paper.items()
        ],
    )


def _pairs(found: Summary, reported: Reported) -> tuple[str, ...]:
    columns = ((found.q_avg, reported.q_avg), (found.q_eoi, reported.q_eoi), (found.time, reported.time))
    return tuple(f"{value:.2f}" for pair in columns for value in pair)


def _samples(page: Page, simulated: Simulation, computing: Mapping[str, float]) -> None:
    paper = {
        name: (Q_AVG_BY_SAMPLES.get(int(name)), COMPUTING_BY_SAMPLES.get(int(name)))
        for name in SAMPLINGS
        if name != "default"
    }
    page.table(
        ("samples", "Q_avg [%]", "paper", "computed in [s]", "paper"),
        [
            (
                name,
                f"{q_avg:.2f}",
                *_or_dash(paper.get(name, (None, None))[0], f"{computing[name]:.3f}", paper.get(name, (None, None))[1]),
            )
            for name, q_avg in simulated.sampled.items()
        ],
    )


def _or_dash(q_avg: str | None, computing: str, reported: float | None) -> tuple[str, str, str]:
    return q_avg or "-", computing, "-" if reported is None else f"{reported:g}"


def _runs(page: Page, runs: dict[str, Run]) -> None:
    page.table(
        ("object", "slips t_f", "seen t_r", "moves on for", "acts t_redo", "done t_e"),
        [(name, *map(_time, (run.t_f, run.t_r, run.moved_on, run.t_redo, run.t_e))) for name, run in runs.items()],
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


def _time(t: float | None) -> str:
    return "-" if t is None else f"{t:.2f}"


def _findings(page: Page, findings: tuple[Finding, ...], outcome: Simulation | Screws | dict[str, Run]) -> list[bool]:
    held = [finding.holds(outcome) for finding in findings]
    page.table(("holds", "finding"), [("yes" if ok else "NO", f.text) for ok, f in zip(held, findings, strict=True)])
    return held


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
