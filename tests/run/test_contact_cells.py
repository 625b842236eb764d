"""The cells of peg in hole, screwing and wiping as their users run them: ranked, run with images, and one audited.

With a fifth of the images, of half the size: nothing here is about how small or how soon a part can be seen.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.program import open_program

ROOT = Path(__file__).parents[2]
CELLS = ROOT / "tests" / "cases" / "contact"


@pytest.fixture
def cells(tmp_path: Path) -> Path:
    folder = Path(shutil.copytree(CELLS, tmp_path / "contact"))
    for file in folder.glob("*.yaml"):
        text = file.read_text(encoding="utf-8").replace("../../../", f"{ROOT}/").replace("rate: 10 Hz", "rate: 2 Hz")
        file.write_text(text.replace("width: 1280, height: 960", "width: 640, height: 480"), encoding="utf-8")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "task"),
    [
        ("peg", "pickup peg1 then insert peg1 socket yaw=0"),
        ("screw", "drive screw1 block yaw=0"),
        ("wipe", "wipe sponge panel pace=0.1"),
    ],
)
def test_a_cell_with_contact_is_done_and_what_was_promised_is_seen(
    name: str, task: str, cells: Path, tmp_path: Path
) -> None:
    file, frames = tmp_path / "program.yaml", tmp_path / "frames"
    open_cell(cells / f"{name}.yaml").rank(task).write(file)
    program, audited = open_program(file), name == "peg"  # one of them, as an audit takes as long as a run
    run = program.run(frames=frames if audited else None)
    assert run.done, run.reason
    precision = run.total.precision
    assert precision is not None
    assert precision >= 0.98
    assert not audited or program.audit(frames, threshold=0.98).passed
