"""The figures about the house can be had, and count what they say."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.house import ROOT, House, main

SOURCE = """
class FaultSeen: ...
class Defaults: ...
class FaultSeen: ...

def pair() -> tuple[int, str]: ...
def many() -> tuple[int, ...]: ...
def _own() -> tuple[int, str]: ...
"""


def test_what_is_counted(tmp_path: Path) -> None:
    package = tmp_path / "sqrp_cli"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "one.py").write_text(SOURCE)
    (package / "two.py").write_text("from sqrp_cli.one import pair\n\ndef long():\n" + "    pair()\n" * 31)
    figures = House(tmp_path).figures()
    assert figures["files"][0] == 3
    assert figures["classes named ..Fault.."] == (2, ["FaultSeen", "FaultSeen"])
    assert figures["class names used twice"] == (1, ["FaultSeen"])
    assert figures["public functions that return bare tuples"] == (1, ["sqrp_cli.one.pair"])
    assert figures["modules with one importer"] == (1, ["sqrp_cli.one"])
    assert figures["functions over 30 lines"] == (1, ["sqrp_cli.two.long"])


def test_the_table_has_a_column_for_each_checkout(capsys: pytest.CaptureFixture[str]) -> None:
    main([str(ROOT)])
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["before", "now"]
    for line in lines[1:]:
        before, now = line.split()[-2:]
        assert before == now
    assert lines[-1].split()[-1] == "0"
