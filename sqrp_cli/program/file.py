"""The program file: an executable YAML file."""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import string
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.program.check import Flaw, Keys, flaws, flaws_in
from sqrp_cli.program.record import Program

_KEYS = ("sqrp_program", "workspace", "digest", "steps")

SHEBANG = "#!/usr/bin/env -S sqrp run --sim"

_NOT_SUMMED = {"checksum", "marks", "workspace"}

_SIGNS = string.ascii_letters + string.digits + "+-"


def load_program(path: Path) -> Program:
    """Read and validate a program file. Raises InputError with the place of each error, see `program.check`."""
    document = read_yaml(path, keys=_KEYS)
    if "sqrp_program" not in document.data:
        message = "this is no program: it lacks the key `sqrp_program`"
        mend = "name a file that does not exist yet, and it is made: sqrp rank WORKSPACE TASK --program NEW.yaml"
        raise InputError(Problem("no-program", message, Place(path), mend=mend))
    program = validate(document, Program)
    problems = _problems(document, flaws(program))
    for number, step in enumerate(program.steps):
        for index, formula in enumerate(step.formulas):
            parse_formula(formula.formula, document.value_place(("steps", number, "formulas", index, "formula")))
    if problems:
        raise InputError(*problems)
    return program


def _problems(document: SourceDocument, found: Iterable[Flaw]) -> list[Problem]:
    return [document.problem(flaw.code, flaw.at, flaw.message) for flaw in found]


def save_program(program: Program, path: Path) -> None:
    """Write an executable program file, all or nothing.

    Raises InputError if it cannot be written, or would be too large to be read again.
    """
    head = f"{SHEBANG}\n# Written by sqrp; change the workspace and rank again instead of editing it.\n"
    sums = {"checksum": _checksum(program), "marks": "".join(_marks(program).values())}
    numbers = {**_as_written(program), **sums}
    Program.model_validate(numbers)  # An invalid figure is a bug; find it before the file is written.
    text = head + yaml.dump(numbers, Dumper=_Dumper, sort_keys=False, width=120, allow_unicode=True)
    if len(text.encode()) > MAX_BYTES:
        message = f"with {len(program.steps)} steps this program would have more than {MAX_BYTES:,} bytes, the limit"
        raise InputError(Problem("file-too-large", message, Place(path), mend=f"--after {path} --program ANOTHER"))
    write_atomically(path, text, executable=True)


def _as_written(program: Program, without: Collection[str] = ()) -> dict[str, Any]:
    """The content of a program's file, without some of its keys."""
    return program.model_dump(mode="json", by_alias=True, exclude=set(without))


def _checksum(program: Program) -> str:
    """Digest of a program, independent of the layout and place of its file."""
    return _digest(_as_written(program, _NOT_SUMMED))


def _marks(program: Program) -> dict[Keys, str]:
    """A sign for each value, by its keys: if the checksum is wrong, they show which value changed.

    Signs are short, as there are hundreds: a changed value keeps its sign once in 64 times.
    """
    values = _values(_as_written(program, _NOT_SUMMED), ())
    return {keys: _SIGNS[int(_digest([keys, value])[:8], 16) % len(_SIGNS)] for keys, value in values}


def _values(value: Any, at: Keys) -> Iterator[tuple[Keys, Any]]:  # noqa: ANN401
    """The values that the file has on one line: plain values and lists of them, with their keys."""
    if isinstance(value, Mapping) and value:
        items: Iterable[tuple[str | int, Any]] = value.items()
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        items = enumerate(value)
    else:
        yield at, value
        return
    for key, item in items:
        yield from _values(item, (*at, key))


def _digest(value: Any) -> str:  # noqa: ANN401
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def new_program(workspace: Workspace, joints: tuple[str, ...], path: Path) -> Program:
    """A program without steps, to be saved at `path`."""
    relative = os.path.relpath(workspace.path, path.absolute().parent)
    return Program(workspace=relative, digest=workspace.digest, joints=joints, steps=())


def check_program(program: Program, path: Path, workspace: Workspace) -> None:
    """Raises InputError if a program was made for another workspace, or if either has changed since."""
    made_for = workspace_path(program, path)
    if made_for != workspace.path:
        message = f"this program was made for {made_for}, not for {workspace.path}"
        raise InputError(Problem("other-workspace", message, Place(path)))
    if program.digest != workspace.digest:
        raise InputError(stale(program, path, workspace))
    if any(flaws_in(program, workspace)):
        raise InputError(*_problems(read_yaml(path, keys=_KEYS), flaws_in(program, workspace)))
    check_unedited(program, path)


def check_unedited(program: Program, path: Path) -> None:
    """Raises InputError if a program was edited, with the first changed value.

    Only this tells computed figures from typed ones.
    """
    if program.checksum != _checksum(program):
        changed = (keys for (keys, is_), was in zip(_marks(program).items(), program.marks, strict=False) if is_ != was)
        message = "this program is not as sqrp wrote it, so what it says need not be true of its motion"
        mend = _again(program, path)
        raise InputError(read_yaml(path).problem("edited-program", next(changed, ("checksum",)), message, mend))


def workspace_path(program: Program, path: Path) -> Path:
    """The workspace file of a program at `path`."""
    return Path(os.path.normpath(path.absolute().parent / program.workspace))


def stale(program: Program, path: Path, workspace: Workspace) -> Problem:
    """The problem of a program with a changed workspace, with the commands that make its steps again."""
    message = f"the workspace `{workspace.name}` has changed since this program was written, so it no longer holds"
    return Problem("stale-program", message, Place(path), mend=_again(program, path))


def _again(program: Program, path: Path) -> str:
    """The commands that make a program again."""
    tasks, workspace = [step.own_task for step in program.steps] or ["TASK"], workspace_path(program, path).parent
    again = (f"sqrp rank {_quoted(workspace)} {_quoted(task)} --program {_quoted(path)}" for task in tasks)
    return " && ".join([f"rm {_quoted(path)}", *again])


def _quoted(word: object) -> str:
    return shlex.quote(str(word))


class _Dumper(yaml.SafeDumper):
    """Lists of plain values on one line, everything else in blocks."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ANN401
        plain = not any(isinstance(item, Mapping) for item in sequence)
        return super().represent_sequence(tag, sequence, flow_style=plain if flow_style is None else flow_style)

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ANN401, ARG002
        """No aliases: they would be refused, or surprise readers of the file."""
        return True
