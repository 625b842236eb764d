"""Patches of files: their text, the names of files in them, and the command that applies them."""

from __future__ import annotations

import difflib
import io
import os
import shlex
from pathlib import Path

from sqrp_cli.knowledge.text.source import SourceDocument


def patch(document: SourceDocument, content: bytes, name: str | None = None) -> str:
    """A unified diff from a document to a new content; empty if nothing differs.

    name: of the file in it; by default as `to_apply` needs it.
    """
    name = in_patch(document.path) if name is None else name
    before, after = ([*io.StringIO(text.decode(), newline="\n")] for text in (document.content, content))
    lines = difflib.unified_diff(before, after, name, name)
    return "".join(line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines)


def from_here(path: Path) -> str:
    """The name of a file in a patch and in a command: relative if it is below the current folder."""
    current = Path.cwd()
    return (path.relative_to(current) if path.is_relative_to(current) else path).as_posix()


def in_patch(path: Path) -> str:
    """The name of a file in a patch; where it is not below the current folder, `patch` takes its bare name only."""
    name = from_here(Path(os.path.normpath(Path.cwd() / path)))
    return path.name if Path(name).is_absolute() else name


def to_apply(patch: Path, path: Path) -> str:
    """The command that applies a patch of a file, in the current folder."""
    at = "" if in_patch(path) != path.name else f" -d {shlex.quote(str(path.parent))}"
    return f"patch -p0{at} < {shlex.quote(str(patch))}"
