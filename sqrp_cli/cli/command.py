"""Commands: the words of a line become a request, and their help names arguments as their neighbours do."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from sqrp_cli.ask.request import NEEDED, Field, OptionWord, Request, Words
from sqrp_cli.cli import completion
from sqrp_cli.errors import ExitCode, bad_option

UsageError: Any = typer.BadParameter.__base__
"""What Typer raises for a command line that it cannot read; it names it nowhere else."""

app = typer.Typer(
    name="sqrp",
    help="How well will the cameras of a robot cell see what matters? Asked and answered before the robot moves.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

line: ContextVar[list[str]] = ContextVar("line", default=[])  # noqa: B039 - never changed
"""The words of the command line that is executed."""


class ParsedCommand(TyperCommand):
    """A command whose help names arguments as its neighbours do: `WORKSPACE [TASK]`, without their Python types."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # its type has no public name
        """Read the words of the command; while they are typed, without an option whose value is still missing.

        Raises InputError for an option without its value that would take the next option for it, and for an empty word
        where a path is expected, which would be the current folder.
        """
        if ctx.resilient_parsing:
            return super().parse_args(ctx, args[:-1] if args and args[-1].startswith("-") else [*args])
        params: list[Any] = self.get_params(ctx)
        try:
            words, *_ = self.make_parser(ctx).parse_args(list(args))
            options = [one for one in params if one.param_type_name == "option"]
            names = {name for one in options for name in (*one.opts, *one.secondary_opts)}
            for one in options:
                if names.intersection(value for value in _each(words.get(one.name)) if isinstance(value, str)):
                    raise bad_option(f"{one.metavar} is missing after {one.opts[0]}: {one.help}")
            rest = super().parse_args(ctx, [*args])
        except UsageError as error:
            error.ctx = error.ctx or ctx  # an option without its value has none
            raise
        for one in params:
            if "" in _each(words.get(one.name)) and any(isinstance(v, Path) for v in _each(ctx.params.get(one.name))):
                is_argument = one.param_type_name == "argument"
                what, kind = (one.metavar, "") if is_argument else (one.opts[0], f" {one.metavar}")
                raise bad_option(f"{what} is empty; expected{kind}: {one.help}")
        return rest

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: ANN401 # as above
        """The words after the command's name in its usage line."""
        shown, params = [self.options_metavar or ""], list[Any](self.get_params(ctx))
        for one in (one for one in params if one.param_type_name == "argument"):
            word = one.metavar if one.nargs == 1 or one.metavar.endswith("...") else f"{one.metavar}..."
            shown.append(word if one.required else f"[{word}]")
        return shown

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


def command(
    name: str, record: type[Request] | None = None, parser: type[ParsedCommand] = ParsedCommand
) -> Callable[[Callable[..., ExitCode]], Callable[..., ExitCode]]:
    """Makes a function a command: an option for each word of its request, and of what only a command line says.

    The function takes the request, if there is one, and by their names the values of the fields that are the defaults
    of its other parameters. Help is its docstring, or that of the request.
    """

    def parameter(word: OptionWord, one: Field) -> inspect.Parameter:
        shown: dict[str, Any] = {"metavar": word.flags if word.is_argument else word.value, "help": word.help}
        if word.complete is not None:
            shown["autocompletion"] = getattr(completion, word.complete)
        if word.is_argument and one.default is not NEEDED:
            shown["show_default"] = False
        made = typer.Argument(**shown) if word.is_argument else typer.Option(word.flags, **shown)
        stated = one.default is NEEDED or isinstance(one.default, bool | int | float)
        default = one.default if len(one.words) == 1 and one.absent is None and stated else None
        kind: Any = word.words if default is not None else word.words | None
        return inspect.Parameter(
            word.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, made]
        )

    def made(run: Callable[..., ExitCode]) -> Callable[..., ExitCode]:
        stated = {one.name: one.default for one in inspect.signature(run).parameters.values()}
        own = {name: one for name, one in stated.items() if isinstance(one, Field)}
        assert record is None or not own.keys() & record.fields, run  # noqa: S101 - a field has one name
        of_line: Any = type("OfLine", (Request,), dict(own))
        asked: type[Request] = of_line if record is None else type(record.__name__, (record, of_line), {})

        def called(**words: Any) -> ExitCode:  # noqa: ANN401 - by the words
            # The value of each word by its name is None or empty where it is not said.
            found: dict[str, Any] = {}
            for name, one in asked.fields.items():
                said = {word.name: words[word.name] for word in one.words if words[word.name] not in (None, [])}
                if said and (one.uses or len(one.words) > 1):
                    found[name] = Words(said | {used: words[used] for used in one.uses})
                elif said:
                    found[name] = next(iter(said.values()))
                elif one.absent is not None:
                    found[name] = one.absent()
            ask = asked(by_words=True, **found)
            return run(*([] if record is None else [ask]), **{name: getattr(ask, name) for name in own})

        # Arguments come first, then options, the record's own before those of its bases.
        arguments = [one for one in asked.fields.values() if any(word.is_argument for word in one.words)]
        options = [asked.fields[name] for name in asked.own_first if asked.fields[name] not in arguments]
        parameters = [parameter(word, one) for one in (*arguments, *options) for word in one.words]
        called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        called.__doc__ = run.__doc__ or (None if record is None else record.__doc__)
        first, _, _ = inspect.cleandoc(called.__doc__ or "").partition("\n\n")  # of `sqrp --help`, whole
        app.command(name, cls=parser, short_help=first.replace("\n", " "))(called)
        return run

    return made
