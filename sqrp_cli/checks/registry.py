"""The registry of findings: what each code means, why it matters, and what passes and fails.

The findings are in `findings.yaml` beside this module, grouped by subject.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sqrp_cli.errors import InputError, Problem, expected_names

FINDINGS = Path(__file__).with_name("findings.yaml")


@dataclass(frozen=True, kw_only=True)
class Rule:
    """The description of one kind of finding."""

    code: str
    """As in `problems[].code`."""
    subject: str
    """The group that it belongs to, such as `Formulas`."""
    severity: str
    """`error`, `warning`, or `error or warning`."""
    meaning: str
    """What it means, in a sentence."""
    why: str
    """Why it matters, in a sentence."""
    passes: str
    """An example without the finding."""
    fails: str
    """An example with it."""
    file: str | None
    """Name of the file that the examples are from; None for a command line or a text."""


@cache
def rules() -> Mapping[str, Rule]:
    """Every rule by its code, subject after subject."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    groups = yaml.load(FINDINGS.read_text(encoding="utf-8"), Loader=loader)  # noqa: S506 # a safe one
    return {code: _rule(group["subject"], code, entry) for group in groups for code, entry in group["findings"].items()}


def _rule(subject: str, code: str, entry: Mapping[str, str]) -> Rule:
    texts = {key: entry[key] for key in ("meaning", "why", "passes", "fails")}
    return Rule(code=code, subject=subject, severity=entry.get("severity", "error"), file=entry.get("in"), **texts)


def rule_of(code: str) -> Rule:
    """The rule of a code. Raises InputError, with the nearest code, if there is none."""
    if code not in rules():
        raise InputError(Problem("unknown-rule", f"there is no finding `{code}`; {expected_names(code, rules())}"))
    return rules()[code]
