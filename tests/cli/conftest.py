"""Runs commands as a user would, each expensive one once, and hands out what they printed."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
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
from tests.cells import read_cell, shipped_cell, write_cell

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


@pytest.fixture(scope="session")
def tabletop():
    """The shipped workspace; nothing here may depend on where its things stand."""
    return ROOT / "workspaces" / "tabletop"


@pytest.fixture(scope="session")
def watch():
    """A cell in which every figure can be worked out by hand; see its files."""
    return ROOT / "tests" / "cases" / "watch"


@pytest.fixture
def own_watch(watch, tmp_path):
    """A copy of that cell, to be changed."""
    return Path(shutil.copytree(watch, tmp_path / "watch"))


@pytest.fixture(scope="session")
def ranked(asked, tabletop):
    return asked("rank", tabletop, TASK, "--json")


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


@pytest.fixture(scope="session")
def explained(asked, tabletop):
    return asked("explain", tabletop, TASK, "--all", "--json")


@pytest.fixture(scope="session")
def shown(asked, tabletop):
    return asked("show", tabletop, "--json")


@pytest.fixture
def tabletop_cell():
    """What the tabletop's file says, to be changed and written elsewhere."""
    return _read_tabletop()


def _read_tabletop() -> dict[str, Any]:
    cell = shipped_cell("tabletop")
    cell["skills"] = [str(ROOT / "skills" / "pickup")]
    return cell


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
    """The tabletop made hard to see.

    Lenses of every kind, a camera on the wrist, narrow limits, two boxes or two cameras for a literal, nested formulas.
    """
    folder: Path = once("harsh", _write_harsh)
    return folder


def _write_harsh(folder: Path) -> Path:
    cell = _read_tabletop()
    skill_folder = Path(shutil.copytree(ROOT / "skills" / "pickup", folder / "pickup"))
    cell["robot"]["base"] = {"position": [0.01, -0.02, 0.005], "rpy": [0.002, -0.001, 0.01]}
    cell["skills"] = ["pickup"]
    cell["detectors"]["color"].update(distance=["60 cm", "150 cm"], min_pixels=24)
    cell["detectors"]["flat"] = {
        "kind": "aruco", "distance": [0.1, 3], "max_incidence": "65 deg", "min_pixels": 6, "min_visible": 1,
    }  # fmt: skip
    lenses = {
        "cam1": ("plumb_bob", [-0.28, 0.09, 0.001, -0.0007, -0.01]),
        "cam2": ("rational_polynomial", [0.4, 0.1, 0.0004, -0.001, 0.02, 0.5, 0.15, 0.01]),
        "cam3": ("equidistant", [-0.02, 0.01, -0.004, 0.001]),
    }
    for name, (model, coefficients) in lenses.items():
        cell["cameras"][name]["image"]["distortion"] = {"model": model, "coefficients": coefficients}
    cell["cameras"]["cam2"].update(rate="25 Hz", latency="120 ms")
    cell["cameras"]["cam4"]["far"] = "1.3 m"
    cell["cameras"]["cam6"]["near"] = "85 cm"
    cell["cameras"]["wrist"] = {
        "frame": "wrist_2_link",
        "pose": {"position": [0, 0.05, 0.05], "rpy": [0, "90 deg", 0]},
        "image": {"width": 320, "height": 200, "fx": 150, "fy": 155, "cx": 150, "cy": 110},
        "near": "5 cm", "rate": "30 Hz",
    }  # fmt: skip
    skill = yaml.safe_load((skill_folder / "skill.yaml").read_text(encoding="utf-8"))
    skill["targets"]["hold"]["cameras"] = 2
    skill["targets"]["obj_on_table"]["boxes"].append(
        {"name": "top", "frame": "object@start", "size": [0.03, 0.03, 0.001], "normal": [0, 0, 1],
         "pose": {"position": [0, 0, 0.0205]}, "detector": "flat"}
    )  # fmt: skip
    skill["formulas"].append("always[a1.start + 0.5, a2.end - 0.3] (eventually[0, 0.2] (obj_on_table))")
    skill["faults"]["late"] = {"formula": "eventually[a5.start, a5.end] (not hold)", "response": "continue"}
    (skill_folder / "skill.yaml").write_text(yaml.safe_dump(skill), encoding="utf-8")
    write_cell(cell, folder)
    return folder


@pytest.fixture(scope="session")
def harsh_explained(asked, harsh):
    return asked("explain", harsh, TASK, "--all", "--json", "--samples", 25)


@pytest.fixture(scope="session")
def harsh_shown(asked, harsh):
    return asked("show", harsh, "--json")


@pytest.fixture(scope="session")
def watched(asked, watch):
    return asked("explain", watch, "watch cube", "--all", "--json")


@pytest.fixture(scope="session")
def watch_shown(asked, watch):
    return asked("show", watch, "--json")


@pytest.fixture(scope="session")
def gripper():
    """A cell with a gripper of two fingers that carry markers."""
    return ROOT / "tests" / "cases" / "gripper"


@pytest.fixture(scope="session")
def gripped(asked, gripper):
    return asked("explain", gripper, "pickup_two_finger", "--all", "--json", "--samples", 9)


@pytest.fixture(scope="session")
def gripper_shown(asked, gripper):
    return asked("show", gripper, "--json")


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
