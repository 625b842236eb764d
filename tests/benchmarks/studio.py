"""How fast the studio follows a hand: `python -m tests.benchmarks.studio [tabletop|crowded]`. Needs Chromium.

On `tabletop`, and on the same with 24 cameras and 200 objects: from the command to the page's address, to the first
picture, to the ranking; from a movement of the pointer to the timeline that it makes (100 steps); from the hand's rest
to the ranking of all.
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from tests.cells import copied, read_cell, write_cell
from tests.cli.browser import chromium
from tests.studio.hand import WHERE, Hand, Started

STEPS = 100


def crowded(cell: Path, cameras: int, objects: int) -> Path:
    """The cell with more of everything: cameras around it, and small boxes at the edges of the table."""
    data = read_cell(cell)
    seen, things = data["cameras"], data["objects"]
    for number in range(cameras - len(seen)):
        like = seen[f"cam{1 + number % 6}"]
        x, y, z = like["pose"]["position"]
        position = [round(x + 0.15 * (1 + number // 6), 3), y, round(z + 0.1, 3)]
        seen[f"more{number}"] = {**like, "pose": {**like["pose"], "position": position}}
    for number in range(objects - len(things)):
        at = [round(-1.1 + 0.03 * (number % 70), 3), round(-0.95 + 0.04 * (number // 70), 3), 0.01]
        size = [0.02, 0.02, 0.02]
        things[f"box{number}"] = {"type": "box", "color": "blue", "size": size, "pose": {"position": at}, "on": "table"}
    write_cell(data, cell)
    return cell


def measured(browser: object, cell: Path, task: str) -> dict[str, float]:
    """The figures of a cell [s]."""
    began = time.perf_counter()
    started = Started(cell, task)
    found = {"address": time.perf_counter() - began}
    page = browser.new_context(viewport={"width": 1400, "height": 900}).new_page()  # type: ignore[attr-defined]
    page.goto(started.address)
    page.wait_for_selector("html[data-drawn=true]", timeout=60_000)
    found["first picture"] = time.perf_counter() - began
    page.close()
    hand = Hand(browser, started.address)
    found["ranking and timeline"] = time.perf_counter() - began
    hand.wait("return sqrp.settled")
    hand.page.wait_for_timeout(1500)
    hand.take("camera", "cam3")
    x, y = hand.js(WHERE, "x")
    hand.page.mouse.move(x, y)
    hand.page.mouse.down()
    for step in range(STEPS):
        hand.page.mouse.move(x + 0.7 * step, y + 0.2 * step)
        hand.wait("return sqrp.latencies.length > x", step)
    delays = sorted(hand.js("sqrp.latencies"))
    found["timeline, median"] = statistics.median(delays) / 1e3
    found["timeline, 95 of 100 within"] = delays[int(0.95 * len(delays)) - 1] / 1e3
    began = time.perf_counter()
    hand.page.mouse.up()
    hand.wait("return sqrp.state.dirty && sqrp.settled")
    found["ranking after rest"] = time.perf_counter() - began
    assert hand.complaints == []
    assert started.closed()[0] == 0
    return found


def main() -> None:
    """Print the figures of the cells: `tabletop`, `crowded`, both by default."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        small = copied(Path(folder) / "small", "tabletop")
        large = crowded(copied(Path(folder) / "large"), 24, 200)
        cells = {"tabletop": small, "crowded": large}
        for name, cell in ((name, cells[name]) for name in sys.argv[1:] or cells):
            figures = measured(browser, cell, "pickup green")
            print(f"{name} (load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)")
            for what, seconds in figures.items():
                print(f"  {what:28} {seconds:6.2f} s")


if __name__ == "__main__":
    main()
