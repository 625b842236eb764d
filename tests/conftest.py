"""Settings of all tests (examples are the same in every run, none is timed), and the cells that they share."""

from __future__ import annotations

import compileall
import fcntl
import os
import pickle
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.platform.memory import collect_seldom
from sqrp_cli.robot.kinematics import RobotModel

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers, which start afterwards; as the command does

settings.register_profile("sqrp", deadline=None, derandomize=True, max_examples=40)
settings.load_profile("sqrp")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the package once: the tests start it in many processes, each of which may be told to keep no bytecode."""
    if not hasattr(config, "workerinput"):  # pytest-xdist gives that to its workers, which start afterwards
        compileall.compile_dir(Path(__file__).parents[1] / "sqrp_cli", quiet=2)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than there are cores: some tests wait, for a browser, for messages, for time to pass."""
    return len(os.sched_getaffinity(0)) + 1


LONGEST = ("docs", "damage")
"""Folders of tests that each take long, as slow ones do: one that begins last would keep other processes waiting."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.parent.name not in LONGEST and item.get_closest_marker("slow") is None)


def pytest_collection_finish() -> None:
    """Have garbage collected as in a process of the command, many of which run in this one."""
    collect_seldom()


TABLETOP = Path(__file__).parents[1] / "workspaces" / "tabletop"


@pytest.fixture(scope="session")
def tabletop() -> Workspace:
    return load_workspace(TABLETOP)


@pytest.fixture(scope="session")
def ur5(tabletop: Workspace) -> RobotModel:
    return RobotModel.load(tabletop.robot)


Once = Callable[[str, Callable[[Path], Any]], Any]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """What a function makes in a new folder of this name, and returns: computed once for all tests and workers."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base  # which the workers share

    def make_once(name: str, make: Callable[[Path], Any]) -> Any:
        folder, kept = shared / name, shared / f"{name}.pickle"
        with (shared / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not kept.exists():
                shutil.rmtree(folder, ignore_errors=True)
                folder.mkdir()
                kept.write_bytes(pickle.dumps(make(folder)))
        return pickle.loads(kept.read_bytes())  # noqa: S301 - it is our own

    return make_once


Damage = Callable[[dict[str, Any]], Path]


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A fresh copy of the cell."""
    return Path(shutil.copytree(Path(__file__).parent / "cases" / "cell", tmp_path / "cell"))


@pytest.fixture
def damaged(cell: Path) -> Damage:
    """Edits the copy as a case describes (see tests/cases/bad_inputs.yaml) and gives its folder."""

    def damage(case: dict[str, Any]) -> Path:
        for edit in case.get("edits", [case]):
            path = cell / edit["file"]
            if edit.get("delete"):
                path.unlink()
            elif "bytes" in edit:
                path.write_bytes(bytes.fromhex(edit["bytes"]))
            elif "text" in edit:
                path.write_text(edit["text"] * edit.get("times", 1), encoding="utf-8")
            else:
                text = path.read_text(encoding="utf-8") + edit.get("append", "")
                for old, new in edit.get("replace", {}).items():
                    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {edit['file']}"
                    text = text.replace(old, new)
                path.write_text(text, encoding="utf-8")
        return cell

    return damage


@pytest.fixture
def position_of() -> Callable[[str, Path], tuple[int, int]]:
    """Line and column, from 1, at which a text first stands in a file."""

    def find(text: str, path: Path) -> tuple[int, int]:
        content = path.read_text(encoding="utf-8")
        before = content[: content.index(text)]
        return before.count("\n") + 1, len(before) - before.rfind("\n")

    return find


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from tests.cli.browser import chromium

    with chromium() as opened:
        yield opened


@pytest.fixture
def heeded_ctrl_c() -> Iterator[None]:
    """Ctrl-C raises KeyboardInterrupt, as in a shell's foreground; background jobs may be started to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
