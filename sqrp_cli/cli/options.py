"""What several commands do: open what they are about, refuse options that go ill together, print and write answers."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.program import OpenProgram
from sqrp_cli.cli.command import line
from sqrp_cli.document import Document
from sqrp_cli.errors import InputError, Place, Problem, bad_option
from sqrp_cli.platform.memory import keep_all_so_far

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping


class Patches(NamedTuple):
    """The patches that a command writes."""

    mark: str
    """How they begin; `patch` and `git apply` skip it. Only files that begin so are overwritten."""
    whose: str  # as messages call them

    def check(self, path: Path) -> None:
        """Raises InputError for a file that cannot be written, or that exists and is no such patch."""
        from sqrp_cli.platform.files import check_writable

        check_writable(path)
        check_own(path, self.mark, f"patch {self.whose}", "choose another name: --patch FILE")

    def write(self, path: Path, patch: str) -> None:
        """Write one."""
        from sqrp_cli.platform.files import write_atomically

        write_atomically(path, f"{self.mark}\n{patch}")


def check_own(path: Path, mark: str, what: str, mend: str = "choose another name") -> None:
    """Raises InputError for a file that exists and does not begin with a mark, so that it is no `what` of ours."""
    if path.is_file():
        with path.open("rb") as file:
            own = file.read(len(mark)) == mark.encode()
        if not own:
            message = f"this file is there already and is no {what}; it was left as it is"
            raise InputError(Problem("would-overwrite", message, Place(path), mend=mend))


def open_with_warnings(path: Path, seed: int = 0) -> OpenCell:
    """Open a workspace and print its warnings. Raises InputError where `sqrp check` finds errors in it."""
    cell = OpenCell.read(path, seed)
    keep_all_so_far()
    _print_warnings(cell)
    return cell


def open_to_write(
    workspace: Path,
    seed: int,
    read: Iterable[Path | None],
    *,
    report: Path | None,
    patch: Path | None = None,
    patches: Patches | None = None,
) -> OpenCell:
    """As `open_with_warnings`; raises InputError, before anything is computed, for files that cannot be written, too.

    read: other files that the command reads. report, patch: the files that it writes. patches: what the patch is.
    """
    from sqrp_cli.platform.files import check_distinct, check_not_read

    check_distinct({"--patch": patch, "--report": report})
    if patch is not None and patches is not None:
        patches.check(patch)
    if report is not None:
        check_report(report)
    cell = open_with_warnings(workspace, seed)
    check_not_read([patch, report], [*read, *cell.files])
    return cell


def read_program(path: Path, seed: int = 0) -> OpenProgram:
    """Read a program that may no longer fit its workspace, and print the warnings about that."""
    program = OpenProgram.read(path, seed)
    keep_all_so_far()
    _print_warnings(program.cell)
    return program


def program_with_warnings(path: Path, seed: int = 0) -> OpenProgram:
    """Open a program and print the warnings about its workspace. Raises InputError where it cannot be run."""
    program = read_program(path, seed)
    program.check()
    return program


def _print_warnings(cell: OpenCell) -> None:
    """Raises InputError with the errors, if there are any."""
    from sqrp_cli.show.terminal.console import print_problems

    print_problems(problem for problem in cell.findings if problem.severity != "error")
    if cell.errors:
        raise InputError(*cell.errors)


def check_needed(what: str, there: object, about: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that are about something which is not there, such as `--vary`."""
    for name, value in about.items():
        if _is_given(value) and not _is_given(there):
            raise bad_option(f"{name} is about {what}, which is missing")


def check_excluded(option: str, others: Mapping[str, object]) -> None:
    """Raises InputError for options, by name, that exclude one which is given."""
    for name, value in others.items():
        if _is_given(value):
            raise bad_option(f"{option} and {name} exclude each other; give one of them")


def _is_given(value: object) -> bool:
    return value is not None and value is not False and value not in ("", (), [], {})


def check_report(path: Path) -> None:
    """Raises InputError, before anything is computed, where a page cannot be written or a library is missing."""
    from sqrp_cli.platform.files import check_writable
    from sqrp_cli.show.pages.assembly import check_libraries

    check_writable(path)
    check_libraries()


def answer(result: Document, *, as_json: bool, **how: bool) -> None:
    """Print a result, for people or as a document; how: see `Document.show`."""
    from sqrp_cli.cli.watch import is_shown_again
    from sqrp_cli.show.terminal.console import say_raw

    if as_json:
        say_raw(result.to_json())
    elif not is_shown_again(result):
        result.show(**how)


def page_is_written(file: Path, write: Callable[..., None], **how: object) -> bool:
    """Write a page, and say where it is; returns False if Ctrl-C came first.

    write: takes the file, and the words of the command line, which the page shows. how: what else it takes.
    """
    from sqrp_cli.show.terminal.console import note

    try:
        write(file, arguments=line.get(), **how)
    except KeyboardInterrupt:
        note(f"interrupted before {file} was written")
        return False
    note(f"open {file} in a browser")
    return True


def note_late(text: str) -> None:
    """Print a line about what a run waits for; loads the console only then."""
    from sqrp_cli.show.terminal.console import note

    note(text)
