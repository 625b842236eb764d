"""Folders of frames: what they may link to, and what they are not; how an index may be wrong is in refused.yaml."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.run.record.images import read_frames

HEAD = "camera,file,step,t\n"


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("frames.csv", b"", "this file is no recording; expected an MCAP file, a bag of ROS, or a folder with frames"),
        ("nowhere", b"", "no such file or folder"),
        (".", b"\xff\xfe", "byte 0xff is not UTF-8 text"),
        (".", HEAD.encode() + b"cam1,link.png,1,0\n", "2: the file `link.png` is not in this folder"),
        (".", HEAD.encode() + b"cam1,out/secret.png,1,0\n", "2: the file `out/secret.png` is not in this folder"),
    ],
)
def test_what_is_no_folder_of_frames_is_refused_in_words(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    (tmp_path / "secret.png").touch()
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / "out").symlink_to(tmp_path)
    (folder / "frames.csv").write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_frames(folder / name, ["cam1"], 1))


def test_a_file_in_the_folder_may_be_reached_by_links_within_it(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "a.png").touch()
    (tmp_path / "link.png").symlink_to("below/a.png")
    (tmp_path / "frames.csv").write_text(f"{HEAD}cam1,link.png,1,0\ncam1,below/a.png,1,\n")
    entries = list(read_frames(tmp_path, ["cam1"], 1))
    assert [(file.name, t) for _, file, _, t in entries] == [("link.png", 0.0), ("a.png", None)]


def test_nothing_is_quoted_of_a_file_that_only_lies_where_the_index_should(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("root:x:0:0\n")
    (tmp_path / "frames.csv").symlink_to("secret")
    with pytest.raises(InputError) as caught:
        list(read_frames(tmp_path, ["cam1"], 1))
    assert "x:0" not in str(caught.value)
