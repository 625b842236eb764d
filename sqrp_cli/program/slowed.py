"""A program at a share of its speed, with its predictions: the same paths, and all times as many times as long."""

from __future__ import annotations

import re
from dataclasses import dataclass

from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.program import record
from sqrp_cli.trajectory import Trajectory

_INTERVAL = re.compile(r"(?<=\[)[^\[\]]*(?=\])")


def slowed(program: record.Program, speed: float) -> record.Program:
    """The program at a speed, as a share of what it says, in 0..1.

    How late an image is, how often one is taken, and how long a literal may lag stay as they are.
    """
    if speed == 1.0:
        return program
    return program.model_copy(update={"steps": tuple(_step(step, 1.0 / speed) for step in program.steps)})


@dataclass(frozen=True)
class SlowedReplanner:
    """A replanner whose steps are slowed, too."""

    replanner: record.Replanner
    speed: float

    def replan(self, step: record.Step, world: World) -> record.Step | None:
        """As `Replanner` says."""
        planned = self.replanner.replan(step, world)
        return None if planned is None else _step(planned, 1.0 / self.speed)


def _step(step: record.Step, factor: float) -> record.Step:
    """A step `factor` times as slow. How late faults are noticed is known by its sights alone."""
    return step.model_copy(
        update={
            "time": step.time * factor,
            "faults": {},
            "primitives": tuple(_primitive(one, factor) for one in step.primitives),
            "formulas": tuple(_formula(one, factor) for one in step.formulas),
            "targets": {atom: _target(one, factor) for atom, one in step.targets.items()},
            "sights": {name: _sight(one, factor) for name, one in step.sights.items()},
        }
    )


def _primitive(primitive: record.ProgramPrimitive, factor: float) -> record.ProgramPrimitive:
    guard = primitive.guard
    if guard is not None:
        guard = guard.model_copy(update={"trajectory": _trajectory(guard.trajectory, factor)})
    return primitive.model_copy(
        update={
            "start": primitive.start * factor,
            "end": primitive.end * factor,
            "trajectory": _trajectory(primitive.trajectory, factor),
            "guard": guard,
        }
    )


def _trajectory(trajectory: Trajectory, factor: float) -> Trajectory:
    return Trajectory(trajectory.path, trajectory.law.stretched(factor))


def _formula(entry: record.ProgramFormula, factor: float) -> record.ProgramFormula:
    def later(found: re.Match[str]) -> str:
        return ", ".join(repr(float(bound) * factor) for bound in found[0].split(","))

    return entry.model_copy(update={"formula": _INTERVAL.sub(later, entry.formula)})


def _target(target: record.ProgramTarget, factor: float) -> record.ProgramTarget:
    seen = {name: tuple((start * factor, end * factor) for start, end in spans) for name, spans in target.seen.items()}
    return target.model_copy(update={"seen": seen})


def _sight(sight: record.ProgramSight, factor: float) -> record.ProgramSight:
    def later(times: tuple[float, ...]) -> tuple[float, ...]:
        return tuple(t * factor for t in times)

    windows = (one.model_copy(update={"start": one.start * factor, "end": one.end * factor}) for one in sight.windows)
    onsets = (one.model_copy(update={"x": later(one.x), "shown": later(one.shown)}) for one in sight.onsets)
    return sight.model_copy(update={"windows": tuple(windows), "onsets": tuple(onsets)})
