"""Files that are wrong are refused in one message, one case after the other from tests/cases/refused.yaml."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sqrp_cli.camera.calibration import read_calibration
from sqrp_cli.camera.hand_eye import read_hand_eye
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.field.calibrating.labelled import read_labels
from sqrp_cli.files.json_file import parse_json
from sqrp_cli.files.xml_file import read_xml
from sqrp_cli.ros.bag import Bag
from sqrp_cli.run.record.images import read_frames
from sqrp_cli.run.record.log import read_log
from tests.cells import ROOT, read_cases, refused
from tests.damage.bombs import text_of
from tests.trials.detectors import write_workspace

CASES = read_cases("refused.yaml")
READERS: dict[str, Callable[[Path, Workspace], object]] = {
    "hand_eye": lambda path, _: read_hand_eye(path, carriers=("world", "base", "wrist")),
    "calibration": lambda path, _: read_calibration(path),
    "json": lambda path, _: parse_json(path, path.read_text(encoding="utf-8")),
    "frames": lambda path, _: list(read_frames(path.parent, ["cam1"], 1)),
    "log": lambda path, _: list(read_log(path)),
    "metadata": lambda path, _: Bag(path),
    "labels": lambda path, workspace: list(read_labels(path.parent, workspace)),
    "xml": lambda path, _: read_xml(path, "robot"),
}
NAMES = {"frames": "frames.csv", "metadata": "metadata.yaml"}


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Workspace:
    return write_workspace(tmp_path_factory.mktemp("cell"))


@pytest.mark.parametrize(
    ("reader", "case"), [(reader, case) for reader in READERS for case in CASES[reader]], ids=lambda one: str(one)[:60]
)
def test_what_is_wrong_is_told_where_it_stands(
    reader: str, case: dict[str, Any], workspace: Workspace, tmp_path: Path
) -> None:
    cameras, path = (
        ROOT / "tests" / "cases" / "cameras",
        tmp_path / NAMES.get(reader, "labels.csv"),
    )
    text = (cameras / case["file"]).read_text(encoding="utf-8") if "file" in case else text_of(case["text"])
    for old, new in case.get("replace", {}).items():
        assert old in text
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    (tmp_path / "a.png").touch()
    problem = refused(READERS[reader], path, workspace)
    assert case["says"] in problem.message
    assert len(problem.message) < 300
    assert "hunter2" not in problem.message
    assert not problem.message.endswith(" at"), "where it is, its place says"
    assert problem.place.file == path
    assert case.get("line") in (None, problem.place.line)
    assert case.get("code") in (None, problem.code)
