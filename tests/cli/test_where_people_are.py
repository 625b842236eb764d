"""Other doors than the command line: packages, a GitHub action, a hook for commits, schemas for editors."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
SQRP = f'#!/bin/sh\nexec {sys.executable} -m sqrp_cli "$@"\n'
GH = """#!/bin/sh
printf '%s\\n' "$*" >> calls
case $* in *--jq*) cat own ;; esac
"""


@pytest.fixture
def shell(tmp_path):
    """Runs a command with `sqrp` and a `gh` that only notes its calls, in a folder of its own."""
    for name, text in (("sqrp", SQRP), ("gh", GH)):
        file = tmp_path / "bin" / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        file.chmod(0o755)
    environment = os.environ | {"PATH": f"{tmp_path / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}

    def run(*command: str, **variables: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command, cwd=tmp_path, env=environment | variables, capture_output=True, text=True, timeout=60, check=False
        )

    return run


def test_the_packages_have_every_file_that_is_no_python():
    patterns = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]["sqrp_cli"]
    for folder, folders, names in os.walk(ROOT / "sqrp_cli", followlinks=True):
        folders[:] = [one for one in folders if one != "__pycache__"]
        for name in (one for one in names if not one.endswith((".py", ".so"))):
            file = Path(folder, name).relative_to(ROOT / "sqrp_cli").as_posix()
            assert any(fnmatch(file, one.replace("**/*", "*")) for one in patterns), file


def test_a_commit_checks_each_workspace_file(shell, own_watch):
    (hook,) = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    sound, broken = own_watch / "workspace.yaml", own_watch / "other.yaml"
    broken.write_text(sound.read_text().replace("near: 50 cm", "near: 50 kg"))
    entry = shlex.split(hook["entry"])
    assert shell(*entry, str(sound)).returncode == 0
    found = shell(*entry, str(broken), str(sound))
    assert found.returncode == 1
    assert "50 kg" in found.stderr


@pytest.mark.parametrize(("own", "least", "code"), [("", "60 %", 0), ("7\n8\n", "60 %, max_time: 1 s", 1)])
def test_the_action_scores_and_writes_its_one_comment(shell, own_watch, tmp_path, own, least, code):
    file = own_watch / "workspace.yaml"
    file.write_text(file.read_text().replace("min_q_avg: 60 %", f"min_q_avg: {least}"))
    *_, score = yaml.safe_load((ROOT / "action.yml").read_text())["runs"]["steps"]
    assert "${{" not in score["run"]  # what others wrote is no part of the script
    (tmp_path / "own").write_text(own)
    variables = {"PATHS": "watch", "BASELINE": "", "OPTIONS": "--jobs 1", "GH_TOKEN": "secret", "NUMBER": "3"}
    variables |= {"RUNNER_TEMP": str(tmp_path), "GITHUB_REPOSITORY": "us/cells"}
    variables |= {"GITHUB_STEP_SUMMARY": str(tmp_path / "summary"), "GITHUB_OUTPUT": str(tmp_path / "output")}
    assert set(score["env"]) == {"COLUMNS", "PATHS", "BASELINE", "OPTIONS", "GH_TOKEN", "NUMBER"}
    done = shell("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", score["run"], **variables)
    scores = json.loads((tmp_path / "sqrp-scores.json").read_text())
    assert (done.returncode, scores["passed"]) == (code, code == 0)
    assert "watch green" in done.stdout
    assert (tmp_path / "summary").read_text().startswith("## SQRP: ")
    calls = (tmp_path / "calls").read_text().splitlines()
    place = "issues/comments/7 --silent --method PATCH" if own else "issues/3/comments --silent"
    assert calls[-1] == f"api repos/us/cells/{place} --field body=@{tmp_path / 'sqrp-scores.md'}"


def test_a_new_workspace_names_the_schema_beside_it(started):
    folder, _ = started
    first, _, _ = (folder / "workspace.yaml").read_text().partition("\n")
    schema = json.loads((folder / first.removeprefix("# yaml-language-server: $schema=")).read_text())
    assert "cameras" in schema["properties"]
