"""What several commands do: open what they are about, refuse options that go ill together, print and write answers."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.program import OpenProgram
from sqrp_cli.cli.command import line
from sqrp_cli.cli.watch import is_shown_again, last_shown
from sqrp_cli.document import Document
from sqrp_cli.errors import InputError, Place, Problem, bad_input, bad_option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence


def write_patch(path: Path, begin: str, patch: str) -> None:
    """Write a patch that a command found; begin: what it is, in a line that `patch` and `git apply` skip."""
    from sqrp_cli.platform.files import write_atomically

    write_atomically(path, f"# {begin}\n{patch}")


_OWN = {
    "--patch": ("patch of `sqrp ", rb"# [^\n]* `sqrp "),  # and which command it is
    "--report": ("page", rb"<!doctype html>"),
    "--save-baseline": ("baseline", rb'\{\s*"format": "sqrp baseline'),
    "--junit": ("JUnit file of `sqrp score`", rb'<\?xml [^>]*>\s*<testsuites name="sqrp score"'),
    "--summary": ("summary of scores", rb"## SQRP: "),
    "--log": ("log of a run", rb'\{"t": [^,]*, "event": "run"'),
    "--record": ("film or recording", rb"....ftyp|\x89MCAP|#ROSBAG"),
    "--export": ("exported trajectory", rb"time,|# trajectory_msgs/|\x89MCAP|#ROSBAG"),
}
"""By the options that write files: what those are, and how they begin."""


def check_outputs(outputs: Mapping[str, Path | None]) -> None:
    """Raises InputError, before anything is computed, for files, by their options, that cannot be written.

    Nor is one that is there already and that something else wrote, or is none of these: it is left as it is.
    """
    from sqrp_cli.platform.files import check_distinct, check_writable

    check_distinct(outputs)
    for option, path in outputs.items():
        if path is None:
            continue
        check_writable(path)
        if option in _OWN and path.is_file():
            what, begin = _OWN[option]
            if option == "--patch":  # those of other commands stay, too
                command = next(word for word in line.get() if not word.startswith("-"))
                what, begin = f"{what}{command}`", begin + command.encode() + rb"\b"
            with path.open("rb") as file:
                first = file.read(1000)
            if (first or option == "--patch") and re.match(begin, first, re.DOTALL) is None:
                message = f"this file is there already and is no {what}, so it is not overwritten"
                raise bad_input("would-overwrite", message, Place(path), mend=f"choose another name: {option} FILE")
        if option == "--report":
            from sqrp_cli.show.pages.assembly import check_libraries

            check_libraries()


def open_with_warnings(path: Path, seed: int = 0) -> OpenCell:
    """Open a workspace and print its warnings. Raises InputError where `sqrp check` finds errors in it."""
    cell = OpenCell.read(path, seed)
    print_warnings(cell.findings)
    return cell


def open_to_write(
    workspace: Path, seed: int, read: Iterable[Path | None], outputs: Mapping[str, Path | None]
) -> OpenCell:
    """As `open_with_warnings`, once outputs are checked, which no input may be. read: inputs besides the workspace."""
    from sqrp_cli.platform.files import check_not_read

    check_outputs(outputs)
    cell = open_with_warnings(workspace, seed)
    check_not_read(outputs.values(), [*read, *cell.files])
    return cell


def read_program(path: Path, seed: int = 0, *, check: bool = True) -> OpenProgram:
    """Open a program and print warnings of its workspace. check: whether it must fit that as it is now."""
    program = OpenProgram.read(path, seed)
    print_warnings(program.cell.findings)
    if check:
        program.check()
    return program


def print_warnings(findings: Sequence[Problem]) -> None:
    """Print the warnings among findings. Raises InputError with the errors, if there are any."""
    from sqrp_cli.show.terminal.console import print_problems

    print_problems(problem for problem in findings if problem.severity != "error")
    if errors := [problem for problem in findings if problem.severity == "error"]:
        raise InputError(*errors)


def check_needed(what: str, there: object, about: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that are about something which is not there, such as `--vary`."""
    if not there:
        for name in _given(about):
            raise bad_option(f"{name} is about {what}, which is missing")


def check_excluded(option: str, there: object, others: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that exclude one, if that is there."""
    if there:
        for name in _given(others):
            raise bad_option(f"{option} and {name} exclude each other; give one of them")


def _given(options: Mapping[str, object]) -> list[str]:
    """The names of the options that a command line gives, of some with their values; a 0 is given, too."""
    return [name for name, value in options.items() if value or (value == 0 and value is not False)]


def answer(result: Document, *, as_json: bool, **how: bool) -> None:
    """Print a result, for people or as a document; how: see `Document.show`."""
    from sqrp_cli.show.terminal.console import say_raw

    if as_json:
        say_raw(result.to_json())
    elif not is_shown_again(result):
        result.show(**how)


def page_is_written(file: Path | None, write: Callable[..., None], **how: object) -> bool:
    """Write a page, if one is wanted, and show it or say where it is; returns False if Ctrl-C came first.

    write: takes the file, and the words of the command line, which the page shows. how: what else it takes.
    """
    from sqrp_cli.show.terminal.console import note

    if file is None:
        return True
    try:
        write(file, arguments=line.get(), **how)
    except KeyboardInterrupt:
        note(f"interrupted before {file} was written")
        return False
    if "--open" in line.get() and not last_shown.get():  # once for all
        import webbrowser

        if webbrowser.open(file.absolute().as_uri()):
            return True
    note(f"open {file} in a browser")
    return True
