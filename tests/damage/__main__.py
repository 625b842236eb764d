"""All damages: `make damage`, or `python -m tests.damage FIRST LAST` for some of them; few are shown one by one."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

from tests.damage.cell import whole_cell
from tests.damage.trial import passed, report, shown, try_damages

ALL, FEW = 10_000, 50


def main() -> int:
    """Try them, show the unsound ones as they come, and print the rates; 0 if all is well."""
    first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, ALL)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        cell = whole_cell(Path(folder) / "cell")
        trials = []
        for trial in try_damages(cell, range(first, last)):
            trials.append(trial)
            if not trial.sound:
                print(shown(trial), file=sys.stderr)
            if len(trials) % 500 == 0:
                print(f"{len(trials)} of {last - first}, {time.monotonic() - began:.0f} s", file=sys.stderr)
    if len(trials) <= FEW:
        print("\n".join(map(shown, trials)))
    print(report(trials, worst=60))
    print(f"{time.monotonic() - began:.0f} s")
    return 0 if passed(trials) else 1


if __name__ == "__main__":
    sys.exit(main())
