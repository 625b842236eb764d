"""The commands, and the one place where errors become messages and exit codes."""

from __future__ import annotations

import os
import re
from functools import cache
from pathlib import Path
from shlex import quote
from typing import Any

import typer

from sqrp_cli import __version__
from sqrp_cli.cli import watch
from sqrp_cli.cli.command import UsageError, app, line
from sqrp_cli.cli.commands import programs, runs, scores, tasks, workspaces  # noqa: F401 - each adds its commands
from sqrp_cli.cli.completion import ASKED, example_task, for_named_shell, propose
from sqrp_cli.cli.streams import ResultsLost
from sqrp_cli.errors import ExitCode, InputError, expected_names, nearest
from sqrp_cli.platform.interrupts import pressed
from sqrp_cli.show.terminal import progress_lines
from sqrp_cli.show.terminal.progress_lines import Verbosity
from sqrp_cli.shown import harmless, one_line

ANYWHERE = ("-q", "--quiet", "-v", "--verbose", "--debug")  # options that may stand before the command and after it


FIRST_STEPS = """\
How well will the cameras of a robot cell see what matters?

{shipped}  sqrp init mycell                               a new cell; --robot NAME: yours
  sqrp check mycell                              after a change of its workspace.yaml
  sqrp rank mycell "pickup green"                which part is seen best; what is not
  sqrp explain mycell "pickup green"             when, by which camera, and why not
  sqrp studio mycell                             all of that live, in a browser
  sqrp help                                      all commands; sqrp help rank: one"""
SHIPPED = '  sqrp rank workspaces/tabletop "pickup green"   a cell that comes with SQRP\n'  # where there is a clone


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sqrp {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: bool = typer.Option(  # noqa: ARG001 - its callback
        False, "-V", "--version", help="Print the version.", is_eager=True, callback=_print_version
    ),
    quiet: bool = typer.Option(False, "-q", "--quiet", help="Only results and errors: no warnings, notes or progress."),
    verbose: bool = typer.Option(
        False, "-v", "--verbose", help="Say more: how exact figures are, and how long each step takes."
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an internal error."),  # noqa: ARG001 - in `execute`
) -> None:
    """Options of every command, before it or after it."""
    chosen = Verbosity.QUIET if quiet else Verbosity.VERBOSE if verbose else Verbosity.NORMAL
    progress_lines.verbosity.set(chosen)


def execute(arguments: list[str]) -> int:
    """Run a command; returns its exit code. Handles every error but Ctrl-C and results that cannot be written.

    Raises KeyboardInterrupt at a Ctrl-C that the command has not reported itself, and ResultsLost.
    """
    if ASKED in os.environ:
        propose(app)
        return ExitCode.OK
    lines, told = progress_lines.lines_wanted.set("--json" not in arguments), line.set(arguments)
    running = watch.execute.set(execute)
    try:
        if for_named_shell([word for word in arguments if word not in ANYWHERE]):
            return ExitCode.OK
        # Calling `app` itself would take system errors for Ctrl-C or for a reader that has left.
        end = arguments.index("--") if "--" in arguments else len(arguments)
        first = [word for word in arguments[:end] if word in ANYWHERE]
        rest = [word for word in arguments[:end] if word not in ANYWHERE]
        if not [*rest, *arguments[end + 1 :]]:
            typer.echo(FIRST_STEPS.format(shipped=SHIPPED * Path("workspaces/tabletop").is_dir()))
            return ExitCode.OK
        if rest[:1] == ["help"]:
            rest = [*rest[1:], "--help"]
        with _group().make_context("sqrp", [*first, *rest, *arguments[end:]]) as context:
            return int(context.command.invoke(context) or ExitCode.OK)
    except typer.Exit as leaving:
        return leaving.exit_code
    except UsageError as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        _print_error(f"error: {_in_own_words(error, message)}")
        if (context := getattr(error, "ctx", None)) is not None:
            _print_error(f"  to see what is expected: {context.command_path} --help")
        return ExitCode.BAD_INPUT
    except InputError as error:
        from sqrp_cli.show.terminal.console import print_problems

        print_problems(error.problems)
        return ExitCode.BAD_INPUT
    except ResultsLost:
        raise
    except MemoryError:
        _print_error("error: there is not enough memory")
        return ExitCode.BAD_INPUT
    except OSError as error:
        where = error.filename or "the system refused an operation"  # files have a name
        _print_error(f"error: {where}: {error.strerror or error}")
        return ExitCode.BAD_INPUT
    except Exception as error:
        if pressed:
            raise KeyboardInterrupt from error
        if "--debug" in arguments:
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split())
        _print_error(f"internal error: {what}; run `sqrp --debug ...` for the traceback")
        return ExitCode.INTERNAL_ERROR
    finally:
        watch.execute.reset(running)
        line.reset(told)
        progress_lines.lines_wanted.reset(lines)
        progress_lines.verbosity.set(Verbosity.NORMAL)


@cache
def _group() -> Any:  # noqa: ANN401 # has no public name
    """All commands as their parser: made once, as `--watch` and scripts run several in one process."""
    return typer.main.get_command(app)


def _in_own_words(error: Exception, message: str) -> str:
    """What is wrong with a command line, in the words of other errors."""
    context: Any = getattr(error, "ctx", None)
    asked: Any = getattr(error, "param", None)
    cause: Any = error.__cause__
    if asked is not None and hasattr(cause, "errors"):
        found = cause.errors()[0]
        kind = {"int": "a whole number", "float": "a number"}.get(found["type"].partition("_")[0])
        if kind is not None:
            return f"{asked.opts[0]} is `{found['input']}`, expected {kind}"
    if message.startswith("Missing ") and asked is not None:
        missing, example = f"{asked.metavar} is missing", ""
        if asked.metavar == "TASK":
            example = example_task(context.params.get("workspace"))
        return f'{missing}, such as "{example}"' if example else f"{missing}: {asked.help}"
    if message.endswith("requires an argument."):
        name = getattr(error, "option_name", "")
        asked = next(one for one in context.command.params if name in one.opts)
        return f"{asked.metavar} is missing after {name}: {asked.help}"
    if match := re.match(r"No such command '(.*?)'\.", message):
        return f"there is no command `{match[1]}`; {expected_names(match[1], _group().commands)}"
    if context is not None and (match := re.match(r"No such option: (\S+)", message)):
        names = (name.lstrip("-") for one in context.command.params for name in (*one.opts, *one.secondary_opts))
        close = nearest(match[1].lstrip("-"), names)
        meant = f"; did you mean `--{close}`?" if close else ""
        return f"`{context.command_path}` has no option `{match[1]}`{meant}"
    if match := re.match(r"Got unexpected extra argument.* \((.*)\)", message):  # mostly of a task without quotes
        task = context.params.get("task")
        command = f"{context.command_path} {quote(str(context.params.get('workspace')))}"
        hint = f'; put the task in quotes: `{command} "{task} {match[1]}"`' if isinstance(task, str) else ""
        return f"found `{match[1]}`, which is more than `{context.command_path}` takes{hint}"
    return message


def _print_error(line: str) -> None:
    typer.echo(harmless(one_line(line)), err=True)
