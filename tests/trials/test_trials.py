"""A few cases of each trial that has short ones; `python -m tests.trials` has all."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.trials.__main__ import TRIALS, asked, module_of, prepared

CASES = [(name, number) for name, trial in TRIALS.items() for number in trial.suite]
SLOW = [(name, number) for name, trial in TRIALS.items() for number in trial.slow]


@pytest.mark.parametrize(("name", "number"), [*CASES, *(pytest.param(*case, marks=pytest.mark.slow) for case in SLOW)])
def test_a_case_is_as_asked(name: str, number: int, tmp_path: Path) -> None:
    folder = prepared(name, tmp_path / "trial") / "case"
    folder.mkdir()
    found = getattr(module_of(name), name)(number, folder, **TRIALS[name].few)
    assert found is not None
    assert len(found) > 1, found
    assert [sentence for sentence, holds in asked(name, [found]) if not holds] == [], found
