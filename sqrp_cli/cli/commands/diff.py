"""`sqrp diff`: what differs between two versions of a workspace, and the effect on its tasks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import Command, argument, option
from sqrp_cli.ask.values import PATH
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.commands.score import ALLOW, ALLOWANCE, show
from sqrp_cli.cli.options import note_late
from sqrp_cli.errors import ExitCode, InputError

NAME = "diff"


class DiffCommand(requests.ScoreRequest, requests.Clustered, requests.Seeded, requests.Printed, Command):
    """Compare two versions of a workspace.

    Show what differs, field by field, and which camera therefore no longer sees which literal, and when.
    """

    before: Path = argument("A", "A workspace as it was.", PATH)
    after: Path = argument("B", "The workspace as it is now.", PATH)
    allow: float = option("--allow", ALLOW, values.number(0.0), default=ALLOWANCE, metavar="POINTS")


def diff(_context: Any, ask: DiffCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Compare, and print what differs."""
    from sqrp_cli.score.work.cluster import connected

    with connected(ask.cluster, note_late, ask.tls) as workers:
        from sqrp_cli.ask.api.scores import why_not_scored
        from sqrp_cli.score.scorecard import Scorecard, difference, read_versions
        from sqrp_cli.score.work.compute import Means, open_computer
        from sqrp_cli.show.terminal.console import progress
        from sqrp_cli.study.sampling import Adaptive

        means = Means(ask.sampling or Adaptive(), ask.jobs, workers, ask.out, ask.seed)
        old, new = read_versions(ask.before, ask.after)
        if not ask.json and old.content == new.content:  # nothing can differ, not even what is computed
            return show(Scorecard(document="diff", results=()), as_json=ask.json)
        with open_computer(means) as computer:
            findings = difference(old, new, computer, ask.allow, progress)
        if findings.count("error"):
            raise InputError(*why_not_scored(findings))
        return show(findings, as_json=ask.json)


command = command_of(DiffCommand, diff)
