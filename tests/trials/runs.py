"""Programs that run in the simulated tabletop: as they are, with slips, and with cameras or perception that fail."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sqrp_cli import open_cell, open_program
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.program.file import load_program
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.record.report import Confusion, SweepDocument, SweptRun
from tests.conftest import TABLETOP

PRECISION, AS_PREDICTED, STANDING = 0.97, 0.9, 0.5
"""Asked: shares of images and of delays, and the time from a failure until the robot stands [s]."""
FAILURES = ("camera-loss", "frozen", "latency", "perception-crash")
LATE = 0.6
"""By how much the images of a camera are late that fails so [s]."""
SLIPS = 20
"""Of each of the two candidates."""

Asked = Iterator[tuple[str, bool]]


def prepare(shared: Path) -> None:
    """Write a program for each candidate that can be done, `RANK-NAME.yaml`."""
    ranking = open_cell(TABLETOP).rank("pickup green", ways="fastest")
    for number, one in enumerate(one for one in ranking.candidates if one.feasible):
        ranking.write(shared / f"{number}-{one.name}.yaml", one.name)


def _programs(folder: Path) -> list[Path]:
    return sorted(folder.parent.glob("*.yaml"))


def _ran(program: Path, seed: int, faults: Sequence[InjectedFault], said: str) -> dict[str, Any]:
    opened = open_program(program, seed=seed)
    with opened.simulated_cell() as cell:
        report = opened.simulate(cell, faults)
    return {
        "said": f"{said}: {report.reason or report.outcome}", "name": program.stem, "outcome": report.outcome,
        "faults": [asdict(fault) for fault in report.faults], "told": report.stop.told,
        "standing": report.stop.standing, "counts": asdict(report.total),
        "because": Counter(found.because for found in report.disagreements if found.predicted),
    }  # fmt: skip


def precision(number: int, folder: Path) -> dict[str, Any]:
    """A candidate without a fault."""
    program = _programs(folder)[number]
    return _ran(program, 0, [], program.stem)


def precision_asked(found: Sequence[dict[str, Any]]) -> Asked:
    for one in found:
        count = Confusion(**one["counts"])
        share, more = count.precision or 0.0, f"{count.tp + count.fp}, {count.fn} more"
        yield f"{one['name']}: {100 * share:.1f} % of the promised images showed it, of {more}", share >= PRECISION
        because = ", ".join(f"{n} {why}" for why, n in sorted(one["because"].items()))
        yield f"{one['name']}: {one['outcome']}; those that did not: {because or 'none'}", one["outcome"] == "done"


def calm(number: int, folder: Path) -> dict[str, Any]:
    """The best candidate without a fault, with the noise of a seed."""
    return _ran(_programs(folder)[0], number, [], f"seed {number}")


def calm_asked(found: Sequence[dict[str, Any]]) -> Asked:
    alarms = [one["said"] for one in found if one["outcome"] != "done" or one["faults"]]
    yield f"{len(alarms)} false alarms in {len(found)} runs {'; '.join(alarms)}", not alarms


def failures(number: int, folder: Path) -> dict[str, Any]:
    """A camera is lost, frozen or late, or perception is killed, at a random time."""
    program, rng = _programs(folder)[0], random.Random(number)  # noqa: S311
    kind, camera = rng.choice(FAILURES), rng.choice(list(load_workspace(TABLETOP).cameras))
    t = round(rng.uniform(0.0, load_program(program).steps[0].time - 1.0), 3)
    fault = InjectedFault(kind, f"{kind}:{camera}", t, camera, LATE if kind == "latency" else 0.0)
    return _ran(program, 0, [fault], f"{kind} of {camera} at {t} s")


def failures_asked(found: Sequence[dict[str, Any]]) -> Asked:
    wrong = sum(one["outcome"] == "done" for one in found)
    yield f"{wrong} of {len(found)} runs in which those who watch fail were said to be done", not wrong
    stopped = [one for one in found if one["outcome"] == "stopped"]
    told, standing = (
        max((one[what] - one["faults"][0]["injected"] for one in stopped), default=0.0) for what in ("told", "standing")
    )
    yield f"told to stop after {told:.2f} s at most, standing after {standing:.2f} s", standing <= STANDING


def sweep(number: int, folder: Path) -> dict[str, Any]:
    """A slip in the middle of one of `SLIPS` equal parts of the lift of the best or of the worst candidate."""
    programs = _programs(folder)
    program = programs[-1 if number >= SLIPS else 0]
    lift = next(one for one in load_program(program).steps[0].primitives if one.name == "a4")
    t = round(lift.start + (number % SLIPS + 0.5) / SLIPS * (lift.end - lift.start), 3)
    return _ran(program, 0, [InjectedFault("slip", f"slip@{t:.3f}", t)], f"{program.stem} slips at {t} s") | {"x": t}


def sweep_asked(found: Sequence[dict[str, Any]]) -> Asked:
    """Delays against predictions, and what the better choice saves."""
    period = max(1.0 / camera.rate for camera in load_workspace(TABLETOP).cameras.values())
    ends = {}
    for name in sorted({one["name"] for one in found}):
        those = [one for one in found if one["name"] == name]
        runs = [SweptRun(**one["faults"][0], x=one["x"], outcome="done", time=0.0) for one in those]
        summary = SweepDocument.of(runs, period, count=len(runs), workspace="", sweep="slip", step=1, steps=[name])
        if summary.seen:
            seen, can = summary.seen, summary.predictable
            yield f"{name}: {seen} slips seen of {can} that can be", seen == can
            delays = [(run.delay, run.predicted_delay) for run in runs if run.happened is not None]
            late = [delay - most for delay, most in delays if delay is not None and most is not None]
            share = f"{summary.as_predicted} seen as predicted, {summary.sooner} sooner, {summary.later} later"
            enough = summary.as_predicted >= AS_PREDICTED * seen - 1e-9
            yield f"{name}: {share} ({min(late):+.2f} to {max(late):+.2f} s)", enough
        if done := [run.recovered for run in runs if run.recovered is not None]:
            ends[name] = sum(done) / len(done)
    if len(ends) == 2:
        best, worst = sorted(ends)
        yield f"{best} saves {ends[worst] - ends[best]:.1f} s after a slip", ends[worst] > ends[best]
