"""Small steps of programs for tests of the runtime."""

from __future__ import annotations

import numpy as np

from sqrp_cli.cell.workspace import World
from sqrp_cli.program.record import ProgramFormula, ProgramPrimitive, ProgramResponse, ProgramTarget, Step
from sqrp_cli.run.monitor.nominal_step import NominalStep
from sqrp_cli.skill.target_box import TargetBox
from sqrp_cli.trajectory import Trajectory


class FixedNominalStep(NominalStep):
    """An expectation with stated values: atoms that hold from a time on, and stretches in which they are covered."""

    sought = None

    def __init__(self, step: Step, changes: dict[str, list[tuple[float, bool]]]) -> None:
        self.step, self._changes = step, changes
        self.times = np.arange(0.0, step.time + 0.02, 0.02).tolist()

    def holds(self, atom: str, start: float, end: float | None = None, *, value: bool = True) -> bool:
        times = [max(t, 0.0) for t in np.linspace(start, start if end is None else end, 51)]
        return all([is_so for since, is_so in self._changes[atom] if since <= t + 1e-9][-1] == value for t in times)


def box() -> TargetBox:
    return TargetBox(
        name="place", detector="color", frame="world", size=(0.04, 0.04, 0.04), X_FB=np.eye(4), normal=None,
        encloses=(),
    )  # fmt: skip


def formula(text: str, action: str = "stop", fault: str | None = None, settle: float = 0.5) -> ProgramFormula:
    response = ProgramResponse(action=action, retries=2, when=None)
    return ProgramFormula(formula=text, fault=fault, settle=settle, response=response)


def played(move: Trajectory) -> ProgramPrimitive:
    """A primitive that is nothing but a motion."""
    return ProgramPrimitive(name="a1", action="JointMove", start=0.0, end=move.duration, held=None, trajectory=move)


def step(
    formulas: list[ProgramFormula], seen: dict[str, dict[str, list[tuple[float, float]]]], time: float = 10.0
) -> Step:
    still, world = Trajectory.standstill(np.zeros(1), time), World(frozenset(), {}, None, None, {"a": 0.0})
    wait = ProgramPrimitive(name="a1", action="Wait", start=0.0, end=time, held=None, trajectory=still)
    targets = {
        atom: ProgramTarget(cameras=1, boxes=(box(),), seen={name: tuple(spans) for name, spans in cameras.items()})
        for atom, cameras in seen.items()
    }
    return Step(
        task="do", skill="do", parameters={}, time=time, q_avg=None, q_eoi=None, faults={}, verdict="",
        primitives=(wait,), formulas=tuple(formulas), targets=targets, before=world, after=world,
    )  # fmt: skip
