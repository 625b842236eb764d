"""What `sqrp rules` prints."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import groupby

from rich.text import Text

from sqrp_cli.checks.registry import Rule
from sqrp_cli.terminal.console import SEVERITY_STYLES, Column, plain, print_table, say, say_line


def print_rules(rules: Iterable[Rule]) -> None:
    """A row for each finding, a table for each subject."""
    for number, (subject, group) in enumerate(groupby(rules, key=lambda rule: rule.subject)):
        if number:
            say()
        rows = [(rule.code, _severity(rule.severity), rule.meaning) for rule in group]
        print_table([Column(subject), Column("severity"), Column("looks for", shrink=True)], rows)
    say("\nOne of them in full, with examples: sqrp rules CODE")


def print_rule(rule: Rule) -> None:
    """One finding in full."""
    say_line(f"{rule.code} ({rule.severity}): {rule.subject}", "bold")
    say(rule.meaning)
    say(rule.why)
    of = f" in {rule.file}" if rule.file else ""
    for title, example in (("Passes", rule.passes), ("Fails", rule.fails)):
        say(f"\n{title}{of}:")
        for line in example.splitlines():
            say_line(f"  {line}")


def _severity(severity: str) -> Text:
    return plain("either" if " " in severity else severity, SEVERITY_STYLES[severity.split()[-1]])
