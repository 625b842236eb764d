"""The two screws at run time, with a slip in the lift: simulated by the command that users have."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from tests.reproduction.cells import SCREW, SCREWS

SLIP = "slip@a4+1.7"
"""Half way up."""

STOPPED = 3
"""Exit code of a run that stopped on a fault."""


class Run(NamedTuple):
    """When the object slipped, that was seen, the robot acted on it, and all was done [s]; None for what never was."""

    t_f: float | None
    t_r: float | None
    t_redo: float | None
    t_e: float | None
    moved_on: float | None
    """For how long the robot moved on to look, before it could judge whether to try again [s]."""
    reason: str | None
    """Why the robot stopped, if it did."""
    prediction: tuple[tuple[str, ...], ...]
    """Of each literal and camera how many images were predicted to show it, of them did, were not, and of them did."""


def runs_with_slip(names: Sequence[str], folder: Path, workspace: Path = SCREWS) -> dict[str, Run]:
    """Rank, write the program, run it with a slip; side by side: a run leaves some of a second core idle.

    Raises CalledProcessError where one of the commands fails.
    """

    def sqrp(*arguments: object) -> str:
        command = [Path(sys.executable).with_name("sqrp"), *map(str, arguments)]
        done = subprocess.run(command, check=False, stdout=subprocess.PIPE, text=True)
        if done.returncode not in (0, STOPPED):
            done.check_returncode()
        return done.stdout

    def run(name: str) -> Run:
        program = folder / f"{name}.yaml"
        program.unlink(missing_ok=True)
        sqrp("rank", workspace, f"{SCREW.split()[0]} {name}", "--ways", "fastest", "--program", program, "--json")
        document = json.loads(sqrp("run", program, "--sim", "--fault", SLIP, "--json"))
        (fault,) = (fault for fault in document["faults"] if fault["name"] == "slip")
        counts = (
            (literal, camera, str(n["tp"] + n["fp"]), str(n["tp"]), str(n["tn"] + n["fn"]), str(n["fn"]))
            for step in document["prediction"]
            for literal, cameras in step.items()
            for camera, n in cameras.items()
        )
        times = (fault[key] for key in ("happened", "detected", "acted", "recovered", "moved_on"))
        return Run(*times, document["reason"], tuple(row for row in counts if row[2] != "0"))

    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(len(names)) as pool:
        return dict(zip(names, pool.map(run, names), strict=True))


def earlier(runs: Mapping[str, Run]) -> float | None:
    """By how much red1 is done before red2 [s]; None where one of them never is."""
    one, two = runs["red1"].t_e, runs["red2"].t_e
    return None if one is None or two is None else two - one
