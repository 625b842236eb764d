"""All damages: `make damage`, or `python -m tests.damage FIRST LAST` for some of them."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from tests.damage.cell import whole_cell
from tests.damage.trial import passed, report, try_damages

first, last = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (0, 2000)
with tempfile.TemporaryDirectory() as folder:
    cell = whole_cell(Path(folder) / "cell")
    trials = list(try_damages(cell, range(first, last)))
print(report(trials, worst=40))
sys.exit(0 if passed(trials) else 1)
