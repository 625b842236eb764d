"""A browser in the studio, and a hand that drags things in its picture."""

from __future__ import annotations

from typing import Any

from tests.cli.browser import Listened

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
