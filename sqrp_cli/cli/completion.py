"""What the shell proposes while a command is typed: tasks, candidates, cameras, codes and names.

Each function is called with what stands before the word and the word as far as it is typed. Nothing is proposed where
a workspace or task cannot be read: a shell has no place for messages.
"""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Sequence
from contextlib import redirect_stdout, suppress
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sqrp_cli.errors import InputError, bad_option, expected_names

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import Workspace

ASKED = "_SQRP_COMPLETE"  # environment variable with which a shell asks for proposals
MOST = 500  # most proposals


def propose(app: typer.Typer) -> None:
    """Print what a shell asks for in its environment variables."""
    # Typer knows neither escaped blanks nor open quotes. Bash quotes no proposal itself, if the word does not begin so.
    if "COMP_WORDS" in os.environ:
        words = os.environ["COMP_WORDS"].split("\n")
        os.environ["COMP_WORDS"] = "\n".join(shlex.join(_words(word)[0]) for word in words)
        quoted = words[min(int(os.environ["COMP_CWORD"]), len(words) - 1)][:1] in ('"', "'")
    else:
        line, quoted = os.environ.get("_TYPER_COMPLETE_ARGS", ""), True
        found, is_open = _words(line)
        ended = line.endswith(" ") and not line.endswith("\\ ") and not is_open
        os.environ["_TYPER_COMPLETE_ARGS"] = shlex.join(found) + " " * ended
    with redirect_stdout(StringIO()) as proposals, suppress(SystemExit):
        app(prog_name="sqrp")
    lines = [line for line in proposals.getvalue().splitlines() if line]
    if not quoted and any(shlex.quote(line) != line for line in lines):  # all, so that they begin alike
        lines = ["'" + line.replace("'", "'\"'\"'") + "'" for line in lines]
    if lines:
        typer.echo("\n".join(lines))


def for_named_shell(words: Sequence[str]) -> bool:
    """Show or install what a shell needs to complete commands, if one is named: `--show-completion zsh`.

    Typer's own options take no name: they act for the shell that runs, whatever follows them. words: of a command line.
    Returns whether it is such a one. Raises InputError for a shell that is not known.
    """
    asked = re.fullmatch(r"(--(?:show|install)-completion)[= ](.*)", " ".join(words), re.DOTALL)
    if asked is None:
        return False
    from typer.completion import Shells, get_completion_script, install  # type: ignore[attr-defined]

    option, named = asked.groups()
    if named not in set(Shells):
        raise bad_option(f"{option} is `{named}`; {expected_names(named, Shells)}")
    if option == "--show-completion":
        typer.echo(get_completion_script(prog_name="sqrp", complete_var=ASKED, shell=named))
    else:
        _, path = install(named, "sqrp", ASKED)
        typer.echo(f"{named} completion is in {path}; restart the terminal to use it")
    return True


def _words(line: str) -> tuple[list[str], bool]:
    """The words of a line, and whether it ends within quotes."""
    for end in ("", '"', "'"):
        with suppress(ValueError):
            return shlex.split(line + end), bool(end)
    return line.split(), False


def tasks(ctx: typer.Context, incomplete: str) -> list[str]:
    """Tasks that go on as typed: the workspace's own, or one more word of a task."""
    from sqrp_cli.task.task import longer_tasks

    known = _workspace(ctx.params.get("workspace"))
    listed = (*(one.task for one in known.tasks), *longer_tasks(incomplete, known)) if known else ()
    return _proposed(listed, incomplete)


def example_task(path: Path | None) -> str:
    """A task of the workspace at a path; empty without one that can be read."""
    from sqrp_cli.task.task import example_task

    workspace = _workspace(path)
    return example_task(workspace) if workspace else ""


def candidates(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the candidates of the command's task."""
    from sqrp_cli.task.task import read_task

    workspace = _workspace(ctx.params.get("workspace"))
    with suppress(InputError):
        if workspace:
            found = read_task(str(ctx.params.get("task")), workspace).candidates
            return _proposed(["best", *(one.name for one in found)], incomplete)
    return []


def cameras(ctx: typer.Context, incomplete: str) -> list[str]:
    """Names of the workspace's cameras."""
    workspace = _workspace(ctx.params.get("workspace"))
    return _proposed(workspace.cameras, incomplete) if workspace else []


def codes(incomplete: str) -> list[str]:
    """Codes of findings."""
    from sqrp_cli.checks.registry import rules

    return _proposed(rules(), incomplete)


def schemas(incomplete: str) -> list[str]:
    """Names of schemas."""
    from sqrp_cli.show.documents.schemas import NAMES

    return _proposed(NAMES, incomplete)


def _workspace(path: Path | None) -> Workspace | None:
    from sqrp_cli.ask.api.program import start_of
    from sqrp_cli.cell.load import load_workspace

    with suppress(InputError, OSError):
        return load_workspace(start_of(path, None)[0]) if path is not None else None
    return None


def _proposed(values: Iterable[str], typed: str) -> list[str]:
    """The values that begin as typed."""
    return list(islice(dict.fromkeys(value for value in values if value.startswith(typed)), MOST))
