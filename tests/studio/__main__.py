"""A hand that does anything, for minutes: `python -m tests.studio [MINUTES]`; part of `make trials`.

Nothing may be complained about in the browser or by the server, and memory stays flat. It is measured at rest, after
every tenth action: nothing is ranked, searched or run, so that the server and the process that computes are all that
is left. Their own memory counts (`Pss_Anon` and `Pss_Shmem` of the system): which share of the libraries is theirs
depends on what else runs on the machine. The first fifth of the measures is for what is loaded once. After that the
last fifth may be above the second one by `MOST_GROWTH` at most (medians); and no measure may be above the first fifth
by more than `MOST_PEAK`. The same holds for the page, after its garbage collection.
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
import time
from pathlib import Path

import psutil

from tests.cells import copied
from tests.cli.browser import chromium
from tests.studio.hand import Hand, Started

MINUTES = 30.0
LONG = "place"  # a task of 162 candidates, whose ranking is not waited for
TASKS = ("pickup object=g2,g6", "pickup g3", "pickup red", "pickup nothing", LONG)
THINGS = "[...document.querySelectorAll('#what option')].map((one) => JSON.parse(one.value))"
CLICK = "(id) => document.getElementById(id).click()"
CHOOSE = """(share) => {
  const rows = document.querySelectorAll('#ranking tbody tr');
  rows[Math.floor(share * rows.length)]?.click();
}"""
UNSETTLED = """(({ state, ranked, asked, answered, held }) => ({ task: state.task, number: state.number, ranked, asked,
  answered, held, told: document.querySelector('#notices').innerText }))(sqrp)"""  # why a page does not come to rest
ACTIONS = {
    "drag": 30, "type": 10, "undo": 12, "redo": 8, "choose": 8, "look": 6, "task": 4, "save": 4, "outside": 3,
    "broken": 2, "play": 4, "stop": 2, "advise": 1, "run": 1,
}  # fmt: skip
"""What a hand does, and how often."""

MOST_GROWTH, MOST_PEAK = 1.1, 1.3  # most that memory may grow after the first fifth of the time, as factors
HEAP = ("usedSize", "embedderHeapUsedSize", "backingStorageSize")
"""What a page holds: values of its scripts, its elements, and the numbers of shapes."""
QUIET, WRITTEN = 60.0, 20.0  # how long it may take until everything rests, and is waited for a program [s]


def flat(who: str, sizes: list[float]) -> bool:
    """Whether memory stays, see above; prints it."""
    fifths = [sizes[k * len(sizes) // 5 : (k + 1) * len(sizes) // 5] for k in range(5)]
    medians = [statistics.median(part) for part in fifths]
    print(f"{who}: {', '.join(f'{one:.0f}' for one in medians)} MB in each fifth of the time, {max(sizes):.0f} at most")
    return medians[-1] <= MOST_GROWTH * medians[1] and max(sizes) < MOST_PEAK * max(fifths[0])


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
        case "run":  # the chosen candidate as a program, and what the tool holds is dropped
            program, end = folder / "pick.yaml", time.monotonic() + WRITTEN
            program.unlink(missing_ok=True)
            hand.js("sqrp.tell({ do: 'save' })")
            hand.js("(file) => sqrp.tell({ do: 'program', file })", str(program))
            while not program.exists() and time.monotonic() < end:  # never, where the candidate cannot be done
                hand.page.wait_for_timeout(500)
            if program.exists():
                hand.js("(file) => sqrp.tell({ do: 'run', file, faults: [] })", str(program))
                hand.page.wait_for_timeout(8000)
                hand.js(CLICK, "run-slip")
                hand.page.wait_for_timeout(4000)
    return what


def measured(hand: Hand, pid: int) -> tuple[float, float]:
    """Memory of a studio and of its page at rest, shared pages once [MB]."""
    hand.js("sqrp.tell({ do: 'stop' })")
    if hand.js("sqrp.state.task") == LONG:
        hand.js("(text) => sqrp.tell({ do: 'task', text, by: 'q_eoi' })", TASKS[0])
        hand.wait("return sqrp.state.task === x", TASKS[0])
    try:
        hand.ranked()
    except Exception:
        print(hand.js(UNSETTLED), hand.complaints)
        psutil.Process(pid).terminate()
        raise
    hand.page.wait_for_timeout(1000)
    devtools = hand.context.new_cdp_session(hand.page)
    for _ in range(2):  # what scripts and elements hold of each other goes in the second one
        devtools.send("HeapProfiler.collectGarbage")
    heap = devtools.send("Runtime.getHeapUsage")
    devtools.detach()
    main, end, kinds = psutil.Process(pid), time.monotonic() + QUIET, ("Pss_Anon:", "Pss_Shmem:")
    while len(main.children(recursive=True)) > 1:
        assert time.monotonic() < end, "the studio does not come to rest"
        time.sleep(0.2)
    rollups = [Path(f"/proc/{one.pid}/smaps_rollup").read_text(encoding="utf-8") for one in (main, *main.children())]
    server = sum(int(part.partition(kind)[2].split()[0]) for part in rollups for kind in kinds) * 1024
    return server / 1e6, sum(heap[part] for part in HEAP) / 1e6


def main(minutes: float) -> int:
    """Run; returns the exit code."""
    draw = random.Random(0)  # noqa: S311 - the same actions every time
    counts: dict[str, int] = {}
    sizes: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        cell = copied(Path(folder), "tabletop")
        good = (cell / "workspace.yaml").read_bytes()
        started = Started(cell, "pickup object=g2,g6")
        hand = Hand(browser, started.address)
        end = time.monotonic() + 60 * minutes
        while time.monotonic() < end:
            what = act(hand, draw, cell, good)
            counts[what] = counts.get(what, 0) + 1
            hand.page.wait_for_timeout(draw.choice([0, 20, 300]))
            if sum(counts.values()) % 10 == 0:
                sizes.append(measured(hand, started.process.pid))
        (cell / "workspace.yaml").write_bytes(good)
        code, err = started.closed()
    print(f"{sum(counts.values())} actions in {minutes:g} min: {counts}")
    enough = len(sizes) >= 5
    if not enough:
        print(f"memory was measured {len(sizes)} times, too few to tell whether it is flat: 5 take some minutes")
    steady = [flat(who, [one[k] for one in sizes]) for k, who in enumerate(("server", "page"))] if enough else [False]
    print(f"console: {hand.complaints or 'nothing'}; exit code {code}")
    quiet = not hand.complaints and code == 0 and "Traceback" not in err and "internal error" not in err
    if not quiet:
        print(err[-3000:])
    return 0 if all(steady) and quiet else 1


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else MINUTES))
