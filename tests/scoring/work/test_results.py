"""Where outcomes are kept, whatever is in the place of one."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from sqrp_cli.scoring.work.results import Results

KEY = "ab" * 32

IN_THE_WAY: dict[str, Callable[[Path], object]] = {
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nowhere": lambda path: path.symlink_to("nowhere"),
    "a link to a device": lambda path: path.symlink_to("/dev/zero"),
    "a pipe": os.mkfifo,
    "an empty folder": Path.mkdir,
    "noise": lambda path: path.write_bytes(b"\xff\0"),
}


@pytest.mark.parametrize("what", IN_THE_WAY)
def test_what_is_in_the_place_of_a_result_is_replaced(what: str, tmp_path: Path) -> None:
    (tmp_path / KEY[:2]).mkdir()
    IN_THE_WAY[what](tmp_path / KEY[:2] / f"{KEY}.json")
    with closing(Results(tmp_path)) as results:
        assert results.get(KEY) is None
        results.keep(KEY, "text")
    with closing(Results(tmp_path)) as results:
        assert results.get(KEY) == "text"
