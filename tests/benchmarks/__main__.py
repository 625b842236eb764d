"""`python -m tests.benchmarks`: what takes how long, against what else one could use."""

from __future__ import annotations

import argparse
import os
import platform
from importlib.metadata import version
from pathlib import Path
from textwrap import fill

from sqrp_cli.platform.memory import keep_freed_memory

PARTS = ("rank", "versions", "coverage", "growth", "candidates", "ways", "planning", "paths", "audit")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all by default")
    parser.add_argument("--runs", type=int, default=5, help="of each measurement (default: 5)")
    parser.add_argument("--candidates", type=int, default=48, help="of the 1,600 to assess (default: 48)")
    parser.add_argument("--baseline", type=Path, help="a checkout of another version, to time in turns with this one")
    parser.add_argument("--cells", type=int, default=30, help="random cells in which paths are compared (default: 30)")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f"unknown part {', '.join(sorted(unknown))}")
    parts = arguments.parts or PARTS

    libraries = ("numpy", "coal", "pin", "ruckig", "mujoco", "embreex")
    print(
        fill(f"Python {platform.python_version()}, " + ", ".join(f"{name} {version(name)}" for name in libraries), 80)
    )
    print(f"{platform.machine()}, {os.cpu_count()} cores, one used (by audits, all)")
    print(f"{arguments.runs} runs: the median where times are wall times, the least where they are CPU times")
    if "rank" in parts:
        from tests.benchmarks.startup import processes, stages

        processes(arguments.runs)
        stages(arguments.runs)
    if "versions" in parts:
        from tests.benchmarks.versions import versions

        versions(arguments.runs, arguments.candidates, arguments.baseline)
    if "coverage" in parts:
        from tests.benchmarks.coverage import compare

        compare(arguments.runs)
    if "growth" in parts:
        from tests.benchmarks.coverage import grow

        grow(arguments.runs)
    if "candidates" in parts:
        from tests.benchmarks.candidates import many

        many(arguments.candidates)
    if "ways" in parts:
        from tests.benchmarks.ways import ways

        ways(arguments.runs)
    if "planning" in parts:
        from tests.benchmarks.planning import plan

        plan(arguments.runs)
    if "paths" in parts:
        from tests.benchmarks.paths import paths

        paths(arguments.cells)
    if "audit" in parts:
        from tests.benchmarks.audit import audits

        audits(arguments.runs)


if __name__ == "__main__":
    # One core for everybody: NumPy's linear algebra would otherwise start a thread per core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    keep_freed_memory()  # as the program itself does
    main()
