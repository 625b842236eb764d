from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.runtime.log import read_log


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\xff\xfe\x00", "no log of `sqrp run --log`: it is not UTF-8 text"),
        (b"", "this log is empty"),
        (b"[1]\n", "this line is no event"),
        (b'{"t": 0, "event": "start"}\n', "or one of another version"),
    ],
)
def test_what_is_no_log_is_refused_in_words(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "log"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        list(read_log(path))
