"""What leaves the program as JSON: a typed record per document, for other programs, pages and tests alike."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

from sqrp_cli.document import Document

KINDS: Mapping[str, str] = {
    "rank": "sqrp_cli.study.result:Ranking",
    "explain": "sqrp_cli.show.documents.explanation:Explanation",
    "explain --all": "sqrp_cli.show.documents.explanation:ExplainedAll",
    "advise": "sqrp_cli.search.advice_result:AdviceDocument",
    "place": "sqrp_cli.search.placing_result:PlaceDocument",
    "check": "sqrp_cli.show.documents.checks:Check",
    "program": "sqrp_cli.show.documents.programs:ProgramDocument",
    "run": "sqrp_cli.run.record.report:RunReport",
    "run --sweep": "sqrp_cli.run.record.report:SweepDocument",
    "audit": "sqrp_cli.field.audit.report:AuditDocument",
    "calibrate": "sqrp_cli.field.calibrating.fit:CalibrateDocument",
    "score": "sqrp_cli.score.result:Scorecard",
    "score --vary": "sqrp_cli.score.result:Sweep",
    "diff": "sqrp_cli.score.result:Scorecard",
    "show": "sqrp_cli.show.documents.scene:ShowDocument",
    "init": "sqrp_cli.show.documents.programs:NewCell",
    "rules": "sqrp_cli.show.documents.checks:RulesDocument",
}
"""Of each `document` its record."""


def record_of(kind: str) -> type[Document]:
    """The record of a kind of document."""
    module, name = KINDS[kind].split(":")
    record: type[Document] = getattr(import_module(module), name)
    return record
