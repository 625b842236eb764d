"""The program file: an executable YAML file."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import string
from collections.abc import Mapping
from contextlib import suppress
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import yaml

from sqrp_cli.cell.canonical_values import canonical_values, digest_of_values, what_changed, with_skills
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.cell.workspace_file import shortest_path
from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.files.source import KeyPath
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.program.record import Program

_KEYS = ("sqrp_program", "workspace", "digest", "steps")
SHEBANG = "#!/usr/bin/env -S sqrp run --sim"
_MAKE = "name a file that does not exist yet, and it is made: sqrp rank WORKSPACE TASK --program NEW.yaml"
_NOT_SUMMED = {"checksum", "marks", "workspace", "made_for"}
"""Keys that the checksum leaves out; `digest`, which it includes, is that of `made_for`."""
_CHANGES_NAMED = 4  # most changes of a workspace in a message
_LIKE_NUMBERS = re.compile(r"[-+.]?[0-9].*")  # text that needs quotes, so that no reader takes it for a number
_MOST_PLACES = 50  # most folders in which a renamed workspace is looked for
_SIGNS = string.ascii_letters + string.digits + "+-"


def load_program(path: Path) -> Program:
    """Read and validate a program file. Raises InputError with the place of each error.

    Whether what it says goes together `check_unedited` tells: nobody else writes programs.
    """
    if path.is_dir():
        raise bad_input("no-program", "found a folder, expected the file of a program", Place(path), mend=_MAKE)
    no_program = bad_input("no-program", "this is no program: it lacks the key `sqrp_program`", Place(path), mend=_MAKE)
    try:
        document = read_yaml(path, keys=_KEYS)
    except InputError as error:
        if path.is_file() and error.problems[0].code != "file-too-large":
            with path.open("rb") as file:
                if b"sqrp_program" not in file.read(4096):
                    raise no_program from error
        raise
    if "sqrp_program" not in document.data:
        raise no_program
    return validate(document, Program)


def save_program(program: Program, path: Path) -> None:
    """Write an executable program file, all or nothing.

    Raises InputError if it cannot be written, or would be too large to be read again.
    """
    head = f"{SHEBANG}\n# Written by sqrp; change the workspace and rank again instead of editing it.\n"
    numbers = program.model_dump(mode="json", by_alias=True)
    numbers |= {"checksum": _digest(_summed(program)), "marks": "".join(_marks(program).values())}
    Program.model_validate(numbers)  # An invalid figure is a bug; find it before the file is written.
    numbers["made_for"] = {subject: _OneLine(values) for subject, values in numbers["made_for"].items()}
    text = head + yaml.dump(numbers, Dumper=_Dumper, sort_keys=False, width=120, allow_unicode=True)
    if len(text.encode()) > MAX_BYTES:
        message = f"with {len(program.steps)} steps this program would have more than {MAX_BYTES:,} bytes, the limit"
        raise bad_input("file-too-large", message, Place(path), mend=f"--after {path} --program ANOTHER")
    write_atomically(path, text, executable=True)


def _summed(program: Program) -> dict[str, Any]:
    """What the checksum is of: a program, independent of the layout and place of its file."""
    return program.model_dump(mode="json", by_alias=True, exclude=_NOT_SUMMED)


def _marks(program: Program) -> dict[KeyPath, str]:
    """A sign for each value, by its keys: if the checksum is wrong, they show which value changed.

    Values are what the file has on one line: plain ones and lists of them. Signs are short, as there are hundreds: a
    changed value keeps its sign once in 64 times.
    """
    marks: dict[KeyPath, str] = {}
    waiting: list[tuple[KeyPath, Any]] = [((), _summed(program))]  # the next one last
    while waiting:
        at, value = waiting.pop()
        if isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
            value = dict(enumerate(value))
        if isinstance(value, Mapping) and value:
            waiting += [((*at, key), item) for key, item in reversed([*value.items()])]
        else:
            marks[at] = _SIGNS[int(_digest([at, value])[:8], 16) % len(_SIGNS)]
    return marks


def _digest(value: Any) -> str:  # noqa: ANN401
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def new_program(workspace: Workspace, joints: tuple[str, ...], path: Path) -> Program:
    """A program without steps, to be saved at `path`."""
    return made_for(Program(workspace="", digest="", joints=joints, steps=()), path, workspace)


def made_for(program: Program, path: Path, workspace: Workspace) -> Program:
    """A program that is right for a workspace, to be saved at `path` with what that says now."""
    said = with_skills(workspace.canonical_values, program.skills)
    where = os.path.relpath(workspace.path, path.absolute().parent)
    return program.model_copy(update={"workspace": where, "digest": digest_of_values(said), "made_for": said})


def check_program(program: Program, path: Path, workspace: Workspace, replaced: int = 0) -> bool:
    """Raises InputError if a program was made for another workspace, or if either has changed since in what matters.

    replaced: how many of its last steps are about to be. Where these are all, and start from the world that the
    workspace stated, that may have changed: True then, as all of the program is written anew.
    """
    where, doubt = workspace_path(program, path), stale(program, path, workspace)
    if where != workspace.path and (where.exists() or doubt is not None):
        raise bad_input("other-workspace", f"this program was made for {where}, not for {workspace.path}", Place(path))
    anew = doubt is not None and replaced == len(program.steps) > 0
    if doubt is not None:
        if not anew:
            raise InputError(doubt)
        # Whether it starts in the world of its workspace as that was: the facts, where objects lie, the arm at home.
        said, world = program.made_for, program.steps[0].before
        here, free = canonical_values(world, {}), world.X_WO.keys() - {world.held}
        lying = (said.get(f"object {name}", {}).get("pose") == here[f"X_WO {name}"][""] for name in free)
        joints = ((said.get(f"joint {name}", {}), here[f"joint {name}"][""]) for name in world.joints)
        home = (one.get("home", position) == position for one, position in joints)
        if {*said.get("state", {})} != {*map(str, world.facts)} or not all(lying) or not all(home):
            raise InputError(doubt)
    check_unedited(program, path)
    return anew


def check_unedited(program: Program, path: Path) -> None:
    """Raises InputError if a program was edited, with the first changed value.

    Only this tells computed figures from typed ones.
    """
    if program.checksum != _digest(_summed(program)):
        changed = (keys for (keys, is_), was in zip(_marks(program).items(), program.marks, strict=False) if is_ != was)
        message = "this program is not as sqrp wrote it, so what it says need not be true of its motion"
        raise read_yaml(path).error("edited-program", next(changed, ("checksum",)), message, _again(program, path))


def workspace_path(program: Program, path: Path) -> Path:
    """The workspace file of a program at `path`."""
    return Path(os.path.normpath(path.absolute().parent / program.workspace))


def find_workspace(program: Program, path: Path) -> Path:
    """The workspace file of a program at `path`, also where one folder on the way to it has been renamed.

    Then it is the only one beside the old place that the program holds in. Raises InputError if there is none.
    """
    where = workspace_path(program, path)
    if where.exists():
        return where
    there = next(folder for folder in where.parents if folder.is_dir())
    below = where.relative_to(there).parts[1:]
    beside = (folder.joinpath(*below) for folder in sorted(there.iterdir()) if folder.is_dir() and below)
    found = []
    for file in islice(filter(Path.is_file, beside), _MOST_PLACES):
        with suppress(InputError):
            if stale(program, path, load_workspace(file)) is None:
                found.append(file)
    if len(found) == 1:
        return found[0]
    message = f"there is no workspace {shortest_path(where)}, where this program looks for it from its own folder"
    mend = "move the program back, or enter under `workspace` where its workspace is now"
    raise read_yaml(path, keys=_KEYS).error("missing-file", ("workspace",), message, mend)


def stale(program: Program, path: Path, workspace: Workspace) -> Problem | None:
    """What has changed in a workspace so that a program no longer holds, with the commands that make its steps again.

    None if it holds.
    """
    if program.digest == digest_of_values(with_skills(workspace.canonical_values, program.skills)):
        return None
    if program.digest != digest_of_values(program.made_for):
        message = "what this program keeps of its workspace was edited, so nobody knows whether it still holds"
        return Problem("stale-program", message, Place(path), mend=_again(program, path))
    changes = what_changed(program.made_for, workspace.canonical_values, program.skills)
    if not changes:
        return None
    message = f"the workspace `{workspace.name}` has changed since this program was written, so it no longer holds"
    more = len(changes) - _CHANGES_NAMED
    what = "; ".join(changes[:_CHANGES_NAMED]) + (f"; and {more} more changes" if more > 1 else "; and one more" * more)
    return Problem("stale-program", f"{message}: {what}", Place(path), mend=_again(program, path))


def _again(program: Program, path: Path) -> str:
    """The commands that make a program again."""
    tasks = [step.own_task for step in program.steps] or ["TASK"]
    workspace, file = shlex.quote(str(shortest_path(workspace_path(program, path)))), shlex.quote(str(path))
    # The same task twice is appended where the program itself is gone on with.
    starts = ((file if task == before else workspace, task) for before, task in pairwise(["", *tasks]))
    again = (f"sqrp rank {at} {shlex.quote(task)} --program {file}" for at, task in starts)
    return " && ".join([f"rm {file}", *again])


class _OneLine(dict[str, Any]):
    """A mapping that the file has on one line, or as many as its values need."""


class _Dumper(yaml.SafeDumper):
    """Lists of plain values on one line, everything else in blocks; text that looks like a number in quotes.

    No aliases: they would be refused, or surprise readers of the file.
    """

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ANN401
        plain = not any(isinstance(item, Mapping) for item in sequence)
        return super().represent_sequence(tag, sequence, flow_style=plain if flow_style is None else flow_style)

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ANN401, ARG002
        return True


_Dumper.add_representer(
    str,
    lambda to, text: to.represent_scalar("tag:yaml.org,2002:str", text, "'" if _LIKE_NUMBERS.fullmatch(text) else None),
)
_Dumper.add_representer(
    _OneLine, lambda to, values: to.represent_mapping("tag:yaml.org,2002:map", values, flow_style=True)
)
