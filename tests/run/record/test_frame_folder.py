from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.run.record.images import read_frames


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("frames.csv", "this file is no recording; expected an MCAP file, a bag of ROS, or a folder with frames.csv"),
        (".", "the columns are others, expected `camera, file, step, t`"),
        ("nowhere", "no such file or folder"),
    ],
)
def test_what_is_no_folder_of_frames_is_refused_in_words(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "frames.csv").write_text('"x,y"\n')
    with pytest.raises(InputError, match=says):
        list(read_frames(tmp_path / name, ["cam1"], 1))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "this file is empty: the run was stopped before it kept an image"),
        (b"\xff\xfe", "byte 0xff is not UTF-8 text"),
        (b"camera,file,step,t\n\0,a,1,0\n", "2: this is no CSV: it has a NUL character"),
        (b"camera,file,step,t\ncam,a.png,1,0\n", "there is no camera `cam`; did you mean `cam1`?"),
        (b"camera,step,file,t\n", "the columns are `camera, step, file, t`, expected"),
        (b"camera,file,step,t\ncam1,here.png,1,nan\n", "2: `t` is `nan`, expected seconds from 0 to 3600"),
        (b"camera,file,step,t\ncam1,here.png,1,1e300\n", "2: `t` is `1e300`, expected seconds from 0 to 3600"),
        (b"camera,file,step,t\ncam1,here.png,1,-0.1\n", "2: `t` is `-0.1`, expected seconds from 0 to 3600"),
        (b"camera,file,step,t\ncam1,here.png,1," + b"9" * 400 + b"\n", r"2: `t` is `9{57}\.\.\.`, expected seconds"),
        (b"camera,file,step,t\ncam1,here.png," + b"9" * 400 + b",0\n", r"2: `step` is `9{57}\.\.\.`, expected a whole"),
        (
            b"camera,file,step,t\ncam1,here.png," + b"9" * 9000 + b",0\n",
            r"2: `step` is `9{57}\.\.\.`, expected a whole",
        ),
        (b"camera,file,step,t\ncam1,here.png,1_0,0\n", "2: `step` is `1_0`, expected a whole number from 1 to 1"),
        (b"camera,file,step,t\n\ncam1,here.png\n", "3: this row has 2 columns, expected 4: camera, file, step, t"),
        (b"camera,file,step,t\ncam1,here.png,1,0,0\n", "2: this row has 5 columns"),
        (b"camera,file,step,t\ncam1,here.png,2,0\n", "2: `step` is `2`, expected a whole number from 1 to 1"),
        (b"camera,file,step,t\ncam1," + b"x" * 9000 + b",1,0\n", "2: `x"),
        (b"camera,file,step,t\ncam1,,1,0\n", "2: ``: no such file or folder"),
        (b"camera,file,step,t\ncam1,a.png,1,0\n", "`a.png`: no such file or folder"),
        (b"camera,file,step,t\n" + b"x" * 200_000 + b",a,1,0\n", "this is no CSV: field larger"),
    ],
)
def test_each_damage_of_the_index_is_refused_in_words(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "frames.csv").write_bytes(content)
    (tmp_path / "here.png").touch()
    with pytest.raises(InputError, match=says):
        list(read_frames(tmp_path, ["cam1"], 1))


@pytest.mark.parametrize(
    "name", ["/etc/hostname", "../secret.png", "below/../../secret.png", "link.png", "out/secret.png"]
)
def test_a_file_outside_the_folder_is_refused_with_its_line(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "frames"
    (folder / "below").mkdir(parents=True)
    (tmp_path / "secret.png").touch()
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    (folder / "out").symlink_to(tmp_path)
    (folder / "frames.csv").write_text(f"camera,file,step,t\ncam1,{name},1,0\n")
    with pytest.raises(InputError, match=f"2: the file `{name}` is not in this folder"):
        list(read_frames(folder, ["cam1"], 1))


def test_a_file_in_the_folder_may_be_reached_by_links_within_it(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "a.png").touch()
    (tmp_path / "link.png").symlink_to("below/a.png")
    (tmp_path / "frames.csv").write_text("camera,file,step,t\ncam1,link.png,1,0\ncam1,below/a.png,1,\n")
    entries = list(read_frames(tmp_path, ["cam1"], 1))
    assert [(file.name, t) for _, file, _, t in entries] == [("link.png", 0.0), ("a.png", None)]


def test_nothing_is_quoted_of_a_file_that_only_lies_where_the_index_should(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("root:x:0:0\n")
    (tmp_path / "frames.csv").symlink_to("secret")
    with pytest.raises(InputError) as caught:
        list(read_frames(tmp_path, ["cam1"], 1))
    assert "x:0" not in str(caught.value)
