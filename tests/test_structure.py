"""The figures of the code can be had, and count what they say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.structure import RECORD_FIELDS, ROOMS, ROOT, Figure, SourceTree

SOURCE = """
class Box:
    encloses: tuple[str, ...]

class Image: ...
class Image: ...

def told(box: Box) -> dict[str, object]:
    return {"encloses": box.encloses, "latency": "later"}

def pair() -> tuple[int, str]: ...
def many() -> tuple[int, ...]: ...
def _own() -> tuple[int, str]: ...
"""


@pytest.fixture(scope="module")
def package() -> SourceTree:
    return SourceTree(ROOT)


@pytest.fixture(scope="module")
def figures(package: SourceTree) -> dict[str, Figure]:
    return package.figures()


def test_what_is_counted(tmp_path: Path) -> None:
    package = tmp_path / "sqrp_cli"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "one.py").write_text(SOURCE)
    (package / "two.py").write_text("from sqrp_cli.one import Box\n\ndef long():\n" + "    Box(encloses=())\n" * 31)
    figures = SourceTree(tmp_path).figures()
    assert figures["files"][0] == 3
    assert figures["records of a target's box"] == (1, ["sqrp_cli.one.Box"])
    assert figures["modules that write a target's box"] == (2, ["sqrp_cli.one", "sqrp_cli.two"])
    assert figures["modules that write a camera"] == (0, [])
    assert figures["class names used twice"] == (1, ["Image"])
    assert figures["public functions that return bare tuples"] == (1, ["sqrp_cli.one.pair"])
    assert figures["modules with one importer"] == (1, ["sqrp_cli.one"])
    assert figures["functions over 30 lines"] == (1, ["sqrp_cli.two.long"])


@pytest.mark.parametrize("field", [RECORD_FIELDS[subject] for subject in ("target's box", "fault's figures", "camera")])
def test_a_new_field_touches_at_most_three_files(field: str, package: SourceTree) -> None:
    assert 1 <= len(package.modules_that_write(field)) <= 3


@pytest.mark.parametrize(("title", "most"), [
    ("types with q_eoi and q_avg", 5), ("records of a cause", 3),
    ("pairs of records that share half of their fields", 20),
])  # fmt: skip
def test_a_result_is_said_once(title: str, most: int, figures: dict[str, Figure]) -> None:
    assert figures[title][0] <= most, figures[title][1]


def test_every_room_keeps_its_budget(package: SourceTree, figures: dict[str, Figure]) -> None:
    rooms = package.rooms()
    assert {room: lines - ROOMS[room][1] for room, lines in rooms.items() if lines > ROOMS[room][1]} == {}
    assert sum(rooms.values()) == figures["lines"][0]  # no module has no room


def test_meshes_are_read_by_one_module() -> None:
    # Coal's own loader numbers the vertices of a part from the first vertex of the whole.
    sources = {path: path.read_text(encoding="utf-8") for path in (ROOT / "sqrp_cli").rglob("*.py")}
    assert [path for path, source in sources.items() if "MeshLoader" in source] == []
