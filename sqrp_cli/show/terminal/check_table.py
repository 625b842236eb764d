"""The output of `sqrp check` and `sqrp rules`: what can be done, why the rest cannot, and what each finding means."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from itertools import groupby

from rich.text import Text

from sqrp_cli.checks.registry import RuleEntry
from sqrp_cli.show.documents.checks import Check, PlannedStep, RulesDocument
from sqrp_cli.show.terminal.console import (
    SEVERITY_STYLES,
    Column,
    Share,
    plain,
    print_table,
    say,
    say_command,
    say_line,
)
from sqrp_cli.show.terminal.rank_table import MOST_ROWS, print_infeasible


def print_check(found: Check) -> None:
    """That a workspace is valid, and how to go on; of a task which candidates can be done, and why the others cannot.

    If nothing can be done at once, the steps to do first. Nothing where there are errors.
    """
    if not found.valid:
        return
    if found.task is None:
        count = len(found.problems)
        said = f"{count} warning{'s' if count > 1 else ''}" if count else "nothing to complain about"
        say(f"{found.workspace} is valid: {said}.")
        if found.example is not None and all(problem.code != "no-skills" for problem in found.problems):
            say_command("Try:", f"sqrp rank {shlex.quote(found.path)} {shlex.quote(found.example)}")
        return
    feasible = [one for one in found.candidates if one.feasible]
    at_once = " at once" if found.suggested and not feasible else ""
    count = len(found.candidates)
    say(f"{found.task} in {found.workspace}: {len(feasible)} of {count} candidates can be done{at_once}\n")
    shown = feasible
    if len(feasible) > MOST_ROWS:  # the fastest for each choice of objects, the first of them
        fastest: dict[tuple[str, ...], int] = {}
        for place in sorted(range(len(feasible)), key=lambda place: feasible[place].time or 0.0):
            fastest.setdefault(tuple(feasible[place].objects.values()), place)
        shown = [feasible[place] for place in sorted(fastest.values())[:MOST_ROWS]]
    if feasible:
        rows = [(one.name, f"{one.time:.2f}" if one.time is not None else "") for one in shown]
        print_table([Column("candidate"), Column("time [s]", right=True)], rows)
        if len(shown) < len(feasible):
            say(f"... and {len(feasible) - len(shown)} more (--json)", "dim")
    elif found.suggested:
        print_suggested(found.suggested)
        say()
    print_infeasible(
        (one.name, one.objects, "; ".join(filter(None, [*one.reasons, one.advice])))
        for one in found.candidates
        if not one.feasible
    )
    around = [f"{one.name}: {', '.join(one.remarks)}" for one in shown if one.remarks]
    for number, line in enumerate(around):
        say(f"\n{line}" if number == 0 else line)


def print_suggested(suggested: Sequence[PlannedStep]) -> None:
    """The steps that lead to a task, a row each; all are feasible."""
    say("It can be done in these steps, each in its best way:\n")
    columns = [Column("#"), Column("step"), Column("Q_eoi [%]", right=True), Column("Q_avg [%]", right=True)]
    rows = [
        (str(number), step.task, Share(step.q_eoi), Share(step.q_avg), f"{step.time:.2f}")
        for number, step in enumerate(suggested, 1)
    ]
    print_table([*columns, Column("time [s]", right=True)], rows)


def print_rules(found: RulesDocument) -> None:
    """A row for each finding, a table for each subject; of a single one all that is known."""
    if len(found.rules) > 1:
        for number, (subject, group) in enumerate(groupby(found.rules, key=lambda rule: rule.subject)):
            if number:
                say()
            rows = [(rule.code, _severity(rule), rule.meaning) for rule in group]
            print_table([Column(subject), Column("severity"), Column("looks for", shrink=True)], rows)
        say("\nOne of them in full, with examples: sqrp rules CODE")
        return
    (rule,) = found.rules
    say_line(f"{rule.code} ({' or '.join(rule.severity)}): {rule.subject}", "bold")
    say(rule.meaning)
    say(rule.why)
    of = f" in {rule.file}" if rule.file else ""
    for title, example in (("Passes", rule.passes), ("Fails", rule.fails)):
        say(f"\n{title}{of}:")
        for line in example.splitlines():
            say_line(f"  {line}")


def _severity(rule: RuleEntry) -> Text:
    last = rule.severity[-1]
    return plain("either" if len(rule.severity) > 1 else last, SEVERITY_STYLES[last])
