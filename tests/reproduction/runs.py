"""The two screws at run time, with a slip in the lift: simulated by the command that users have."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from tests.reproduction.findings import Finding
from tests.reproduction.paper import RETRY_EARLIER
from tests.reproduction.screws import TASK, WORKSPACE

SLIP = "slip@a4+1.7"
"""Half way up."""

STOPPED = 3
"""Exit code of a run that stopped on a fault."""


@dataclass(frozen=True)
class Run:
    """When the object slipped, that was seen, the robot acted on it, and all was done [s]; None for what never was.

    moved_on: for how long the robot moved on to look, before it could judge whether to try again [s]. reason: why the
    robot stopped, if it did. prediction: per literal and camera how many images were predicted to show it, how many of
    them did, how many were not predicted to, and how many of those did.
    """

    t_f: float | None
    t_r: float | None
    t_redo: float | None
    t_e: float | None
    moved_on: float | None
    reason: str | None
    prediction: tuple[tuple[str, ...], ...]


def runs_with_slip(names: Sequence[str], folder: Path, workspace: Path = WORKSPACE) -> dict[str, Run]:
    """As `run_with_slip` of each, side by side: a run leaves some of a second core idle."""
    with ThreadPoolExecutor(len(names)) as pool:
        return dict(zip(names, pool.map(lambda name: run_with_slip(name, folder, workspace), names), strict=True))


def run_with_slip(name: str, folder: Path, workspace: Path) -> Run:
    """Rank, write the program, run it with a slip. Raises CalledProcessError where one of the commands fails."""
    program = folder / f"{name}.yaml"
    program.parent.mkdir(parents=True, exist_ok=True)
    program.unlink(missing_ok=True)
    skill = TASK.split()[0]
    _sqrp("rank", str(workspace), f"{skill} {name}", "--ways", "fastest", "--program", str(program), "--json")
    document = json.loads(_sqrp("run", str(program), "--sim", "--fault", SLIP, "--json"))
    (fault,) = (fault for fault in document["faults"] if fault["name"] == "slip")
    counts = (
        (literal, camera, str(n["tp"] + n["fp"]), str(n["tp"]), str(n["tn"] + n["fn"]), str(n["fn"]))
        for step in document["prediction"]
        for literal, cameras in step.items()
        for camera, n in cameras.items()
    )
    times = (fault[key] for key in ("happened", "detected", "acted", "recovered", "moved_on"))
    return Run(*times, document["reason"], tuple(row for row in counts if row[2] != "0"))


def earlier(runs: Mapping[str, Run]) -> float | None:
    """By how much red1 is done before red2 [s]; None where one of them never is."""
    one, two = runs["red1"].t_e, runs["red2"].t_e
    return None if one is None or two is None else two - one


AFTER_A_SLIP: tuple[Finding[Mapping[str, Run]], ...] = (
    Finding("after a slip both screws are picked up by a retry", lambda runs: earlier(runs) is not None),
    Finding(
        f"red1 finishes the retry earlier than red2 by about {RETRY_EARLIER:g} s",
        lambda runs: abs((earlier(runs) or 0.0) - RETRY_EARLIER) <= 3.0,
    ),
)


def _sqrp(*arguments: str) -> str:
    command = [Path(sys.executable).with_name("sqrp"), *arguments]
    done = subprocess.run(command, check=False, stdout=subprocess.PIPE, text=True)
    if done.returncode not in (0, STOPPED):
        done.check_returncode()
    return done.stdout
