"""The output of `sqrp check` and `sqrp rules`: what can be done, why the rest cannot, and what each finding means."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from itertools import groupby

from rich.text import Text

from sqrp_cli.checks.registry import RuleEntry
from sqrp_cli.errors import Problem
from sqrp_cli.programming.suggestion import Feasibility, SuggestedStep
from sqrp_cli.report.documents.checks import RulesDocument
from sqrp_cli.terminal.console import SEVERITY_STYLES, Column, Share, plain, print_table, say, say_command, say_line
from sqrp_cli.terminal.rank_table import MOST_ROWS, print_infeasible


def print_valid(path: str, name: str, warnings: Sequence[Problem], example: str) -> None:
    """The message that a workspace is valid, and how to go on. path: as it was given. example: a task of it."""
    findings = f"{len(warnings)} warning{'s' if len(warnings) > 1 else ''}" if warnings else "nothing to complain about"
    say(f"{name} is valid: {findings}.")
    if all(problem.code != "no-skills" for problem in warnings):
        say_command("Try:", f"sqrp rank {shlex.quote(path)} {shlex.quote(example)}")


def print_candidates(
    task: str, workspace: str, found: Sequence[Feasibility], suggested: Sequence[SuggestedStep]
) -> None:
    """The steps to do first if nothing can be done at once, a row per candidate that can, and why the others cannot."""
    feasible = [feasibility for feasibility in found if feasibility.feasible]
    at_once = " at once" if suggested and not feasible else ""
    say(f"{task} in {workspace}: {len(feasible)} of {len(found)} candidates can be done{at_once}\n")
    shown: Sequence[Feasibility] = []
    if feasible:
        shown = _fastest_of_each(feasible)
        rows = [(one.candidate.name, f"{one.time:.2f}" if one.time is not None else "") for one in shown]
        print_table([Column("candidate"), Column("time [s]", right=True)], rows)
        if len(shown) < len(feasible):
            say(f"... and {len(feasible) - len(shown)} more (--json)", "dim")
    elif suggested:
        print_suggested(suggested)
        say()
    blocked = [one for one in found if not one.feasible]
    print_infeasible(
        (one.candidate.name, one.candidate.binding, "; ".join(filter(None, [*one.reasons, one.suggestion.words])))
        for one in blocked
    )
    around = [f"{one.candidate.name}: {', '.join(one.remarks)}" for one in shown if one.remarks]
    for number, line in enumerate(around):
        say(f"\n{line}" if number == 0 else line)


def _fastest_of_each(feasible: Sequence[Feasibility]) -> Sequence[Feasibility]:
    """All of a few candidates; of many the fastest for each choice of objects, the first of them."""
    if len(feasible) <= MOST_ROWS:
        return feasible
    fastest: dict[tuple[str, ...], int] = {}
    for place in sorted(range(len(feasible)), key=lambda place: feasible[place].time or 0.0):
        fastest.setdefault(tuple(feasible[place].candidate.binding.values()), place)
    return [feasible[place] for place in sorted(fastest.values())[:MOST_ROWS]]


def print_suggested(suggested: Sequence[SuggestedStep]) -> None:
    """The steps that lead to a task, a row each; all are feasible."""
    say("It can be done in these steps, each in its best way:\n")
    columns = [Column("#"), Column("step"), Column("Q_eoi [%]", right=True), Column("Q_avg [%]", right=True)]
    rows = [
        (str(number), step.task, Share(found.q_eoi), Share(found.q_avg), f"{found.time:.2f}")
        for number, step in enumerate(suggested, 1)
        if (found := step.assessment)
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
