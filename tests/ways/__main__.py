"""All ways by hand in random cells: `python -m tests.ways [CELLS [FIRST]]`, 200 by default; part of `make trials`.

Prints a line for each cell. Exit code 1 if a better way than the one shown, or another Pareto set, is found by hand.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.ways.by_hand import cell_with_ways


def main(arguments: Sequence[str]) -> int:
    """Print a line for each cell, and the summary."""
    count, first = (int(arguments[0]) if arguments else 200), (int(arguments[1]) if len(arguments) > 1 else 0)
    done = wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + count):
            found = cell_with_ways(Path(folder) / f"{seed}", seed).ways()
            done += found.shown is not None
            wrong += not found.right
            said = f"{len(found.by_hand):2} ways, {len(found.optimal)} named, shown {found.shown}"
            print(f"{seed:4}  {said}{'' if found.right else f'  WRONG, by hand {found.by_hand}'}", flush=True)
    print(f"{wrong} of {count} cells wrong; in {done} the part can be picked")
    return 1 if wrong or not done else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
