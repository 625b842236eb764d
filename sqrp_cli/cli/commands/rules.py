"""`sqrp rules`: what each finding means."""

from __future__ import annotations

from typing import Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import Command, argument
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import answer
from sqrp_cli.errors import ExitCode

NAME = "rules"


class RulesCommand(requests.Printed, Command):
    """List all findings: their codes, what each looks for, and why.

    With CODE, show one finding in full, with an example that passes and one that fails.
    """

    code: str | None = argument(
        "CODE",
        "A finding, such as wrong-unit; all of them unless given.",
        values.text("a code"),
        default=None,
        complete="codes",
    )


def show_rules(_context: Any, ask: RulesCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Print findings."""
    from sqrp_cli.checks.registry import rule_of, rules
    from sqrp_cli.show.documents.checks import RulesDocument

    chosen = list(rules().values()) if ask.code is None else [rule_of(ask.code)]
    answer(RulesDocument(rules=chosen), as_json=ask.json)
    return ExitCode.OK


command = command_of(RulesCommand, show_rules)
