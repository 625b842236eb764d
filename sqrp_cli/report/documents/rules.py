"""`rules`: what each finding means."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from sqrp_cli.report.documents.document import Document, Record

if TYPE_CHECKING:
    from sqrp_cli.checks.registry import Rule


@dataclass(frozen=True, kw_only=True)
class RuleEntry(Record):
    """What is known about one kind of finding."""

    code: str
    """As in `problems[].code`."""
    subject: str
    severity: list[Literal["error", "warning"]]
    """Both, where it depends on the case."""
    meaning: str
    why: str
    file: str | None
    """The file that the examples are from; null for a command line or a description."""
    passes: str
    """An example without the finding."""
    fails: str
    """An example with it."""

    @classmethod
    def of(cls, rule: Rule) -> RuleEntry:
        """A rule of the registry."""
        return cls(
            code=rule.code,
            subject=rule.subject,
            severity=[name for name in ("error", "warning") if name in rule.severity],
            meaning=rule.meaning,
            why=rule.why,
            file=rule.file,
            passes=rule.passes,
            fails=rule.fails,
        )


@dataclass(frozen=True, kw_only=True)
class RulesDocument(Document):
    """What can be found, or one finding of it."""

    rules: list[RuleEntry]

    @classmethod
    def of(cls, rules: Iterable[Rule]) -> RulesDocument:
        """Rules of the registry."""
        return cls(rules=[RuleEntry.of(rule) for rule in rules])
