"""Kept results count as long as the program that computed them is the same, wherever its parts lie."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

import sqrp_cli
from sqrp_cli.score.kept import code_digest

PACKAGE = Path(sqrp_cli.__file__).parent
CODE = sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*") if path.suffix == ".py")


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return Path(shutil.copytree(PACKAGE, tmp_path / "package", ignore=shutil.ignore_patterns("__pycache__")))


def test_a_copy_of_the_package_is_the_same_program(package: Path) -> None:
    assert code_digest(package) == code_digest(PACKAGE)


@pytest.mark.parametrize("file", CODE[:: len(CODE) // 20], ids=str)
def test_a_change_of_any_file_is_another_program(package: Path, file: Path) -> None:
    (package / file).write_bytes((package / file).read_bytes() + b"\n")
    assert code_digest(package) != code_digest(PACKAGE)


def test_a_folder_with_another_name_is_digested_like_every_other(package: Path) -> None:
    moved = (package / "study").rename(package / "planning")
    renamed = code_digest(package)
    assert renamed != code_digest(PACKAGE)
    (moved / "quality.py").write_text("")
    assert code_digest(package) != renamed
