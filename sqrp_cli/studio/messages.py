"""What browsers are told: texts in JSON with `do` first."""

from __future__ import annotations

import json
from collections.abc import Sequence

from sqrp_cli.errors import Problem
from sqrp_cli.report.documents.checks import ReportedProblem
from sqrp_cli.report.pages.assembly import tidy


def message(do: str, **fields: object) -> str:
    """A message: figures with all their digits, nothing invisible in names."""
    return json.dumps(tidy({"do": do, **fields}, digits=None), allow_nan=False)


def kind_of(text: str) -> str:
    """The `do` of a message."""
    return text.split('"', 4)[3]


def findings(problems: Sequence[Problem]) -> list[ReportedProblem]:
    """Problems as documents have them."""
    return [ReportedProblem.of(problem) for problem in problems]
