"""Settings of all tests: property tests draw the same examples in every run, and none of them is timed."""

from __future__ import annotations

import compileall
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("sqrp", deadline=None, derandomize=True)
settings.load_profile("sqrp")


def pytest_configure(config: pytest.Config) -> None:
    """Compile the package once: the tests start it in many processes, each of which may be told to keep no bytecode."""
    if not hasattr(config, "workerinput"):  # pytest-xdist gives that to its workers, which start afterwards
        compileall.compile_dir(Path(__file__).parents[1] / "sqrp_cli", quiet=2)
