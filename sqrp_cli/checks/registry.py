"""The registry of findings: what each code means, why it matters, and what passes and fails.

The findings are in `findings.yaml` beside this module, grouped by subject.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Literal

from sqrp_cli.records import dataclass

FINDINGS = Path(__file__).with_name("findings.yaml")


@dataclass(frozen=True, kw_only=True)
class RuleEntry:
    """What is known about one kind of finding."""

    code: str
    """As in `problems[].code`."""
    subject: str
    """The group that it belongs to, such as `Formulas`."""
    severity: list[Literal["error", "warning"]]
    """Both, where it depends on the case."""
    meaning: str
    """What the finding means, in a sentence."""
    why: str
    """Why it matters, in a sentence."""
    file: str | None
    """The file of the examples; null if they are command lines or descriptions."""
    passes: str
    """An example without the finding."""
    fails: str
    """An example with it."""


@cache
def rules() -> Mapping[str, RuleEntry]:
    """Every rule by its code, subject after subject."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    groups = yaml.load(FINDINGS.read_text(encoding="utf-8"), Loader=loader)  # noqa: S506 # a safe one
    found = dict[str, RuleEntry]()
    for subject, code, entry in ((group["subject"], *item) for group in groups for item in group["findings"].items()):
        texts = {key: entry[key] for key in ("meaning", "why", "passes", "fails")}
        severity = entry.get("severity", "error").split(" or ")
        found[code] = RuleEntry(code=code, subject=subject, severity=severity, file=entry.get("in"), **texts)
    return found
