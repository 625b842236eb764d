"""Motions as text: tables, joint trajectories of ROS as YAML, our program files and the logs of our runs."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from functools import partial
from io import TextIOWrapper
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from sqrp_cli.errors import InputError, Place, bad_input, first_names
from sqrp_cli.files.input_file import open_input
from sqrp_cli.files.json_file import parse_json
from sqrp_cli.files.source import KeyPath, describe
from sqrp_cli.files.units import LARGEST, as_number
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.geometry import Array
from sqrp_cli.program.file import check_unedited, load_program
from sqrp_cli.program.joint_trajectory import points
from sqrp_cli.recording.episode import HELD, MOST_NUMBERS, Episode, Recording, alone, episode_of

MAX_BYTES = 200_000_000
"""Largest log or table that is read; with six cameras a second of a run takes some 7 kB, so this is eight hours."""
MAX_LINE, MAX_LINES = 10_000_000, 1_000_000  # Most bytes of a line that is read, and most lines of a log
RATE = 100.0
"""Of the states that are read of a program [Hz], whose motion is exact; there are more where a primitive begins."""
_WITHIN: tuple[KeyPath, ...] = ((), ("joint_trajectory",), ("trajectory",), ("trajectory", "joint_trajectory"))
"""Where a file may have its trajectory: alone, of MoveIt, and as the goal of an action."""
_TIME = re.compile(r"(?i)(time|time_?stamp|stamp|t|secs?|seconds|time_from_start)\W*_?(ns|us|µs|ms|s|secs?)?\W*")
_EPISODE = re.compile(r"(?i)episode(_?(index|id|number))?")
_DIVISORS = {"ns": 1e9, "us": 1e6, "µs": 1e6, "ms": 1e3}
_UNITS = {"deg": r"(?i)\bdeg|_deg|°", "rad": r"(?i)\brad|_rad", "percent": r"(?i)%|percent", "mm": r"(?i)(\b|_)mm\b"}
_AHEAD = 1000  # Rows among which the first cell of a column tells whether it has numbers, if it is empty in those above
_RAPID, _UNUSED = re.compile(r"(?i)(.*[._])?(rax_\d|eax_[a-f])"), 8.9e9
"""Axes as RAPID names them, in degrees; it writes 9E9 for those that are not there."""
_NUMBERED, _TURN = re.compile(r"(?i)(j|joint|a|axis|q)[\s_]?\d"), 6.4
"""Joints that are numbered are in degrees if any of them goes beyond this: hardly one turns so far [rad]."""
_OURS = "position_"  # Leads the positions in our own tables, which have velocities and accelerations, too


def open_table(path: Path, rate: float | None, _signal: str | None) -> Recording:
    """A table; with a column `episode_index` it has several episodes, one after the other.

    All other columns of numbers but that of times are joints. Raises InputError, with the line, for what is no number.
    """
    columns, where = _columns(path), Place(path)
    clock, chapter = (next(filter(pattern.fullmatch, columns), None) for pattern in (_TIME, _EPISODE))
    if clock is None and rate is None:
        message = f"this table has {first_names([*columns])}; expected a column of times as well"
        raise bad_input("wrong-columns", message, where, mend="name that of times `time`, in seconds, or state a rate")
    others = {name: column for name, column in columns.items() if name not in (clock, chapter)}
    joints = {name: column for name, column in others.items() if not (column > _UNUSED).all()}
    if ours := {name.removeprefix(_OURS): column for name, column in joints.items() if name.startswith(_OURS)}:
        joints = {**ours, **({HELD: joints[HELD]} if HELD in joints else {})}
    numbered = [name for name in joints if _NUMBERED.fullmatch(name)]
    turns = any(np.abs(joints[name]).max(initial=0.0) > _TURN for name in numbered)
    units = {name: "deg" for name in joints if _RAPID.fullmatch(name) or (turns and name in numbered)}
    units |= {name: unit for unit, said in _UNITS.items() for name in joints if re.search(said, name)}
    units |= dict.fromkeys(ours, "rad")
    number = columns[chapter] if chapter is not None else np.zeros(len(next(iter(columns.values()))))
    starts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(number)]

    def read(episode: int) -> Episode:
        begin, end = starts[episode : episode + 2]
        times = columns[clock] if clock is not None else number  # which a stated rate replaces
        states = np.column_stack([column[begin:end] for column in (times, *joints.values())])
        return episode_of(states, [*joints], where, f"episode {numbers[episode]}" if chapter else "this table", rate)

    numbers = tuple(f"{one:g}" for one in number[starts[:-1]])
    return Recording(path, "table", tuple(joints), read, units, numbers)


def _columns(path: Path) -> Mapping[str, Array]:
    """The columns of numbers of a table by name, (n,) each, that of times in seconds; text is left out.

    They are divided by `;`, tabs, `,`, `|` or blanks, whichever the line of names has; where that is no comma, numbers
    may have decimal commas. The first cell of a column that is not empty tells whether it has numbers, and empty ones
    among these are NaN. Lines that begin with `#` or `%` are left out.
    """
    at, commas = 0, False
    with open_input(path, MAX_BYTES) as file, TextIOWrapper(file, "utf-8-sig", errors="replace") as text:

        def lines() -> Iterator[str]:
            nonlocal at
            for line in iter(partial(text.readline, MAX_LINE), ""):
                at += 1
                if line.strip() and line.lstrip()[0] not in "#%":
                    yield line.replace(",", ".") if commas else line

        try:
            rows, used, cells = lines(), dict[int | str, Callable[[str], float]](), list[str]()
            head = next(rows, "")
            divider = next((one for one in ";\t,|" if one in head), None)
            commas = divider != ","
            for line in islice(rows, _AHEAD):
                own = (cell.strip(' "\n') for cell in line.split(divider))
                cells = [one or other for one, other in zip_longest(cells, own, fillvalue="")]
                if all(cells):
                    break
            names = [name.strip(' "\n') for name in head.split(divider)]
            for index, (name, cell) in enumerate(zip(names, cells, strict=False)):
                if name == HELD:
                    used[index] = lambda cell: float(cell.strip() not in ("", "0"))
                elif not np.isnan(as_number(cell)) or cell.lower() == "nan":
                    used[index] = lambda cell: float(cell.strip() or "nan")
                elif _TIME.fullmatch(name):
                    used[index] = lambda cell: datetime.fromisoformat(cell.strip()).timestamp()
            chosen = [index for index in range(len(names)) if index in used]
            if not cells or not chosen or len({names[index] for index in chosen}) < len(chosen):
                raise ValueError("no numbers, or a name twice")
            text.seek(0)
            at, rows = 0, islice(lines(), 1, None)
            numbers = partial(np.loadtxt, delimiter=divider, quotechar='"', comments=None, ndmin=2)
            table = numbers(rows, usecols=chosen, converters=used, max_rows=MOST_NUMBERS // len(chosen))
            if next(rows, None) is not None:
                raise ValueError(f"more than {MOST_NUMBERS:,} numbers")
        except ValueError as error:
            told = str(error).partition(" at row ")[0][:100]
            message = f"this is no line of a table: {told}; expected names in the first one, then numbers"
            raise bad_input("wrong-columns", message, Place(path, at)) from error
    found = {names[index]: column for index, column in zip(chosen, table.T, strict=True)}
    clocks = {name: match[2] or "s" for name in found if (match := _TIME.fullmatch(name))}
    return found | {name: found[name] / _DIVISORS.get(unit.lower(), 1.0) for name, unit in clocks.items()}


def open_trajectory(path: Path, rate: float | None, _signal: str | None) -> Recording:
    """A trajectory_msgs/JointTrajectory, alone or in a message that has one. Raises InputError with the place."""
    document = read_yaml(path, keys=("joint_names", "points", "joint_trajectory", "trajectory"))
    at = next((at for at in _WITHIN if document.at((*at, "points")) is not None), ())
    names, rows = (document.at((*at, key)) for key in ("joint_names", "points"))
    if not isinstance(names, list) or not isinstance(rows, list):
        raise document.error("wrong-value", at, "expected the lists `joint_names` and `points`")
    names, states = [*map(str, names)], np.zeros((len(rows), 1 + len(names)))
    for index, row in enumerate(rows):
        try:
            since, positions = row["time_from_start"], np.array(row["positions"], dtype=float)
            if isinstance(since, dict):  # of ROS 1, or of ROS 2
                named = {"sec": since.get("secs", "?"), "nanosec": since.get("nsecs", 0), **since}
                since = float(named["sec"]) + 1e-9 * float(named["nanosec"])
            states[index] = [float(since), *positions.reshape(len(names))]
        except (KeyError, TypeError, ValueError) as error:
            message = f"expected {len(names)} numbers in `positions`, for `joint_names`, and its `time_from_start`"
            raise document.error("wrong-value", (*at, "points", index), message) from error
    return alone(path, "joint trajectory", names, states, rate)


def open_program(path: Path, rate: float | None, _signal: str | None) -> Recording:
    """The motion of a program, exactly at times of a rate, by default `RATE`, and where parts begin; and `HELD`."""
    check_unedited(program := load_program(path), path)
    found = [*points(program, rate or RATE)] if program.steps else []
    states = np.array([[point.time, *point.q, point.held is not None] for point in found], dtype=float)
    return alone(path, "program", [*program.joints, HELD], states, None)


def open_log(path: Path, rate: float | None, _signal: str | None) -> Recording:
    """Where the robot was during a run, by its log, and `HELD`. Raises InputError."""
    names, q, held = list[str](), list[float](), None
    states = array("d")
    for place, event in log_lines(path):
        if event["event"] == "state" and len(states) < MOST_NUMBERS:
            names, q, held = names or event.get("joints", []), event.get("q", q), event.get("held", held)
            try:
                states.extend(np.array([event["t"], *q, held is not None], dtype=float).reshape(2 + len(names)))
            except (TypeError, ValueError) as error:
                raise no_log("this state has not as many positions `q` as there are `joints`", place) from error
    return alone(path, "log", [*map(str, names), HELD], np.array(states).reshape(-1, 2 + len(names)), rate)


def log_lines(path: Path) -> Iterator[tuple[Place, Mapping[str, Any]]]:
    """The fields of each line of a log, with its time `t` [s] and kind `event`; one that was cut off ends it.

    Raises InputError, with the line, for anything but a log.
    """
    with open_input(path, MAX_BYTES) as file:
        for number, line in enumerate(iter(partial(file.readline, MAX_LINE + 1), b""), 1):
            place = Place(path, number)
            if len(line) > MAX_LINE or number > MAX_LINES:
                message = f"this log is too large: the limit is {MAX_LINES:,} lines of {MAX_LINE:,} bytes"
                raise bad_input("file-too-large", message, place)
            try:
                document = parse_json(path, line.decode("utf-8"), number)
            except UnicodeDecodeError as error:
                raise no_log("this is no log of `sqrp run --log`: it is not UTF-8 text", place) from error
            except InputError as error:
                if number == 1:
                    raise no_log("this is no log of `sqrp run --log`: its first line is no JSON", place) from error
                if not line.endswith(b"\n") and error.problems[0].code == "json-syntax":
                    return
                raise
            what = "this line is no event of a log"
            if not isinstance(document, dict):
                raise no_log(f"{what}: found {describe(document)}, expected a mapping", place)
            t, kind = document.get("t"), document.get("event")
            if isinstance(t, bool) or not isinstance(t, int | float) or abs(t) > LARGEST:
                raise no_log(f"{what}: `t` is {describe(t)}, expected a number of seconds", place)
            if not isinstance(kind, str):
                raise no_log(f"{what}: `event` is {describe(kind)}, expected its kind", place)
            yield place, document


def no_log(message: str, place: Place) -> InputError:
    """The error of a file that is no log of a run."""
    return bad_input("no-log", message, place, mend="make one: sqrp run PROGRAM --sim --log FILE")
