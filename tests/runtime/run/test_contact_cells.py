"""The cells of peg in hole, screwing and wiping as their users run them: ranked, run with images, audited."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.api.cell import open_cell
from sqrp_cli.api.program import open_program

CELLS = Path(__file__).parents[2] / "cases" / "contact"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "task"),
    [
        ("peg", "pickup peg1 then insert peg1 socket yaw=0"),
        ("screw", "drive screw1 block yaw=0"),
        ("wipe", "wipe sponge panel pace=0.1"),
    ],
)
def test_a_cell_with_contact_is_done_and_what_was_promised_is_seen(name: str, task: str, tmp_path: Path) -> None:
    file, frames = tmp_path / "program.yaml", tmp_path / "frames"
    open_cell(CELLS / f"{name}.yaml").rank(task).write(file)
    program = open_program(file)
    run = program.run(frames=frames)
    assert run.done, run.report.reason
    assert program.audit(frames, threshold=0.98).passed
