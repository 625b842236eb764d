"""`make docs` builds a site whose pages, made from the code, name everything there is."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from sqrp_cli.checks.registry import rules
from sqrp_cli.cli.app import app
from sqrp_cli.show.documents.schemas import FILES, schema_of
from tests.docs.page import ROOT


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    built = subprocess.run(
        command, cwd=ROOT, env={**os.environ, "NO_MKDOCS_2_WARNING": "1"}, capture_output=True, text=True
    )
    assert built.returncode == 0, built.stderr
    assert built.stderr == ""
    return folder


def test_every_command_has_its_section(site: Path) -> None:
    page = (site / "reference" / "commands.html").read_text()
    for command in typer.main.get_command(app).commands:  # type: ignore[attr-defined] # it is a group
        assert f'id="sqrp-{command}"' in page


def test_the_first_page_and_the_menu_lead_to_every_page_under_a_name_of_its_own(site: Path) -> None:
    menu, _, first = (site / "index.html").read_text().partition('<div class="md-content"')
    pages = [page for page in site.rglob("*.html") if page.name not in ("index.html", "404.html")]
    for page in pages:
        link = f'href="{page.relative_to(site)}"'
        assert link in menu, link
        assert link in first, link
    assert len({re.findall("<title>.*?</title>", page.read_text())[0] for page in pages}) == len(pages)


def test_every_finding_has_its_section(site: Path) -> None:
    page = (site / "reference" / "findings.html").read_text()
    for code in rules():
        assert f'id="{code}"' in page


@pytest.mark.parametrize("file", FILES)
def test_every_key_of_a_file_is_on_its_page(site: Path, file: str) -> None:
    page, schema = (site / "reference" / f"{file}.html").read_text(), schema_of(file)
    entries = [schema, *(entry for entry in schema["$defs"].values() if "properties" in entry)]
    for key in {key for entry in entries for key in entry["properties"]}:
        assert f"<code>{key}</code>" in page, key


def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    for page in site.rglob("*.html"):
        text = page.read_text()
        assert '<script src="http' not in text, page
        assert '<link rel="stylesheet" href="http' not in text, page


FOUND = {"gripper": "My gripper", "latency": "latency", "never noticed": "Will a dropped part be noticed?"}
"""What people look for, and words of the best answer."""


@pytest.mark.slow
def test_search_works_from_the_disk(site: Path, browser: Any) -> None:
    page = browser.new_page(offline=True)
    page.goto((site / "index.html").as_uri())
    for words, answer in FOUND.items():
        page.fill(".md-search__input", "")
        page.type(".md-search__input", words)
        page.locator(".md-search-result__item").nth(0).filter(has_text=answer).wait_for()
    page.close()
