"""What is damaged, and which command is then asked."""

from __future__ import annotations

import ipaddress
import json
import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from random import Random
from urllib.parse import urlsplit

from tests.damage import cell_bombs, mesh_bombs, record_bombs, recording_bombs, robot_bombs
from tests.damage.bombs import Bomb
from tests.damage.cell import BASELINE, FRAME, FRAMES, LOG, MCAP, RESULTS, ROS1, ROSBAG2, SCORE, TASK, WATCHED
from tests.damage.mutations import damage

Command = Callable[[Path], Sequence[object]]


@dataclass(frozen=True)
class Damaged:
    """A damaged cell, and what is asked about it.

    what: the kind of damage. name: what a refusal must name. lines, words: where the damage is; None where it is no
    matter of lines.
    """

    what: str
    command: Sequence[object]
    name: str
    lines: range | None = None
    words: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Kind:
    """A kind of input. share: of the cases. do: damages a cell that it may change, in its own way each turn.

    harmless: a file that is computed again where it is damaged, so that everything is as it would be without.
    parts: whether a refusal must name a part of it, too; of a recording that cannot be read nothing is known but that.
    """

    name: str
    share: int
    do: Callable[[Path, Random, int], Damaged]
    harmless: bool = False
    parts: bool = True


def _file(
    file: str,
    command: Command,
    bombs: Sequence[Bomb],
    share: int = 2,
    title: str = "",
    *,
    harmless: bool = False,
    parts: bool = True,
) -> Kind:
    """A file of the cell: in three of four turns as people and disks damage it, in the fourth a bomb."""

    def do(cell: Path, random: Random, turn: int) -> Damaged:
        path = _first(cell, file)
        name = ROSBAG2 if path.parent.name == ROSBAG2 else path.name
        if turn % 4 == 0:
            bomb = bombs[turn // 4 % len(bombs)]
            bomb.set(path, random)
            return Damaged(bomb.name, command(cell), name)
        done = damage(path.read_bytes(), random)
        path.unlink()  # the undamaged cell has the same file
        path.write_bytes(done.content)
        lines = done.lines if parts and path.name != "binary.stl" else None
        return Damaged(done.what, command(cell), name, lines, done.words)

    return Kind(title or file, share, do, harmless, parts)


def _first(cell: Path, file: str) -> Path:
    return sorted(cell.glob(file))[0]


def _rank(cell: Path) -> Sequence[object]:
    return ["rank", cell, TASK, "--samples", "2"]


def _check(cell: Path) -> Sequence[object]:
    return ["check", cell, TASK]


def _after(cell: Path) -> Sequence[object]:
    return ["check", cell, TASK, "--after", cell / "program.yaml"]


def _listing(cell: Path) -> Sequence[object]:
    return ["program", cell / "program.yaml"]


def _replay(cell: Path) -> Sequence[object]:
    return ["run", "--replay", cell / WATCHED / LOG, "--json"]


def _replay_page(cell: Path) -> Sequence[object]:
    return [*_replay(cell), "--report", cell / "page.html"]


def _replay_program(cell: Path) -> Sequence[object]:
    return [
        "run",
        cell / WATCHED / "program.yaml",
        "--replay",
        cell / WATCHED / LOG,
        "--report",
        cell / "page.html",
        "--json",
    ]


def _audit(cell: Path) -> Sequence[object]:
    return ["audit", cell / WATCHED / "program.yaml", cell / WATCHED / FRAMES, "--json"]


def _recording(name: str) -> Command:
    return lambda cell: ["audit", cell / WATCHED / "program.yaml", cell / WATCHED / name, "--json"]


def _baseline(cell: Path) -> Sequence[object]:
    return ["score", cell, *SCORE, "--out", cell / RESULTS, "--resume", "--baseline", cell / BASELINE]


def _results(cell: Path) -> Sequence[object]:
    return ["score", cell, *SCORE, "--out", cell / RESULTS, "--resume"]


def _cluster(cell: Path) -> Sequence[object]:
    """A file that leads to another machine is not tried."""
    path = cell / "scheduler.json"
    address = ""
    with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
        address = json.loads(path.read_text(encoding="utf-8"))["address"] if path.is_file() else ""
    return _check(cell) if _is_far(address) else ["score", cell, *SCORE, "--cluster", path]


def _is_far(address: object) -> bool:
    """Whether an address may be that of another machine."""
    with suppress(ValueError):
        host = urlsplit(str(address)).hostname
        return bool(host) and not ipaddress.ip_address(host).is_loopback
    return "//127.0.0.1" not in str(address) and "//[::1" not in str(address) and "//" in str(address)


def _task(cell: Path, random: Random, turn: int) -> Damaged:
    """A task on the command line."""
    if turn % 2 == 0:
        text, what = (
            record_bombs.TASKS[turn // 2 % len(record_bombs.TASKS)],
            f"task {turn // 2 % len(record_bombs.TASKS)}",
        )
    else:
        done = damage(record_bombs.TASK.encode(), random)
        text, what = done.content.decode(errors="surrogateescape"), done.what
    return Damaged(what, ["check", cell, text.replace("\0", "")], "")


_ODD = (
    b"c\xe9ll",
    b"\xff",
    b"a b'c\"d",
    b"-x",
    b"\xe2\x80\xae",
    b"line\nend",
    b"\x1b[31m",
    b"x" * 250,
    b"$(x)",
    b"~",
    b"%41",
    b"#",
)


def _path(cell: Path, random: Random, turn: int) -> Damaged:
    """Files and folders whose names are no text, or text that a shell or a terminal would take for something else."""
    name = os.fsdecode(_ODD[turn % len(_ODD)])
    odd = cell.with_name("odd") / name
    odd.parent.mkdir(exist_ok=True)
    shutil.rmtree(odd, ignore_errors=True)
    odd.mkdir()
    moved = shutil.move(cell, odd / "cell")
    other = odd / name
    commands: list[Sequence[object]] = [
        _rank(moved), _check(moved), ["show", moved, "--json"], _replay_page(moved), _audit(moved), _baseline(moved),
            _cluster(moved), _after(moved),
        [*_rank(moved), "--program", other], [*_rank(moved), "--report", odd / f"{name[:200]}.html"], ["show",
            other], ["check", odd, TASK], ["program", other],
        ["program", moved / "program.yaml", "--export", odd / f"{name[:200]}.csv"], ["program", other, "--export",
            odd / "none" / name], ["run", "--replay", other],
        ["audit", moved / WATCHED / "program.yaml", odd], ["score", other, *SCORE], ["score", moved, *SCORE,
            "--baseline", other], ["score", moved, *SCORE, "--cluster", other],
        ["score", moved, *SCORE, "--out", other], ["init", other], ["init", odd, "--urdf", other], ["diff", other,
            moved], ["explain", moved, TASK, "--json", "--samples", "2"],
        ["score", moved, *SCORE, "--junit", odd / "none" / name], ["score", moved, *SCORE, "--save-baseline", other],
    ]  # fmt: skip
    which = turn // len(_ODD) % len(commands)
    if turn % 3 == 0:
        path = moved / random.choice(["workspace.yaml", "robots/six_axis_arm.urdf", "program.yaml"])
        done = damage(path.read_bytes(), random)
        path.unlink()
        path.write_bytes(done.content)
    return Damaged(f"name {turn % len(_ODD)}, command {which}", commands[which], "")


KINDS = (
    _file("workspace.yaml", _rank, cell_bombs.WORKSPACE, 4),
    _file("skills/pickup/skill.yaml", _rank, cell_bombs.SKILL, 4),
    _file("skills/pickup/pickup.pddl", _check, cell_bombs.PDDL, 4),
    _file("camera.yaml", _check, cell_bombs.CAMERA),
    _file("opencv.yaml", _check, cell_bombs.CAMERA),
    _file("hand_eye.yaml", _check, cell_bombs.HAND_EYE),
    _file("robots/six_axis_arm.urdf", _rank, robot_bombs.ARM, 4),
    _file("robots/suction_cup.urdf", _rank, robot_bombs.TOOL),
    _file("arm.srdf", _check, robot_bombs.GROUPS),
    _file("cube.stl", _rank, mesh_bombs.TEXT_STL),
    _file("binary.stl", _rank, mesh_bombs.BINARY_STL),
    _file("cube.obj", _rank, mesh_bombs.OBJ, 3),
    _file("cube.dae", _rank, mesh_bombs.COLLADA, 4),
    _file("program.yaml", _after, record_bombs.PROGRAM, 2, "program to go on from"),
    _file("program.yaml", _listing, record_bombs.PROGRAM, 2, "program to list"),
    _file(f"{WATCHED}/{LOG}", _replay, record_bombs.LOG, 3, "log to replay"),
    _file(f"{WATCHED}/{LOG}", _replay_page, record_bombs.LOG, 1, "log for a page"),
    _file(f"{WATCHED}/{LOG}", _replay_program, record_bombs.LOG, 1, "log with its program"),
    _file(BASELINE, _baseline, record_bombs.BASELINE, 3),
    _file(f"{RESULTS}/*/*.json", _results, record_bombs.JSON, 2, "kept result", harmless=True),
    _file(f"{WATCHED}/{FRAMES}/frames.csv", _audit, record_bombs.FRAMES, 1, "frames.csv"),
    _file(f"{WATCHED}/{FRAMES}/{FRAME}", _audit, record_bombs.PNG, 1, "frame", parts=False),
    _file(f"{WATCHED}/{MCAP}", _recording(MCAP), recording_bombs.MCAP, 2, "MCAP", parts=False),
    _file(f"{WATCHED}/{ROS1}", _recording(ROS1), recording_bombs.ROS1, 2, "bag of ROS 1", parts=False),
    _file(
        f"{WATCHED}/{ROSBAG2}/*.db3", _recording(ROSBAG2), recording_bombs.SQLITE, 1, "rosbag2 with SQLite", parts=False
    ),
    _file(f"{WATCHED}/{ROSBAG2}/*.yaml", _recording(ROSBAG2), record_bombs.YAML, 1, "metadata.yaml", parts=False),
    _file("scheduler.json", _cluster, record_bombs.SCHEDULER, 2),
    Kind("task", 3, _task),
    Kind("name of a file", 2, _path),
)
"""Kinds of input."""

TURNS = tuple(kind for round_ in range(4) for kind in KINDS if kind.share > round_)
"""The kinds in the order in which they take turns."""


def damaged(cell: Path, number: int) -> tuple[Kind, Damaged]:
    """Damage a cell in a way that its number tells."""
    kind = TURNS[number % len(TURNS)]
    turn = number // len(TURNS) * kind.share + TURNS[: number % len(TURNS)].count(kind)
    return kind, kind.do(cell, Random(number), turn)  # noqa: S311
