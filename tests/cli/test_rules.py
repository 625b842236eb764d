"""`sqrp rules`: every finding with its meaning, and one of them in full."""

from __future__ import annotations

import pytest

from sqrp_cli.checks.registry import rules


def test_every_finding_has_a_row_under_its_subject(sqrp):
    outcome = sqrp("rules")
    assert outcome.code == 0
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    rows = {line.split()[0] for line in lines if line[:1].strip()}
    assert rows >= set(rules())
    for rule in rules().values():
        assert any(line.startswith(rule.subject) for line in lines)


@pytest.mark.parametrize("code", rules())
def test_every_line_of_an_example_is_shown(sqrp, code):
    shown = sqrp("rules", code).out
    for line in (*rules()[code].passes.splitlines(), *rules()[code].fails.splitlines()):
        assert f"  {line.rstrip()}" in shown


def test_the_document_has_what_the_registry_has(sqrp):
    document = sqrp("rules", "--json").document
    assert document["schema"] == 1
    assert [entry["code"] for entry in document["rules"]] == list(rules())
    (both,) = sqrp("rules", "overlapping-objects", "--json").document["rules"]
    assert both["severity"] == ["error", "warning"]
