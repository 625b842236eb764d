"""The kernel is built wherever its sources differ from what is at hand, and from nowhere else."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from sqrp_cli.kernel import library

ROOT = Path(__file__).parents[2]


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout's sources without a library; of a kernel that is compiled at once."""
    package = tmp_path / "checkout" / "sqrp_cli"
    shutil.copytree(ROOT / "sqrp_cli" / "kernel", package / "kernel", ignore=shutil.ignore_patterns("kernel-*"))
    (package / "kernel" / "sight.cpp").write_text('extern "C" int seen() { return 1; }\n')
    shutil.copy(ROOT / "sqrp_cli" / "errors.py", package)
    return package.parent


def loaded(checkout: Path, **environment: str) -> str:
    """The file that a new process loads, or its last words."""
    code = "from sqrp_cli.kernel.library import load; print(load()._name)"
    quick = {"CXX": shutil.which("c++") or ""}
    ours = {"XDG_CACHE_HOME": str(checkout.parent / "cache"), "PYTHONPATH": str(checkout)} | quick | environment
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=os.environ | ours, capture_output=True, text=True, cwd=checkout, check=False)
    return done.stdout.strip() or done.stderr.splitlines()[-1]


def test_a_checkout_builds_once_in_the_cache_and_again_after_an_edit(checkout: Path) -> None:
    first = loaded(checkout)
    assert Path(first).parent == checkout.parent / "cache" / "sqrp"
    before = Path(first).stat().st_mtime_ns
    assert loaded(checkout, CXX="no-such-compiler") == first
    assert Path(first).stat().st_mtime_ns == before
    with (checkout / "sqrp_cli" / "kernel" / "sight.cpp").open("a") as source:
        source.write("// another one\n")
    assert loaded(checkout) != first


def test_a_library_beside_the_sources_needs_no_compiler(checkout: Path) -> None:
    kernel = checkout / "sqrp_cli" / "kernel"
    shutil.copy(loaded(checkout), kernel)
    shutil.rmtree(checkout.parent / "cache")
    assert Path(loaded(checkout, CXX="no-such-compiler")).parent == kernel


def test_a_checkout_that_cannot_be_written_to_is_left_alone(checkout: Path) -> None:
    names = sorted(checkout.rglob("*"))
    no_home = {"XDG_CACHE_HOME": "/proc/none", "PYTHONDONTWRITEBYTECODE": "1", "TMPDIR": str(checkout.parent)}
    assert Path(loaded(checkout, **no_home)).parent == checkout.parent / f"sqrp-{os.getuid()}"
    assert sorted(checkout.rglob("*")) == names


@pytest.mark.parametrize(
    ("compiler", "words"),
    [("no-such-compiler", "No such file"), ("false", "`false`: it failed"), ("c++ -Dint=@", "error")],
)
def test_a_kernel_that_cannot_be_built_is_told(checkout: Path, compiler: str, words: str) -> None:
    told = loaded(checkout, CXX=compiler)
    assert "the compiled kernel cannot be made" in told
    assert words in told
    assert not list((checkout.parent / "cache" / "sqrp").iterdir())


@pytest.mark.trial
@pytest.mark.skipif(not shutil.which("c++"), reason="no compiler")
def test_the_kernel_needs_nothing_of_the_c_plus_plus_library(checkout: Path) -> None:
    shutil.copy(ROOT / "sqrp_cli" / "kernel" / "sight.cpp", checkout / "sqrp_cli" / "kernel")
    built = loaded(checkout, CXX="c++ -nostdinc++ -nodefaultlibs -Wl,--no-undefined,--no-as-needed -lm -lc")
    assert Path(built).suffix == ".so"


def test_each_platform_has_its_own_name() -> None:
    names = {library.library_name(*where) for where in [("linux", "x86_64"), ("linux", "aarch64"), ("darwin", "arm64")]}
    assert len(names) == 3
