"""The paper's two experiments, each figure beside the paper's: `python -m tests.reproduction [--without-runs]`.

Prints the tables and writes the same as a page with pictures to `build/reproduction`.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from math import nan
from pathlib import Path

from sqrp_cli import open_cell
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.show.pictures.pictures import SHEET, write_pictures
from sqrp_cli.study.sampling import Sampling
from tests.reproduction import cells, findings
from tests.reproduction.cells import EVERY_SECOND, GREEN, SAMPLINGS, SCREW, feasible, figures_of
from tests.reproduction.findings import DRAWS, failing
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
LINES = ["# The paper's experiments, reproduced"]


def say(text: str) -> None:
    """A paragraph of the page, or a heading."""
    print(text.replace("## ", "\n"))
    LINES.extend(["", text])


def table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table, in which columns are as wide as they need to be."""
    widths = [max(map(len, column)) for column in zip(titles, *rows, strict=True)]
    for row in (titles, *rows):
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
    print()
    LINES.extend(["", f"| {' | '.join(titles)} |", "|" + " --- |" * len(titles)])
    LINES.extend(f"| {' | '.join(row)} |" for row in rows)


def pictures(cell: str, task: str, choice: str, sampling: Sampling | None = None) -> None:
    """What the cameras see in the blind intervals of a candidate, in its fastest way."""
    opened = open_cell(f"workspaces/{cell}")
    analysis = opened.explain(task, choice, sampling=sampling, ways="fastest").explained.analysis
    assert analysis is not None
    with tempfile.TemporaryDirectory() as folder:
        if write_pictures(opened.cell, analysis, Path(folder)):
            (FOLDER / f"{cell}-{choice}.png").write_bytes((Path(folder) / SHEET).read_bytes())
            LINES.extend(["", f"Blind intervals of {choice}:", "", f"![{choice}]({cell}-{choice}.png)"])


def qualities(found: Mapping[str, Figures], paper: Mapping[str, Figures]) -> None:
    rows, none = [], Figures(nan, nan, nan)
    for name, reported in paper.items():
        pairs = [f"{value:.2f}" for pair in zip(found.get(name, none), reported, strict=True) for value in pair]
        rows.append((name, *pairs))
    table(("object", "Q_avg [%]", "paper", "Q_eoi [%]", "paper", "time [s]", "paper"), rows)


def main(arguments: list[str]) -> int:
    """Exit code 0 if all findings hold."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    tabletop, screws = cells.shipped(cells.TABLETOP), cells.shipped(cells.SCREWS)
    pick_green = cells.pick_green(tabletop)
    simulated, real = pick_green(tabletop), cells.pick_screws(screws)
    say("## Simulation: six ways to pick up a green object, 10 samples per primitive")
    qualities(simulated.of, SIMULATION)
    say(f"g6: {simulated.why_not_g6}. First in the ranking: {simulated.first}.")
    say("## Samples per primitive: Q_avg of g1 and the time to compute it")
    g1, rows = cells.candidates(tabletop, GREEN)["g1"], []
    for name, sampling in SAMPLINGS.items():
        began = time.perf_counter()  # the check of its preconditions is part of it
        q_avg = figures_of(feasible(tabletop, g1, sampling)).q_avg
        computing = f"{time.perf_counter() - began:.3f}"
        paper = Q_AVG_BY_SAMPLES.get(name, "-"), COMPUTING_BY_SAMPLES.get(name, "-")
        rows.append((name, f"{q_avg:.2f}", paper[0], computing, paper[1]))
    table(("samples", "Q_avg [%]", "paper", "computed in [s]", "paper"), rows)
    for name in ("g1", "g5"):
        pictures("tabletop", GREEN, name)
    say("## Real world: two screws, a sample every second")
    qualities(real.of, REAL_WORLD)
    pictures("screws", SCREW, "red2", EVERY_SECOND)
    asked = [(findings.SIMULATED, simulated), (findings.REAL, real)]
    if "--without-runs" not in arguments:
        runs = runs_with_slip(list(REAL_WORLD), FOLDER)
        say(f"## At run time: {SLIP} for both screws")
        tell_runs(runs)
        asked.append((findings.AFTER_A_SLIP, runs))
    say("## Findings")
    lost = {text for own, outcome in asked for text in failing(own, outcome)}
    every = [text for own, _ in asked for text in own]
    table(("holds", "finding"), [("NO" if text in lost else "yes", text) for text in every])
    say("## The same with every camera moved by 2 mm and turned by 0.2 degrees, 20 times")
    of_screws = (findings.REAL, screws, cells.pick_screws)
    counts = [
        sum(not failing(own, compute(findings.moved(cell, draw))) for draw in range(DRAWS))
        for own, cell, compute in ((findings.SIMULATED, tabletop, pick_green), of_screws)
    ]
    say(f"All findings hold {counts[0]} times in simulation and {counts[1]} times in the real world.")
    write_atomically(FOLDER / "README.md", "\n".join(LINES) + "\n")
    print(f"\n{len(every) - len(lost)} of {len(every)} findings hold. With pictures: {FOLDER / 'README.md'}")
    return 1 if lost else 0


def tell_runs(runs: dict[str, Run]) -> None:
    times = {name: (run.t_f, run.t_r, run.moved_on, run.t_redo, run.t_e) for name, run in runs.items()}
    table(
        ("object", "slips t_f", "seen t_r", "moves on for", "acts t_redo", "done t_e"),
        [(name, *("-" if t is None else f"{t:.2f}" for t in own)) for name, own in times.items()],
    )
    for name, run in runs.items():
        if run.reason is not None:
            say(f"{name} stopped: {run.reason}")
    by = earlier(runs)
    found = "-" if by is None else f"{by:.1f} s"
    say(f"red1 finishes the retry earlier than red2 by {found}; in the paper by {RETRY_EARLIER:g} s.")
    say("Prediction against detection, over all images:")
    rows = [(name, *row) for name, run in runs.items() for row in run.prediction]
    table(("object", "literal", "camera", "predicted", "of them seen", "not predicted", "but seen"), rows)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
