"""The kernel reads and writes only what is its own, and does nothing that C++ leaves undefined."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sqrp_cli.kernel import library

ROOT = Path(__file__).parents[2]
TESTS = (
    "tests/kernel",
    "tests/motion",
    "tests/sight/visibility",
    *(f"tests/sight/test_{name}.py" for name in ("limits", "not_finite", "part_shares", "reference")),
)


@pytest.mark.trial
@pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
def test_nothing_that_is_undefined_happens_in_the_tests_of_the_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CXX", "g++ -g -fsanitize=address,undefined -fno-sanitize-recover=all")
    library.build(tmp_path / "kernel.so")
    compiler = shutil.which("g++") or ""
    # The sanitizer comes before all else in the process, and so does the C++ library, whose exceptions it watches.
    names = [subprocess.check_output([compiler, f"-print-file-name={name}"], text=True).strip()
             for name in ("libasan.so", "libubsan.so", "libstdc++.so")]  # fmt: skip
    kernel = {"SANITIZED_KERNEL": str(tmp_path / "kernel.so"), "LD_PRELOAD": " ".join(names)}
    # Python keeps what it has at exit; EAIK deletes what it holds as another type than it made.
    options = {"ASAN_OPTIONS": "detect_leaks=0:new_delete_type_mismatch=0", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "tests.kernel.sanitized", "-p", "no:cacheprovider",
               "-k", "not library and not sanitizers", *TESTS]  # fmt: skip
    done = subprocess.run(
        command, env=os.environ | kernel | options, cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-5000:]
