from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.runtime.recording import read_frames


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("frames.csv", "this is a file; expected a folder with frames.csv in it"),
        (".", "the columns are `x,y`, expected `camera, file, step, t`"),
        ("nowhere", "there is no frames.csv in this folder"),
    ],
)
def test_what_is_no_folder_of_frames_is_refused_in_words(tmp_path: Path, name: str, says: str) -> None:
    (tmp_path / "frames.csv").write_text('"x,y"\n')
    with pytest.raises(InputError, match=says):
        list(read_frames(tmp_path / name, ["cam1"], 1))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the columns are ``, expected"),
        (b"\xff\xfe", "it is not UTF-8 text"),
        (b"camera,file,step,t\n\0,a,1,0\n", "there is no camera|this is no CSV"),
        (b"camera,file,step,t\ncam,a.png,1,0\n", "there is no camera `cam`; did you mean `cam1`?"),
        (b"camera,file,step,t\ncam1,a.png,1,nan\n", "`step` and `t` must be a number each"),
        (b"camera,file,step,t\ncam1,a.png\n", "`step` and `t` must be a number each"),
        (b"camera,file,step,t\ncam1,a.png,2,0\n", "`step` is 2, the program has 1"),
        (b"camera,file,step,t\ncam1,a.png,1,0\n", "there is no file `a.png`"),
        (b"camera,file,step,t\n" + b"x" * 200_000 + b",a,1,0\n", "this is no CSV: field larger"),
    ],
)
def test_each_damage_of_the_index_is_refused_in_words(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / "frames.csv").write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_frames(tmp_path, ["cam1"], 1))
