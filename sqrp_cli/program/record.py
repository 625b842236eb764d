"""The program: everything that the programming phase hands to the runtime.

Each step holds the exact motion (see `trajectory`), the formulas with their times and responses, where to look, which
camera covers what when, and the world before and after.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Annotated, Literal, Protocol

import numpy as np
from pydantic import Field, SerializerFunctionWrapHandler, model_serializer, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.figures import FaultMetrics, Seconds, Share
from sqrp_cli.knowledge.skill.settings import ANY, FASTEST
from sqrp_cli.knowledge.skill.target_box import TargetBox
from sqrp_cli.knowledge.text.entries import AsStored, Entry, Finite, Written
from sqrp_cli.knowledge.text.units import read_quantity
from sqrp_cli.knowledge.workspace.understood import Plain
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.logic.image_time import Onset, Window, delays
from sqrp_cli.trajectory import Trajectory

Numbers = tuple[Finite, ...]


class _PathNumbers(Entry):
    breaks: Numbers
    coefficients: tuple[tuple[Numbers, ...], ...]


class _LawNumbers(Entry):
    breaks: Numbers
    coefficients: tuple[Numbers, ...]


class _TrajectoryNumbers(Entry):
    """Fields of a `trajectory.Trajectory` with its path and law in a file, checked before arrays are made of them."""

    path: _PathNumbers
    law: _LawNumbers

    @model_validator(mode="after")
    def _consistent(self) -> _TrajectoryNumbers:
        for part, breaks, count in (
            ("path", self.path.breaks, len(self.path.coefficients)),
            ("law", self.law.breaks, len(self.law.coefficients)),
        ):
            if count == 0 or len(breaks) != count + 1 or any(b < a for a, b in pairwise(breaks)):
                message = "the breaks of the {part} must rise and be one more than there are pieces"
                raise PydanticCustomError("program-motion", message, {"part": part})
        if any(a == b for a, b in pairwise(self.path.breaks)):
            raise PydanticCustomError("program-motion", "the breaks of the path must be different")
        if any(len(piece) != 4 for piece in self.law.coefficients):
            raise PydanticCustomError("program-motion", "every piece of the law must have four coefficients")
        rows = {len(row) for piece in self.path.coefficients for row in piece}
        if len(rows) != 1 or 0 in rows or len({len(piece) for piece in self.path.coefficients}) != 1:
            message = "every coefficient of the path must have one number per joint, every piece as many coefficients"
            raise PydanticCustomError("program-motion", message)
        return self


_Motion = Annotated[
    Trajectory,
    Written(_TrajectoryNumbers, lambda numbers: Trajectory.from_numbers(numbers.model_dump()), Trajectory.to_numbers),
]


class ProgramGuard(Entry):
    """What a guarded move takes for contact, and how it goes on where it meets nothing."""

    force: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    """At the tool [N]."""
    trajectory: _Motion
    """The motion without contact, as long as that of the primitive, which stands where contact is expected."""


class ProgramPrimitive(Entry):
    """A primitive action with its time and its motion."""

    name: str
    """As in the skill."""
    does: str | None = None
    """What it does, in a word or two; None in programs of earlier versions."""
    action: str
    """The kind of action, such as `JointMove` or `Grasp`."""
    start: Seconds
    """From the start of the step [s]."""
    end: Seconds
    """From the start of the step [s]."""
    held: str | None
    """The object in the tool throughout; None if there is none."""
    trajectory: _Motion
    """The exact motion, on a clock from `start`."""
    guard: ProgramGuard | None = None
    """Of a move that ends at contact; left out of the file for all others."""

    @model_serializer(mode="wrap")
    def _without_what_is_none(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        written: dict[str, object] = write(self)
        return {key: value for key, value in written.items() if key not in ("does", "guard") or value is not None}


class ProgramResponse(Entry):
    """What to do when a formula is violated, or a fault is seen."""

    action: Literal["stop", "retry", "continue"]
    """Stop the robot, try the step again, or go on."""
    retries: int = 0
    """How many retries are allowed."""
    when: str | None = None
    """What must be seen before a retry, a formula; None if nothing."""


class ProgramFormula(Entry):
    """A formula to be monitored, with the response to its violation."""

    formula: str
    """The formula about objects, all times in seconds from the start of the step."""
    fault: str | None
    """Name of the fault that it describes; None if it describes none."""
    settle: Seconds
    """Time that a literal may lag behind its expected change [s]."""
    response: ProgramResponse
    """What to do when it is violated, or its fault is seen."""


class ProgramTarget(Entry):
    """What decides an atom."""

    cameras: int
    """How many cameras must each see all boxes."""
    boxes: tuple[TargetBox, ...]
    """Where to look."""
    seen: Mapping[str, tuple[tuple[Seconds, Seconds], ...]]
    """Intervals in which a camera sees all boxes, from the start of the step [s], by the camera's name."""
    usual: Mapping[str, tuple[tuple[Seconds, Seconds], ...]] = {}
    """Those in which its images usually show them, likewise. Programs of earlier versions lack it."""
    refuted: Mapping[str, tuple[tuple[Seconds, Seconds], ...]] = {}
    """Those in which they usually show that the atom is false; empty where that takes the same as to confirm it."""

    @model_serializer(mode="wrap")
    def _without_what_is_empty(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        written: dict[str, object] = write(self)
        return {key: value for key, value in written.items() if key not in ("usual", "refuted") or value}


class ProgramOnset(Entry):
    """From when on images show a fault that happens at a time x, at points in order; linear in between."""

    x: tuple[Seconds, ...]
    """From the start of the step [s]."""
    shown: tuple[Seconds, ...]
    """From when on images show it, from the start of the step [s]."""

    @model_validator(mode="after")
    def _consistent(self) -> ProgramOnset:
        rising = all(a <= b for times in (self.x, self.shown) for a, b in pairwise(times))
        if len(self.x) < 2 or len(self.x) != len(self.shown) or not rising:
            raise PydanticCustomError("program-motion", "expected two times or more that rise, and as many of both")
        return self


class ProgramSight(Entry):
    """When images show a fault."""

    windows: tuple[Annotated[Window, AsStored()], ...]
    """Those of cameras of one rate and latency in order, apart from each other."""
    onsets: tuple[ProgramOnset, ...]
    """Of each interval in which it may happen."""

    def latest(self, x: float) -> float | None:
        """How long after time x [s] of the step a fault is noticed at the latest [s]; None if it may never be."""
        onset = next((one for one in self.onsets if one.x[0] - 1e-9 <= x <= one.x[-1] + 1e-9), None)
        if onset is None:
            return None
        shown = float(np.interp(x, onset.x, onset.shown))
        at = Onset(np.array([x, x]), np.array([shown, shown]))
        return delays(self.windows, at, lambda t: t, np.empty(0)).worst


class Step(Entry):
    """A chosen candidate: a skill with all its parameters."""

    task: str
    """As it was asked for."""
    skill: str
    """Name of the skill."""
    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    time: Seconds
    """Duration of its motion [s]."""
    q_avg: Share | None
    """Q_avg in 0..1; None where no formula applies."""
    q_eoi: Share | None
    """Q_eoi in 0..1; None where there is no event of interest."""
    faults: Mapping[str, FaultMetrics]
    """By the fault's name."""
    verdict: str
    """Where it is blind, why, and what would help."""
    primitives: tuple[ProgramPrimitive, ...]
    """In the order in which they are done."""
    formulas: tuple[ProgramFormula, ...]
    """Of the skill, in its order."""
    targets: Mapping[str, ProgramTarget]
    """By the atom that they decide."""
    before: World
    """The world that it starts from."""
    after: World
    """The world that it leaves behind."""
    sights: Mapping[str, ProgramSight] = {}
    """When images show each fault, by its name. Programs of earlier versions lack it."""

    @property
    def short_task(self) -> str:
        """The skill and its objects, such as `pickup g2`: a task with just this choice."""
        objects = (value for value in self.parameters.values() if value in self.before.X_WO)
        return " ".join([self.skill, *map(str, objects)])

    @property
    def own_task(self) -> str:
        """The short task with the motion parameters of the task, each with the chosen value.

        A value that leaves a parameter free stands for all.
        """
        words = [self.short_task]
        for name, _, text in (word.partition("=") for word in self.task.split() if "=" in word):
            chosen = self.parameters.get(name)
            if chosen is not None and chosen not in self.before.X_WO:
                texts = text.split(",")
                values = [one if (read := read_quantity(one)) is None else read.value for one in texts]
                fitting = [one for one, value in zip(texts, values, strict=True) if value == chosen]
                fitting += [one for one in texts if one in (ANY, FASTEST)]
                words += [f"{name}={one}" for one in fitting[:1]]
        return " ".join(words)

    @property
    def held_after(self) -> tuple[str | None, ...]:
        """What the tool holds after each primitive."""
        held = [*(primitive.held for primitive in self.primitives), self.after.held]
        return tuple(held[1:] if self.primitives else [])


class Program(Entry):
    """Steps for one workspace."""

    sqrp_program: Literal[1] = 1
    """Version of the file's fields."""
    workspace: str
    """Its file, relative to the program's."""
    digest: str
    """Of `made_for`; without that, of the bytes of the workspace's files."""
    checksum: str = ""
    """Of all that a file says apart from its workspace; empty until it is saved."""
    marks: str = ""
    """A sign for each value: they show where a file was changed whose checksum does not fit."""
    joints: tuple[str, ...]
    """Names of the joints of all trajectories, in their order."""
    steps: tuple[Step, ...]
    """In the order in which they are done."""
    made_for: Mapping[str, Mapping[str, Plain]] = {}
    """What the workspace said that matters, see `workspace.understood`: it tells what has changed since. Programs of
    earlier versions lack it."""

    @property
    def skills(self) -> tuple[str, ...]:
        """The skills of its steps, each once."""
        return tuple(dict.fromkeys(step.skill for step in self.steps))

    def with_steps(self, steps: Sequence[Step]) -> Program:
        """The program with more steps at its end."""
        return self.model_copy(update={"steps": (*self.steps, *steps)})

    def without_last_step(self) -> Program:
        """The program without its last step; it must have one."""
        return self.model_copy(update={"steps": self.steps[:-1]})


class Replanner(Protocol):
    """Plans a step again from another world, for a retry; passed to the runtime, which cannot plan itself."""

    def replan(self, step: Step, world: World) -> Step | None:
        """The same skill with the same parameters from `world`; None if that is infeasible."""
