"""Random cells broken by a known change, and mended: `python -m tests.advice [CELLS [FIRST]]`.

Each is broken by moving, turning or narrowing one camera, or by moving the part. Advice of the same kind is asked for
with the motion fixed; then the least one is applied, and `score` and `explain` must find the wish met. Prints its size
against the known one.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import sqrp_cli
from tests.advice.broken import Broken, broken_cell


class Mended(NamedTuple):
    """What advice did for a broken cell."""

    found: int
    least: float | None
    """Size of the least change of the kind that was broken [m or rad]."""
    same: float | None
    """Size of that of the same camera or object."""
    passed: bool
    """Whether `score` passes after the least one is applied, and `explain`, with finer samples, agrees."""
    seconds: float
    """Of processor time for the advice."""

    def ratio(self, broken: Broken) -> float | None:
        """The least change against the known one."""
        return None if self.least is None else self.least / broken.size


def mended(broken: Broken) -> Mended:
    """Ask for advice, apply the first, and score."""
    start = time.process_time()
    found = sqrp_cli.open_cell(broken.folder).advise(broken.task, kinds=[broken.kind], ways="fastest")
    seconds = time.process_time() - start
    sizes = {one.target: one.size for one in found.advice}
    if not sizes:
        return Mended(0, None, None, False, seconds)
    found.apply(1)
    cell = sqrp_cli.open_cell(broken.folder)
    (explained,) = cell.explain(broken.task, ways="fastest").candidates
    passed = cell.score().passed and (explained.q_eoi or 0.0) >= broken.threshold
    return Mended(len(sizes), min(sizes.values()), sizes.get(broken.target), passed, seconds)


def main(arguments: list[str]) -> int:
    """Print a line for each cell, and the summary."""
    count, first = (int(arguments[0]) if arguments else 50), (int(arguments[1]) if len(arguments) > 1 else 0)
    done, passed, ratios, seed = 0, 0, [], first
    while done < count:
        with tempfile.TemporaryDirectory() as folder:
            broken = broken_cell(Path(folder) / "cell", seed)
            if broken is not None:
                result = mended(broken)
                ratio = result.ratio(broken)
                done, passed = done + 1, passed + result.passed
                ratios += [] if ratio is None else [ratio]
                shown = "none" if ratio is None else f"{ratio:.2f}"
                verdict = "passes" if result.passed else "FAILS"
                print(
                    f"{seed:3} {broken.kind:9} {broken.target:5} by {broken.size:.3f}: advice {shown:>5} of it, "
                    f"{result.found} found, score {verdict}, {result.seconds:.1f} s",
                    flush=True,
                )
        seed += 1
    over = [ratio for ratio in ratios if ratio > 1]
    mean = sum(ratios) / max(1, len(ratios))
    most = max(ratios, default=0.0)
    print(f"{passed} of {done} pass; advice / known change: mean {mean:.2f}, most {most:.2f}, {len(over)} larger")
    return 0 if passed == done and not over else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
