"""Cells in which colours collide, 50 by default: `python -m tests.light [CELLS [FIRST]]`; FIRST is the first seed.

In each, the best candidate is chosen and photographed, image by image, and looked at as in a run: with colours as they
count, and as if they did not. Prints a line for each cell that says otherwise than its promise, and the sums; exit code
1 where less than 99.5 % of what was promised is seen, more than a tenth of the stops for blindness is left, or more
than half of the images that show what was not promised were not even usually to show it.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")
os.environ["LP_NUM_THREADS"] = "0"

from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.programming.cell import Cell
from tests.light.cells import coloured_cell
from tests.light.photos import Photos, Tally, best_of, step_of, usually_seen, without_colours

PROMISED_AND_SEEN, STOPS_LEFT, SURPRISES_LEFT = 0.995, 0.1, 0.5
"""Asked: of the images that were promised to show something, of the stops without colours, and of the images that show
what was not promised without colours, which knows of no other promise."""


def tally(cell: Cell, task: str) -> Tally | None:
    """The images of the best candidate against its promise; None if there is no candidate."""
    best = best_of(cell, task)
    if best is None:
        return None
    step, photos = step_of(cell, best, task), Photos(cell.workspace, best.motion.joint_names)
    photos.take(step)
    return photos.against(step, usually_seen(cell, best, photos.times))


def main(arguments: Sequence[str]) -> int:
    """Make, choose, photograph and count."""
    cells, first = (int(value) for value in (*arguments, *("50", "1000")[len(arguments) :]))
    sums, stops = {"with": Counter[str](), "without": Counter[str]()}, Counter[str]()
    for seed in range(first, first + cells):
        with tempfile.TemporaryDirectory() as folder:
            task = coloured_cell(Path(folder) / "cell", seed)
            cell = Cell.load(load_workspace(Path(folder) / "cell"))
            for name, judged in (("with", cell), ("without", without_colours(cell))):
                found = tally(judged, task)
                if found is None:
                    continue
                sums[name] += found.counts
                stops[name] += found.stop is not None
                if found.stop or (name == "with" and found.counts["fp"]):
                    print(f"{seed} {name} colours: {dict(found.misses)} {found.stop or ''}", flush=True)
    for name, counts in sums.items():
        promised, rest = counts["tp"] + counts["fp"], counts["tn"] + counts["fn"]
        print(
            f"{name} colours: {counts['tp']} of {promised} promised images showed it "
            f"({100 * counts['tp'] / max(promised, 1):.2f} %), {counts['fn']} of {rest} others did; "
            f"{stops[name]} stops for blindness; usually to be seen were {counts['usual fn']} of those "
            f"{counts['fn']}, and {counts['usual tn']} that did not"
        )
    seen = sums["with"]["tp"] >= PROMISED_AND_SEEN * (sums["with"]["tp"] + sums["with"]["fp"])
    surprises = sums["with"]["fn"] - sums["with"]["usual fn"]
    expected = surprises <= SURPRISES_LEFT * sums["without"]["fn"]
    return 0 if seen and expected and stops["with"] <= STOPS_LEFT * stops["without"] else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
