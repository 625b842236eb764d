"""The README shows what the commands print, at 80 columns and without colour. Run as a script, this writes it there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = ROOT / "README.md"
BLOCK = re.compile(r"```console\n\$ (?P<command>[^\n]*)\n(?P<output>.*?)```", re.DOTALL)


def printed(command: str) -> str:
    """What a command prints on stdout, in a terminal of 80 columns without colour, in a folder that may be written to.

    The folder looks like the repository's otherwise.
    """
    with tempfile.TemporaryDirectory() as name:
        for part in ("skills", "workspaces"):
            (Path(name) / part).symlink_to(ROOT / part)
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        environment = {**os.environ, "COLUMNS": "80", "NO_COLOR": "1", "PATH": path}
        run = subprocess.run(["sh", "-c", command], cwd=name, env=environment, capture_output=True, text=True)  # noqa: S607
    assert run.returncode == 0, run.stderr
    return run.stdout


def blocks() -> list[tuple[str, str]]:
    """The commands of the README with the output that it shows."""
    return [(match["command"], match["output"]) for match in BLOCK.finditer(README.read_text())]


@pytest.mark.parametrize(("command", "output"), blocks(), ids=[command for command, _ in blocks()])
def test_the_readme_shows_what_the_command_prints(command: str, output: str) -> None:
    assert printed(command) == output


def test_the_readme_shows_the_main_commands() -> None:
    shown = {command.split("&&")[-1].split()[1] for command, _ in blocks()}
    assert shown >= {"rank", "explain", "check", "program", "score"}


if __name__ == "__main__":
    README.write_text(
        BLOCK.sub(lambda match: f"```console\n$ {match['command']}\n{printed(match['command'])}```", README.read_text())
    )
