from __future__ import annotations

import os
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError, Place
from sqrp_cli.platform.files import alone, check_distinct, check_writable, write_atomically


def test_what_cannot_be_a_file_is_refused_and_a_missing_folder_with_the_command_that_makes_it(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no folder") as caught:
        write_atomically(tmp_path / "a" / "b.txt", "text")
    assert caught.value.problems[0].mend == f"mkdir -p {tmp_path / 'a'}"
    with pytest.raises(InputError, match="cannot be written"):
        write_atomically(tmp_path / ("x" * 300), "text")
    with pytest.raises(InputError, match="this is a folder"):
        write_atomically(tmp_path, "text")
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_as_a_whole_and_a_link_to_it_stays_one(tmp_path: Path) -> None:
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("old")
    link.symlink_to(real)
    for path, text in ((link, "new"), (real, "newer")):
        write_atomically(path, text)
        assert (link.is_symlink(), real.read_text()) == (True, text)
    assert sorted(tmp_path.iterdir()) == [link, real]


def test_whoever_wants_to_be_alone_with_a_file_waits_for_the_others(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    folder = os.open(tmp_path, os.O_RDONLY)
    with alone(tmp_path / "program.yaml"), pytest.raises(BlockingIOError):
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(folder)


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_failure_leaves_the_old_file_and_says_which_could_not_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    path = tmp_path / "program.yaml"
    path.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(*((os, "fsync") if call == "fsync" else (Path, "replace")), fail)
    with pytest.raises(InputError, match="No space left on device") as caught:
        write_atomically(path, "new")
    assert caught.value.problems[0].place == Place(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_device_or_pipe_is_written_to_and_stays_what_it_is(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_atomically(pipe, "text")
    assert os.read(reader, 10) == b"text"
    os.close(reader)
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


def test_a_write_protected_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "page.html"
    path.write_text("old")
    path.chmod(0o444)
    monkeypatch.setattr(os, "access", lambda name, _: Path(name) != path)  # as for anybody but root
    with pytest.raises(InputError, match="write-protected") as caught:
        check_writable(path)
    assert caught.value.problems[0].mend == f"choose another name, or: chmod u+w {path}"
    assert path.read_text() == "old"


def test_one_file_for_two_outputs_is_refused_by_the_names_of_the_options(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(tmp_path / "file")
    with pytest.raises(InputError, match="--junit and --report both name this file"):
        check_distinct({"--junit": tmp_path / "file", "--summary": None, "--report": tmp_path / "link"})
    check_distinct({"--junit": tmp_path / "one", "--summary": tmp_path / "other", "--report": None})
    check_distinct({"--junit": Path("/dev/null"), "--summary": Path("/dev/null")})


def test_what_is_written_to_an_open_stream_comes_after_what_is_in_its_file(tmp_path: Path) -> None:
    path = tmp_path / "all.txt"
    path.write_text("before\n")
    with path.open("a") as stream:
        write_atomically(Path(f"/proc/self/fd/{stream.fileno()}"), "after\n")
    assert path.read_text() == "before\nafter\n"
