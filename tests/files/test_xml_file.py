"""XML that no reader of ours understands is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.files.xml_file import read_xml


@pytest.mark.parametrize("encoding", ["utf-abc", "utf-7", "cp932", "x" * 100])
def test_an_encoding_that_cannot_be_read_is_refused(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(f'<?xml version="1.0" encoding="{encoding}"?>\n<robot name="arm"/>')
    with pytest.raises(InputError, match=r"arm\.urdf:1: not well-formed XML"):
        read_xml(path, "robot")


def test_a_file_of_another_kind_is_said_once_to_be_no_xml(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text("root:x:0:0")
    with pytest.raises(InputError, match=r"arm\.urdf:1:1: not well-formed XML: (syntax error|invalid token)$"):
        read_xml(path, "robot")
    path.write_text("<robot &>")
    with pytest.raises(InputError, match=r"arm\.urdf:1:8: not well-formed XML: invalid token"):
        read_xml(path, "robot")


@pytest.mark.parametrize("text", ["<robot><{tag}></robot>", "<{tag}/>"])
def test_a_tag_of_a_million_letters_is_named_by_its_beginning(tmp_path: Path, text: str) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(text.format(tag="w" * 1_000_000))
    with pytest.raises(InputError) as caught:
        read_xml(path, "robot")
    assert len(caught.value.problems[0].message) < 300
