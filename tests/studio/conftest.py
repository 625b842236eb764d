"""One studio of the tabletop for the tests of a module, and a browser."""

from __future__ import annotations

import pytest

from tests.cells import copied
from tests.studio.hand import Started

TASK = "pickup object=g2,g6"
"""One candidate that can be done, and one that cannot."""


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A copy of the tabletop that a test may change."""
    return copied(tmp_path_factory.mktemp("studio"), "tabletop")


@pytest.fixture(scope="module")
def studio(cell):
    """A studio of that copy."""
    started = Started(cell, TASK)
    yield started
    code, err = started.closed()
    assert code == 0
    assert "Traceback" not in err
    assert "internal error" not in err
