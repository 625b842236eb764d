"""Long trials of running programs in the tabletop cell: `python -m tests.trials [TRIAL ...]`.

precision: every feasible candidate without a fault: what was predicted to be seen must be seen.
sweep:     20 slips in the lift of the best and of the worst candidate: delays against predictions.
calm:      20 runs of the best candidate without a fault, each with other noise: none may raise an alarm.
failures:  50 runs in which, at a random time, a camera is lost, frozen or late or perception is killed.
repeat:    the same run twice: the logs must be the same, byte for byte.

Two runs at a time. What is done is kept in build/trials, so that an interrupted trial goes on where it was, as long as
neither program nor code changes.
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.program.file import load_program
from sqrp_cli.run.cell.requirements import check_simulator
from sqrp_cli.show.terminal.console import Column, print_table
from tests.trials.jobs import WORKSPACE, Counts, Job, Results, fingerprint, jobs_of, run, write_programs
from tests.trials.lines import (
    Line,
    calm_lines,
    failure_lines,
    precision_lines,
    repeat_lines,
    sweep_lines,
)

FOLDER = Path("build/trials")
TRIALS = ("precision", "sweep", "calm", "failures", "repeat")
AT_A_TIME = 2


def main(wanted: Sequence[str]) -> int:
    """Run the trials that are named, or all; exit code 0 if all that is asked holds."""
    check_simulator()
    if unknown := set(wanted) - set(TRIALS):
        print(f"there is no trial {', '.join(sorted(unknown))}; expected {', '.join(TRIALS)}", file=sys.stderr)
        return 2
    FOLDER.mkdir(parents=True, exist_ok=True)
    names = write_programs(FOLDER)
    cameras = load_workspace(WORKSPACE).cameras
    first, last = (load_program(FOLDER / f"{name}.yaml").steps[0] for name in (names[0], names[-1]))
    jobs = [job for job in jobs_of(first, list(cameras), names, last, Counts()) if job.trial in (wanted or TRIALS)]
    results = Results(FOLDER / "results.jsonl", {name: fingerprint(FOLDER, name) for name in names})
    try:
        _run_all(jobs, results)
    except KeyboardInterrupt:
        print("interrupted; this is what is done so far", file=sys.stderr)
    lines = list(_lines(jobs, results, names, max(1.0 / camera.rate for camera in cameras.values())))
    print_table(
        [Column("what"), Column("asked", right=True), Column("found"), Column("holds")],
        [
            [line.what, line.asked, line.found, "" if line.holds is None else "yes" if line.holds else "NO"]
            for line in lines
        ],
    )
    complete = all(job in results for job in jobs)
    return 0 if complete and all(line.holds is not False for line in lines) else 1


def _run_all(jobs: Sequence[Job], results: Results) -> None:
    """Run what is not done yet, and tell how far it is."""
    left = [job for job in jobs if job not in results]
    began = time.perf_counter()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(AT_A_TIME, context) as pool:
        running = {pool.submit(run, job, FOLDER): job for job in left}
        try:
            for number, future in enumerate(as_completed(running), 1):
                job, result = running[future], future.result()
                results.add(job, result)
                ended = result.get("crash") or result.get("reason") or result.get("outcome") or "logged"
                elapsed = time.perf_counter() - began
                print(f"{number:4} of {len(left)}  {elapsed:6.0f} s  {job.key}: {ended}", file=sys.stderr, flush=True)
        finally:
            pool.shutdown(cancel_futures=True)


def _lines(jobs: Sequence[Job], results: Results, names: Sequence[str], period: float) -> Iterator[Line]:
    for trial in TRIALS:
        asked = [job for job in jobs if job.trial == trial]
        done = [(job, results[job]) for job in asked if job in results]
        missing = len(asked) - len(done)
        if missing:
            yield Line(f"{trial}: runs that are not done yet", "0", str(missing), False)
        if not done:
            continue
        match trial:
            case "precision":
                yield from precision_lines(done, missing)
            case "sweep":
                yield from sweep_lines(done, names, period)
            case "calm":
                yield from calm_lines(done, missing)
            case "failures":
                yield from failure_lines(done, missing)
            case _:
                yield from repeat_lines(done)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
