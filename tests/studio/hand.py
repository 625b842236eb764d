"""A studio in a process of its own, as a user starts it, and a hand that drags things in its picture in a browser."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from tests.cli.browser import Listened

ROOT = Path(__file__).parents[2]
WHERE = """(role) => {
  const { gizmo, scene } = sqrp;
  scene.render(); // a scene that is new has the eye of no picture until it is drawn
  const local = { x: [0.6, 0, 0], y: [0, 0.6, 0], z: [0, 0, 0.6], level: [0, 0, 0], turn: [0.53, -0.53, 0] }[role];
  const from = role === 'aim' ? gizmo.ball : gizmo.group;
  const point = from.position.clone().set(...(local ?? [0, 0, 0])).applyMatrix4(from.matrixWorld).project(scene.eye);
  const place = scene.host.getBoundingClientRect();
  return [place.left + ((point.x + 1) / 2) * place.width, place.top + ((1 - point.y) / 2) * place.height];
}"""


class Hand(Listened):
    """A page of the studio, with everything that it complained about."""

    def __init__(self, browser: Any, address: str, width: int = 1400, height: int = 900) -> None:
        super().__init__(browser, width, height)
        self.page.goto(address)
        self.ready()

    def wait(self, condition: str, argument: Any = None) -> None:
        """Wait until a condition holds; condition: the body of a function of `x`."""
        self.page.wait_for_function(f"(x) => {{ {condition} }}", arg=argument)

    def ready(self) -> None:
        """Wait for the ranking and for the chosen candidate over time."""
        self.page.wait_for_selector("html[data-ready=true]")

    def ranked(self) -> list[dict[str, Any]]:
        """The candidates, once those of the present text are there."""
        self.wait("return sqrp.settled")
        found: list[dict[str, Any]] = self.js("sqrp.entries.map((entry) => entry.candidate)")
        return found

    def take(self, kind: str, name: str) -> None:
        """Select what to move."""
        self.page.select_option("#what", value=f'["{kind}","{name}"]')

    def type(self, what: str, text: str) -> None:
        """Type into a field, by its label or its `#id`."""
        self.page.fill(what if what.startswith("#") else f"[aria-label='{what}']", text)
        self.page.keyboard.press("Enter")

    def drag(self, role: str, dx: float, dy: float, steps: int = 4, *, leave: bool = False) -> None:
        """Drag a handle by so many pixels, and let it go. leave: hold it still."""
        x, y = self.js(WHERE, role)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for step in range(1, steps + 1):
            self.page.mouse.move(x + dx * step / steps, y + dy * step / steps)
        if not leave:
            self.page.mouse.up()


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
