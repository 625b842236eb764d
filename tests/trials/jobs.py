"""The runs of the trials: what is run, and what is kept of it."""

from __future__ import annotations

import hashlib
import json
import random
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

from sqrp_cli.ask.api.program import LazyReplanner
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import Infeasible
from sqrp_cli.motion.cell import Cell
from sqrp_cli.program.file import load_program, new_program, save_program
from sqrp_cli.program.record import Step
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
from sqrp_cli.run.faults import InjectedFault
from sqrp_cli.run.record.log import LogWriter
from sqrp_cli.run.record.report import RunReport
from sqrp_cli.run.run import Recording
from sqrp_cli.run.start import Simulation, header, instants, slip_at
from sqrp_cli.study.assessment import study
from sqrp_cli.study.program_update import make_step
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import verdict
from sqrp_cli.task.task import read_task

ROOT = Path(__file__).parent.parent.parent
WORKSPACE = ROOT / "workspaces" / "tabletop"
TASK = "pickup green"
FAILURES = ("camera-loss", "frozen", "latency", "perception-crash")
LATE = 0.6
"""By how much the images of a camera are late that fails so [s]."""


@dataclass(frozen=True)
class Job:
    """One run.

    trial: which it belongs to. name: of the candidate. seed: of the image noise. fault: what happens, at time t [s].
    """

    trial: str
    name: str
    seed: int = 0
    fault: str = ""
    t: float = 0.0
    camera: str = ""

    @property
    def key(self) -> str:
        """What tells it from all others."""
        return " ".join(str(value) for value in asdict(self).values())

    @property
    def faults(self) -> list[InjectedFault]:
        """What happens to it."""
        if self.fault == "slip":
            return [slip_at(self.t)]
        delay = LATE if self.fault == "latency" else 0.0
        return (
            [InjectedFault(self.fault, f"{self.fault}:{self.camera}", self.t, self.camera, delay)] if self.fault else []
        )


def write_programs(folder: Path) -> list[str]:
    """Write a program for each feasible candidate, `NAME.yaml`; returns their names, the best first."""
    workspace = load_workspace(WORKSPACE)
    cell = Cell.load(workspace)
    assessments = []
    for candidate in read_task(TASK, workspace).candidates:
        result = study(cell, candidate, workspace.stated_world, Adaptive(), full=True)
        if isinstance(result, Infeasible):
            continue
        assessment = result.assessment(verdict(cell, result))
        assessments.append(assessment)
        path = folder / f"{candidate.name}.yaml"
        step = make_step(TASK, result, assessment, tuple(workspace.cameras))
        save_program(new_program(workspace, cell.model.arm, path).with_steps([step]), path)
    return [ranked.candidate.name for ranked in rank(assessments, "q_eoi")]


def fingerprint(folder: Path, name: str) -> str:
    """Of all that the results depend on: a program, and the code that runs it."""
    files = [folder / f"{name}.yaml", *sorted((ROOT / "sqrp_cli").rglob("*.py"))]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:16]


@dataclass(frozen=True)
class Counts:
    """How many runs each trial has."""

    slips: int = 20
    calm: int = 20
    failures: int = 50


def jobs_of(step: Step, cameras: list[str], names: list[str], worst: Step, counts: Counts) -> Iterator[Job]:
    """All runs, the short ones first. step, worst: of the first and the last of the candidates `names`."""
    best = names[0]
    rng = random.Random(0)  # noqa: S311
    for _ in range(counts.failures):
        fault, camera = rng.choice(FAILURES), rng.choice(cameras)
        yield Job("failures", best, 0, fault, round(rng.uniform(0.0, step.time - 1.0), 3), camera)
    for name in names:
        yield Job("precision", name)
    yield Job("repeat", best, 0, "slip", round(_lift(step, 1)[0], 3))
    yield Job("repeat", best, 1, "slip", round(_lift(step, 1)[0], 3))
    for seed in range(counts.calm):
        yield Job("calm", best, seed + 1)
    for name, lift in ((best, _lift(step, counts.slips)), (names[-1], _lift(worst, counts.slips))):
        for t in lift:
            yield Job("sweep", name, 0, "slip", round(t, 3))


def _lift(step: Step, count: int) -> list[float]:
    lift = next(primitive for primitive in step.primitives if primitive.name == "a4")
    return instants(lift.start, lift.end, count)


_cells = ExitStack()


@cache
def _simulation(program: Path, seed: int) -> Simulation:
    workspace = load_workspace(WORKSPACE)
    return Simulation(load_program(program), workspace, LazyReplanner(workspace), seed)


@cache
def _cell(folder: Path) -> SimulatedCell:
    """Made once per process: all programs begin in the same world."""
    program = next(iter(sorted(folder.glob("*.yaml"))))
    return _cells.enter_context(_simulation(program, 0).cell())


def run(job: Job, folder: Path) -> dict[str, Any]:
    """Run a job; returns what is kept of it. A crash is a result, too."""
    try:
        program = folder / f"{job.name}.yaml"
        if job.trial == "repeat":
            return {"log": _log(_simulation(program, 0), job, folder / f"repeat{job.seed}.jsonl")}
        simulation = _simulation(program, job.seed)
        if job.seed:
            return _kept(simulation.run(job.faults))
        return _kept(simulation.run(job.faults, cell=_cell(folder)))
    except Exception as error:
        return {"crash": repr(error)}


def _kept(report: RunReport) -> dict[str, Any]:
    total = report.total
    return {
        "outcome": report.outcome,
        "reason": report.reason,
        "time": report.time,
        "faults": [asdict(fault) for fault in report.faults],
        "told": report.stop.told,
        "standing": report.stop.standing,
        "counts": asdict(total),
        "because": Counter(found.because for found in report.disagreements if found.predicted),
        "wall": report.wall["all"],
    }


def _log(simulation: Simulation, job: Job, path: Path) -> str:
    """The digest of the log of a run."""
    writer = LogWriter(path, header(simulation.program, simulation.workspace, 0, job.faults))
    writer.finish(simulation.run(job.faults, Recording([writer])))
    writer.close()
    return hashlib.sha256(path.read_bytes()).hexdigest()


class Results:
    """What is kept of the runs that are done, in a file of one JSON document per line, so that trials can go on."""

    def __init__(self, path: Path, fingerprints: Mapping[str, str]) -> None:
        """fingerprints: of each candidate; what was kept under others does not count."""
        self._path, self._fingerprints = path, fingerprints
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        self._kept: dict[str, dict[str, Any]] = {}
        for line in lines:
            document = json.loads(line)
            self._kept[document["key"]] = document["result"]

    def __contains__(self, job: Job) -> bool:
        return self._key(job) in self._kept

    def __getitem__(self, job: Job) -> dict[str, Any]:
        return self._kept[self._key(job)]

    def add(self, job: Job, result: dict[str, Any]) -> None:
        """Keep the result of a run."""
        self._kept[self._key(job)] = result
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": self._key(job), "result": result}) + "\n")

    def _key(self, job: Job) -> str:
        return f"{self._fingerprints[job.name]} {job.key}"
