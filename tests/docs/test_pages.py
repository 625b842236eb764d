"""Every command in the documentation has been run, and prints what is shown."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import typer
from PIL import Image

from sqrp_cli import __version__
from sqrp_cli.cli.app import app
from tests.docs.page import BLOCK, PAGES, ROOT, blocks, played

RUN = [page for page in PAGES if any(block.kind in ("console", "sh") for block in blocks(page.read_text()))]
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)#\s]+)?(?:#([^)\s]+))?\)")

MADE = {
    "commands.md",
    "mounts.md",
    "robot.md",
    "workspace.md",
    "skill.md",
    "findings.md",
    "usual-values.md",
    "calibration-formats.md",
}
"""Pages that are made from the code."""
LONG = {"audit", "run", "advise", "parameters", "place", "place-cameras"}
"""Pages of several seconds of processor time each: runs with all cameras of the tabletop, and searches."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "rate"),
    [
        pytest.param(
            page,
            "2 Hz" if page.stem == "audit" else "10 Hz",  # what is audited is not shown, so few images will do
            id=str(page.relative_to(ROOT)),
            marks=[pytest.mark.trial] if page.stem in LONG else [],
        )
        for page in RUN
    ],
)
def test_commands_print_what_the_page_shows(page: Path, rate: str) -> None:
    for block, printed in played(page, rate):
        assert printed == block.output, block.command


PYTHON = re.compile(r"^```python\n(?P<code>.*?)^```$", re.DOTALL | re.MULTILINE)
WITH_CODE = [page for page in PAGES if PYTHON.search(page.read_text())]


@pytest.mark.slow
@pytest.mark.parametrize("page", WITH_CODE, ids=[str(page.relative_to(ROOT)) for page in WITH_CODE])
def test_python_on_a_page_runs_from_top_to_bottom(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, object] = {}
    for code in PYTHON.findall(page.read_text()):
        exec(compile(code, str(page), "exec"), names)  # noqa: S102 - our own pages


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_links_lead_to_files_that_exist(page: Path) -> None:
    for target, _ in LINK.findall(BLOCK.sub("", page.read_text())):
        assert not target or (page.parent / target).exists() or Path(target).name in MADE, target


def test_the_readme_is_a_front_door_of_at_most_700_words() -> None:
    assert len((ROOT / "README.md").read_text().split()) <= 700


def test_the_readme_asks_why_of_the_candidate_that_its_ranking_has_last() -> None:
    readme = (ROOT / "README.md").read_text()
    *_, last = re.findall(r"^\d+ [ *] +(\w+) ", readme, re.MULTILINE)
    assert f'"pickup green" --choose {last}`' in readme


def test_the_drawing_of_the_idea_has_figures_that_commands_print() -> None:
    shown = (ROOT / "README.md").read_text() + (ROOT / "docs" / "howto" / "run.md").read_text()
    figures = re.findall(r">[^<]*?(\d+\.\d+) [sm]<", (ROOT / "docs" / "pictures" / "idea.svg").read_text())
    assert len(figures) == 9
    assert [figure for figure in figures if not re.search(rf"\b{re.escape(figure)}\b", shown)] == []


def test_the_first_page_shows_every_command() -> None:
    text = (ROOT / "docs" / "index.md").read_text()
    for command in typer.main.get_command(app).commands:  # type: ignore[attr-defined] # it is a group
        assert f"`sqrp {command}" in text, command


def test_what_make_run_installs_is_enough_for_every_command_of_the_readme() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    (installed,) = re.findall(
        r"^\.venv/run:.*\n\t\$\(INSTALL\) '\.\[(.*)\]'", (ROOT / "Makefile").read_text(), re.MULTILINE
    )
    readme = (ROOT / "README.md").read_text()
    assert "--planner" not in readme
    assert "--cluster" not in readme
    assert {*installed.split(",")} == extras.keys() - {"planners", "cluster", "dev"}
    assert f"`pip install '.[{installed}]'` for all" in readme


def test_the_changes_begin_with_the_version() -> None:
    newest = re.search(r"^## (\S+),", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert newest is not None
    assert newest[1] == __version__


def test_pictures_show_the_figures_that_commands_print() -> None:
    pictures = {
        name: Image.open(ROOT / "docs" / "pictures" / f"{name}.png").info["Description"] for name in ("report", "run")
    }
    rows = re.findall(r"^\d+ [ *] +\w+ .*?((?: +[\d.]+){6})$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(rows) == 5
    assert {figure for row in rows for figure in row.split()} <= {*re.split(r"[^\d.]+", pictures["report"])}
    (slipped,) = re.findall(
        r"Here the cube has slipped at ([\d.]+) s", (ROOT / "docs" / "howto" / "run.md").read_text()
    )
    assert slipped in pictures["run"]
