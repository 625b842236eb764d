"""`python -m tests.benchmarks`: what takes how long, against another version and against what else one could use."""

from __future__ import annotations

import argparse
import os
import platform
from importlib import import_module
from importlib.metadata import version

PARTS = ("commands", "parts", "coverage", "planning", "paths")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; all by default")
    parser.add_argument("--runs", type=int, default=5, help="of each measurement (default: 5)")
    parser.add_argument("--against", metavar="COMMIT", help="run the commands of this version, too, in turns")
    parser.add_argument("--command", metavar="WORDS", default="", help="only commands with these in their name")
    parser.add_argument("--cells", type=int, default=30, help="random cells in which paths are compared (default: 30)")
    arguments = parser.parse_args()
    if unknown := set(arguments.parts) - set(PARTS):
        parser.error(f"unknown part {', '.join(sorted(unknown))}")
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "pin", "ruckig", "embreex"))
    print(f"Python {platform.python_version()}, {libraries}, {platform.machine()}, one core used")
    runs = arguments.runs
    work = {
        "commands": lambda module: module.compare(arguments.against, runs, arguments.command),
        "parts": lambda module: [module.parts(name, runs) for name in ("rank tabletop", "rank tower")],
        "coverage": lambda module: module.compare(runs),
        "planning": lambda module: (module.candidates(runs), module.plan(runs)),
        "paths": lambda module: module.paths(arguments.cells),
    }
    for part in arguments.parts or PARTS:
        work[part](import_module(f"tests.benchmarks.{part}"))


if __name__ == "__main__":
    # One core for everybody: NumPy's linear algebra would otherwise start a thread per core.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
