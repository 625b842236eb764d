"""What a command loads before it begins: every module that it does not use is time that its user waits."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import sqrp_cli

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"

PROBE = """
import sys
from sqrp_cli.cli.main import run
code = run(sys.argv[2:])
print(code, *sorted(set(sys.argv[1].split(",")) & set(sys.modules)), file=sys.stderr)
"""

HEAVY = (
    "pinocchio", "asyncio", "multiprocessing", "distributed", "mujoco", "cv2", "ompl", "rich.progress", "http.client",
    "sqrp_cli.show.documents.scores", "sqrp_cli.score",
)  # fmt: skip
"""Modules that no ranking of cubes on a table needs."""

READING = ("numpy", "pydantic", "rich.console", "yaml", "coal")
"""Modules that wait until a workspace is read."""


def loaded(modules: tuple[str, ...], *arguments: str | Path) -> str:
    command = [sys.executable, "-c", PROBE, ",".join(modules), *map(str, arguments)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stderr.splitlines()[-1]


def test_a_ranking_loads_only_what_it_uses():
    assert loaded(HEAVY, "rank", str(TABLETOP), "pickup g2") == "0"


def test_help_is_there_before_anything_is_read():
    assert loaded((*HEAVY, *READING), "--help") == "0"


def test_byte_code_goes_to_the_cache_where_it_may_not_be_written_beside_the_sources(tmp_path: Path):
    plain = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(Path(sqrp_cli.__file__).parent, tmp_path / "sqrp_cli", ignore=plain)
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1", "XDG_CACHE_HOME": str(tmp_path / "cache"),
    }  # fmt: skip
    environment.pop("PYTHONPYCACHEPREFIX", None)
    subprocess.run([sys.executable, "-m", "sqrp_cli", "--help"], env=environment, cwd=tmp_path, check=True)
    assert list((tmp_path / "cache" / "sqrp" / "bytecode").rglob("app.*.pyc"))
    assert not list((tmp_path / "sqrp_cli").rglob("__pycache__"))


def test_a_saved_result_is_shown_without_what_found_it(tmp_path: Path):
    for question in (["explain"], ["advise", "--want", "q_eoi 100 %", "--kinds", "way"]):
        command = [sys.executable, "-m", "sqrp_cli", question[0], str(TABLETOP), "pickup g2", *question[1:], "--json"]
        (tmp_path / "found.json").write_bytes(subprocess.run(command, capture_output=True).stdout)
        assert (
            loaded(("sqrp_cli.motion", "sqrp_cli.robot", "sqrp_cli.cell", "yaml"), "show", tmp_path / "found.json")
            == "0"
        )
