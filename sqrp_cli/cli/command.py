"""Commands: the words of a line become a request, and their help names arguments as their neighbours do."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from contextvars import ContextVar
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from sqrp_cli.ask.request import NEEDED, Field, OptionWord, Request, Words
from sqrp_cli.cli import completion
from sqrp_cli.errors import ExitCode, bad_option

Command = Callable[..., ExitCode | None]  # None stands for OK
UsageError: Any = typer.BadParameter.__base__
"""What Typer raises for a command line that it cannot read; it names it nowhere else."""

COMMANDS = {
    "Start": "init check show",
    "Choose": "rank explain advise place studio",
    "Run": "program run audit",
    "Automate": "score diff",
    "More commands": "set schema rules cell calibrate",
}
"""As `--help` lists them: in groups, by what a user is about to do."""

FIRST = {
    "rank": "program choose by ways report",
    "explain": "choose all ways images step",
    "advise": "want kinds choose apply patch",
    "place": "cameras want survive patch report",
    "run": "sim robot fault record report",
    "score": "baseline save-baseline junit summary report",
    "diff": "allow json",
    "init": "robot urdf gripper recording",
}
"""The options that matter most, of commands with many."""

OPTIONS = {
    "Sampling": "samples dt tolerance calibration",
    "Computing": "jobs seed out resume cluster tls",
    "Output": "all report open images patch junit summary save-baseline log record frames watch json help",
}
"""Groups of all other options; those of none stand between."""
FEW = 9  # so many options need no groups


class GroupedCommands(TyperGroup):
    """The commands, listed in groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: ANN401 # its type has no public name
        """Write the groups of commands, then the options that all of them take."""
        width = max(map(len, self.commands))
        for title, names in COMMANDS.items():
            with formatter.section(title):
                formatter.write_dl([(name.ljust(width), self.commands[name].short_help) for name in names.split()])
        with formatter.section("Options"):
            formatter.write_dl([row for one in self.get_params(ctx) if (row := one.get_help_record(ctx))])


app = typer.Typer(
    name="sqrp",
    cls=GroupedCommands,
    help="How well will the cameras of a robot cell see what matters? Asked and answered before the robot moves.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 120},
)

line: ContextVar[list[str]] = ContextVar("line", default=[])  # noqa: B039 - never changed
"""The words of the command line that is executed."""


class ParsedCommand(TyperCommand):
    """A command whose help names arguments as its neighbours do: `WORKSPACE [TASK]`, without their Python types."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: ANN401 # its type has no public name
        """Read the words of the command; while they are typed, without an option whose value is still missing.

        An option whose value stands in brackets says `all` where none follows, not even a misspelt one. Raises
        InputError for another one without its value that would take the next option for it, and for an empty word where
        a path is expected, which would be the current folder.
        """
        params: list[Any] = self.get_params(ctx)
        alone = [one.opts[0] for one in params if re.fullmatch(r"\[.*\]", one.metavar or "")]
        for place in [place for place, word in enumerate(args, 1) if word in alone][::-1]:
            following = "".join(args[place : place + 1])
            if not following or following.startswith("-") or " " in following or Path(following).exists():
                args = [*args[:place], "all", *args[place:]]
        if ctx.resilient_parsing:
            return super().parse_args(ctx, args[:-1] if args and args[-1].startswith("-") else [*args])
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
        """Write the arguments, then the options: few in one list, of many the first few, then the rest in groups."""
        arguments, options = list[tuple[str, str]](), dict[str, tuple[str, str]]()
        for one in (one for one in list[Any](self.get_params(ctx)) if one.get_help_record(ctx) is not None):
            shown, help_ = one.get_help_record(ctx)
            if one.param_type_name == "argument":
                arguments.append((one.metavar or shown, help_))
            else:
                options[max(one.opts, key=len).lstrip("-")] = (shown, help_)
        width = min(30, max(len(shown) for shown, _ in options.values()))
        first = FIRST.get(self.name or "", "") if len(options) > FEW else " ".join(options)
        elsewhere = " ".join([first, *OPTIONS.values()]).split()
        others = " ".join(name for name in options if name not in elsewhere)
        sections = {"Arguments": arguments}
        for title, names in {"Options": first, "More options": others, **OPTIONS}.items():
            sections[title] = [options.pop(name) for name in names.split() if name in options]
        for title, rows in sections.items():
            if rows:
                with formatter.section(title):
                    formatter.write_dl([(shown.ljust(width), help_) for shown, help_ in rows])


def _each(value: Any) -> list[Any]:  # noqa: ANN401 # as above
    return list(value) if isinstance(value, (list, tuple)) else [value]


def command(name: str, record: type[Request] | None = None) -> Callable[[Command], Command]:
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

    def made(run: Command) -> Command:
        stated = {one.name: one.default for one in inspect.signature(run).parameters.values()}
        own = {name: one for name, one in stated.items() if isinstance(one, Field)}
        of_record = () if record is None else record.own_first
        asked: type[Request] = type("Asked", (record or Request,), dict(own))  # a field of its own goes first

        def called(**words: Any) -> ExitCode | None:  # noqa: ANN401 - by the words
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
        fields = [asked.fields[name] for name in dict.fromkeys([*own, *asked.fields])]
        arguments = [one for one in fields if any(word.is_argument for word in one.words)]
        options = [asked.fields[name] for name in dict.fromkeys([*of_record, *own])]
        ordered = [*arguments, *(one for one in options if one not in arguments)]
        parameters = [parameter(word, one) for one in ordered for word in one.words]
        called.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in parameters}
        called.__doc__ = run.__doc__ or (None if record is None else record.__doc__)
        first, _, _ = inspect.cleandoc(called.__doc__ or "").partition("\n\n")  # of `sqrp --help`, whole
        app.command(name, cls=ParsedCommand, short_help=first.replace("\n", " "))(called)
        return run

    return made
