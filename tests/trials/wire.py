"""A cell on the wire, in a process of its own, against the same in simulation.

Slips are seen within a frame and 20 ms of when they are seen in simulation, with the same outcome. Where cameras or
joint states stay out, repeat themselves or are late, the arm stands within 0.5 s, by the cell; after `kill -9` of the
run within a second of the cell's own clock. Cells that are not as the program says are refused with the figure.
"""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from tests.cells import ROOT, shipped_cell, write_cell

FRAME, PROCESSING, STANDING, AFTER_A_KILL = 0.1, 0.02, 0.5, 1.0
"""[s]"""
PACE = 0.5
"""Of the cell's clock against that of the wall, so that a busy machine keeps up."""
CAMERAS, SLIPS = ("cam3", "cam6"), 20
LOSSES = (
    "camera-loss:cam3@{}", "frozen:cam6@{}", "latency:cam3=0.4", "joints-loss@{}", "joints-frozen@{}",
    "joints-latency=0.4",
)  # fmt: skip


OTHERWISE: tuple[tuple[str, str, tuple[Any, ...], object], ...] = (
    ("a joint is off by 1 degree", "1.00 deg from where", ("robot", "home", "elbow_joint"), "111 deg"),
    ("wrong K", "fx of its CameraInfo", ("cameras", "cam3", "image", "horizontal_fov"), "35 deg"),
    ("wrong resolution", "160x120", ("cameras", "cam3", "image"), {"width": 160, "height": 120}),
    ("a camera moved by 2 cm", "20.0 mm", ("cameras", "cam6", "pose", "position", 2), 0.539),
    ("half the images", "images a second", ("cameras", "cam3", "rate"), 5),
)
"""One thing each in which a cell differs from the workspace of the program, and the figure by which it is refused."""


def _sqrp(*words: object) -> list[str]:
    return [sys.executable, "-m", "sqrp_cli", *map(str, words)]


def small_cell(folder: Path) -> Path:
    """`tabletop` with two cameras and small images, which a busy computer can simulate in time."""
    document = shipped_cell("tabletop")
    document["cameras"] = {name: document["cameras"][name] for name in CAMERAS}
    for camera in document["cameras"].values():
        camera["image"].update(width=320, height=240)
    document["skills"] = [str(ROOT / "skills" / "pickup")]
    (folder / "cell").mkdir(exist_ok=True)
    return write_cell(document, folder / "cell")


def prepare(shared: Path) -> None:
    """The cell, and its program."""
    subprocess.run(
        _sqrp("rank", small_cell(shared), "pickup g2", "--program", shared / "pick.yaml"), check=True, stdout=-3
    )


@dataclass
class Served:
    """A cell that is served, and what it has said."""

    program: Path
    config: Path
    log: Path

    def times(self, what: str) -> list[float]:
        return [float(found[1]) for found in re.finditer(rf"([\d.]+) s: [^\n]*{what}", self.log.read_text())]

    def run(self, *more: object) -> tuple[int, dict[str, Any], str]:
        command = _sqrp("run", self.program, "--robot", self.config, "--yes", "--json", *more)
        found = subprocess.run(command, capture_output=True, text=True)
        return found.returncode, json.loads(found.stdout) if found.stdout.strip() else {}, found.stderr

    def now(self) -> float:
        """The time of the cell, from its beginning [s]."""
        from sqrp_cli.ros.dds import DdsTransport
        from sqrp_cli.ros.messages import nanoseconds
        from sqrp_cli.run.cell.ros_cell import CLOCK

        transport = DdsTransport(yaml.safe_load(self.config.read_text()).get("domain", 0), "127.0.0.1")
        inbox = transport.subscribe(CLOCK)
        while not inbox.count:
            transport.wait(0.1)
        t = nanoseconds(inbox.take()[-1][0].clock)
        transport.close()
        (start,) = re.findall(r"time 0 is ([\d.]+)", self.log.read_text())
        return t * 1e-9 - float(start)


@contextmanager
def _served(folder: Path, *words: object, workspace: Path | None = None) -> Iterator[Served]:
    shared, config, log = folder.parent, folder / "robot.yaml", folder / "log"
    command = ["cell", workspace or shared / "cell", "--serve", "ros2", "--config", config, "--pace", PACE, *words]
    with log.open("w") as out:
        process = subprocess.Popen(_sqrp(*command), stderr=out, text=True)
        try:
            while not config.exists():
                assert process.poll() is None, log.read_text()
                time.sleep(0.1)
            yield Served(shared / "pick.yaml", config, log)
        finally:
            process.kill()
            process.wait()


def wire(number: int, folder: Path) -> dict[str, Any]:
    """A slip in the middle of one of equal parts of the lift, against a sweep in simulation."""
    program, sweep = folder.parent / "pick.yaml", folder.parent / "sweep.json"
    if not sweep.exists():
        command = _sqrp("run", program, "--sim", "--sweep", "slip@a4", "--n", SLIPS, "--json")
        sweep.write_text(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
    one, log = json.loads(sweep.read_text())["runs"][number], folder / "run.jsonl"
    with _served(folder, "--program", program, "--fault", f"slip@{one['x']:.3f}") as cell:
        code, document, err = cell.run("--log", log)
    events = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    begun = [event["t"] for event in events if event.get("event") == "primitive"]
    seen = [fault["detected"] for fault in document.get("faults", []) if fault["detected"] is not None]
    there = None if one["detected"] is None else one["detected"] - one["injected"] + one["x"]
    here = seen[0] - begun[0] if seen and begun else None
    close = there == here if None in (here, there) else abs(here - there) <= FRAME + PROCESSING
    good = close and code == (0 if one["outcome"] == "done" else 3)
    more = "" if good else f": {document.get('reason')} {err[-200:]}"
    return {"said": f"slip {one['x']:.3f}  sim {there}  wire {here}  exit {code}{more}", "good": good}


def losses(number: int, folder: Path) -> dict[str, Any]:
    """Cameras or joint states stay out, repeat themselves or are late."""
    t = f"{random.Random(number).uniform(0.8, 2.4):.3f}"  # noqa: S311
    fault = LOSSES[number % len(LOSSES)].format(t)
    with _served(folder, "--program", folder.parent / "pick.yaml", "--fault", fault) as cell:
        code, document, err = cell.run()
        time.sleep(1.0 / PACE)
        happened, stands = cell.times("made to happen"), cell.times("the arm stands")
    late = stands[-1] - happened[0] if happened and stands else float("inf")
    said = f"{fault:24} exit {code}  standing after {late:.3f} s: {document.get('reason', err[-200:])}"
    return {"said": said, "good": code == 3 and late <= STANDING}


def kills(number: int, folder: Path) -> dict[str, Any]:
    """`kill -9` of the run."""
    with _served(folder, "--program", folder.parent / "pick.yaml") as cell:
        run = subprocess.Popen(_sqrp("run", cell.program, "--robot", cell.config, "--yes"), stdout=-3, stderr=-3)
        while not cell.times("the arm moves"):
            time.sleep(0.02)
            assert run.poll() is None
        time.sleep(random.Random(number).uniform(0.2, 2.0) / PACE)  # noqa: S311
        killed = cell.now()
        run.kill()
        run.wait()
        time.sleep(1.5 / PACE + 0.5)
        late = cell.times("the arm stands")[-1] - killed
    return {"said": f"killed at {killed:.2f} s: stands {late:.3f} s later", "good": late <= AFTER_A_KILL}


def refusals(number: int, folder: Path) -> dict[str, Any]:
    """A cell that is otherwise than the workspace of the program in one thing."""
    what, figure, (*keys, last), value = OTHERWISE[number]
    other = at = yaml.safe_load((folder.parent / "cell" / "workspace.yaml").read_text())
    for key in keys:
        at = at[key]
    at[last] = {**at[last], **value} if isinstance(value, dict) else value
    with _served(folder, workspace=write_cell(other, folder)) as cell:
        code, _, err = cell.run()
    said = next((line for line in err.splitlines() if figure in line), err[-300:])
    return {"said": f"{what:28} exit {code}  {said}", "good": code == 2 and figure in err}
