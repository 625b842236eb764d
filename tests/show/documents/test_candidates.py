"""Figures in documents, and where the documentation defines them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest

from sqrp_cli.document import LIVE
from sqrp_cli.score.result import Scorecard, Sweep
from sqrp_cli.show.documents.checks import Check
from sqrp_cli.study.result import CandidateResult

NUMBERS = Path(__file__).parents[3] / "docs" / "reference" / "numbers.md"


def names(kind: Any, known: set[Any]) -> Iterator[str]:
    """The fields of a record, and of the records in it."""
    if is_dataclass(kind) and kind not in known:
        known.add(kind)
        hints = get_type_hints(kind)
        for part in (part for part in fields(kind) if part.metadata != LIVE):
            yield part.name
            yield from names(hints[part.name], known)
    for part in get_args(kind):
        yield from names(part, known)


@pytest.mark.parametrize("record", [CandidateResult, Check, Scorecard, Sweep])
def test_every_field_is_defined_in_the_reference(record: type) -> None:
    text = NUMBERS.read_text(encoding="utf-8")
    assert [name for name in names(record, set()) if f"`{name}`" not in text] == []
