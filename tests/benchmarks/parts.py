"""Where the CPU time of a whole command goes, in parts that add up to it: samples of the stack, each with its time.

As a script, it is one such command: `python -m tests.benchmarks.parts FILE rank workspaces/tabletop "pickup green"`.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import FrameType

EVERY = 1e-3
"""CPU time between samples [s]."""

LEAST = 0.01
"""Parts below this share are counted together."""


def parts(name: str, runs: int) -> None:
    """A table of one command: the parts of the run that took least."""
    from tests.benchmarks.commands import COMMANDS, ROOT  # not at the top: the command must import what it needs itself
    from tests.benchmarks.table import print_table

    found = []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(runs):
            file = Path(folder, "parts.json")
            command = [sys.executable, "-m", "tests.benchmarks.parts", str(file), *COMMANDS[name], "--jobs", "1"]
            subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
            found.append(json.loads(file.read_text()))
    least = min(found, key=lambda times: sum(times.values()))
    whole = sum(least.values())
    large = {part: seconds for part, seconds in least.items() if seconds >= LEAST * whole}
    large["others"] = whole - sum(large.values())
    order = sorted(large, key=lambda part: (part == "others", -large[part]))
    rows = [[part, f"{1e3 * large[part]:.0f}", f"{100 * large[part] / whole:.0f} %"] for part in order]
    rows.append(["whole", f"{1e3 * whole:.0f}", "100 %"])
    print_table(f"Where `{name}` spends its CPU time", ["", "ms", "share"], rows, f"parts of {name}")


class _Sampler:
    """Adds the CPU time since the last sample to the part that runs: calls of libraries belong to who calls them."""

    def __init__(self) -> None:
        self.times: Counter[str] = Counter()
        self.last = time.process_time()
        self.times["the interpreter"] = self.last
        signal.signal(signal.SIGPROF, lambda _, frame: self.sample(frame))
        signal.setitimer(signal.ITIMER_PROF, EVERY, EVERY)

    def sample(self, frame: FrameType | None) -> None:
        now = time.process_time()
        self.times[_part(frame)] += now - self.last
        self.last = now


def _part(frame: FrameType | None) -> str:
    """What a stack is in: an import of ours or of a library, or the folder of the innermost function of ours."""
    found = None
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        ours = name.startswith("sqrp_cli")
        if frame.f_code.co_name == "<module>" and name not in ("", "__main__"):
            return f"imports of {'our modules' if ours else name.partition('.')[0]}"
        if found is None and ours:
            found = "/".join(name.split(".")[1:-1]) or name
        frame = frame.f_back
    return found or "others"


def _main(file: str, command: list[str]) -> None:
    sampler = _Sampler()
    from sqrp_cli.cli.main import main

    sys.argv = ["sqrp", *command]
    try:
        main()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        sampler.sample(None)
        Path(file).write_text(json.dumps(sampler.times))


if __name__ == "__main__":
    _main(sys.argv[1], sys.argv[2:])
