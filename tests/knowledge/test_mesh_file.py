"""A mesh file either is what it says, or is refused at once with the line of what is wrong."""

from __future__ import annotations

import re
import time
import tracemalloc
from pathlib import Path

import pytest

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.mesh_file import check_mesh
from tests.knowledge.mesh_bombs import bombs

BOMBS = bombs()


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", BOMBS)
def test_a_mesh_that_contradicts_itself_is_refused_with_what_is_wrong(name: str, tmp_path: Path) -> None:
    bomb = BOMBS[name]
    path = write(tmp_path / f"mesh{bomb.suffix}", bomb.content)
    before = time.process_time()
    tracemalloc.start()
    with pytest.raises(InputError) as caught:
        check_mesh(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert re.search(bomb.says, str(caught.value)), str(caught.value)
    assert len(str(caught.value)) < 600
    assert peak < 300e6
    assert time.process_time() - before < 30.0
