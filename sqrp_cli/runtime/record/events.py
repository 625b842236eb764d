"""What happens in a run, a record for each kind of event: as it is published, and as a line of the log holds it.

The log begins with `RunBegan` and ends with `RunReported`. What stands in its lines are the fields that an event was
given, in the order in which they are declared. Those with a default are missing in some logs from elsewhere. The
publisher gives events to those who listen.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Annotated, Literal, Protocol, get_args

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
from sqrp_cli.runtime.record.report import RunReport

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


class _Part(BaseModel):
    """Of an event; keys that a log has beside its fields are let be."""

    model_config = ConfigDict(strict=True, frozen=True, use_attribute_docstrings=True)


class _Event(_Part):
    t: FiniteFloat
    """Simulated time [s]."""
    event: str
    """The kind of event."""

    def line(self) -> dict[str, object]:
        """What the log holds of it."""
        return {"t": self.t, "event": self.event, **self.model_dump(exclude_unset=True)}

    def tells(self, field: str) -> bool:
        """Whether it was given a field that can be left out."""
        return field in self.model_fields_set

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Schema of the line, which always has its kind."""
        schema = handler.resolve_ref_schema(handler(core))
        schema["properties"]["event"].pop("default", None)
        schema["required"] = ["t", "event", *(key for key in schema["required"] if key not in {"t", "event"})]
        return schema


class ProgramStep(_Part):
    """A step of the program that is run."""

    skill: str
    parameters: dict[str, str | float]
    time: FiniteFloat
    """Duration of its motion as planned [s]."""


class RunBegan(_Event):
    """What is run and how: the first line of a log."""

    event: Literal["run"] = "run"
    sqrp_log: Literal[1]
    """Version of the log's fields."""
    workspace: str
    digest: str
    """Of the workspace's files."""
    seed: int = 0
    cameras: list[str]
    rates: dict[str, Annotated[FiniteFloat, Field(gt=0)]] = {}
    """How often each camera takes an image [Hz]."""
    faults: list[str] = []
    """What is to happen, as `--fault` takes it."""
    steps: list[ProgramStep] = []


class AskedBox(_Part):
    """A box in which images are judged."""

    frame: str
    """A link of the robot, with which it moves, or `world`, where it stays."""
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
    parameters: dict[str, str | float] = {}
    time: FiniteFloat = 0.0
    """Duration of its motion as planned [s]."""
    boxes: dict[str, list[AskedBox]]
    """Where images are searched, by atom."""


class PrimitiveBegan(_Event):
    """A primitive action begins."""

    event: Literal["primitive"] = "primitive"
    name: str


class ShownAtom(_Part):
    """What the images of a time show of an atom."""

    value: ShownTruth
    """What all cameras together say."""
    true: bool | None = None
    """The value in the simulation when the images were taken."""
    predicted: bool = False
    """Whether the program predicts that enough cameras see it."""
    asked: bool
    """Whether a formula asks about it then."""
    cameras: dict[str, ShownTruth]
    """What each camera says that can judge it."""


class EvidenceSeen(_Event):
    """What images show has become known, or changed as a later image of the same time arrived."""

    event: Literal["evidence"] = "evidence"
    exposed: FiniteFloat
    """When the images were taken [s]."""
    step_time: FiniteFloat | None = None
    """The same since the motion of the step began [s]; null before it."""
    literals: dict[str, ShownAtom]
    """By atom."""


class WholeState(_Event):
    """Where everything really is, which the robot does not know: the first of a run, with all of it."""

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
    """Where everything really is now: what is left out is as it was."""

    event: Literal["state"] = "state"
    q: list[FiniteFloat] = []
    """Positions of all joints [rad or m]."""
    held: str | None = None
    """What the tool holds."""
    objects: dict[str, Numbers7] = {}
    """Poses in the world of what has moved: x, y, z [m] and a quaternion x, y, z, w."""


class FaultInjected(_Event):
    """A fault is made to happen."""

    event: Literal["injected"] = "injected"
    fault: str
    """As `--fault` takes it."""


class FaultHappened(_Event):
    """The formula of a fault that was injected has become true in the cell."""

    event: Literal["happened"] = "happened"
    fault: str
    """Its name."""


class FaultSeen(_Event):
    """The images show a fault."""

    event: Literal["fault"] = "fault"
    name: str
    text: str = ""
    """What is wrong, in words."""
    response: Literal["stop", "retry", "continue"] = "stop"
    """What the skill says is to be done."""


class MovingOn(_Event):
    """The robot goes on with its motion, to where the condition of a retry can be seen."""

    event: Literal["moving on"] = "moving on"
    to_see: str
    """The condition."""
    cameras: list[str] = []
    """That should see it from there."""
    until: FiniteFloat = 0.0
    """When it is to stop, in the time of the step's motion [s]."""


class Stopping(_Event):
    """The robot is told to stop."""

    event: Literal["stopping"] = "stopping"
    reason: str = ""


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

    event: Literal["done", "stopped"]
    reason: str | None = None
    """Why it stopped."""


class RunReported(_Event):
    """How a run went: the last line of a log, with the fields of the report."""

    event: Literal["report"] = "report"
    report: RunReport

    def line(self) -> dict[str, object]:
        """What the log holds of it: no wall time; as in logs of earlier versions, no camera of a fault of a step."""
        document = {key: value for key, value in asdict(self.report).items() if key != "wall"}
        for fault in document["faults"]:
            if fault["camera"] is None:
                del fault["camera"]
        return {"t": self.t, "event": self.event, **document}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Schema of the line, in which the report's fields are those of the event."""
        schema = super().__get_pydantic_json_schema__(core, handler)
        report = handler.resolve_ref_schema(schema["properties"].pop("report"))
        schema["properties"] |= {key: value for key, value in report["properties"].items() if key != "wall"}
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
    | Retrying
    | RunEnded
    | RunReported
)
"""Something that happens in a run."""


KINDS: Mapping[str, type[Event]] = {
    kind: model for model in get_args(Event) for kind in get_args(model.model_fields["event"].annotation)
}
"""The records by the kind that the log calls them; the first state of a log is a `WholeState` instead."""


class Listener(Protocol):
    """Whoever wants to know what happens: the log, the live view."""

    def __call__(self, event: Event) -> None:
        """Take notice."""


class EventPublisher:
    """Gives the events of a run to its listeners, and keeps account of where the wall time goes."""

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self._listeners = tuple(listeners)
        self._began = time.perf_counter()
        self.doing = "looks"
        """What the robot does now, in a word."""
        self.wall: dict[str, float] = {}
        """Seconds of wall time by what they were spent on."""

    def publish(self, event: Event) -> None:
        """Publish an event, at its time on the cell's clock to the microsecond."""
        event = event.model_copy(update={"t": round(event.t, 6)})
        for listener in self._listeners:
            listener(event)

    def begin(self, t: float, primitive: str) -> None:
        """Publish that a primitive action begins."""
        self.doing = primitive
        self.publish(PrimitiveBegan(t=t, name=primitive))

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Add the time that passes to what it is spent on."""
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
