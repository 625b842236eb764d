"""The program: everything that the programming phase hands to the runtime.

Each step holds the exact motion (see `trajectory`), the formulas with their times and responses, where to look, which
camera covers what when, and the world before and after.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, PlainSerializer, SerializerFunctionWrapHandler, model_serializer

from sqrp_cli.cell.canonical_values import Plain
from sqrp_cli.cell.workspace import World
from sqrp_cli.figures import FaultMetrics, Seconds, Share
from sqrp_cli.files.entries import Entry, FileRecord, SerializedAs, refused
from sqrp_cli.files.units import read_quantity
from sqrp_cli.logic.image_time import Onset, Window, delays
from sqrp_cli.logic.literal import NOT
from sqrp_cli.skill.settings import ANY, FASTEST
from sqrp_cli.skill.target_box import TargetBox, fact_words
from sqrp_cli.trajectory import Trajectory

Made = TypeVar("Made")


def _of_arrays(read: Callable[[Mapping[str, Any]], Made]) -> Callable[[Mapping[str, Any]], Made]:
    """What reads a record of arrays. Raises PydanticCustomError for what it cannot read."""

    def checked(numbers: Mapping[str, Any]) -> Made:
        try:
            return read(numbers)
        except (LookupError, TypeError, ValueError) as error:
            message = "expected arrays with one number per joint, every piece with as many, as they were written"
            raise refused("program-motion", message) from error

    return checked


_Fault = Annotated[FaultMetrics, PlainSerializer(lambda one: {k: v for k, v in vars(one).items() if k != "why"})]
"""Without the reason why it is noticed late, which is for whoever ranks."""
_Motion = Annotated[
    Trajectory, SerializedAs(dict[str, dict[str, Any]], _of_arrays(Trajectory.from_numbers), Trajectory.to_numbers)
]


class _Sparse(Entry):
    """An entry that leaves out of the file what has its default."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, write: SerializerFunctionWrapHandler) -> dict[str, object]:
        written: dict[str, object] = write(self)
        fields = type(self).model_fields
        return {
            key: value for key, value in written.items() if fields[key].is_required() or value != fields[key].default
        }


class ProgramGuard(Entry):
    """What a guarded move takes for contact, and how it goes on where it meets nothing.

    force: at the tool [N]. trajectory: the motion without contact, as long as that of the primitive, which stands where
    contact is expected.
    """

    force: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    trajectory: _Motion


class ProgramPrimitive(_Sparse):
    """A primitive action with its time and its motion.

    name: as in the skill. does: what it does, in a word or two; None if the skill does not say. action: the kind
    of action, such as `JointMove` or `Grasp`. start, end: from the start of the step [s]. held: the object in the tool
    throughout; None if there is none. trajectory: the exact motion, on a clock from `start`. guard: of a move that ends
    at contact; left out of the file for all others.
    """

    name: str
    does: str | None = None
    action: str
    start: Seconds
    end: Seconds
    held: str | None
    trajectory: _Motion
    guard: ProgramGuard | None = None


class ProgramResponse(Entry):
    """What to do when a formula is violated, or a fault is seen: stop the robot, try the step again, or go on.

    retries: how many are allowed. when: what must be seen before a retry, a formula; None if nothing.
    """

    action: Literal["stop", "retry", "continue"]
    retries: int = 0
    when: str | None = None


class ProgramFormula(_Sparse):
    """A formula to be monitored, with the response to its violation, or to seeing its fault.

    formula: about objects, all times in seconds from the start of the step. fault: name of the fault that it describes;
    None if it describes none. settle: time that a literal may lag behind its expected change [s]. words: what happens
    at that fault, such as `it slips while it is lifted`; None if the skill does not say.
    """

    formula: str
    fault: str | None
    settle: Seconds
    response: ProgramResponse
    words: str | None = None


Spans = tuple[tuple[Seconds, Seconds], ...]  # intervals from the start of the step [s]


class ProgramTarget(_Sparse):
    """What decides an atom.

    cameras: how many must each see all boxes. boxes: where to look. seen: intervals in which a camera sees all boxes,
    by its name. usual: those in which its images usually show them.
    refuted: those in which they usually show that the atom is false; empty where that takes the same as to confirm it.
    """

    cameras: int
    boxes: tuple[TargetBox, ...]
    seen: Mapping[str, Spans]
    usual: Mapping[str, Spans] = {}
    refuted: Mapping[str, Spans] = {}


_Onset = Annotated[
    Onset,
    SerializedAs(
        dict[str, tuple[Seconds, ...]],
        _of_arrays(lambda times: Onset(np.array(times["x"]), np.array(times["shown"]))),
        lambda onset: {"x": onset.x.tolist(), "shown": onset.shown.tolist()},
    ),
]


class ProgramSight(Entry):
    """When images show a fault.

    windows: those of cameras of one rate and latency in order, apart from each other. onsets: of each interval in which
    it may happen.
    """

    windows: tuple[Annotated[Window, FileRecord()], ...]
    onsets: tuple[_Onset, ...]

    def latest(self, x: float) -> float | None:
        """How long after time x [s] of the step a fault is noticed at the latest [s]; None if it may never be."""
        onset = next((one for one in self.onsets if one.x[0] - 1e-9 <= x <= one.x[-1] + 1e-9), None)
        if onset is None:
            return None
        at = Onset(np.array([x, x]), np.interp([x, x], onset.x, onset.shown))
        return delays(self.windows, at, lambda t: t, np.empty(0)).worst


class Step(Entry):
    """A chosen candidate: a skill with all its parameters, objects and motion parameters by name.

    task: as it was asked for. time: duration of its motion [s]. q_avg, q_eoi: in 0..1; None where no formula applies,
    or there is no event of interest. faults, sights: the cost of each fault and when images show it, by its name.
    verdict: where it is blind, why, and what would help. primitives: in
    the order in which they are done. formulas: of the skill, in its order. targets: by the atom that they decide.
    before, after: the world that it starts from, and the one that it leaves behind.
    """

    task: str
    skill: str
    parameters: Mapping[str, float | str]
    time: Seconds
    q_avg: Share | None
    q_eoi: Share | None
    faults: Mapping[str, _Fault]
    verdict: str
    primitives: tuple[ProgramPrimitive, ...]
    formulas: tuple[ProgramFormula, ...]
    targets: Mapping[str, ProgramTarget]
    before: World
    after: World
    sights: Mapping[str, ProgramSight] = {}

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

    def in_words(self, literal: str) -> str:
        """What a literal says, such as `the tool does not hold g2`."""
        target = self.targets.get(literal.removeprefix(NOT))
        return fact_words(literal, () if target is None else target.boxes, self.before.X_WO)

    @property
    def says(self) -> dict[str, str]:
        """Every fact that formulas are about in words, by atom."""
        return {atom: self.in_words(atom) for atom in self.targets}


class Program(Entry):
    """Steps for one workspace, in the order in which they are done.

    workspace: its file, relative to the program's. digest: of `made_for`. checksum: of all that a file says apart from
    its workspace; empty until it is saved. marks: a sign for each value; they show where a file was changed whose
    checksum does not fit. joints: names of those of all trajectories, in their order. made_for: what the workspace said
    that matters, see `workspace.canonical_values`: it tells what has changed since.
    """

    sqrp_program: Literal[1] = 1
    workspace: str
    digest: str
    checksum: str = ""
    marks: str = ""
    joints: tuple[str, ...]
    steps: tuple[Step, ...]
    made_for: Mapping[str, Mapping[str, Plain]] = {}

    @property
    def skills(self) -> tuple[str, ...]:
        """The skills of its steps, each once."""
        return tuple(dict.fromkeys(step.skill for step in self.steps))


Replanner = Callable[[Step, World], Step | None]
"""Plans a step again from another world, for a retry; passed to the runtime, which cannot plan itself.

It gives the same skill with the same parameters; None if that is infeasible.
"""
