"""The file of a workspace: where it is, what it is called, and its text as YAML."""

from __future__ import annotations

import hashlib
import os
import shlex
from contextlib import suppress
from pathlib import Path

from sqrp_cli.errors import InputError, Place, bad_input, first_names
from sqrp_cli.files.input_file import NOT_THERE, YAML_ENDINGS, nearest_entry, read_input
from sqrp_cli.files.packages import from_folder
from sqrp_cli.files.source import SourceDocument
from sqrp_cli.files.yaml_file import MAX_BYTES, parse_yaml, read_yaml
from sqrp_cli.platform.files import alone, real_path, write_atomically
from sqrp_cli.shown import shown_name

WORKSPACE_FILE = "workspace.yaml"


def read_workspace_document(path: Path, content: bytes | None = None) -> SourceDocument:
    """A workspace file as YAML; content: replaces that of the file.

    Raises as `read_yaml`, and for a program or skill.
    """
    keys = ("robot", "cameras", "objects", "skills")
    document = read_yaml(path, keys=keys) if content is None else parse_yaml(path, content, keys=keys)
    if "sqrp_program" in document.data:
        named = document.data.get("workspace")
        expected = "expected a workspace"
        if isinstance(named, str):
            expected = f"its workspace is {from_folder(document.path.parent, named)}"
        mend = f"sqrp program {shlex.quote(str(path))}"
        raise bad_input("no-workspace", f"this is a program; {expected}", Place(document.path), mend=mend)
    if "primitives" in document.data and "robot" not in document.data:
        raise bad_input("no-workspace", "this is a skill; name the workspace that uses it", Place(path))
    return document


def check_no_workspace(folder: Path) -> None:
    """Raises InputError for the folder of a workspace, among whose files a command is to write its own."""
    if (folder / WORKSPACE_FILE).exists():
        message = "this is the folder of a workspace, and what is kept would lie among its files"
        raise bad_input("would-overwrite", message, Place(folder), mend=f"choose another name: {folder / 'results'}")


def read_again(path: Path, digest: str, content: bytes | None = None) -> SourceDocument:
    """A workspace file that was read before, for a change of it; content: its text where that was not on the disk.

    digest: SHA-256 of what was read. Raises InputError where the file has changed meanwhile.
    """
    document = read_workspace_document(path, content)
    if content is None and hashlib.sha256(document.content).hexdigest() != digest:
        raise _changed(path)
    return document


def replace_workspace(document: SourceDocument, content: bytes, mend: str = "run the same command again") -> None:
    """Write another text into a workspace file. Raises InputError where it is not what was read, or cannot be written.

    So of two changes at once the second is refused, and none is lost. mend: what messages then advise.
    """
    with alone(document.path):
        if read_input(document.path, MAX_BYTES) != document.content:
            raise _changed(document.path, mend)
        write_atomically(document.path, content)


def _changed(path: Path, mend: str = "run the same command again") -> InputError:
    return bad_input("changed-meanwhile", "the workspace has changed meanwhile", Place(path), mend=mend)


def workspace_name(file: Path) -> str:
    """What a workspace is called: the name of its folder, or of a file that is not `workspace.yaml`."""
    return shown_name(file.parent.name if file.name == WORKSPACE_FILE else file.stem)


def shortest_path(file: Path) -> Path:
    """The path that a command needs for a workspace file: its folder is enough for `workspace.yaml`."""
    return file.parent if file.name == WORKSPACE_FILE else file


def workspace_file(path: Path) -> Path:
    """The file of the workspace at a path: itself, or `workspace.yaml` in it. Raises InputError where there is none.

    It begins with the path as it is given, unless that leads up through a link: programs have one name for a file.
    """
    given = path
    if ".." in path.parts and path.exists() and str(real_path(path)) != os.path.abspath(path):  # noqa: PTH100
        path = real_path(path)
    if path.is_dir():
        if os.path.lexists(path / WORKSPACE_FILE):
            return path / WORKSPACE_FILE
        entries = sorted(path.iterdir())
        inside = [entry.name for entry in entries if (entry / WORKSPACE_FILE).is_file()]
        files = [entry.name for entry in entries if entry.suffix in YAML_ENDINGS]
        hint = "the folder is empty" if not entries else "it has neither YAML files nor workspaces"
        if inside:
            hint = f"it has the workspaces {first_names(inside)}"
        elif files:
            hint = f"it has {first_names(files)}"
        raise bad_input("no-workspace", f"the folder has no {WORKSPACE_FILE}; {hint}", Place(given))
    if not path.exists():
        folder = given.parent
        while not folder.is_dir():
            folder = folder.parent
        wanted = given.relative_to(folder).parts[0]
        rest = given.relative_to(folder / wanted)
        close = None
        with suppress(OSError):  # folders that may not be read
            # A folder within one may be meant, such as `workspaces/tabletop` by `tabletop`.
            below = (Path(entry.name) / wanted / rest for entry in sorted(folder.iterdir()))
            close = next((str(path) for path in below if _is_workspace(folder / path)), None)
        close = close or nearest_entry(folder / wanted, lambda entry: _is_workspace(entry / rest))
        hint = f"; there is no folder {folder / wanted}" if rest.parts else ""
        hint = f"; did you mean `{folder / close}`?" if close else hint
        raise bad_input("missing-file", f"{NOT_THERE}{hint}", Place(given))
    return path


def _is_workspace(path: Path) -> bool:
    """Whether a path could be a workspace: a folder with a `workspace.yaml`, or another YAML file."""
    return (path / WORKSPACE_FILE).is_file() or (path.suffix in YAML_ENDINGS and path.is_file())
