"""Whole commands of this checkout and of a named commit, in turns: least CPU time, ratio, most memory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.benchmarks.table import print_table
from tests.cells import ROOT, edit, read_cell, write_cell

TABLETOP = ["workspaces/tabletop", "pickup green"]
COMMANDS = {
    "check tower": ["check", "workspaces/tower"],
    "rank tower": ["rank", "workspaces/tower", "stack red green"],
    "rank tabletop": ["rank", *TABLETOP],
    "rank tabletop, fastest ways": ["rank", *TABLETOP, "--ways", "fastest"],
    "rank screws": ["rank", "workspaces/screws", "pickup screw"],
    "explain tabletop": ["explain", *TABLETOP, "--all"],
    "advise g1": ["advise", "workspaces/tabletop", "pickup g1"],
    "score workspaces": ["score", "workspaces"],
    "place 2 cameras": ["place", *TABLETOP, "--cameras", "2"],
    "48 candidates of a crowd": ["rank", "CROWD48", "pickup green", "--ways", "fastest"],
    "96 candidates of a crowd": ["rank", "CROWD96", "pickup green", "--ways", "fastest"],
    "rank so101": ["rank", "so_arm_description/urdf/so101.urdf", "pickup green"],
    "rank tiago_dual": ["rank", "tiago_description/robots/tiago_dual.urdf", "pickup green"],
}
"""Each in one process; of a URDF, in the starter cell that the version's own `init` makes of it."""

OBJECTS, YAWS, CAMERAS = 200, 8, 24
"""Of a crowd."""


def compare(commit: str | None, runs: int, wanted: str) -> None:
    """A row for each command whose name has `wanted` in it; commit: what to compare with."""
    names = [name for name in COMMANDS if wanted in name]
    with tempfile.TemporaryDirectory() as folder, _checkouts(commit, Path(folder)) as trees:
        rows = []
        for name in names:
            jobs = [] if name == "check tower" or name.startswith(("explain", "place")) else ["--jobs", "1"]
            asked = [(tree, [*(_cell(tree, Path(folder), word) for word in COMMANDS[name]), *jobs]) for tree in trees]
            spent = [[_run(*one) for one in asked] for _ in range(runs + 1)][1:]  # the first makes byte code
            least = [min(run[k][0] for run in spent) for k in range(len(trees))]
            memory = max(run[0][1] for run in spent)
            ratio = [f"{least[0] / least[1]:.2f}"] if commit else []
            rows.append([name, *(f"{seconds:.2f}" for seconds in least), *ratio, f"{memory / 1024:.0f}"])
            print(f"  {rows[-1]}", file=sys.stderr, flush=True)
    before = [f"`{commit}` [s]", "ratio"] if commit else []
    title = f"Whole commands, CPU, the least of {runs} runs" + (" of each, in turns" if commit else "")
    print_table(title, ["", "now [s]", *before, "memory [MB]"], rows, "commands" if commit and not wanted else None)


@contextmanager
def _checkouts(commit: str | None, folder: Path) -> Iterator[list[Path]]:
    """This checkout, and one of the commit."""
    if commit is None:
        yield [ROOT]
        return
    other, git = folder / "before", ["git", "-C", str(ROOT), "worktree"]
    subprocess.run([*git, "add", "--quiet", "--detach", str(other), commit], check=True)
    try:
        yield [ROOT, other]
    finally:
        subprocess.run([*git, "remove", "--force", str(other)], check=True)


def _run(tree: Path, command: list[str]) -> tuple[float, int]:
    """CPU time of a command and all its processes [s], and its most memory [kB]."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment |= {"PYTHONPATH": str(tree), "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryFile() as output:
        started = subprocess.Popen(
            [sys.executable, "-m", "sqrp_cli", *command], cwd=tree, env=environment, stdout=output, stderr=output
        )
        _, status, used = os.wait4(started.pid, 0)
        started.returncode = os.waitstatus_to_exitcode(status)
        if started.returncode not in (0, 1):
            output.seek(0)
            raise SystemExit(f"{' '.join(command)} in {tree}: {output.read().decode()[-500:]}")
    return used.ru_utime + used.ru_stime, used.ru_maxrss


def _cell(tree: Path, folder: Path, word: str) -> str:
    """A word of a command of a checkout; a cell that it names is made first."""
    if not word.startswith("CROWD") and not word.endswith(".urdf"):
        return word
    cell = folder / f"{Path(word).stem} of {tree.name}"
    if not cell.exists() and word.startswith("CROWD"):
        _crowd(tree, cell, int(word[5:]) // YAWS)
    elif not cell.exists():
        _run(tree, ["init", str(cell), "--no-run", "--urdf", f"package://example-robot-data/robots/{word}"])
    return str(cell)


def _crowd(tree: Path, folder: Path, green: int) -> None:
    """Tabletop of a checkout with 200 small cubes, as many of them green, 24 cameras and 8 approach yaws."""
    cell = read_cell(tree / "workspaces" / "tabletop")
    shutil.copytree(tree / "skills", folder / "skills")
    yaws = ", ".join(f"{360 * i / YAWS:g} deg" for i in range(YAWS))
    edit(folder / "skills" / "pickup" / "skill.yaml", "approach_yaw: any ", f"approach_yaw: {{values: [{yaws}]}} ")
    cell["skills"] = ["skills/pickup"]
    cell["objects"] = {"table": cell["objects"]["table"]}
    for number in range(OBJECTS):
        angle, radius = 2 * np.pi * (number % 40) / 40, 0.36 + 0.07 * (number // 40)
        place = [float(radius * np.cos(angle)), float(radius * np.sin(angle)), 0.0125]
        color = "green" if number % (OBJECTS // green) == 0 and number < green * (OBJECTS // green) else "blue"
        cube = {"type": "cube", "color": color, "size": ["25 mm"] * 3, "pose": {"position": place}, "on": "table"}
        cell["objects"][f"g{number}"] = cube
    camera = next(iter(cell["cameras"].values()))
    cell["cameras"] = {}
    for number in range(CAMERAS):
        angle = 2 * np.pi * number / CAMERAS
        place = [float(1.2 * np.cos(angle)), float(1.2 * np.sin(angle)), 0.7 + 0.3 * (number % 3)]
        target = [float(0.4 * np.cos(angle)), float(0.4 * np.sin(angle)), 0.05]
        cell["cameras"][f"cam{number}"] = {**camera, "pose": {"position": place, "look_at": target}}
    cell["state"] = ["hand_empty", *(f"obj_on_table(g{number})" for number in range(OBJECTS))]
    cell.pop("tasks", None)
    write_cell(cell, folder)
