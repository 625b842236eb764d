"""Files that a workspace names may be any: none of them is waited for, and none is quoted that is of another kind."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.files.input_file import open_input, read_input
from tests.cells import refused

FILES = ("workspace.yaml", "arm.urdf", "arm.srdf", "side.yaml", "cube.stl", "pickup/skill.yaml", "pickup/pickup.pddl")

SECRETS = {
    "shadow": "root:$6$SECRET$SECRET/:19000:0:99999:7:::\ndaemon:*:19000:0\n",
    "environment": "TOKEN=SECRET\0PATH=/SECRET\0",
    "text": "SECRET\n",
    "number": "5ECRET00\n",
    "other YAML": "password: [SECRET, {SECRET\n",
    "tagged YAML": "password: !SECRET x\n",
    "anchored YAML": "password: *SECRET\n",
    "repeated YAML": "SECRET: 1\nSECRET: 2\n",
    "other XML": "<password>\n SECRET</passwort>\n",
    "JSON": '{"password": "SECRET", }\n',
    "key": "-----BEGIN PRIVATE KEY-----\nSECRET+/=\n-----END PRIVATE KEY-----\n",
    "parentheses": "(SECRET (SECRET\n",
}


def said(error: InputError) -> Iterator[str]:
    for problem in error.problems:
        yield from (problem.message, problem.excerpt or "", problem.mend or "")


@pytest.mark.parametrize("secret", SECRETS.values(), ids=SECRETS)
@pytest.mark.parametrize("file", FILES)
def test_nothing_is_quoted_of_a_file_of_another_kind(file: str, secret: str, cell: Path) -> None:
    (cell / file).write_text(secret, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_workspace(cell)
    assert "ECRET" not in " ".join(said(caught.value))


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("there", ["/proc/self/environ", "/proc/kmsg", "/proc/self/status", "a pipe", "itself"])
def test_a_file_that_the_system_makes_up_or_that_is_none_is_not_waited_for(file: str, there: str, cell: Path) -> None:
    os.mkfifo(cell / "a pipe")
    if not (cell / there).exists() and there != "itself":
        pytest.skip("this system makes up no such file")
    (cell / file).unlink()
    (cell / file).symlink_to((cell / file) if there == "itself" else (cell / there))
    with pytest.raises(InputError) as caught:
        load_workspace(cell)
    codes = {"no-regular-file", "unreadable-file"} if there[0] == "/" else {"missing-file"}
    assert {problem.code for problem in caught.value.problems} <= codes
    assert all(problem.excerpt is None for problem in caught.value.problems)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full", "/dev/tty", "/dev/ptmx"])
def test_a_device_is_never_opened(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "open", lambda *_: pytest.fail("opened"))
    assert "expected a file" in refused(read_input, Path(device), 10).message


def test_a_pipe_that_took_the_place_of_a_file_a_moment_ago_is_not_waited_for(tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr(Path, "is_file", lambda _: True)
    assert "expected a file" in refused(read_input, tmp_path / "pipe", 10).message


def test_a_size_limit_holds_to_the_byte_and_from_the_stated_size(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.touch()
    assert read_input(path, 10) == b""
    path.write_bytes(b"0123456789")
    assert read_input(path, 10) == b"0123456789"
    assert "the file has 10 bytes, the limit is 9" in refused(read_input, path, 9).message
    os.truncate(path, 3 << 30)
    limit = "the file has 3,221,225,472 bytes, the limit is 200,000,000"
    assert limit in refused(open_input(path).__enter__).message


@pytest.mark.parametrize(
    ("file", "old", "new"),
    [("workspace.yaml", "skills: [pickup]", "skills: [pickup"), ("arm.urdf", "</robot>", "</robt>")],
)
def test_what_was_recognised_is_quoted_with_the_place(damaged, file: str, old: str, new: str) -> None:
    assert refused(load_workspace, damaged({"file": file, "replace": {old: new}})).excerpt
