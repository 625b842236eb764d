"""What becomes of one arm: made by `init`, ranked, and run once."""

from __future__ import annotations

import json
import multiprocessing
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from queue import Empty
from typing import Any

from tests.arms.arms import MatrixArm

LONGEST = 900.0
"""Seconds after which a trial is given up."""

LEAST_SEEN = 0.98
"""Share of the promised images that must show what they should."""


@dataclass(frozen=True)
class ArmOutcome:
    """How far an arm got."""

    name: str
    axes: int = 0
    tip: str = ""
    cubes: int = 0
    feasible: int = 0
    done: bool = False
    promised: int = 0
    seen: int = 0
    reason: str = ""
    """Why it got no further, in one sentence."""

    @property
    def ranks(self) -> bool:
        """Whether something can be picked up."""
        return self.feasible > 0

    @property
    def share(self) -> float:
        """Of the promised images, those that showed what they should."""
        return self.seen / self.promised if self.promised else 0.0

    @property
    def holds(self) -> bool:
        """Whether its first task runs to the end, and is seen as promised."""
        return self.ranks and self.done and self.share >= LEAST_SEEN


def tried(arm: MatrixArm, folder: Path, packages: Path) -> ArmOutcome:
    """Try an arm in a process of its own."""
    context = multiprocessing.get_context("spawn")
    answers: multiprocessing.Queue[dict[str, Any]] = context.Queue()
    process = context.Process(target=_try, args=(arm, folder, packages, answers))
    process.start()
    try:
        return ArmOutcome(**answers.get(timeout=LONGEST))
    except Empty:
        process.kill()
        return ArmOutcome(arm.name, reason=f"not finished after {LONGEST:.0f} s")
    finally:
        process.join(5.0)


def _try(arm: MatrixArm, folder: Path, packages: Path, answers: multiprocessing.Queue[dict[str, Any]]) -> None:
    os.environ["ROS_PACKAGE_PATH"] = str(packages)
    try:
        outcome = _outcome(arm, folder)
    except Exception as error:
        outcome = ArmOutcome(arm.name, reason=f"{type(error).__name__}: {str(error).splitlines()[0]}")
    answers.put(asdict(outcome))


def _outcome(arm: MatrixArm, folder: Path) -> ArmOutcome:
    from sqrp_cli import new_cell, open_cell

    made = new_cell(folder, urdf=arm.urdf, tip=arm.tip, run=True)
    starter, run = made.starter, made.run
    axes = len(open_cell(folder).cell.model.arm)
    nothing = next((str(problem) for problem in made.problems if problem.code == "nothing-in-reach"), "")
    ranking = None if starter.task is None else open_cell(folder).rank(starter.task)
    feasible = 0 if ranking is None else sum(candidate.feasible for candidate in ranking.candidates)
    stopped = "" if run is None or run.reason is None else f"stopped at {run.time:.2f} s: {run.reason}"
    return ArmOutcome(
        name=arm.name,
        axes=axes,
        tip=starter.tip,
        cubes=len(starter.cubes),
        feasible=feasible,
        done=run is not None and run.outcome == "done",
        promised=0 if run is None else run.promised,
        seen=0 if run is None else run.seen,
        reason=nothing or stopped,
    )


def kept(path: Path) -> dict[str, ArmOutcome]:
    """Outcomes of an earlier run, by the arm's name."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {outcome.name: outcome for outcome in (ArmOutcome(**json.loads(line)) for line in lines)}
