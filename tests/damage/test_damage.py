"""One damage of every kind: a clear refusal or a result, never a traceback, never a hang."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cells import ROOT
from tests.damage.kinds import KINDS
from tests.trials.__main__ import asked


@pytest.mark.slow
def test_damaged_input_is_refused_with_file_and_place_or_still_works(tmp_path: Path) -> None:
    # In a process of its own: commands are forked from it, within a limit of memory that earlier tests use up here.
    shared = tmp_path / "damage"
    subprocess.run([sys.executable, "-m", "tests.trials", "--case", "damage", "-1", shared], cwd=ROOT, check=True)
    found = json.loads((shared / "-1.json").read_text())
    assert {one["kind"] for one in found["all"]} == {kind.name for kind in KINDS}
    assert [sentence for sentence, holds in asked("damage", [found]) if not holds] == [], found["said"]
