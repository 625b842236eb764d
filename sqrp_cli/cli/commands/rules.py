"""`sqrp rules`: what each finding means."""

from __future__ import annotations

from typing import Annotated

import typer

from sqrp_cli.cli import completion
from sqrp_cli.cli.options import Json
from sqrp_cli.errors import ExitCode
from sqrp_cli.report.documents.document import as_text

NAME = "rules"

Code = Annotated[
    str | None,
    typer.Argument(
        metavar="CODE",
        autocompletion=completion.codes,
        help="A finding, such as wrong-unit; all of them unless given.",
        show_default=False,
    ),
]


def command(code: Code = None, as_json: Json = False) -> ExitCode:
    """List all findings: their codes, what each looks for, and why.

    With CODE, show one finding in full, with an example that passes and one that fails.
    """
    from sqrp_cli.checks.registry import rule_of, rules

    chosen = list(rules().values()) if code is None else [rule_of(code)]
    if as_json:
        from sqrp_cli.report.documents.checks import RulesDocument
        from sqrp_cli.terminal.console import say_raw

        say_raw(as_text(RulesDocument(rules=chosen)))
        return ExitCode.OK
    from sqrp_cli.terminal.check_table import print_rule, print_rules

    if code is None:
        print_rules(chosen)
    else:
        print_rule(chosen[0])
    return ExitCode.OK
