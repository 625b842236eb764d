"""The commands, and the one place where errors become messages and exit codes."""

from __future__ import annotations

import typer

from sqrp_cli import __version__
from sqrp_cli.cli import audit, check, diff, explain, init, program, rank, schema, score, show
from sqrp_cli.cli import run as run_program
from sqrp_cli.errors import ExitCode, InputError

UsageError: type[Exception] = typer.BadParameter.__base__  # type: ignore[assignment] # typer names it nowhere else

app = typer.Typer(
    name="sqrp",
    help="How well will the cameras of a robot cell see what matters? Asked and answered before the robot moves.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

for module in (check, rank, explain, program, run_program, audit, score, diff, show, schema, init):
    app.command(module.NAME)(module.command)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"sqrp {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: bool = typer.Option(False, "--version", help="Print the version.", is_eager=True, callback=_print_version),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an internal error."),
) -> None:
    """Options that go before the command."""


def execute(arguments: list[str]) -> int:
    """Run a command; returns its exit code. Every error but Ctrl-C ends up here.

    Raises KeyboardInterrupt at a Ctrl-C that the command has not told about itself.
    """
    try:
        result = app(arguments, prog_name="sqrp", standalone_mode=False, obj=arguments)
        if result == ExitCode.INTERRUPTED and not isinstance(result, ExitCode):
            raise KeyboardInterrupt  # of which typer has made a number
        return int(result or ExitCode.OK)
    except typer.Exit as leaving:
        return leaving.exit_code
    except UsageError as error:
        _print_usage_error(error)
        return ExitCode.BAD_INPUT
    except InputError as error:
        from sqrp_cli.terminal.console import print_problems

        print_problems(error.problems)
        return ExitCode.BAD_INPUT
    except typer.Abort as error:  # what other versions of typer make of it
        raise KeyboardInterrupt from error
    except OSError as error:
        where = error.filename or "the output cannot be written"  # files that are read have a name
        typer.echo(f"error: {where}: {error.strerror or error}", err=True)
        return ExitCode.BAD_INPUT
    except Exception as error:
        if "--debug" in arguments:
            raise
        what = " ".join(f"{type(error).__name__}: {error}".split())
        typer.echo(f"internal error: {what}; run `sqrp --debug ...` for the traceback", err=True)
        return ExitCode.INTERNAL_ERROR


def _print_usage_error(error: Exception) -> None:
    message = error.format_message() if hasattr(error, "format_message") else str(error)
    if message.startswith("Usage:"):  # no command at all
        typer.echo(message, err=True)
        return
    typer.echo(f"error: {message}", err=True)
    context = getattr(error, "ctx", None)
    if context is not None:
        typer.echo(f"  to see what is expected: {context.command_path} --help", err=True)
