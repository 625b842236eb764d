"""Cells in which colours collide, 50 by default: `python -m tests.light [CELLS [FIRST]]`; FIRST is the first seed.

In each, the best candidate is chosen and photographed, image by image, and looked at as in a run: with colours as they
count, and as if they did not. Prints a line for each cell that says otherwise than its promise, and the sums; exit code
1 where less than 99.5 % of what was promised is seen or less than 98 % of what is usual, where more than a tenth of the
stops for blindness is left, or more than half of the images that show what was neither promised nor usual.
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

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.run.record.report import Confusion
from tests.light.cells import coloured_cell
from tests.light.photos import Photos, Tally, best_of, step_of, without_colours

PROMISED_AND_SEEN, USUAL_AND_SEEN, STOPS_LEFT, SURPRISES_LEFT = 0.995, 0.98, 0.1, 0.5
"""Asked: of the images that were promised to show something, of usual images, of the stops without colours, and of the
images that show what was not promised without colours, by promises alone."""


def tally(cell: Cell, task: str) -> Tally | None:
    """The images of the best candidate against its promise; None if there is no candidate."""
    best = best_of(cell, task)
    if best is None:
        return None
    step, photos = step_of(cell, best, task), Photos(cell.workspace, best.motion.joint_names)
    photos.take(step)
    return photos.against(step)


def main(arguments: Sequence[str]) -> int:
    """Make, choose, photograph and count."""
    cells, first = (int(value) for value in (*arguments, *("50", "1000")[len(arguments) :]))
    names = ("with", "without")
    sums, rests, stops = {name: Confusion() for name in names}, {name: Confusion() for name in names}, Counter[str]()
    for seed in range(first, first + cells):
        with tempfile.TemporaryDirectory() as folder:
            task = coloured_cell(Path(folder) / "cell", seed)
            cell = Cell.load(load_workspace(Path(folder) / "cell"))
            for name, judged in (("with", cell), ("without", without_colours(cell))):
                found = tally(judged, task)
                if found is None:
                    continue
                sums[name] += found.counts
                rests[name] += found.rest
                stops[name] += found.stop is not None
                if found.stop or (name == "with" and found.counts.fp):
                    print(f"{seed} {name} colours: {dict(found.misses)} {found.stop or ''}", flush=True)
    for name, counts in sums.items():
        rest = rests[name]
        print(
            f"{name} colours: {counts.tp} of {counts.tp + counts.fp} promised images showed it "
            f"({100 * (counts.precision or 0):.2f} %), {rest.tp} of {rest.tp + rest.fp} usual ones, "
            f"{rest.fn} of {rest.fn + rest.tn} others; {stops[name]} stops for blindness"
        )
    seen = (sums["with"].precision or 0) >= PROMISED_AND_SEEN and (rests["with"].precision or 0) >= USUAL_AND_SEEN
    expected = rests["with"].fn <= SURPRISES_LEFT * sums["without"].fn
    return 0 if seen and expected and stops["with"] <= STOPS_LEFT * stops["without"] else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
