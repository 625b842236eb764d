"""Figures of candidates in documents, and where the documentation defines them."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from sqrp_cli.document import LIVE
from sqrp_cli.study.result import CandidateResult

NUMBERS = Path(__file__).parents[3] / "docs" / "reference" / "numbers.md"


@pytest.mark.parametrize("name", [part.name for part in fields(CandidateResult) if part.metadata != LIVE])
def test_every_field_of_a_candidate_is_defined_in_the_reference(name: str) -> None:
    assert f"`{name}`" in NUMBERS.read_text(encoding="utf-8")
