"""Long trials with figures that are asked for: `python -m tests.trials NAME [COUNT [FIRST]]`; without a name, a table.

A trial has many cases, each made by its number alone: COUNT of them, from FIRST on. A case runs in a process of its
own, and what comes of it is kept in build/trials as long as the code is the same, so that an interrupted trial goes on.
Exit code 1 where something is not as asked.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]

Found = dict[str, Any]
"""What is kept of a case; `said` is printed."""


class Trial(NamedTuple):
    """Where a trial is, and how much of it there is.

    Its module has a function with the trial's name, `(number, folder, **few) -> Found | None`, which gets an empty
    folder; and, if cases share something, `prepare(shared)`, which makes it in the parent of their folders. What is
    asked is that all are `good`, or what `NAME_asked(found)` yields: sentences, each with whether it is so.
    """

    shows: str
    module: str
    count: int
    """Cases of `make trials`."""
    suite: tuple[int, ...] = ()
    """Those that every run of the tests has."""
    slow: tuple[int, ...] = ()
    """Those that `make test` has besides."""
    few: Mapping[str, int] = {}
    """How a case of the tests is made shorter."""
    first: int = 0
    at_a_time: int = 2
    longest: float = 1800.0
    """When a case is given up [s]."""


TRIALS = {
    "precision": Trial("what is predicted to be seen is seen", "runs", 5),
    "calm": Trial("no alarm where nothing is wrong", "runs", 20, first=1),
    "failures": Trial("the robot stands soon where a camera or perception fails", "runs", 50),
    "sweep": Trial("slips in the lift of the best and the worst candidate are seen as predicted", "runs", 40),
    "slips": Trial("slips in random cells are seen within the predicted delays", "slips", 10, slow=(8,), few={"n": 2}),
    "broken": Trial("what a known change broke is mended by no more", "broken", 50, suite=(0,), slow=(9,)),
    "ways": Trial("the way shown and the Pareto set are those of all ways by hand", "ways", 200, suite=(0, 1, 2, 3)),
    "slits": Trial("sampling finds what is seen for as long as it promises", "slits", 100),
    "place": Trial("two cameras are the best pair, by brute force", "place", 13),
    "light": Trial("where colours collide, images show what is promised", "light", 50, first=1000),
    "lamps": Trial("which parts are too dark or too bright to be told", "light", 40, first=2000),
    "arms": Trial("a cell of a URDF alone is ranked and run", "arms", 80, longest=900.0),
    "curves": Trial("curves of detectors say how likely they see", "detectors", 2),
    "ranges": Trial("how far away markers are read", "detectors", 12),
    "limits": Trial("at which size, angle and visible share detectors begin to fail", "detectors", 15),
    "recordings": Trial("the camera that has moved is named, and wrong clocks", "recordings", 40),
    "losses": Trial("the arm of a served cell stands soon where messages stay out", "wire", 20, at_a_time=1),
    "kills": Trial("it stands soon where the run is killed", "wire", 5, at_a_time=1),
    "wire": Trial("slips in a served cell are seen as in simulation", "wire", 20, at_a_time=1),
    "refusals": Trial("a served cell that is not as the program says is refused", "wire", 5, at_a_time=1),
    "damage": Trial("damaged files are refused with a place, or still work", "damage", 100),
    "load": Trial("scores of many cells by processes and a cluster, killed and resumed", "load", 1, at_a_time=1),
}  # fmt: skip
APART = ("damage", "load")
"""Those that have a target of their own in the Makefile."""


def module_of(name: str) -> Any:
    """Of a trial."""
    return import_module(f"tests.trials.{TRIALS[name].module}")


def prepared(name: str, shared: Path) -> Path:
    """The folder of a trial, in which is what its cases share."""
    module = module_of(name)
    if hasattr(module, "prepare") and not shared.exists():
        shared.mkdir(parents=True)
        module.prepare(shared)
    shared.mkdir(parents=True, exist_ok=True)
    return shared


def one_case(name: str, number: int, shared: Path) -> None:
    """Write down what becomes of a case; a crash is a result, too."""
    own = shared / f"case{number}"
    shutil.rmtree(own, ignore_errors=True)
    own.mkdir()
    try:
        found = getattr(module_of(name), name)(number, own) or {"said": "nothing to try"}
    except Exception as error:
        found = {"said": f"crashed: {error!r}", "crashed": True}
    shutil.rmtree(own)
    (shared / f"{number}.json").write_text(json.dumps(found), encoding="utf-8")


def main(words: list[str]) -> int:
    """Run the cases of a trial that are not done yet, and sum them up."""
    if words[:1] == ["--case"]:
        one_case(words[1], int(words[2]), prepared(words[1], Path(words[3])))
        return 0
    if words == ["all"]:
        return max(main([name]) for name in TRIALS if name not in APART)
    if not words or words[0] not in TRIALS:
        print("\n".join(f"{name:12} {trial.count:4}  {trial.shows}" for name, trial in TRIALS.items()))
        return 2 if words else 0
    name, trial = words[0], TRIALS[words[0]]
    count, first = (int(word) for word in (*words[1:], *map(str, (trial.count, trial.first)[len(words) - 1 :])))
    code = [*(ROOT / "sqrp_cli").rglob("*.[pyh]*"), *(ROOT / "tests" / "trials").rglob("*.py")]
    digest = hashlib.sha256(b"".join(file.read_bytes() for file in sorted(code) if file.suffix != ".pyc"))
    shared = prepared(name, ROOT / "build" / "trials" / digest.hexdigest()[:12] / name)
    numbers, began = range(first, first + count), time.perf_counter()

    def tried(number: int) -> Found:
        file = shared / f"{number}.json"
        if not file.exists():
            command = [sys.executable, "-m", "tests.trials", "--case", name, str(number), str(shared)]
            try:
                done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=trial.longest)
            except subprocess.TimeoutExpired:
                return {"said": f"not finished after {trial.longest:.0f} s", "crashed": True}
            if not file.exists():
                return {"said": f"died with {done.returncode}: {done.stderr[-300:]}", "crashed": True}
        found: Found = json.loads(file.read_text(encoding="utf-8"))
        return found

    found = []
    print(f"{name}: {trial.shows}")
    with ThreadPoolExecutor(trial.at_a_time) as pool:
        try:
            for number, one in zip(numbers, pool.map(tried, numbers), strict=True):
                found.append(one)
                print(f"{number:5}  {time.perf_counter() - began:6.0f} s  {one['said']}", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            print("interrupted; this is what is done so far", file=sys.stderr)
    return summed_up([("all cases are done", len(found) == count), *asked(name, found)])


def asked(name: str, found: Iterable[Found]) -> list[tuple[str, bool]]:
    """What is asked of a trial, and whether it is so in these cases."""
    whole = [one for one in found if not one.get("crashed")]
    wanted = [one for one in whole if len(one) > 1]
    crashed = sum(bool(one.get("crashed")) for one in found)
    own = getattr(module_of(name), f"{name}_asked", all_good)
    return [(f"{crashed} cases crashed", crashed == 0), *(own(wanted) if wanted else [])]


def all_good(found: Sequence[Found]) -> Iterator[tuple[str, bool]]:
    good = sum(one["good"] for one in found)
    yield f"{good} of {len(found)} are as they should be", good == len(found)


def summed_up(lines: Iterable[tuple[str, bool]]) -> int:
    """Print what is asked; 0 if all of it is so."""
    good = True
    for sentence, holds in lines:
        good &= holds
        print(f"  {'yes' if holds else 'NO '}  {sentence}", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
