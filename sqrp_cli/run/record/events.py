"""The events of a run: a record for each kind, published to listeners and written as a line of the log.

The log begins with `RunBegan` and ends with `RunReported`. A line has the fields that an event was given, in the order
of their declaration. Logs of other programs may lack those with a default.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Annotated, Literal, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    GetJsonSchemaHandler,
    PlainSerializer,
    PlainValidator,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticKnownError

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.record.report import Outcome, RunReport

VERSION: Literal[1] = 1
"""Of the log's fields."""
_TRUTHS = {truth.word: truth for truth in (Truth.TRUE, Truth.FALSE, Truth.UNKNOWN)}


def _truth(found: object) -> Truth:
    if isinstance(found, Truth):
        return found
    if not isinstance(found, str) or found not in _TRUTHS:
        raise PydanticKnownError("literal_error", {"expected": "'true', 'false' or 'blind'"})
    return _TRUTHS[found]


ShownTruth = Annotated[
    Truth,
    PlainValidator(_truth),
    PlainSerializer(lambda truth: truth.word, return_type=str),
    WithJsonSchema({"type": "string", "enum": list(_TRUTHS)}),
]
"""A truth value that images show: `true`, `false` or `blind` in the log."""
Numbers3 = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Numbers4 = Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)]
Numbers7 = Annotated[list[FiniteFloat], Field(min_length=7, max_length=7)]


class _LogRecord(BaseModel):
    """Of an event; keys that a log has beside its fields are let be."""

    model_config = ConfigDict(strict=True, frozen=True, use_attribute_docstrings=True)


class _Event(_LogRecord):
    t: FiniteFloat
    """Simulated time [s]."""
    event: str
    """The kind of event."""

    def line(self) -> dict[str, object]:
        """Its line in the log."""
        return {"t": self.t, "event": self.event, **self.model_dump(exclude_unset=True)}

    def has(self, field: str) -> bool:
        """Whether an optional field is set."""
        return field in self.model_fields_set

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Schema of the line, which always has its kind."""
        schema = handler.resolve_ref_schema(handler(core))
        schema["properties"]["event"].pop("default", None)
        schema["required"] = ["t", "event", *(key for key in schema["required"] if key not in {"t", "event"})]
        return schema


class ProgramStep(_LogRecord):
    """A step of the program that is run."""

    skill: str
    """Name of the skill."""
    parameters: dict[str, str | float]
    """Objects and motion parameters by name."""
    time: FiniteFloat
    """Duration of its motion as planned [s]."""


class RunBegan(_Event):
    """The program and its circumstances: the first line of a log."""

    event: Literal["run"] = "run"
    sqrp_log: Literal[1]
    """Version of the log's fields."""
    workspace: str
    """Name of the workspace."""
    digest: str
    """Of what was understood of the workspace."""
    seed: int = 0
    """Of everything random in the run."""
    cameras: list[str]
    """Their names."""
    rates: dict[str, Annotated[FiniteFloat, Field(gt=0)]] = {}
    """How often each camera takes an image [Hz]."""
    faults: list[str] = []
    """Faults to inject, in the form of `--fault`."""
    steps: list[ProgramStep] = []
    """Of the program, in order."""


class AskedBox(_LogRecord):
    """A box in which images are judged."""

    frame: str
    """A link of the robot, so that the box moves with it, or `world`."""
    size: Numbers3
    """Full extents [m]."""
    pose: Annotated[list[Numbers4], Field(min_length=4, max_length=4)]
    """Its pose in the frame, 4x4."""


class StepBegan(_Event):
    """An attempt at a step begins: the robot looks, then moves."""

    event: Literal["step"] = "step"
    number: int = 1
    """Of the step, from 1."""
    skill: str = ""
    """Name of the skill."""
    parameters: dict[str, str | float] = {}
    """Objects and motion parameters by name."""
    time: FiniteFloat = 0.0
    """Duration of its motion as planned [s]."""
    boxes: dict[str, list[AskedBox]]
    """Where images are searched, by atom."""


class PrimitiveBegan(_Event):
    """A primitive action begins."""

    event: Literal["primitive"] = "primitive"
    name: str
    """As in the skill."""
    does: str | None = None
    """What it does, in a word or two; None in logs of earlier versions."""


class ShownAtom(_LogRecord):
    """What images of one time show of an atom."""

    value: ShownTruth
    """The value from all cameras together."""
    true: bool | None = None
    """The value in the simulation when the images were taken."""
    predicted: bool = False
    """Whether the program predicts that enough cameras see it."""
    asked: bool
    """Whether a formula requires it at that time."""
    cameras: dict[str, ShownTruth]
    """The value from each camera that can judge it."""


class EvidenceSeen(_Event):
    """The evidence of a time is known, or has changed because another image of that time arrived."""

    event: Literal["evidence"] = "evidence"
    exposed: FiniteFloat
    """When the images were taken [s]."""
    step_time: FiniteFloat | None = None
    """The same since the motion of the step began [s]; null before it."""
    literals: dict[str, ShownAtom]
    """By atom."""


class WholeState(_Event):
    """The true poses, which the robot does not know: the first state of a run, complete."""

    event: Literal["state"] = "state"
    joints: list[str]
    """Names of all joints."""
    q: list[FiniteFloat]
    """Their positions [rad or m]."""
    held: str | None
    """What the tool holds."""
    objects: dict[str, Numbers7] = {}
    """Poses in the world: x, y, z [m] and a quaternion x, y, z, w."""

    def line(self) -> dict[str, object]:
        """What the log holds of it: of objects nothing where there are none."""
        return {key: value for key, value in super().line().items() if key != "objects" or value}

    def since(self, before: WholeState) -> StateChanged:
        """What is not as it was before."""
        moved = {name: X for name, X in self.objects.items() if before.objects.get(name) != X}
        fields: dict[str, object] = {"t": self.t}
        fields |= {key: getattr(self, key) for key in ("q", "held") if getattr(self, key) != getattr(before, key)}
        return StateChanged.model_validate({**fields, "objects": moved} if moved else fields)


class StateChanged(_Event):
    """The true poses now; what is left out is unchanged."""

    event: Literal["state"] = "state"
    q: list[FiniteFloat] = []
    """Positions of all joints [rad or m]."""
    held: str | None = None
    """What the tool holds."""
    objects: dict[str, Numbers7] = {}
    """Poses in the world of what has moved: x, y, z [m] and a quaternion x, y, z, w."""


class FaultInjected(_Event):
    """A fault is injected."""

    event: Literal["injected"] = "injected"
    fault: str
    """In the form of `--fault`."""


class FaultHappened(_Event):
    """The formula of a fault that was injected has become true in the cell."""

    event: Literal["happened"] = "happened"
    fault: str
    """Its name."""


class FaultSeen(_Event):
    """The images show a fault."""

    event: Literal["fault"] = "fault"
    name: str
    """As the skill calls it; of another violation that the skill lets pass, its formula."""
    text: str = ""
    """What is wrong, in words."""
    response: Literal["stop", "retry", "continue"] = "stop"
    """The response of the skill."""


class MovingOn(_Event):
    """The robot continues its motion to where the condition of a retry can be seen."""

    event: Literal["moving on"] = "moving on"
    to_see: str
    """The condition."""
    cameras: list[str] = []
    """The cameras that should see it from there."""
    until: FiniteFloat = 0.0
    """When it is to stop, in the time of the step's motion [s]."""


class Stopping(_Event):
    """The robot is commanded to stop."""

    event: Literal["stopping"] = "stopping"
    reason: str = ""
    """Why it stops, in words."""


class ContactFelt(_Event):
    """A guarded move ends: the tool met what it looked for."""

    event: Literal["contact"] = "contact"
    force: FiniteFloat
    """At the tool [N]."""


class Retrying(_Event):
    """A motion for another attempt at a step is planned."""

    event: Literal["retry"] = "retry"
    attempt: int
    """Number of the retry, from 1."""
    of: int
    """How many the skill allows."""
    step: str = ""
    """Its skill."""
    time: FiniteFloat = 0.0
    """Duration of the motion as planned [s]."""


class RunEnded(_Event):
    """The program is done, or the robot has stopped."""

    event: Outcome
    reason: str | None = None
    """Why it stopped, or what was not noticed."""


_NOT_LOGGED = ("schema", "document", "workspace", "wall")
"""Fields of a run's document that the last line of a log does not have: its header has the workspace."""


class RunReported(_Event):
    """How a run went: the last line of a log, with the fields of the report."""

    event: Literal["report"] = "report"
    report: RunReport

    def line(self) -> dict[str, object]:
        """What the log holds: as in logs of earlier versions, no wall time, no camera of a fault of a step."""
        document = {key: value for key, value in asdict(self.report).items() if key not in _NOT_LOGGED}
        for fault in document["faults"]:
            if fault["camera"] is None:
                del fault["camera"]
        return {"t": self.t, "event": self.event, **document}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Schema of the line, in which the report's fields are those of the event."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        report = handler.resolve_ref_schema(schema["properties"].pop("report"))
        known = {key: value for key, value in report["properties"].items() if key not in _NOT_LOGGED}
        schema["properties"] |= known
        schema["required"].remove("report")
        return schema


State = WholeState | StateChanged
"""Where everything really is."""
Event = (
    RunBegan
    | StepBegan
    | PrimitiveBegan
    | EvidenceSeen
    | State
    | FaultInjected
    | FaultHappened
    | FaultSeen
    | MovingOn
    | Stopping
    | ContactFelt
    | Retrying
    | RunEnded
    | RunReported
)
"""An event of a run."""
KINDS: Mapping[str, type[Event]] = {
    kind: model for model in get_args(Event) for kind in get_args(model.model_fields["event"].annotation)
}
"""The records by the kind that the log calls them; the first state of a log is a `WholeState` instead."""
Listener = Callable[[Event], None]
"""Receives events: the log, the live view."""


class EventPublisher:
    """Passes the events of a run to its listeners, and adds up the wall time per activity."""

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self._listeners = tuple(listeners)
        self._began = time.perf_counter()
        self.doing = "looks"
        """What the robot does now."""
        self.wall: dict[str, float] = {}
        """Wall time by activity [s]."""

    def publish(self, event: Event) -> None:
        """Publish an event, at its time on the cell's clock to the microsecond."""
        event = event.model_copy(update={"t": round(event.t, 6)})
        for listener in self._listeners:
            listener(event)

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Add the elapsed wall time to an activity."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.wall[what] = self.wall.get(what, 0.0) + time.perf_counter() - began

    def elapsed(self) -> float:
        """Wall time since the beginning [s]."""
        return time.perf_counter() - self._began


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
