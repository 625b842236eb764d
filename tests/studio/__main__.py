"""A hand that does anything, for minutes: `python -m tests.studio [MINUTES]`; part of `make trials`.

Nothing may be complained about in the browser or by the server, and memory stays flat.
"""

from __future__ import annotations

import random
import sys
import tempfile
import time
from pathlib import Path

import psutil

from tests.cli.browser import chromium
from tests.studio.hand import Hand
from tests.studio.started import Started, copied

MINUTES = 30.0
TASKS = ("pickup object=g2,g6", "pickup g3", "pickup red", "pickup nothing", "place")
THINGS = "[...document.querySelectorAll('#what option')].map((one) => JSON.parse(one.value))"
CLICK = "(id) => document.getElementById(id).click()"
CHOOSE = """(share) => {
  const rows = document.querySelectorAll('#ranking tbody tr');
  rows[Math.floor(share * rows.length)]?.click();
}"""
ACTIONS = {
    "drag": 30,
    "type": 10,
    "undo": 12,
    "redo": 8,
    "choose": 8,
    "look": 6,
    "task": 4,
    "save": 4,
    "outside": 3,
    "broken": 2,
    "play": 4,
    "stop": 2,
    "advise": 1,
}
"""What a hand does, and how often."""

MOST_GROWTH = 1.3
"""Most that memory may grow after the first fifth of the time, as a factor."""


def memory(pid: int) -> float:
    """Of a process and all that it has started, shared pages once [MB]."""
    main = psutil.Process(pid)
    total = 0
    for process in (main, *main.children(recursive=True)):
        try:
            total += process.memory_full_info().pss
        except psutil.Error:
            continue
    return total / 1e6


def act(hand: Hand, draw: random.Random, folder: Path, good: bytes) -> str:
    """Do one thing; returns what."""
    file = folder / "workspace.yaml"
    what = draw.choices(list(ACTIONS), list(ACTIONS.values()))[0]
    match what:
        case "drag":
            kind, name = draw.choice(hand.js(THINGS))
            hand.js("sqrp.look(null)")
            hand.take(kind, name)
            role = draw.choice(["x", "y", "z", "level", "aim" if kind == "camera" else "turn"])
            hand.drag(role, draw.uniform(-40, 40), draw.uniform(-30, 30), steps=draw.randint(1, 12))
        case "type":
            fields = hand.page.locator("#fields input")
            one = fields.nth(draw.randrange(fields.count()))
            one.fill(f"{draw.uniform(-2, 60):.2f}")
            one.press("Enter")
        case "undo" | "redo":
            hand.js(CLICK, what)  # does nothing where there is nothing to do
        case "choose":
            hand.js(CHOOSE, draw.random())
        case "look":
            hand.js("(name) => sqrp.look(name)", draw.choice([None, "cam1", "cam4"]))
        case "task":
            hand.page.fill("#task", draw.choice(TASKS))
            hand.page.keyboard.press("Enter")
        case "save":
            hand.js(CLICK, "save")
            hand.page.wait_for_timeout(500)
            hand.js(CLICK, draw.choice(["save-now", "save-not"]))
        case "outside":
            file.write_bytes(good.replace(b"rate: 10 Hz", f"rate: {draw.randint(5, 30)} Hz".encode(), 1))
        case "broken":
            file.write_bytes(good[: draw.randrange(100, len(good))])
            time.sleep(draw.uniform(0, 1))
            file.write_bytes(good)
        case "play":
            hand.js(CLICK, "play")
        case "advise" | "stop":
            hand.js("(what) => sqrp.tell({ do: what })", what)
    return what


def main(minutes: float) -> int:
    """Run; returns the exit code."""
    draw = random.Random(0)  # noqa: S311 - the same actions every time
    counts: dict[str, int] = {}
    sizes: list[float] = []
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        cell = copied("tabletop", Path(folder))
        good = (cell / "workspace.yaml").read_bytes()
        started = Started(cell, "pickup object=g2,g6")
        hand = Hand(browser, started.address)
        end = time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            what = act(hand, draw, cell, good)
            counts[what] = counts.get(what, 0) + 1
            hand.page.wait_for_timeout(draw.choice([0, 20, 300]))
            if sum(counts.values()) % 20 == 0:
                sizes.append(memory(started.process.pid))
        heap = hand.js("performance.memory.usedJSHeapSize / 1e6")
        (cell / "workspace.yaml").write_bytes(good)
        code, err = started.closed()
    first, rest = sizes[: len(sizes) // 5 + 1], sizes[len(sizes) // 5 + 1 :]
    print(f"{sum(counts.values())} actions in {minutes:g} min: {counts}")
    print(f"server {max(first):.0f} MB at first, {max(rest):.0f} MB after, {sizes[-1]:.0f} MB at the end")
    print(f"page {heap:.0f} MB")
    print(f"console: {hand.complaints or 'nothing'}; exit code {code}")
    flat = max(rest) < MOST_GROWTH * max(first)
    quiet = not hand.complaints and code == 0 and "Traceback" not in err and "internal error" not in err
    if not quiet:
        print(err[-3000:])
    return 0 if flat and quiet else 1


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES))
