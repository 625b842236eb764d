"""Golden files of the command line: `python -m tests.golden [NAME ...]` writes what commands print now.

A transcript (tests/cli/golden/*.txt) has sections, each of which begins with `== TITLE` in a new folder with a copy of
the cell `watch` and links to the shipped cells and to tests/cases. A line with `$` is a command: of `sqrp`
(`COLUMNS=40 sqrp ...`: in a terminal of another width; `> /dev/null`: without its stdout; `< FILE`: answers to its
questions), or one of `WORDS`; below it stand stdout (`|`), stderr (`!`) and an exit code other than 0 (`?`). A
document (*.json) has the figures of a command and a shipped cell, compared to 1e-9. Look at the difference before you
commit it.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import sqrp_cli
from sqrp_cli.errors import InputError
from sqrp_cli.show.terminal import progress_lines
from sqrp_cli.study.robustness import Calibration
from sqrp_cli.study.sampling import Adaptive, FixedCount
from tests.cells import ROOT, copied, edit, made_cell

FOLDER = ROOT / "tests" / "cli" / "golden"
PLACES = {sysconfig.get_path("purelib"): "SITE", str(ROOT): "ROOT"}
"""What paths of this machine are called."""

DOCUMENTS = {
    f"{command}-{cell}": (command, ROOT / "workspaces" / cell, *([task] if command == "rank" else []), "--json")
    for command in ("check", "rank", "score")
    for cell, task in {"tabletop": "pickup green", "screws": "pickup screw", "tower": "stack red green"}.items()
} | {
    "show-watch": ("show", ROOT / "tests" / "cases" / "watch", "--json"),
    "show-tabletop": ("show", ROOT / "workspaces" / "tabletop", "--json"),
    "explain-watch": (
        *("explain", ROOT / "tests" / "cases" / "watch", "watch object=turned,behind"),
        *("--all", "--samples", 3, "--json"),
    ),
}
"""Words of commands, by the name of the file that has their document."""


class Section(NamedTuple):
    """Commands that are run one after the other in one folder."""

    title: str
    commands: list[str]
    lines: list[str]
    """As the file has it, with what is printed."""


def sections(name: str) -> list[Section]:
    """Those of a transcript."""
    found: list[Section] = []
    for line in (FOLDER / f"{name}.txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("== "):
            found.append(Section(line[3:], [], []))
        if found and line:
            found[-1].lines.append(line)
            if line.startswith("$ "):
                found[-1].commands.append(line[2:])
    return found


WORDS: dict[str, Callable[..., Any]] = {
    "edit": edit,
    "write": lambda file, text, times="1": Path(file).write_text(int(times) * text, encoding="utf-8") and None,
    "join": lambda file, first, *parts: (
        Path(file).write_text(
            Path(first).read_text("utf-8") + "".join(int(n) * text for text, n in zip(*2 * [iter(parts)], strict=True)),
            encoding="utf-8",
        )
        and None
    ),
    "cat": lambda file: Path(file).read_text(encoding="utf-8"),
    "grep": lambda text, file: "\n".join(line for line in Path(file).read_text("utf-8").splitlines() if text in line),
    "ls": lambda folder=".": "\n".join(sorted(one.name for one in Path(folder).iterdir() if not one.is_symlink())),
    "copy": lambda one, other: shutil.copytree(one, other) and None,
    "move": lambda one, other: Path(one).rename(other) and None,
    "mkdir": lambda folder: Path(folder).mkdir(),
    "link": lambda target, name: Path(name).symlink_to(target),
    "own": lambda cell, camera=None: copied(Path("own"), cell, camera) and None,
    "made": lambda cell: Path(cell).mkdir() or (made_cell(cell, Path(cell)) and None),
    "py": lambda expression: evaluated(expression),
    "sh": lambda script: run_by_shell(script),
}
"""What can be done with files; texts have `\\n` for the end of a line.

`join`: a file with texts after it, each so many times. `own`: a shipped cell to be changed, own/workspaces/CELL; with
the cameras before one. `made`: a cell of
tests/cases/made_cells.yaml. `py`: an expression of the Python interface.
`sh`: commands in processes of their own, by a shell.
"""


def run_by_shell(script: str) -> str:
    """What a shell prints of commands that run in processes of their own, and the exit code of the last."""
    own = 'sqrp() { "$PYTHON" -m sqrp_cli "$@"; }\n'
    variables = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "LINES", "TERM")}
    variables |= {"PYTHON": sys.executable, "COLUMNS": "80", "NO_COLOR": "1", "LC_ALL": "C.UTF-8"}
    variables |= {"PYTHONDONTWRITEBYTECODE": "1"}  # a full disk would leave half of it
    done = subprocess.run(["/bin/sh", "-c", own + script], env=variables, capture_output=True, timeout=120, check=False)
    code = [f"? {done.returncode}"] if done.returncode else []
    err = [f"! {line}" for line in done.stderr.decode().splitlines()]
    return "\n".join([*done.stdout.decode().splitlines(), *err, *code])


@cache
def interface() -> dict[str, Any]:
    """What expressions may name: all that the package has, kinds of sampling, and the tabletop as `cell`."""
    known = {one.__name__: one for one in (Adaptive, FixedCount, Calibration)}
    return {**vars(sqrp_cli), **known, "cell": sqrp_cli.open_cell(ROOT / "workspaces" / "tabletop")}


def evaluated(expression: str) -> str:
    """What a prompt shows of an expression, or the error that it raises."""
    try:
        found = eval(expression, interface())  # noqa: S307 - our own
    except (InputError, TypeError) as error:
        return f"{type(error).__name__}: {error}".encode(errors="replace").decode()
    return "" if found is None else repr(found)


def placeless(text: str) -> str:
    """A text that is the same on every machine, at every speed."""
    for path, name in PLACES.items():
        text = text.replace(path, name)
    return re.sub(r"^[\d.]+ s of wall time .*", "TIME", text, flags=re.MULTILINE)


def played(section: Section, folder: Path, sqrp: Callable[..., Any]) -> Iterator[str]:
    """The lines of a section as they are now; where a command is refused, every file must be as it was."""
    shutil.copytree(ROOT / "tests" / "cases" / "watch", folder / "watch")
    (folder / "workspaces").symlink_to(ROOT / "workspaces")
    (folder / "cases").symlink_to(ROOT / "tests" / "cases")

    def plain(text: str) -> list[str]:
        return placeless(text.replace(str(folder.resolve()), "FOLDER")).splitlines()

    def files() -> dict[Path, bytes]:
        return {one: one.read_bytes() for one in Path().rglob("*") if one.is_file() and not one.is_symlink()}

    yield f"== {section.title}"
    with contextlib.chdir(folder):
        for command in section.commands:
            yield f"$ {command}"
            columns, _, rest = command.rpartition(" sqrp ") if command.startswith("COLUMNS=") else ("", "", "")
            command = f"sqrp {rest}" if columns else command
            word, *words = [one.replace("\\n", "\n").replace("\\udcff", "\udcff") for one in shlex.split(command)]
            if word in WORDS:
                shown = WORDS[word](*words)
                yield from (f"| {line}".rstrip() for line in plain(shown or ""))
                continue
            quiet, answers = words[-2:] == [">", "/dev/null"], words[-1] if words[-2:-1] == ["<"] else None
            words = words[:-2] if quiet or answers else words
            assert word == "sqrp", f"{word} is none of sqrp, {', '.join(WORDS)}"
            before = files()
            stdin = io.StringIO("" if answers is None else Path(answers).read_text(encoding="utf-8"))
            # Nothing is told of progress, however long it takes.
            with mock.patch.object(progress_lines, "PERIOD", math.inf), mock.patch.object(sys, "stdin", stdin):
                outcome = sqrp(*words, columns=int(columns[8:] or 80))
            yield from (f"| {line}".rstrip() for line in plain("" if quiet else outcome.out))
            yield from (f"! {line}".rstrip() for line in plain(outcome.err))
            if outcome.code:
                yield f"? {outcome.code}"
            assert "Traceback" not in outcome.err
            assert outcome.code != 2 or outcome.out or "--junit" in words or files() == before, (
                f"{command} has changed files"
            )


def document(name: str, sqrp: Callable[..., Any]) -> Any:
    """What a command prints, with paths as they are everywhere."""
    return json.loads(placeless(sqrp(*DOCUMENTS[name]).out))


def differences(one: Any, other: Any, where: str = "") -> Iterator[str]:
    """Where documents differ; figures by more than 1e-9, relative to 1."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in {**one, **other}:
            yield from differences(one.get(key, "no field"), other.get(key, "no field"), f"{where}.{key}")
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for index, pair in enumerate(zip(one, other, strict=True)):
            yield from differences(*pair, f"{where}[{index}]")
    elif isinstance(one, float) and isinstance(other, int | float):
        if not math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9):
            yield f"{where}: {one} was {other}"
    elif type(one) is not type(other) or one != other:
        yield f"{where}: {one!r} was {other!r}"


def text_of(value: Any, depth: int = 3, indent: str = "") -> str:
    """JSON, its outer entries on lines of their own."""
    if depth == 0 or not isinstance(value, dict | list) or not value:
        return json.dumps(value, ensure_ascii=False)
    pairs = [(f"{json.dumps(key)}: ", one) for key, one in value.items()] if isinstance(value, dict) else [
        ("", one) for one in value]  # fmt: skip
    inner = ",\n".join(f"{indent} {key}{text_of(one, depth - 1, indent + ' ')}" for key, one in pairs)
    begin, end = "{}" if isinstance(value, dict) else "[]"
    return f"{begin}\n{inner}\n{indent}{end}"


def main(names: list[str]) -> None:
    """Write the files that are named, or all."""
    from tests.cli.conftest import _call

    for file in sorted(FOLDER.glob("*.txt")):
        if not names or file.stem in names:
            head, _, _ = file.read_text(encoding="utf-8").partition("== ")
            texts = []
            for section in sections(file.stem):
                with tempfile.TemporaryDirectory() as folder:
                    texts.append("\n".join(played(section, Path(folder), _call)))
            file.write_text(head + "\n\n".join(texts) + "\n", encoding="utf-8")
    for name in DOCUMENTS:
        if not names or name in names:
            (FOLDER / f"{name}.json").write_text(text_of(document(name, _call)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp()
    main(sys.argv[1:])
