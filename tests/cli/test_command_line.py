"""The command line as its neighbours have it: help in words, options anywhere, short flags, places in a ranking."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

import sqrp_cli
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.cli.app import app
from sqrp_cli.cli.command import FIRST

NAMES = [one.name for one in app.registered_commands]


@pytest.mark.parametrize("command", ["", *NAMES])
def test_help_fits_eighty_columns_and_speaks_in_words(sqrp, command):
    out = sqrp(*filter(None, [command]), "--help", columns=80).out
    assert all(len(line) <= 80 for line in out.splitlines())
    assert not re.search(r"<\w|list\[|[{}]", out)
    # Every command and option stands there once.
    parser = typer.main.get_command(app)
    params = (parser.commands[command] if command else parser).params
    known = ["--help", *(max(one.opts, key=len) for one in params if one.param_type_name == "option")]
    listed = out.partition("Options:" if command else "answered before the robot moves.")[2]
    shown = re.findall(r"^  (?:-\w, )?(\S+)", listed, re.MULTILINE)
    assert sorted(one.partition("/")[0] for one in shown) == sorted([*known, *([] if command else NAMES)])


@pytest.mark.parametrize("command", FIRST)
def test_the_options_that_matter_come_first(sqrp, command):
    found = sqrp("help", command, columns=120)
    first = found.out.partition("\nOptions:\n")[2].partition("\n\n")[0]
    assert re.findall(r"^  --([\w-]+)", first, re.MULTILINE) == FIRST[command].split()
    assert len(FIRST[command].split()) <= 5
    assert found == sqrp(command, "--help", columns=120)
    assert max(map(len, found.out.splitlines())) in range(100, 121)


def test_verbose_says_how_long_each_step_took(sqrp, watch):
    plain, verbose = sqrp("rank", watch, "watch green"), sqrp("rank", watch, "watch green", "--verbose")
    same, _, short = plain.out.rpartition("Sampled")
    assert short.endswith("; -v says more.\n")
    assert plain.err == ""
    assert verbose.out.startswith(same)
    assert verbose.err.startswith("Assessing watch green: ")
    assert verbose.err.endswith(" s\n")


TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"

MOST_MODULES = 180  # of the package, that any of these commands enters

PROBE = """
import sys
from sqrp_cli.cli.main import run
code = run(sys.argv[2:])
own = sum(name.startswith("sqrp_cli") for name in sys.modules)
print(own, code, *sorted(set(sys.argv[1].split(",")) & set(sys.modules)), file=sys.stderr)
"""

HEAVY = (
    "pinocchio", "asyncio", "multiprocessing", "distributed", "mujoco", "cv2", "ompl", "rich.progress", "http.client",
    "numpy.ma", "sqrp_cli.show.documents.scores", "sqrp_cli.score", "sqrp_cli.program.file", "sqrp_cli.program.record",
)  # fmt: skip
"""Modules that no ranking of cubes on a table needs."""

READING = ("numpy", "pydantic", "rich.console", "yaml", "coal")
"""Modules that wait until a workspace is read."""


def loaded(modules: tuple[str, ...], *arguments: str | Path) -> str:
    command = [sys.executable, "-c", PROBE, ",".join(modules), *map(str, arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    own, _, found = done.stderr.splitlines()[-1].partition(" ")
    assert int(own) <= MOST_MODULES
    return found


def test_commands_load_only_what_they_use(tmp_path):
    # A ranking loads only what it uses.
    assert loaded(HEAVY, "rank", str(TABLETOP), "pickup g2") == "0"
    # Help is there before anything is read.
    assert loaded((*HEAVY, *READING), "--help") == "0"
    # A ranking with a page enters few modules.
    assert loaded((), "rank", TABLETOP, "pickup g2", "--report", tmp_path / "page.html") == "0"


def test_byte_code_goes_to_the_cache_where_it_may_not_be_written_beside_the_sources(tmp_path):
    plain = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(Path(sqrp_cli.__file__).parent, tmp_path / "sqrp_cli", ignore=plain)
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1", "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }  # fmt: skip
    environment.pop("PYTHONPYCACHEPREFIX", None)
    subprocess.run([sys.executable, "-m", "sqrp_cli", "--help"], env=environment, cwd=tmp_path, check=True)
    assert list((tmp_path / "cache" / "sqrp" / "bytecode").rglob("app.*.pyc"))
    assert not list((tmp_path / "sqrp_cli").rglob("__pycache__"))


def test_a_saved_result_is_shown_without_what_found_it(tmp_path):
    engines = ("sqrp_cli.motion", "sqrp_cli.robot", "sqrp_cli.cell", "sqrp_cli.study.pipeline", "yaml")
    for question in (
        ["explain", TABLETOP, "pickup g2"],
        ["advise", TABLETOP, "pickup g2", "--want", "q_eoi 100 %", "--kinds", "way"],
        ["place", TABLETOP.parent / "tower", "--cameras", "2"],
        ["score", Path(__file__).parents[1] / "cases" / "watch"],
    ):
        command = [sys.executable, "-m", "sqrp_cli", *map(str, question), "--json"]
        (tmp_path / "found.json").write_bytes(subprocess.run(command, capture_output=True).stdout)
        assert loaded(engines, "show", tmp_path / "found.json") == "0", question[0]


def test_a_value_that_is_set_while_the_file_changes_loses_neither(sqrp, own_watch, monkeypatch):
    file, read, texts = own_watch / "workspace.yaml", OpenCell.read, []

    def slow(*arguments, **named):
        texts.append(f"{file.read_text()}# changed by another one\n")
        file.write_text(texts[-1])
        return read(*arguments, **named)

    monkeypatch.setattr(OpenCell, "read", slow)
    found = sqrp("set", own_watch, "cameras.eye.rate=20")
    assert found.code == 2
    assert "the workspace has changed meanwhile" in found.err
    assert file.read_text() == texts[0]
