"""Trials of a cell on the wire, each in processes of their own: `python -m tests.wire [--only PART]`.

`--share 1/2` and `2/2` make every other trial each, so that two cores or two sittings make all of them.

slips: as many slips as in simulation, seen within a frame and 20 ms of when they are seen there, with the same outcome.
losses: cameras and joint states that stay out, repeat themselves or are late; the arm stands within 0.5 s, by the cell.
kills: `kill -9` of the run; the arm stands within a second of the cell's own clock.
refusals: cells that are not as the program says; each is refused with the figure.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import yaml

from tests.cells import shipped_cell, write_cell

ROOT = Path(__file__).parents[2]
FRAME, PROCESSING = 0.1, 0.02
CAMERAS = ("cam3", "cam6")
LOSSES = (
    "camera-loss:cam3@{}", "frozen:cam6@{}", "latency:cam3=0.4", "joints-loss@{}", "joints-frozen@{}",
    "joints-latency=0.4",
)  # fmt: skip
STANDING, AFTER_A_KILL = 0.5, 1.0


def sqrp(*words: object) -> list[str]:
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


@dataclass
class Served:
    """A cell that is served, and what it has said."""

    process: subprocess.Popen[str]
    config: Path
    log: Path

    def times(self, what: str) -> list[float]:
        return [float(found[1]) for found in re.finditer(rf"([\d.]+) s: [^\n]*{what}", self.log.read_text())]


class Trials:
    def __init__(self, pace: float, folder: Path, share: slice, sweep: Path | None = None) -> None:
        self.pace, self.folder, self.share = pace, folder, share
        self.kept_sweep = sweep or folder / "sweep.json"
        self.workspace = small_cell(folder)
        self.program = folder / "pick.yaml"
        subprocess.run(sqrp("rank", self.workspace, "pickup g2", "--program", self.program), check=True, stdout=-3)
        self.number = 0

    @contextmanager
    def served(self, *faults: str, workspace: Path | None = None, program: bool = True) -> Iterator[Served]:
        self.number += 1
        config, log = self.folder / f"{self.number}.yaml", self.folder / f"{self.number}.log"
        words = ["cell", workspace or self.workspace, "--serve", "ros2", "--config", config, "--pace", self.pace]
        words += ["--program", self.program] if program else []
        with log.open("w") as out:
            process = subprocess.Popen(
                sqrp(*words, *(word for fault in faults for word in ("--fault", fault))), stderr=out, text=True
            )
            while not config.exists():
                assert process.poll() is None, log.read_text()
                time.sleep(0.1)
            try:
                yield Served(process, config, log)
            finally:
                process.kill()
                process.wait()

    def run(self, cell: Served, *more: object) -> tuple[int, dict, str]:
        found = subprocess.run(
            sqrp("run", self.program, "--robot", cell.config, "--yes", "--json", *more), capture_output=True, text=True
        )
        return found.returncode, json.loads(found.stdout) if found.stdout.strip() else {}, found.stderr

    def slips(self, count: int) -> bool:
        """Slips in the middles of equal parts of the lift, against a sweep in simulation."""
        if not self.kept_sweep.exists():
            sweep = sqrp("run", self.program, "--sim", "--sweep", "slip@a4", "--n", count, "--json")
            self.kept_sweep.write_text(subprocess.run(sweep, capture_output=True, text=True, check=False).stdout)
        good, runs = 0, json.loads(self.kept_sweep.read_text())["runs"][self.share]
        for one in runs:
            x = one["x"]
            log = self.folder / "run.jsonl"
            with self.served(f"slip@{x:.3f}") as cell:
                code, document, err = self.run(cell, "--log", log)
            begun = (
                [e["t"] for e in map(json.loads, log.open()) if e.get("event") == "primitive"] if log.exists() else []
            )
            log.unlink(missing_ok=True)
            seen = [f["detected"] for f in document.get("faults", []) if f["detected"] is not None]
            there = None if one["detected"] is None else one["detected"] - one["injected"] + x
            here = seen[0] - begun[0] if seen and begun else None
            close = there == here if None in (here, there) else abs(here - there) <= FRAME + PROCESSING
            same = code == (0 if one["outcome"] == "done" else 3)
            good += close and same
            print(
                f"slip {x:6.3f}  sim {there}  wire {here}  exit {code}",
                "ok" if close and same else f"NO: {document.get('reason')} {err[-200:]}",
                flush=True,
            )
        print(f"slips: {good} of {len(runs)} as in simulation")
        return good == len(runs)

    def losses(self, count: int) -> bool:
        good, draw = 0, random.Random(0)  # noqa: S311 # of trials
        times = [f"{draw.uniform(0.8, 2.4):.3f}" for _ in range(count)]
        faults = [LOSSES[number % len(LOSSES)].format(t) for number, t in enumerate(times)][self.share]
        for fault in faults:
            with self.served(fault) as cell:
                code, document, err = self.run(cell)
                time.sleep(1.0 / self.pace)
                happened, stands = cell.times("made to happen"), cell.times("the arm stands")
            late = stands[-1] - happened[0] if happened and stands else float("inf")
            well = code == 3 and late <= STANDING
            good += well
            print(
                f"{fault:24} exit {code}  standing after {late:.3f} s: {document.get('reason', err[-200:])}",
                "ok" if well else "NO",
                flush=True,
            )
        print(f"losses: {good} of {len(faults)} standing within {STANDING} s")
        return good == len(faults)

    def kills(self, count: int) -> bool:
        good, draw = 0, random.Random(1)  # noqa: S311 # of trials
        pauses = [draw.uniform(0.2, 2.0) for _ in range(count)][self.share]
        for pause in pauses:
            with self.served() as cell:
                run = subprocess.Popen(sqrp("run", self.program, "--robot", cell.config, "--yes"), stdout=-3, stderr=-3)
                while not cell.times("the arm moves"):
                    time.sleep(0.02)
                    assert run.poll() is None
                time.sleep(pause / self.pace)
                killed = cell_time(cell)
                run.send_signal(signal.SIGKILL)
                run.wait()
                time.sleep(1.5 / self.pace + 0.5)
                late = cell.times("the arm stands")[-1] - killed
            good += late <= AFTER_A_KILL
            print(
                f"killed at {killed:.2f} s: stands {late:.3f} s later  {'ok' if late <= AFTER_A_KILL else 'NO'}",
                flush=True,
            )
        print(f"kills: {good} of {len(pauses)} standing within {AFTER_A_KILL} s")
        return good == len(pauses)

    def refusals(self) -> bool:
        """Cells that differ from the workspace of the program in one thing each."""
        document = yaml.safe_load(self.workspace.read_text())
        cases = {
            "a joint is off by 1 degree": ("1.00 deg from where", ("robot", "home", "elbow_joint"), "111 deg"),
            "wrong K": ("fx of its CameraInfo", ("cameras", "cam3", "image", "horizontal_fov"), "35 deg"),
            "wrong resolution": ("160x120", ("cameras", "cam3", "image", "width"), 160),
            "a camera moved by 2 cm": ("20.0 mm", ("cameras", "cam6", "pose", "position", 2), 0.539),
            "half the images": ("images a second", ("cameras", "cam3", "rate"), 5),
        }  # fmt: skip
        good = 0
        for what, (figure, keys, value) in cases.items():
            other = json.loads(json.dumps(document))
            at = other
            for key in keys[:-1]:
                at = at[key]
            at[keys[-1]] = value
            if what == "wrong resolution":
                at["height"] = 120
            folder = self.folder / what.replace(" ", "-")
            folder.mkdir()
            write_cell(other, folder)
            with self.served(workspace=folder / "workspace.yaml", program=False) as cell:
                code, _, err = self.run(cell)
            well = code == 2 and figure in err
            good += well
            said = next((line for line in err.splitlines() if figure in line), err[-300:])
            print(f"{what:28} exit {code}  {said}  {'ok' if well else 'NO'}", flush=True)
        print(f"refusals: {good} of {len(cases)}")
        return good == len(cases)


def cell_time(cell: Served) -> float:
    """The time of a cell that is served, from its beginning [s]."""
    from sqrp_cli.ros.dds import DdsTransport
    from sqrp_cli.ros.messages import nanoseconds
    from sqrp_cli.run.cell.ros_cell import CLOCK

    about = yaml.safe_load(cell.config.read_text())
    transport = DdsTransport(about.get("domain", 0), "127.0.0.1")
    inbox = transport.subscribe(CLOCK)
    while not inbox.count:
        transport.wait(0.1)
    now = nanoseconds(inbox.take()[-1].message.clock)
    transport.close()
    return now * 1e-9 - float(re.search(r"time 0 is ([\d.]+)", cell.log.read_text())[1])


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--n", type=int, default=20)
    parser.add_argument("--pace", type=float, default=0.5)
    parser.add_argument("--only", choices=("slips", "losses", "kills", "refusals"))
    parser.add_argument("--share", default="1/1", help="K/N: every Nth trial, from the Kth on")
    parser.add_argument("--sweep", type=Path, help="keep the sweep in simulation, or take it from there")
    given = parser.parse_args()
    first, every = map(int, given.share.split("/"))
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(given.pace, Path(folder), slice(first - 1, None, every), given.sweep)
        parts = {
            "refusals": trials.refusals,
            "losses": lambda: trials.losses(given.n),
            "kills": lambda: trials.kills(max(1, given.n // 4)),
            "slips": lambda: trials.slips(given.n),
        }
        found = [part() for name, part in parts.items() if given.only in (None, name)]
    return 0 if all(found) else 1


if __name__ == "__main__":
    sys.exit(main())
