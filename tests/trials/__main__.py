"""Long trials of running programs in the tabletop cell; `python -m tests.trials NAME [COUNT]`.

precision: every feasible candidate without a fault: what was predicted to be seen must be seen.
sweep:     slips at COUNT instants of the lift, in the best and in the worst candidate: delays against predictions.
calm:      COUNT runs of the best candidate without a fault and with other seeds: none may raise an alarm.
failures:  COUNT runs in which, at a random time, a camera is lost, frozen or late or perception killed: each must stop.
"""

from __future__ import annotations

import random
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from sqrp_cli.cli.run import LazyReplanner
from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.program import Program, new_program
from sqrp_cli.programming.assessment import study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.infeasible import Infeasible
from sqrp_cli.programming.program_update import make_step
from sqrp_cli.programming.sampling import Adaptive
from sqrp_cli.programming.task import read_task
from sqrp_cli.programming.verdict import verdict
from sqrp_cli.runtime.faults import InjectedFault
from sqrp_cli.runtime.outcome import Confusion
from sqrp_cli.runtime.simulated_run import Simulation, sweep
from sqrp_cli.runtime.simulation.requirements import check_simulator

ROOT = Path(__file__).parent.parent.parent
TASK = "pickup green"
BEST, WORST = "g2", "g1"

PERIOD, PROCESSING = 0.1, 0.02
"""Of the cameras, and time that it takes to look at an image [s]."""


def simulations(names: tuple[str, ...] = ()) -> dict[str, Simulation]:
    """The feasible candidates of the task, ready to run."""
    workspace = load_workspace(ROOT / "workspaces" / "tabletop")
    cell = Cell.load(workspace)
    found = {}
    for candidate in read_task(TASK, workspace).candidates:
        if names and candidate.name not in names:
            continue
        result = study(cell, candidate, workspace.initial_world, Adaptive(), full=True)
        if not isinstance(result, Infeasible):
            step = make_step(TASK, result, result.assessment(verdict(cell, result)), tuple(workspace.cameras))
            program: Program = new_program(workspace, cell.model.arm, ROOT / "program.yaml").with_step(step)
            found[candidate.name] = Simulation(program, workspace, LazyReplanner(workspace), 0)
    return found


def precision(_: int) -> bool:
    """Prints the counts of every candidate; whether at least 97 % of what was predicted was seen in each."""
    print("candidate  outcome  predicted  and seen         not predicted  but seen")
    overall = Confusion()
    kinds: Counter[str] = Counter()
    fine = True
    for name, simulation in simulations().items():
        report = simulation.run()
        total = report.total
        overall += total
        share = total.precision or 0.0
        fine &= report.outcome == "done" and share >= 0.97
        row = f"{total.tp + total.fp:9}  {total.tp:8} {100 * share:5.1f} %  {total.tn + total.fn:13}  {total.fn:8}"
        print(f"{name:9}  {report.outcome:7}  {row}", flush=True)
        for found in report.disagreements:
            if found.predicted:
                border = "mask border" if 0.0 < found.share < 0.6 else "detector limit" if found.share else "lighting"
                kinds[border] += 1
    print(f"all: {overall.tp} of {overall.tp + overall.fp} = {100 * (overall.precision or 0.0):.2f} %")
    print("predicted but not seen, by what could be judged of the box:", dict(kinds) or "none")
    return fine


def sweeps(count: int) -> bool:
    """Prints delays; whether all that can be seen was seen, and 90 % in the predicted time."""
    fine = True
    ends = {}
    for name, simulation in simulations((BEST, WORST)).items():
        faults = []
        for run in sweep(simulation, "slip@a4", count, lambda: None):
            f = run.fault
            faults.append(f)
            times = (
                f"t_f {_s(f.happened)}  t_r {_s(f.detected)}  delay {_s(f.delay)}  predicted {_s(f.predicted_delay)}"
            )
            print(f"  {name} {run.x:6.2f}  {times}  t_e {_s(f.recovered)}  {run.report.reason or ''}", flush=True)
        able = [f for f in faults if f.predicted_delay is not None and f.happened is not None]
        seen = [f for f in able if f.delay is not None]
        later = [(f.delay or 0.0) - (f.predicted_delay or 0.0) for f in seen]
        close = [difference for difference in later if abs(difference) <= PERIOD + PROCESSING]
        done = [f.recovered for f in faults if f.recovered is not None]
        ends[name] = sum(done) / len(done) if done else float("nan")
        delay = sum(f.delay or 0.0 for f in seen) / max(len(seen), 1)
        print(
            f"{name}: {len(seen)} of {len(able)} seen, {len(close)} within one frame and processing of the prediction, "
            f"{min(later, default=0.0):+.2f} to {max(later, default=0.0):+.2f} s off it, "
            f"mean delay {delay:.2f} s, {len(done)} done after {ends[name]:.1f} s",
            flush=True,
        )
        fine &= len(seen) == len(able) and len(close) >= 0.9 * len(seen)
    print(f"after a slip, {BEST} is done {ends[WORST] - ends[BEST]:.1f} s before {WORST}")
    return fine


def _s(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f}"


def calm(count: int) -> bool:
    """Prints alarms; whether there were none."""
    simulation = simulations((BEST,))[BEST]
    alarms = 0
    for seed in range(count):
        report = replace(simulation, seed=seed).run()
        alarms += report.outcome != "done" or bool(report.faults)
        print(f"seed {seed}: {report.outcome} {report.reason or ''}", flush=True)
    print(f"{alarms} false alarms in {count} runs")
    return alarms == 0


def failures(count: int) -> bool:
    """Prints when each run stopped; whether all did, for the right reason, told to within 0.5 s."""
    simulation = simulations((BEST,))[BEST]
    rng = random.Random(0)  # noqa: S311
    step = simulation.program.steps[0]
    fine = 0
    latest = standing = 0.0
    for _ in range(count):
        kind = rng.choice(("camera-loss", "frozen", "latency", "perception-crash"))
        camera, t = rng.choice(list(simulation.workspace.cameras)), rng.uniform(0.0, step.time - 1.0)
        fault = InjectedFault(kind, f"{kind}:{camera}@{t:.2f}", t, camera, 0.6 if kind == "latency" else 0.0)
        report = simulation.run([fault])
        injected = report.faults[0].injected or 0.0
        told, stood = (report.stop_told or 1e9) - injected, (report.stop_done or 1e9) - injected
        good = report.outcome == "stopped" and told <= 0.5
        fine += good
        latest, standing = max(latest, told), max(standing, stood)
        print(f"{fault.text:26} {report.outcome} told {told:.2f} s, stood {stood:.2f} s: {report.reason}", flush=True)
    print(f"{fine} of {count} stopped: told so at most {latest:.2f} s after the failure, standing {standing:.2f} s")
    return fine == count


TRIALS: dict[str, tuple[Callable[[int], bool], int]] = {
    "precision": (precision, 1),
    "sweep": (sweeps, 20),
    "calm": (calm, 20),
    "failures": (failures, 50),
}


def main() -> int:
    """Run the trials that are named, or all."""
    check_simulator()
    names = sys.argv[1:2] or list(TRIALS)
    fine = True
    for name in names:
        trial, count = TRIALS[name]
        print(f"== {name}", flush=True)
        fine &= trial(int(sys.argv[2]) if len(sys.argv) > 2 else count)
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
