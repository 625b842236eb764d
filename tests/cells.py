"""Cells as documents: the shipped ones to be changed, and where they are written."""

from __future__ import annotations

import copy
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError, Problem

ROOT = Path(__file__).parents[1]
FILES = ROOT / "tests" / "cases" / "files"  # of robots, worlds and meshes, sound ones


def read_cases(name: str) -> Any:
    """What a file of tests/cases says; by libyaml where it is there, as the suite reads all cases in every worker."""
    text = (ROOT / "tests" / "cases" / name).read_text(encoding="utf-8")
    return yaml.load(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506 - both are safe


def command_lines(name: str, **places: object) -> list[list[str]]:
    """Those of a list in tests/cases/commands.yaml, with what stands for its words in capitals."""
    places = {one.upper(): ROOT / "workspaces" / one for one in ("tabletop", "screws", "tower")} | places
    places["WATCH"] = ROOT / "tests" / "cases" / "watch"
    lines = map(shlex.split, read_cases("commands.yaml")[name])
    return [[re.sub("[A-Z]{3,}", lambda w: str(places.get(w[0], w[0])), word) for word in line] for line in lines]


def read_cell(folder: Path) -> dict[str, Any]:
    """What the workspace file of a folder says, with absolute paths of tool and skills."""
    text = (folder / "workspace.yaml").read_text(encoding="utf-8")
    cell = yaml.safe_load(re.sub(r"\bon:", "'on':", text))  # YAML 1.1 takes a bare `on` for a truth value
    tool = cell["robot"]["tool"]
    tool["urdf"] = str((folder / tool["urdf"]).resolve())
    cell["skills"] = [str((folder / skill).resolve()) for skill in cell["skills"]]
    return cell


def shipped_cell(name: str) -> dict[str, Any]:
    """What the file of a shipped workspace says, with absolute paths of tool and skills."""
    return read_cell(ROOT / "workspaces" / name)


def write_cell(cell: dict[str, Any], folder: Path) -> Path:
    """Write a workspace file into a folder; its path."""
    path = folder / "workspace.yaml"
    path.write_text(yaml.safe_dump(cell, sort_keys=False), encoding="utf-8")
    return path


def follow(document: Any, dotted: str) -> tuple[Any, Any]:
    """The container of a value, and its key there."""
    *path, last = dotted.split(".")
    for key in path:
        document = document[int(key) if isinstance(document, list) else key]
    return document, int(last) if isinstance(document, list) else last


def set_values(document: Any, values: dict[str, Any]) -> None:
    """Set values by their dotted paths; one after the last of a list is added."""
    for path, value in values.items():
        container, key = follow(document, path)
        container[slice(key, key + 1) if isinstance(container, list) else key] = (
            [value] if isinstance(container, list) else value
        )


def made_cell(name: str, folder: Path) -> Path:
    """Write a cell of tests/cases/made_cells.yaml into a folder; the folder."""
    case = copy.deepcopy(read_cases("made_cells.yaml")[name])  # its anchors are shared
    cell = shipped_cell(case["of"])
    cell["cameras"] = {one: cell["cameras"][one] for one in case.get("cameras", cell["cameras"])}
    if "skills" in case:
        cell["skills"] = [str(ROOT / "skills" / one) for one in case["skills"]]
    set_values(cell, case["set"])
    return write_cell(cell, folder).parent


def refused(call: Callable[..., object], *arguments: object, **named: object) -> Problem:
    """The one problem for which a call is refused."""
    with pytest.raises(InputError) as caught:
        call(*arguments, **named)
    (problem,) = caught.value.problems
    return problem


def refusal(folder: Path) -> Problem:
    """The first of the problems for which the workspace in a folder is refused."""
    with pytest.raises(InputError) as caught:
        load_workspace(folder)
    return caught.value.problems[0]


def edit(file: str | Path, *pairs: str) -> None:
    """Replace texts in a file, or in that of the workspace in a folder; each stands there once."""
    path = Path(file) / "workspace.yaml" if Path(file).is_dir() else Path(file)
    text = path.read_text(encoding="utf-8")
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {path}"
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")


def copied(folder: Path, name: str = "tabletop", camera: str | None = None) -> Path:
    """A copy of a shipped workspace with all that it names; of its cameras those before one, if that is named."""
    for part in ("workspaces", "skills"):
        shutil.copytree(ROOT / part, folder / part, dirs_exist_ok=True)
    file = folder / "workspaces" / name / "workspace.yaml"
    if camera is not None:
        text = file.read_text(encoding="utf-8")
        file.write_text(text[: text.index(f"  {camera}:")] + text[text.index("skills:") :], encoding="utf-8")
    return file.parent
