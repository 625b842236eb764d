"""A workspace whose files are somewhere else: on another machine, say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.shapes import Mesh, Part


def files_to_load(workspace: Workspace) -> Mapping[Path, str]:
    """The files that are read again when a workspace is loaded for computing, with the digests of their content."""
    parts = [*workspace.robot.parts, *(part for thing in workspace.objects.values() for part in thing.parts)]
    paths = {part.shape.path for part in parts if isinstance(part.shape, Mesh)}
    return {file.path: file.digest for file in workspace.files.values() if file.path in paths}


def relocated(workspace: Workspace, moved: Callable[[Path], Path]) -> Workspace:
    """The workspace with every file of `files_to_load` where `moved` puts it."""

    def parts(old: tuple[Part, ...]) -> tuple[Part, ...]:
        return tuple(
            replace(part, shape=replace(part.shape, path=moved(part.shape.path)))
            if isinstance(part.shape, Mesh)
            else part
            for part in old
        )

    return replace(
        workspace,
        robot=replace(workspace.robot, parts=parts(workspace.robot.parts)),
        objects={name: replace(thing, parts=parts(thing.parts)) for name, thing in workspace.objects.items()},
    )
