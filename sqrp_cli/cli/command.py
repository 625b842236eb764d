"""How commands show what they take: arguments and options by the words of their metavars."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand

from sqrp_cli.ask.request import NEEDED, Field, OptionWord, Request
from sqrp_cli.cli import completion
from sqrp_cli.errors import ExitCode, bad_option

Asked = TypeVar("Asked", bound=Request)

UsageError: Any = typer.BadParameter.__base__
"""What Typer raises for a command line that it cannot read; it names it nowhere else."""


def command_of(record: type[Asked], run: Callable[[Any, Asked], ExitCode]) -> Callable[..., ExitCode]:
    """A function for Typer with an option for each word of a request; its help is the request's docstring.

    run: takes Typer's context and the request.
    """

    def parameter(word: OptionWord, one: Field) -> inspect.Parameter:
        shown: dict[str, Any] = {"metavar": word.flags if word.is_argument else word.metavar, "help": word.help}
        if word.complete is not None:
            shown["autocompletion"] = getattr(completion, word.complete)
        if word.is_argument and one.default is not NEEDED:
            shown["show_default"] = False
        made = typer.Argument(**shown) if word.is_argument else typer.Option(word.flags, **shown)
        single = len(one.words) == 1 and one.absent is None
        default = (
            one.default if single and (one.default is NEEDED or isinstance(one.default, bool | int | float)) else None
        )
        kind: Any = word.words if default is not None else word.words | None
        return inspect.Parameter(
            word.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, made]
        )

    def called(context: typer.Context, **words: Any) -> ExitCode:  # noqa: ANN401 - by the words
        return run(context, record.of_words(words))

    first = inspect.Parameter("context", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)
    said = [parameter(*one) for one in record.said()]
    called.__signature__ = inspect.Signature([first, *said])  # type: ignore[attr-defined]
    called.__annotations__ = {one.name: one.annotation for one in (first, *said)}
    called.__doc__ = record.__doc__
    return called


class ParsedCommand(TyperCommand):
    """A command whose help names arguments as its neighbours do: `WORKSPACE [TASK]`, without their Python types."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # its type has no public name
        """Read the words of the command; while they are typed, without an option whose value is still missing."""
        unfinished = ctx.resilient_parsing and args and args[-1].startswith("-")
        try:
            if not ctx.resilient_parsing:
                self._check_values(ctx, args)
            rest = super().parse_args(ctx, args[:-1] if unfinished else [*args])
        except UsageError as error:
            error.ctx = error.ctx or ctx  # an option without its value has none
            raise
        if not ctx.resilient_parsing:
            # Raises InputError for an empty word where a path is expected, which would be the current folder.
            words, *_ = self.make_parser(ctx).parse_args(list(args))
            params: list[Any] = self.get_params(ctx)
            for one in params:
                read = _each(ctx.params.get(one.name))
                if "" in _each(words.get(one.name)) and any(isinstance(value, Path) for value in read):
                    is_argument = one.param_type_name == "argument"
                    what, kind = (one.metavar, "") if is_argument else (one.opts[0], f" {one.metavar}")
                    raise bad_option(f"{what} is empty; expected{kind}: {one.help}")
        return rest

    def _check_values(self, ctx: Any, args: list[str]) -> None:  # noqa: ANN401 # as above
        """Raises InputError for an option without its value that would take the next option for it."""
        words, *_ = self.make_parser(ctx).parse_args(list(args))
        options: list[Any] = [one for one in self.get_params(ctx) if one.param_type_name == "option"]
        names = {name for one in options for name in (*one.opts, *one.secondary_opts)}
        for one in options:
            if names.intersection(value for value in _each(words.get(one.name)) if isinstance(value, str)):
                raise bad_option(f"{one.metavar} is missing after {one.opts[0]}: {one.help}")

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 # as above
        """The words after the command's name in its usage line."""
        shown = [_usage(one) for one in self.get_params(ctx) if one.param_type_name == "argument"]
        return [self.options_metavar or "", *shown]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 # as above
        """Write the sections of arguments and options."""
        sections: dict[str, list[tuple[str, str]]] = {"argument": [], "option": []}
        for one in self.get_params(ctx):
            record = one.get_help_record(ctx)
            if record is not None:
                name = one.metavar if one.param_type_name == "argument" else record[0]
                sections[one.param_type_name].append((name or record[0], record[1]))
        for kind, rows in sections.items():
            if rows:
                with formatter.section(f"{kind.capitalize()}s"):
                    formatter.write_dl(rows)


def _each(value: Any) -> list[Any]:  # noqa: ANN401 # as above
    return list(value) if isinstance(value, (list, tuple)) else [value]


def _usage(argument: Any) -> str:  # noqa: ANN401 # as above
    word = argument.metavar if argument.nargs == 1 or argument.metavar.endswith("...") else f"{argument.metavar}..."
    return word if argument.required else f"[{word}]"
