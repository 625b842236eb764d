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

from tests.damage import record_bombs, recording_bombs
from tests.damage.bombs import TEXT, YAML, Bomb, listed
from tests.damage.cell import BASELINE, FRAME, FRAMES, LOG, MCAP, RESULTS, ROS1, ROSBAG2, SCORE, TASK, WATCHED
from tests.damage.mutations import damage


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


COMMANDS = {
    "rank": f"rank .|{TASK}|--samples 2",
    "check": f"check .|{TASK}",
    "show": "show . --json",
    "after": f"check .|{TASK}|--after ./program.yaml",
    "listing": "program ./program.yaml",
    "replay": f"run --replay ./{WATCHED}/{LOG} --json",
    "replay page": f"run --replay ./{WATCHED}/{LOG} --json --report ./page.html",
    "replay program": f"run ./{WATCHED}/program.yaml --replay ./{WATCHED}/{LOG} --report ./page.html --json",
    **{name: f"audit ./{WATCHED}/program.yaml ./{WATCHED}/{name} --json" for name in (FRAMES, MCAP, ROS1, ROSBAG2)},
    **{name: f"check ./demos.yaml {name}" for name in ("dataset", "table", "trajectory")},
    "baseline": f"score . {' '.join(SCORE)} --out ./{RESULTS} --resume --baseline ./{BASELINE}",
    "results": f"score . {' '.join(SCORE)} --out ./{RESULTS} --resume",
    "cluster": f"score . {' '.join(SCORE)} --cluster ./scheduler.json",
}
"""Words of commands, divided by blanks; with bars where a word has blanks. A dot begins what is in the cell."""


def asked(command: str, cell: Path) -> list[str]:
    """The words of one of the commands about a cell; a scheduler file that leads to another machine is not tried."""
    if command == "cluster":
        address, path = "", cell / "scheduler.json"
        with suppress(OSError, ValueError, LookupError, TypeError, RecursionError):
            address = json.loads(path.read_text(encoding="utf-8"))["address"] if path.is_file() else ""
        command = "check" if _is_far(address) else command
    text = COMMANDS[command]
    words = [word for part in text.split("|") for word in ([part] if part == TASK else part.split())]
    return [str(cell / word) if word[0] == "." else word for word in words]


def _is_far(address: object) -> bool:
    """Whether an address may be that of another machine."""
    with suppress(ValueError):
        host = urlsplit(str(address)).hostname
        return bool(host) and not ipaddress.ip_address(host).is_loopback
    return "//127.0.0.1" not in str(address) and "//[::1" not in str(address) and "//" in str(address)


def _damage_in_place(path: Path, random: Random) -> tuple[str, range, frozenset[str]]:
    done = damage(path.read_bytes(), random)
    path.unlink()  # the undamaged cell has the same file
    path.write_bytes(done.content)
    return done.what, done.lines, done.words


def _file(
    file: str, command: str, bombs: Sequence[Bomb], share: int = 2, title: str = "", *, harmless: bool = False,
    parts: bool = True,
) -> Kind:  # fmt: skip
    """A file of the cell: in three of four turns as people and disks damage it, in the fourth a bomb."""

    def do(cell: Path, random: Random, turn: int) -> Damaged:
        path = sorted(cell.glob(file))[0]
        name = ROSBAG2 if path.parent.name == ROSBAG2 else path.name
        if turn % 4 == 0:
            bomb = bombs[turn // 4 % len(bombs)]
            bomb.set(path, random)
            return Damaged(bomb.name, asked(command, cell), name)
        what, lines, words = _damage_in_place(path, random)
        return Damaged(what, asked(command, cell), name, lines if parts and name != "binary.stl" else None, words)

    return Kind(title or file, share, do, harmless, parts)


def _task(cell: Path, random: Random, turn: int) -> Damaged:
    """A task on the command line."""
    which = turn // 2 % len(record_bombs.TASKS)
    text, what = record_bombs.TASKS[which], f"task {which}"
    if turn % 2:
        done = damage(record_bombs.TASK.encode(), random)
        text, what = done.content.decode(errors="surrogateescape"), done.what
    return Damaged(what, ["check", cell, text.replace("\0", "")], "")


_ODD = (
    b"c\xe9ll", b"\xff", b"a b'c\"d", b"-x", b"\xe2\x80\xae", b"line\nend", b"\x1b[31m", b"x" * 250, b"$(x)", b"~",
    b"%41", b"#",
)  # fmt: skip


def _path(cell: Path, random: Random, turn: int) -> Damaged:
    """Files and folders whose names are no text, or text that a shell or a terminal would take for something else."""
    name = os.fsdecode(_ODD[turn % len(_ODD)])
    odd = cell.with_name("odd") / name
    odd.parent.mkdir(exist_ok=True)
    shutil.rmtree(odd, ignore_errors=True)
    odd.mkdir()
    moved, other = shutil.move(cell, odd / "cell"), odd / name
    plain = ("rank", "check", "show", "replay page", FRAMES, "baseline", "cluster", "after")
    commands: list[Sequence[object]] = [
        *(asked(command, moved) for command in plain),
        [*asked("rank", moved), "--program", other], [*asked("rank", moved), "--report", odd / f"{name[:200]}.html"],
        ["show", other], ["check", odd, TASK], ["program", other],
        ["program", moved / "program.yaml", "--export", odd / f"{name[:200]}.csv"],
        ["program", other, "--export", odd / "none" / name], ["run", "--replay", other],
        ["audit", moved / WATCHED / "program.yaml", odd], ["score", other, *SCORE],
        ["score", moved, *SCORE, "--baseline", other], ["score", moved, *SCORE, "--cluster", other],
        ["score", moved, *SCORE, "--out", other], ["init", other], ["init", odd, "--urdf", other],
        ["diff", other, moved], ["explain", moved, TASK, "--json", "--samples", "2"],
        ["score", moved, *SCORE, "--junit", odd / "none" / name], ["score", moved, *SCORE, "--save-baseline", other],
    ]  # fmt: skip
    which = turn // len(_ODD) % len(commands)
    if turn % 3 == 0:
        _damage_in_place(moved / random.choice(["workspace.yaml", "robots/six_axis_arm.urdf", "program.yaml"]), random)
    return Damaged(f"name {turn % len(_ODD)}, command {which}", commands[which], "")


ARM, CAMERA = (*TEXT, *listed("urdf")), (*TEXT, *YAML, *listed("camera"))

KINDS = (
    _file("workspace.yaml", "rank", (*TEXT, *YAML, *listed("workspace")), 4),
    _file("skills/pickup/skill.yaml", "rank", (*TEXT, *YAML, *listed("skill")), 4),
    _file("skills/pickup/pickup.pddl", "check", (*TEXT, *listed("pddl")), 4),
    _file("camera.yaml", "check", CAMERA),
    _file("opencv.yaml", "check", CAMERA),
    _file("hand_eye.yaml", "check", (*TEXT, *YAML, *listed("hand eye"))),
    _file("robots/six_axis_arm.urdf", "rank", ARM, 4),
    _file("robots/suction_cup.urdf", "rank", (*TEXT, *[one for one in ARM if one.name in ("depth", "attributes")])),
    _file("arm.srdf", "check", (*TEXT, *listed("srdf"))),
    _file("cube.stl", "rank", (*TEXT, *listed("text stl"))),
    _file("binary.stl", "rank", record_bombs.BINARY_STL),
    _file("cube.obj", "rank", (*TEXT, *listed("obj")), 3),
    _file("cube.dae", "rank", record_bombs.COLLADA, 4),
    _file("program.yaml", "after", record_bombs.PROGRAM, 2, "program to go on from"),
    _file("program.yaml", "listing", record_bombs.PROGRAM, 2, "program to list"),
    _file(f"{WATCHED}/{LOG}", "replay", record_bombs.LOG, 3, "log to replay"),
    _file(f"{WATCHED}/{LOG}", "replay page", record_bombs.LOG, 1, "log for a page"),
    _file(f"{WATCHED}/{LOG}", "replay program", record_bombs.LOG, 1, "log with its program"),
    _file(BASELINE, "baseline", (*record_bombs.JSON, *listed("baseline")), 3),
    _file(f"{RESULTS}/*/*.json", "results", record_bombs.JSON, 2, "kept result", harmless=True),
    _file(f"{WATCHED}/{FRAMES}/frames.csv", FRAMES, record_bombs.FRAMES, 1, "frames.csv"),
    _file(f"{WATCHED}/{FRAMES}/{FRAME}", FRAMES, record_bombs.PNG, 1, "frame", parts=False),
    _file(f"{WATCHED}/{MCAP}", MCAP, recording_bombs.MCAP, 2, "MCAP", parts=False),
    _file(f"{WATCHED}/{ROS1}", ROS1, recording_bombs.ROS1, 2, "bag of ROS 1", parts=False),
    _file(f"{WATCHED}/{ROSBAG2}/*.db3", ROSBAG2, recording_bombs.SQLITE, 1, "rosbag2 with SQLite", parts=False),
    _file(f"{WATCHED}/{ROSBAG2}/*.yaml", ROSBAG2, record_bombs.YAML, 1, "metadata.yaml", parts=False),
    _file("recorded/set/meta/info.json", "dataset", record_bombs.JSON, 1, "dataset of LeRobot"),
    _file("recorded/set/data/*/*.parquet", "dataset", recording_bombs.PARQUET, 2, "Parquet file", parts=False),
    _file("recorded/demo.csv", "table", record_bombs.JOINTS, 2, "table of joints"),
    _file("recorded/demo.yaml", "trajectory", (*TEXT, *YAML), 1, "joint trajectory"),
    _file("scheduler.json", "cluster", (*record_bombs.JSON, *listed("scheduler")), 2),
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
