"""Pages that `--report` wrote: what they carry, and how they look in a headless Chromium without network."""

from __future__ import annotations

import base64
import json
import re
import shutil
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

FLAGS = [
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--disable-gpu", "--enable-unsafe-swiftshader",
]  # fmt: skip
"""For a browser that is run by root, asks no server for anything, and works as on a machine without a graphics card."""

PATIENCE = 180_000
"""How long anything may take before it counts as hanging [ms]: other tests may have all cores."""


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser; the test is skipped where there is none."""
    api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
    executable = shutil.which("chromium")
    if executable is None:
        pytest.skip("there is no Chromium; apt-get install chromium")
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=FLAGS)
        yield browser
        browser.close()


BEYOND = "beyond the last stop"
STOP = """() => {
  const stop = document.activeElement, { left, top, width, height } = stop.getBoundingClientRect();
  if (stop === document.body) return 'beyond the last stop';
  const hit = document.elementFromPoint(left + width / 2, top + Math.min(height / 2, 8));
  const marked = getComputedStyle(stop).outlineStyle !== 'none';
  const free = marked && hit && (stop.contains(hit) || hit.contains(stop));
  return free ? null : `${marked} ${stop.outerHTML.slice(0, 80)}`;
}"""
"""Where the keyboard is, unless that is marked and nothing lies above it."""


def walk(page: Any) -> None:
    """Go through a page by the tab key, from the first stop to beyond the last; each of them has to be in sight.

    A page of the studio is to be at rest: a ranking that comes takes the rows away, and the keyboard with them.
    """
    page.wait_for_function("() => !('settled' in sqrp) || (sqrp.settled && sqrp.detailShown)")
    page.evaluate("() => { document.activeElement.blur(); scrollTo(0, 0); }")
    for _ in range(
        1 + page.evaluate("document.querySelectorAll('a, button, input, select, summary, [tabindex]').length")
    ):
        page.keyboard.press("Tab")
        stop = page.evaluate(STOP)
        if stop == BEYOND:
            return
        assert stop is None, stop
    raise AssertionError("the tab key does not come to an end")


class Listened:
    """A page in the browser, with everything that it complained about."""

    def __init__(self, browser: Any, width: int, height: int, **settings: object) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": height}, **settings)
        self.context.set_default_timeout(PATIENCE)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.page.on("console", self._listen)
        self.page.on("pageerror", lambda error: self.complaints.append(error.stack or str(error)))
        self.page.on("dialog", lambda dialog: self.complaints.append(f"dialog {dialog.message}"))

    def _listen(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall" not in message.text:
            self.complaints.append(message.text)

    def js(self, expression: str, argument: Any = None) -> Any:
        """The value of an expression in the page."""
        return self.page.evaluate(expression, argument)


class Opened(Listened):
    """A page that `--report` wrote, with everything that it asked for, too."""

    def __init__(self, browser: Any, path: Path) -> None:
        super().__init__(browser, 1000, 700, offline=True)
        self.requests: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready=true]")

    def texts(self, selector: str) -> list[str]:
        """What the elements of a selector say."""
        return [text.strip() for text in self.page.locator(selector).all_inner_texts()]


def click_at_random(opened: Opened, seed: int, rounds: int = 40) -> str:
    """Click rows of the table, and what else there is to click, faster than pages load; the name of the last row.

    rounds: how often, with one to four rows each.
    """
    name = opened.js(_CLICKS, [seed, rounds])
    opened.page.wait_for_function("() => !sqrp.entries[sqrp.selected].moves || sqrp.motion")
    return str(name)


_CLICKS = """async ([seed, rounds]) => {
  let state = seed;
  const random = (n) => Math.floor(((state = (1664525 * state + 1013904223) % 4294967296) / 4294967296) * n);
  const visible = (selector) => [...document.querySelectorAll(selector)].filter((element) => element.offsetParent);
  let last;
  for (; rounds; rounds--) {
    for (let clicks = 1 + random(4); clicks; clicks--) {
      const others = visible('#study button, #study input, #study .lane, #theme');
      if (random(2) && others.length) others[random(others.length)].click();
      const rows = document.querySelectorAll('#ranking tbody tr');
      last = rows[random(rows.length)].querySelector('button');
      last.click();
    }
    if (random(3)) await new Promise((resolve) => setTimeout(resolve, random(40)));
  }
  return last.getAttribute('aria-label');
}"""


def detail_in(page: Path, number: int = 0) -> dict[str, Any]:
    """The document of one of the candidates of a page."""
    return carried(page, f"detail-{number}")


def overview_of(page: Path) -> dict[str, Any]:
    """What a page shows first."""
    return carried(page, "overview")


def carried(page: Path, name: str) -> dict[str, Any]:
    """A document that a page carries."""
    (data,) = re.findall(rf'id="{name}">([^<]*)<', page.read_text(encoding="utf-8"))
    document = json.loads(zlib.decompress(base64.b64decode(data)))
    assert isinstance(document, dict)
    return document
