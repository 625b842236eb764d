"""Which workspaces are to be scored: folders, files and patterns become workspace files."""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.workspace.load import WORKSPACE_FILE, workspace_file
from sqrp_cli.platform.paths_as_text import shown_name


def find_workspaces(patterns: Sequence[str]) -> tuple[Path, ...]:
    """The workspace files that patterns stand for, each once: in the order of the patterns, each pattern's by name.

    A pattern is a workspace file, the folder of one, a folder with workspaces at any depth below it (hidden folders
    left out), or a glob of those (`cells/*`, `**` for any depth). Raises InputError for one that no workspace fits.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        if Path(pattern).exists() or not glob.has_magic(pattern):
            matches = [Path(pattern)]
        else:
            matches = [Path(match) for match in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207
        files = [file for match in matches for file in _files(match)]
        if not files:
            # A single path that does not exist is explained by whoever reads workspaces.
            files = [] if glob.has_magic(pattern) else [workspace_file(Path(pattern))]
        if not files:
            message = f"no workspace fits `{pattern}`; a workspace is a folder with a {WORKSPACE_FILE}"
            raise InputError(Problem("no-workspace", message, Place(Path(pattern))))
        found.update(dict.fromkeys(Path.cwd() / file for file in files))
    return tuple(found)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path] if path.suffix in (".yaml", ".yml") else []
    if (path / WORKSPACE_FILE).is_file():
        return [path / WORKSPACE_FILE]
    found = path.rglob(WORKSPACE_FILE)
    return sorted(file for file in found if not any(part.startswith(".") for part in file.relative_to(path).parts))


def short_names(files: Sequence[Path]) -> Mapping[Path, str]:
    """What output calls each workspace: its folder's name, or as much of its path as tells it from the others."""
    names: dict[Path, str] = {}
    paths = {file: (file.parent if file.name == WORKSPACE_FILE else file.with_suffix("")) for file in files}
    for file, path in paths.items():
        count = 1
        while count < len(path.parts) and any(
            other.parts[-count:] == path.parts[-count:] for at, other in paths.items() if at != file
        ):
            count += 1
        names[file] = shown_name("/".join(path.parts[-count:]))
    return names
