"""A studio in a process of its own, as a user starts it."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


class Started:
    """`sqrp studio` of a workspace; `closed` ends it as Ctrl-C does."""

    def __init__(self, workspace: Path, *arguments: str, cwd: Path = ROOT) -> None:
        command = [sys.executable, "-m", "sqrp_cli", "studio", str(workspace), "--no-browser", *arguments]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(command, text=True, cwd=cwd, env=environment, preexec_fn=_heed_ctrl_c, **pipes)
        assert self.process.stdout is not None
        ready, _, _ = select.select([self.process.stdout], [], [], 180)
        self.address = self.process.stdout.readline().strip() if ready else ""
        if not self.address:
            self.process.kill()
            raise AssertionError(self.process.communicate()[1])
        self.host, _, self.token = self.address.removeprefix("http://").strip("/").partition("/")

    def closed(self) -> tuple[int, str]:
        """Its exit code, and what it printed on stderr."""
        self.process.send_signal(signal.SIGINT)
        _, err = self.process.communicate(timeout=120)
        return self.process.returncode, err


def _heed_ctrl_c() -> None:
    """Ctrl-C ends it, even where a shell that runs tests in the background ignores it."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
