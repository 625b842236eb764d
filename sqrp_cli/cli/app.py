"""The commands, and the one place where errors become messages and exit codes."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from functools import cache
from shlex import quote
from typing import Any

import typer

from sqrp_cli import __version__
from sqrp_cli.cli.command import ParsedCommand, UsageError
from sqrp_cli.cli.commands import (
    advise,
    audit,
    calibrate,
    cell,
    check,
    diff,
    explain,
    init,
    place,
    program,
    rank,
    rules,
    schema,
    score,
    show,
    studio,
)
from sqrp_cli.cli.commands import run as run_program
from sqrp_cli.cli.commands import set as set_values
from sqrp_cli.cli.completion import ASKED, example_task, for_named_shell, propose
from sqrp_cli.cli.streams import ResultsLost
from sqrp_cli.cli.watch import EXECUTE
from sqrp_cli.errors import ExitCode, InputError, expected_names, nearest
from sqrp_cli.platform.interrupts import was_interrupted
from sqrp_cli.show.terminal import progress_lines
from sqrp_cli.show.terminal.progress_lines import Verbosity
from sqrp_cli.shown import harmless, one_line

app = typer.Typer(
    name="sqrp",
    help="How well will the cameras of a robot cell see what matters? Asked and answered before the robot moves.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

ANYWHERE = ("-q", "--quiet", "-v", "--verbose", "--debug")
"""Options that may stand before the command and after it."""

COMMANDS = (
    check, rank, explain, advise, place, program, run_program, cell, audit, calibrate, score, diff, show,
    set_values, studio, rules, schema, init,
)  # fmt: skip
"""In the order in which `--help` lists them."""

_NAMES = tuple(module.NAME for module in COMMANDS)

for module in COMMANDS:
    app.command(module.NAME, cls=getattr(module, "Parser", ParsedCommand))(module.command)


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
    verbose: bool = typer.Option(False, "-v", "--verbose", help="Say how long each step takes, too."),
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
    lines = progress_lines.wanted.set("--json" not in arguments)
    try:
        if for_named_shell([word for word in arguments if word not in ANYWHERE]):
            return ExitCode.OK
        # Calling `app` itself would take system errors for Ctrl-C or for a reader that has left.
        with _group().make_context("sqrp", _with_options_first(arguments), obj=arguments) as context:
            context.meta[EXECUTE] = execute
            return int(context.command.invoke(context) or ExitCode.OK)
    except typer.Exit as leaving:
        return leaving.exit_code
    except UsageError as error:
        _print_usage_error(error)
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
        if was_interrupted():
            raise KeyboardInterrupt from error
        if "--debug" in arguments:
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split())
        _print_error(f"internal error: {what}; run `sqrp --debug ...` for the traceback")
        return ExitCode.INTERNAL_ERROR
    finally:
        progress_lines.wanted.reset(lines)
        progress_lines.verbosity.set(Verbosity.NORMAL)


@cache
def _group() -> Any:  # noqa: ANN401 # has no public name
    """All commands as their parser: made once, as `--watch` and scripts run several in one process."""
    return typer.main.get_command(app)


def _with_options_first(arguments: Sequence[str]) -> list[str]:
    """The words of a command line, those before the command that may also come after it."""
    end = arguments.index("--") if "--" in arguments else len(arguments)
    moved = [word for word in arguments[:end] if word in ANYWHERE]
    return [*moved, *(word for word in arguments[:end] if word not in ANYWHERE), *arguments[end:]]


def _print_usage_error(error: Exception) -> None:
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    if message.startswith("Usage:"):  # no command at all
        typer.echo(message, err=True)
        return
    context = getattr(error, "ctx", None)
    told = _number_expected(error) or _value_expected(error, message, context) or _command_expected(message)
    told = told or _option_expected(message, context)
    told = told or _too_many(message, context) or message
    _print_error(f"error: {told}")
    if context is not None:
        _print_error(f"  to see what is expected: {context.command_path} --help")


def _command_expected(message: str) -> str:
    """The message about a word that is no command, with those that are; empty for any other message."""
    found = re.match(r"No such command '(.*?)'\.", message)
    return "" if found is None else f"there is no command `{found[1]}`; {expected_names(found[1], _NAMES)}"


def _option_expected(message: str, context: Any) -> str:  # noqa: ANN401 # has no public name
    """The message about an option that a command does not have; empty for any other message."""
    found = re.match(r"No such option: (\S+)", message)
    if found is None or context is None:
        return ""
    names = (name.lstrip("-") for one in context.command.params for name in (*one.opts, *one.secondary_opts))
    close = nearest(found[1].lstrip("-"), names)
    meant = f"; did you mean `--{close}`?" if close else ""
    return f"`{context.command_path}` has no option `{found[1]}`{meant}"


def _too_many(message: str, context: Any) -> str:  # noqa: ANN401 # has no public name
    """The message about words that are more than a command takes, mostly of a task without quotes; else empty."""
    found = re.match(r"Got unexpected extra argument.* \((.*)\)", message)
    if found is None:
        return ""
    task = context.params.get("task")
    command = f"{context.command_path} {quote(str(context.params.get('workspace')))}"
    hint = f'; put the task in quotes: `{command} "{task} {found[1]}"`' if isinstance(task, str) else ""
    return f"found `{found[1]}`, which is more than `{context.command_path}` takes{hint}"


def _value_expected(error: Exception, message: str, context: Any) -> str:  # noqa: ANN401 # has no public name
    """What an argument that is missing, or an option without its value, should be; empty for any other error."""
    asked: Any = getattr(error, "param", None)
    if message.startswith("Missing ") and asked is not None:
        found = f"{asked.metavar} is missing"
        if asked.metavar == "TASK" and (example := example_task(context.params.get("workspace"))):
            return f'{found}, such as "{example}"'
    elif message.endswith("requires an argument."):
        name = getattr(error, "option_name", "")
        asked = next(one for one in context.command.params if name in one.opts)
        found = f"{asked.metavar} is missing after {name}"
    else:
        return ""
    return f"{found}: {asked.help}"


def _number_expected(error: Exception) -> str:
    """What is wrong with the number of an option, in the words of other errors; empty for any other error."""
    option, cause = getattr(error, "param", None), error.__cause__
    if option is None or cause is None or not hasattr(cause, "errors"):
        return ""
    found = cause.errors()[0]
    kind = {"int": "a whole number", "float": "a number"}.get(found["type"].partition("_")[0])
    least, most = getattr(option, "min", None), getattr(option, "max", None)
    if kind is None and least is None:
        return ""
    kind = kind or ("a number" if isinstance(least, float) else "a whole number")
    given = found["input"] if found["type"].startswith(("greater", "less")) else f"`{found['input']}`"
    upto = "" if least is None else f" from {least:g} on" if most is None else f" from {least:g} to {most:,}"
    return f"{option.opts[0]} is {given}, expected {kind}{upto}"


def _print_error(line: str) -> None:
    typer.echo(harmless(one_line(line)), err=True)
