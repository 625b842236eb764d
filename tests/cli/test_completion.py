"""What bash and zsh propose while a command is typed."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pexpect
import pytest

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.task.task import read_task

PROGRAM = shutil.which("sqrp", path=str(Path(sys.executable).parent)) or ""
SHELLS = [
    shell if shutil.which(shell) else pytest.param(shell, marks=pytest.mark.skip(reason=f"there is no {shell}"))
    for shell in ("bash", "zsh")
]
SETTINGS = {
    "bash": 'bind "set enable-bracketed-paste off"',
    "zsh": "unset zle_bracketed_paste; autoload -Uz compinit; compinit -u -D",
}


@pytest.fixture
def proposed(sqrp, monkeypatch):
    """What bash is told to propose for the last of these words."""

    def ask(*words: str) -> list[str]:
        monkeypatch.setenv("_SQRP_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", "\n".join(("sqrp", *words)))
        monkeypatch.setenv("COMP_CWORD", str(len(words)))
        outcome = sqrp()
        assert (outcome.code, outcome.err) == (0, "")
        return outcome.out.split("\n")[:-1]

    return ask


def test_words_and_tasks_are_proposed_as_a_shell_takes_them(proposed, tabletop):
    # Commands and options are proposed.
    assert proposed("ra") == ["rank"]
    assert proposed("rank", "cell", "pickup", "--ca") == ["--calibration"]
    # A task goes on word by word and each proposal is one.
    workspace = load_workspace(tabletop)
    assert proposed("rank", str(tabletop), '"st') == ["stack"]
    found = proposed("rank", str(tabletop), '"pickup ')
    assert {"pickup g1", "pickup green", "pickup speed=1", "pickup then"} <= set(found)
    for text in found:
        if not text.endswith(("=", " then")):
            assert read_task(text, workspace).candidates
    # Of a task of several steps the last is completed.
    found = proposed("rank", str(tabletop), '"pickup g1 then stack g1 g')
    assert "pickup g1 then stack g1 g2" in found
    assert all(text.startswith("pickup g1 then stack g1 g") for text in found)
    # An unquoted task is proposed in quotes.
    assert proposed("rank", str(tabletop), "pickup\\ gr") == ["'pickup green'"]
    assert "'pickup green'" in proposed("rank", str(tabletop), "pick")
    assert proposed("rank", str(tabletop), "'pickup gr") == ["pickup green"]
    # Candidates cameras codes and schemas are proposed.
    assert proposed("explain", str(tabletop), '"pickup green"', "--choose", "g") == [f"g{n}" for n in range(1, 7)]
    assert proposed("place", str(tabletop), "--keep", "cam") == [f"cam{n}" for n in range(1, 7)]
    assert proposed("rules", "wrong-u") == ["wrong-unit"]
    assert proposed("schema", "work") == ["workspace"]


@pytest.mark.parametrize(
    "words", [("rank", "nowhere", "pick"), ("rank", "a'b", '"x'), ("explain", "x", "y", "--choose", "")]
)
def test_where_nothing_can_be_read_nothing_is_proposed(proposed, words):
    assert proposed(*words) == []


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "pwsh"])
def test_the_completion_of_a_shell_that_is_named_is_shown(sqrp, shell):
    shown = sqrp("--show-completion", shell)
    assert (shown.code, shown.err) == (0, "")
    assert f"complete_{'powershell' if shell == 'pwsh' else shell}" in shown.out
    assert sqrp(f"--show-completion={shell}", "-q") == shown


def test_completion_is_installed_for_the_shell_that_is_named(sqrp, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    said = sqrp("--install-completion", "fish").out
    file = tmp_path / ".config/fish/completions/sqrp.fish"
    assert str(file) in said.replace("\n", "")
    assert file.read_text() == sqrp("--show-completion", "fish").out


@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_completes_a_task_with_a_blank_in_it(shell, tabletop, tmp_path):
    options = ["--norc", "--noprofile", "-i"] if shell == "bash" else ["-f", "-i"]
    path = f"{Path(PROGRAM).parent}{os.pathsep}{os.environ['PATH']}"
    terminal = pexpect.spawn(
        shell,
        options,
        env={**os.environ, "PATH": path, "TERM": "dumb", "HOME": str(tmp_path)},
        encoding="utf-8",
        dimensions=(50, 250),
        timeout=60,
    )
    terminal.sendline(f'PS1="READY> "; {SETTINGS[shell]}; eval "$(sqrp --show-completion {shell})"; echo do""ne')
    terminal.expect("done\r")
    terminal.expect("READY> ")
    terminal.send(f'sqrp rank {tabletop} "pickup gr\t')
    terminal.expect_exact('pickup green" ')
    terminal.close(force=True)
