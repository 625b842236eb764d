"""The events of a run: what an event of each kind says, how they are published, and how each is a line of the log.

The log begins with an event `run` and ends with `report`. A line has the fields that an event was given, in the order
of their declaration. Logs of other programs may lack those with a default.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_type_hints

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    GetJsonSchemaHandler,
    create_model,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.logic.truth import TruthWord
from sqrp_cli.program.record import Program
from sqrp_cli.run.record.report import Outcome, RunReport

VERSION: Literal[1] = 1  # Of the log's fields
Numbers3 = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Numbers4 = Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)]
Numbers7 = Annotated[list[FiniteFloat], Field(min_length=7, max_length=7)]


class ProgramStep(BaseModel, strict=True, frozen=True, use_attribute_docstrings=True):
    """A step of the program that is run."""

    skill: str
    """Name of the skill."""
    parameters: dict[str, str | float]
    """Objects and motion parameters by name."""
    time: FiniteFloat
    """Duration of its motion as planned [s]."""


class AskedBox(BaseModel, strict=True, frozen=True, use_attribute_docstrings=True):
    """A box in which images are judged."""

    frame: str
    """A link of the robot, so that the box moves with it, or `world`."""
    size: Numbers3
    """Full extents [m]."""
    pose: Annotated[list[Numbers4], Field(min_length=4, max_length=4)]
    """Its pose in the frame, 4x4."""


class ShownAtom(BaseModel, strict=True, frozen=True, use_attribute_docstrings=True):
    """What images of one time show of an atom."""

    value: TruthWord
    """The value from all cameras together."""
    true: bool | None = None
    """The value in the simulation when the images were taken."""
    predicted: bool = False
    """Whether the program predicts that enough cameras see it."""
    asked: bool
    """Whether a formula requires it at that time."""
    cameras: dict[str, TruthWord]
    """The value from each camera that can judge it."""


def _says(text: str, default: Any = ...) -> Any:  # noqa: ANN401 - as `Field`
    """What a field means; default: of one that logs of other programs may lack."""
    return Field(default, description=text)


_POSE = "x, y, z [m] and a quaternion x, y, z, w"


class EventFields:
    """The fields that events may have; `MODELS` says which kind has which."""

    sqrp_log: Annotated[Literal[1], _says("Version of the log's fields.")]
    workspace: Annotated[str, _says("Name of the workspace.")]
    digest: Annotated[str, _says("Of what was understood of the workspace.")]
    seed: Annotated[int, _says("Of everything random in the run.", 0)]
    cameras: Annotated[list[str], _says("Their names.")]
    rates: Annotated[
        dict[str, Annotated[FiniteFloat, Field(gt=0)]], _says("How often each camera takes an image [Hz].", {})
    ]
    faults: Annotated[list[str], _says("Faults to inject, in the form of `--fault`.", [])]
    steps: Annotated[list[ProgramStep], _says("Of the program, in order.", [])]
    number: Annotated[int, _says("Of the step, from 1.", 1)]
    skill: Annotated[str, _says("Name of the skill.", "")]
    parameters: Annotated[dict[str, str | float], _says("Objects and motion parameters by name.", {})]
    time: Annotated[FiniteFloat, _says("Duration of its motion as planned [s].", 0.0)]
    boxes: Annotated[dict[str, list[AskedBox]], _says("Where images are searched, by atom.")]
    says: Annotated[dict[str, str], _says("The facts in words, by atom.", {})]
    name: Annotated[str, _says("As in the skill.")]
    does: Annotated[str | None, _says("What it does, in a word or two; None if the skill does not say.", None)]
    exposed: Annotated[FiniteFloat, _says("When the images were taken [s].")]
    step_time: Annotated[
        FiniteFloat | None, _says("The same since the motion of the step began [s]; null before it.", None)
    ]
    literals: Annotated[dict[str, ShownAtom], _says("By atom.")]
    joints: Annotated[list[str], _says("Names of all joints.")]
    q: Annotated[list[FiniteFloat], _says("Their positions [rad or m].")]
    held: Annotated[str | None, _says("What the tool holds.")]
    objects: Annotated[dict[str, Numbers7], _says(f"Poses in the world: {_POSE}.", {})]
    fault: Annotated[str, _says("In the form of `--fault`.")]
    text: Annotated[str, _says("What is wrong, in words.", "")]
    response: Annotated[Literal["stop", "retry", "continue"], _says("The response of the skill.", "stop")]
    to_see: Annotated[str, _says("The condition.")]
    until: Annotated[FiniteFloat, _says("When it is to stop, in the time of the step's motion [s].", 0.0)]
    reason: Annotated[str | None, _says("Why it stopped, or what was not noticed.", None)]
    force: Annotated[FiniteFloat, _says("At the tool [N].")]
    attempt: Annotated[int, _says("Number of the retry, from 1.")]
    of: Annotated[int, _says("How many the skill allows.")]
    step: Annotated[str, _says("Its skill.", "")]
    report: Annotated[RunReport, _says("All of it.")]


_TYPES = get_type_hints(EventFields, include_extras=True)
_KIND = "The kind of event."


if TYPE_CHECKING:  # each kind has some of them
    _Fields = EventFields
else:
    _Fields = object


class Event(BaseModel, _Fields):
    """An event of a run, with the fields of its kind; keys that a line of a log has beside them are let be."""

    model_config = ConfigDict(strict=True, frozen=True)

    t: FiniteFloat = Field(description="Simulated time [s].")
    event: str = Field(description=_KIND)

    def line(self) -> dict[str, object]:
        """Its line in the log."""
        fields = self.model_dump(exclude_unset=True, exclude={"report"})
        if self.event == "report":  # no wall time, no camera of a fault of a step
            fields |= {key: value for key, value in asdict(self.report).items() if key not in _NOT_LOGGED}
            for fault in fields["faults"]:
                if fault["camera"] is None:
                    del fault["camera"]
        return {"t": self.t, "event": self.event, **fields}

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Schema of the line, which always has its kind; of a report, its fields are those of the event."""
        schema = handler.resolve_ref_schema(handler(core))
        properties = schema["properties"]
        properties["event"].pop("default", None)
        schema["required"] = ["t", "event", *(key for key in schema["required"] if key not in {"t", "event", "report"})]
        if "report" in properties:
            report = handler.resolve_ref_schema(properties.pop("report"))
            properties |= {key: value for key, value in report["properties"].items() if key not in _NOT_LOGGED}
        return schema


_NOT_LOGGED = ("schema", "document", "workspace", "wall")
"""Fields of a run's document that the last line of a log does not have: its header has the workspace."""


def _kind(name: str, kind: Any, about: str, fields: str, /, **others: tuple[Any, ...]) -> type[Event]:  # noqa: ANN401 - or a literal
    """The record of a kind of event, with some fields, by their names.

    others: what else some of them mean, with a default where logs may lack them, and a narrower type.
    """
    literal: Any = Literal
    type_, default = (literal[kind], kind) if isinstance(kind, str) else (kind, ...)
    made: dict[str, Any] = {"event": (Annotated[type_, Field(description=_KIND)], default)}
    for key in fields.split():
        hint, said = _TYPES[key], _TYPES[key].__metadata__[-1]
        made[key] = (hint, ... if said.is_required() else said.default)
        if key in others:
            text, default, *narrower = others[key]
            made[key] = (Annotated[narrower[0] if narrower else hint, Field(description=text)], default)
    found: type[Event] = create_model(name, __base__=Event, __doc__=about, **made)
    return found


MODELS = (
    _kind(
        "RunBegan",
        "run",
        "The program and its circumstances: the first line of a log.",
        "sqrp_log workspace digest seed cameras rates faults steps",
    ),
    _kind(
        "StepBegan",
        "step",
        "An attempt at a step begins: the robot looks, then moves.",
        "number skill parameters time boxes says",
    ),
    _kind("PrimitiveBegan", "primitive", "A primitive action begins.", "name does"),
    _kind(
        "EvidenceSeen",
        "evidence",
        "The evidence of a time is known, or has changed because another image of that time arrived.",
        "exposed step_time literals",
    ),
    _kind(
        "WholeState",
        "state",
        "The true poses, which the robot does not know: the first state of a run, complete.",
        "joints q held objects",
    ),
    _kind(
        "StateChanged",
        "state",
        "The true poses now; what is left out is unchanged.",
        "q held objects",
        q=("Positions of all joints [rad or m].", []),
        held=("What the tool holds.", None),
        objects=(f"Poses in the world of what has moved: {_POSE}.", {}),
    ),
    _kind("FaultInjected", "injected", "A fault is injected.", "fault"),
    _kind(
        "FaultHappened",
        "happened",
        "The formula of a fault that was injected has become true in the cell.",
        "fault",
        fault=("Its name.", ...),
    ),
    _kind(
        "FaultSeen",
        "fault",
        "The images show a fault.",
        "name text response",
        name=("As the skill calls it; of another violation that the skill lets pass, its formula.", ...),
    ),
    _kind(
        "MovingOn",
        "moving on",
        "The robot continues its motion to where the condition of a retry can be seen.",
        "to_see cameras until",
        cameras=("The cameras that should see it from there.", []),
    ),
    _kind(
        "Stopping",
        "stopping",
        "The robot is commanded to stop.",
        "reason",
        reason=("Why it stops, in words.", "", str),
    ),
    _kind("ContactFelt", "contact", "A guarded move ends: the tool met what it looked for.", "force"),
    _kind(
        "Retrying",
        "retry",
        "A motion for another attempt at a step is planned.",
        "attempt of step time",
        time=("Duration of the motion as planned [s].", 0.0),
    ),
    _kind("RunEnded", Outcome, "The program is done, or the robot has stopped.", "reason"),
    _kind("RunReported", "report", "How a run went: the last line of a log, with the fields of the report.", "report"),
)
"""The record of each kind of event: its fields, what they mean, and defaults."""
KINDS: Mapping[str, type[Event]] = {
    kind: model for model in MODELS for kind in get_args(model.model_fields["event"].annotation)
}
"""The records by the kind that the log calls them; the first state of a log is a `WHOLE_STATE` instead."""
WHOLE_STATE = next(model for model in MODELS if "joints" in model.model_fields)  # The record of the first state
LINE: Any = Union[MODELS]  # noqa: UP007 - of as many as there are
"""The type of any line of a log, for its schema."""
BETWEEN: Mapping[str, str] = {"step": "looks", "moving on": "moves on to look", "stopping": "stops"}
"""What the robot does from events of these kinds on until a primitive begins, in words."""
Listener = Callable[[Event], None]  # Receives events: the log, the live view


def event(kind: str, t: float, **fields: Any) -> Event:  # noqa: ANN401 - as the kind has them
    """An event of a kind at a time [s] of the run. Raises TypeError for a field that the kind does not have."""
    model = WHOLE_STATE if "joints" in fields else KINDS[kind]
    if unknown := fields.keys() - model.model_fields.keys():
        raise TypeError(f"an event `{kind}` has no {', '.join(unknown)}")
    return model(t=t, event=kind, **fields) if kind in get_args(Outcome) else model(t=t, **fields)


def run_began(program: Program, workspace: Workspace, seed: int, faults: Sequence[str]) -> Event:
    """What a log begins with; faults: to inject, in the form of `--fault`."""
    steps = [ProgramStep(skill=step.skill, parameters=dict(step.parameters), time=step.time) for step in program.steps]
    return event(
        "run",
        0.0,
        sqrp_log=VERSION,
        workspace=workspace.name,
        digest=workspace.digest,
        seed=seed,
        cameras=list(workspace.cameras),
        rates={name: camera.rate for name, camera in workspace.cameras.items()},
        faults=faults,
        steps=steps,
    )


class EventPublisher:
    """Passes the events of a run to its listeners, and adds up the wall time per activity."""

    def __init__(self, listeners: Sequence[Listener]) -> None:
        self._listeners = tuple(listeners)
        self.began = time.perf_counter()
        """When the run began, by the clock of this process [s]."""
        self.doing = BETWEEN["step"]
        """What the robot does now."""
        self.wall: dict[str, float] = {}
        """Wall time by activity [s]."""

    def publish(self, kind: str, t: float, **fields: Any) -> None:  # noqa: ANN401 - as the kind has them
        """Publish an event of a kind at a time on the cell's clock [s], told to the microsecond."""
        told = event(kind, round(t, 6), **fields)
        self.doing = told.name if kind == "primitive" else BETWEEN.get(kind, self.doing)
        for listener in self._listeners:
            listener(told)

    @contextmanager
    def timed(self, what: str) -> Iterator[None]:
        """Add the elapsed wall time to an activity."""
        began = time.perf_counter()
        try:
            yield
        finally:
            self.wall[what] = self.wall.get(what, 0.0) + time.perf_counter() - began


def listed(names: Sequence[str]) -> str:
    """Names as in a sentence."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
