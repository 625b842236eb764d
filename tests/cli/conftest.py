"""Runs commands as a user would, each expensive one once, and hands out what they printed."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from unittest import mock

import pytest
import yaml

from sqrp_cli.cli.main import run
from tests.cells import made_cell, read_cases, read_cell, set_values, shipped_cell, write_cell

if TYPE_CHECKING:
    from tests.cli.slip_run import Cell, SlipRun

ROOT = Path(__file__).parents[2]
TASK = "pickup green"


@pytest.fixture(autouse=True)
def _as_before():
    """An interrupted command ignores Ctrl-C from then on, as its process ends; that of the tests goes on."""
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


def press_ctrl_c(*_: object, **__: object) -> None:
    """Ctrl-C in place of a step of a command; for tests with `heeded_ctrl_c`."""
    signal.raise_signal(signal.SIGINT)


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON document on stdout; strict about what JSON allows."""

        def refuse(constant: str) -> None:
            raise AssertionError(f"{constant} is no JSON")

        document = json.loads(self.out, parse_constant=refuse)
        assert isinstance(document, dict)
        return document


@dataclass(frozen=True)
class Written:
    """What `rank` printed as text, and the files that it wrote."""

    out: str
    program: Path
    page: Path


def _environment(columns: int, extra: dict[str, str]) -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if name not in {"FORCE_COLOR", "LINES", "TERM"}}
    return {**kept, "COLUMNS": str(columns), "NO_COLOR": "1", **extra}


def _call(*arguments: object, columns: int = 80) -> Outcome:
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.dict(os.environ, _environment(columns, {}), clear=True),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        code = run([str(argument) for argument in arguments])
    return Outcome(int(code), out.getvalue(), err.getvalue())


def _start(*arguments: object, prelude: str = "", columns: int = 80, **variables: str) -> Outcome:
    program = f"{prelude}\nfrom sqrp_cli.cli.main import main\nmain()"
    finished = subprocess.run(
        [sys.executable, "-c", program, *map(str, arguments)],
        env=_environment(columns, variables),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        encoding="utf-8",
        timeout=120,
        check=False,
    )
    return Outcome(finished.returncode, finished.stdout, finished.stderr)


@pytest.fixture(scope="session")
def sqrp():
    """Runs a command in this process; `columns` is the width of the terminal."""
    return _call


@pytest.fixture(scope="session")
def sqrp_process():
    """Runs a command in a process of its own; `prelude` is Python that runs before it, other keywords are variables."""
    return _start


@pytest.fixture(scope="session")
def asked(once):
    """What a command says of a cell that no test changes, as `sqrp`: computed once for all tests and workers."""

    def ask(*arguments: object, columns: int = 80) -> Outcome:
        name = hashlib.sha256(repr(([*map(str, arguments)], columns)).encode()).hexdigest()
        outcome: Outcome = once(name, lambda _: _call(*arguments, columns=columns))
        return outcome

    return ask


TABLETOP = ROOT / "workspaces" / "tabletop"
WATCH, GRIPPER = (ROOT / "tests" / "cases" / name for name in ("watch", "gripper"))


@pytest.fixture(scope="session")
def tabletop():
    """The shipped workspace; nothing here may depend on where its things stand."""
    return TABLETOP


@pytest.fixture(scope="session")
def watch():
    """A cell in which every figure can be worked out by hand; see its files."""
    return WATCH


@pytest.fixture(scope="session")
def gripper():
    """A cell with a gripper of two fingers that carry markers."""
    return GRIPPER


def _said(*command: object) -> Any:
    """A fixture: what a command says as a document, once for all."""
    return pytest.fixture(lambda asked: asked(*command, "--json"), scope="session")


ranked = _said("rank", TABLETOP, TASK)
explained = _said("explain", TABLETOP, TASK, "--all")
shown = _said("show", TABLETOP)
watched = _said("explain", WATCH, "watch cube", "--all")
watch_shown = _said("show", WATCH)
gripped = _said("explain", GRIPPER, "pickup_two_finger", "--all", "--samples", 9)
gripper_shown = _said("show", GRIPPER)


@pytest.fixture
def own_watch(watch, tmp_path):
    """A copy of that cell, to be changed."""
    return Path(shutil.copytree(watch, tmp_path / "watch"))


@pytest.fixture(scope="session")
def tabletop_written(once, tabletop):
    """The ranking of the tabletop as text, its best way as a program, and its page."""

    def write(folder: Path) -> Written:
        program, page = folder / "pick.yaml", folder / "page.html"
        outcome = _call("rank", tabletop, TASK, "--program", program, "--report", page)
        assert outcome.code == 0, outcome.err
        return Written(outcome.out, program, page)

    made: Written = once("written", write)
    return made


@pytest.fixture
def tabletop_cell():
    """What the tabletop's file says, to be changed and written elsewhere."""
    return {**shipped_cell("tabletop"), "skills": [str(ROOT / "skills" / "pickup")]}


@pytest.fixture(scope="session")
def laying(tmp_path_factory):
    """A part of the tabletop with a skill that lays down what was picked up."""
    return write_cell(read_cell(ROOT / "tests" / "cases" / "laying"), tmp_path_factory.mktemp("laying")).parent


@pytest.fixture(scope="session")
def holding(laying):
    """A program after which the tool holds g2."""
    path = laying / "holding.yaml"
    assert _call("rank", laying, "pickup g2", "--program", path).code == 0
    return path


@pytest.fixture(scope="session")
def started(once):
    """A new workspace, which no test changes, and what `init --json` said of it."""
    made: tuple[Path, Outcome] = once("new", lambda base: (base / "cell", _call("init", base / "cell", "--json")))
    return made


@pytest.fixture(scope="session")
def harsh(once):
    """The tabletop made hard to see."""

    def write(folder: Path) -> Path:
        skill_folder = Path(shutil.copytree(ROOT / "skills" / "pickup", folder / "pickup"))
        text = (skill_folder / "skill.yaml").read_text(encoding="utf-8")
        skill = yaml.safe_load(re.sub(r"\bon:", "'on':", text))  # YAML 1.1 takes a bare `on` for a truth value
        set_values(skill, read_cases("made_cells.yaml")["harsh_skill"])
        (skill_folder / "skill.yaml").write_text(yaml.safe_dump(skill), encoding="utf-8")
        return made_cell("harsh", folder)

    folder: Path = once("harsh", write)
    return folder


@pytest.fixture(scope="session")
def harsh_explained(asked, harsh):
    return asked("explain", harsh, TASK, "--all", "--json", "--samples", 25)


@pytest.fixture(scope="session")
def harsh_shown(asked, harsh):
    return asked("show", harsh, "--json")


@pytest.fixture(scope="session")
def quick_cell(once):
    """A cell to whose folder no test adds a file, as all workers share it."""
    from tests.cli.slip_run import quick_cell  # which loads the simulator

    cell: Cell = once("quick", partial(quick_cell, _call))
    return cell


@pytest.fixture(scope="session")
def slip_run(once, quick_cell):
    from tests.cli.slip_run import run_with_slip

    run: SlipRun = once("slip", lambda _: run_with_slip(_call, quick_cell))
    return run


@pytest.fixture(scope="session")
def scenes(explained, shown, harsh_explained, harsh_shown, watched, watch_shown, gripped, gripper_shown):
    """Per cell the `show` document and the `explain` documents of its feasible candidates."""
    pairs = {
        "tabletop": (shown, explained),
        "harsh": (harsh_shown, harsh_explained),
        "watch": (watch_shown, watched),
        "gripper": (gripper_shown, gripped),
    }
    return {
        name: (show.document, [c for c in explain.document["candidates"] if c["feasible"]])
        for name, (show, explain) in pairs.items()
    }


@pytest.fixture
def show(scene):
    """The `show` document of the cell of a module's fixture `scene`."""
    return scene[0]


@pytest.fixture
def documents(scene):
    """The `explain` documents of its feasible candidates."""
    return scene[1]
