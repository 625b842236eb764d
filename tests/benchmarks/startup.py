"""Where the time of `sqrp rank` goes, from process start to table."""

from __future__ import annotations

import io
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from statistics import median
from typing import TypeVar

from tests.benchmarks.scene import TABLETOP
from tests.benchmarks.table import milliseconds, print_table

TASK = "pickup green"
SQRP = Path(sys.executable).with_name("sqrp")
IMPORTS = (
    "import sqrp_cli.cli.main, sqrp_cli.api.session, sqrp_cli.terminal.rank_table, sqrp_cli.knowledge.workspace.load"
)

_STAGES = f"""
import time
start = time.perf_counter()
{IMPORTS}
imports = 1e3 * (time.perf_counter() - start)
from tests.benchmarks.startup import print_stages
print_stages(imports)
"""

Result = TypeVar("Result")


def processes(runs: int) -> None:
    """Wall times of whole processes."""
    commands = {
        "python -c pass": [sys.executable, "-c", "pass"],
        "python, all imports of rank": [sys.executable, "-c", IMPORTS],
        "sqrp --help": [str(SQRP), "--help"],
        "sqrp check tabletop": [str(SQRP), "check", str(TABLETOP)],
        f'sqrp rank tabletop "{TASK}"': [str(SQRP), "rank", str(TABLETOP), TASK],
    }
    rows = [[name, f"{milliseconds(lambda c=command: _run(c), runs):.0f}"] for name, command in commands.items()]
    print_table("Whole processes", ["", "ms"], rows)


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, capture_output=True)  # commands of this file


class _Clock:
    """Times of stages in the order of their first use; a stage that runs inside another is counted in both."""

    def __init__(self) -> None:
        self.times: dict[str, float] = {}

    def run(self, stage: str, work: Callable[[], Result]) -> Result:
        self.times.setdefault(stage, 0.0)
        start = time.perf_counter()
        result = work()
        self.times[stage] += 1e3 * (time.perf_counter() - start)
        return result


def stages(runs: int) -> None:
    """Time of each stage in one process, mesh files and byte code warm."""
    samples = []
    for _ in range(runs):
        output = subprocess.run(
            [sys.executable, "-c", _STAGES],
            check=True, capture_output=True, text=True, cwd=Path(__file__).parents[2],
        ).stdout  # fmt: skip
        samples.append(dict(line.split("\t") for line in output.splitlines()))
    rows = [[stage, f"{median(float(sample[stage]) for sample in samples):.1f}"] for stage in samples[0]]
    print_table(f'Where `sqrp rank tabletop "{TASK}"` spends it', ["", "ms"], rows)


def print_stages(imports: float) -> None:
    """One line per stage, name and milliseconds with a tab between; run in a process of its own.

    imports: how long the imports took before this module was imported [ms].
    """
    clock = _Clock()
    clock.times["imports (without the interpreter)"] = imports
    from sqrp_cli.knowledge.text.input_file import ContentDigest
    from sqrp_cli.knowledge.workspace.load import load_workspace
    from sqrp_cli.programming.arm.kinematics import RobotModel
    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.coverage import observation, timeline
    from sqrp_cli.programming.pipeline import Assignment
    from sqrp_cli.programming.ranking import rank
    from sqrp_cli.programming.sensing import observer
    from sqrp_cli.programming.solids import load_solids
    from sqrp_cli.programming.task import read_task
    from sqrp_cli.programming.ways import find
    from sqrp_cli.terminal.rank_table import print_ranking

    def watch(module: object, name: str, stage: str) -> None:
        work = getattr(module, name)
        setattr(module, name, lambda *a, **k: clock.run(stage, lambda: work(*a, **k)))

    watch(ContentDigest, "add_file", "- of this the digest of every file")
    workspace = clock.run("read and check the workspace", lambda: load_workspace(TABLETOP))
    task = read_task(TASK, workspace)
    parts = [part for thing in workspace.objects.values() if thing.X_WO is not None for part in thing.parts]
    model = clock.run("robot model", lambda: RobotModel.load(workspace.robot))
    clock.run("meshes", lambda: load_solids([*model.parts, *parts]))
    cell = clock.run("rest of the cell", lambda: Cell.load(workspace))

    watch(find, "plan_branches", "all ways: IK, motion and collision")
    watch(find, "prospects", "all ways: looks")
    watch(find, "observed", "the best: exact coverage")
    watch(timeline, "all_first_samples", "all candidates: where to sample")
    watch(timeline, "look_at", "all candidates: states and coverage")
    watch(observation, "states_of", "- of this, and of looks, kinematics of the samples")
    watch(observer.WatchedBoxes, "limits", "- of this limits")
    watch(observer, "near_pairs", "- of this culling")
    watch(observer.HullTester, "met", "- of this view hulls in coal")
    watch(observer, "visible_shares", "- of this visible shares")
    assignment = Assignment(cell=cell, world=workspace.stated_world)
    assessments = clock.run("all candidates, whole", lambda: [assignment.assess(c) for c in task.candidates])
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        clock.run("ranking and table", lambda: print_ranking(TASK, assignment, rank(assessments, "q_eoi"), "q_eoi"))
    for stage, value in clock.times.items():
        print(f"{stage}\t{value}")
