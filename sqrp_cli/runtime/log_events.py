"""What the events of a log hold, as far as something is shown of them: for logs that come from outside."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from sqrp_cli.knowledge.json_file import json_name

Numbers3 = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Numbers4 = Annotated[list[FiniteFloat], Field(min_length=4, max_length=4)]
Numbers7 = Annotated[list[FiniteFloat], Field(min_length=7, max_length=7)]


class _Fields(BaseModel):
    """Fields of an event; others are let be."""

    model_config = ConfigDict(strict=True)


class _ProgramStep(_Fields):
    skill: str
    parameters: dict[str, str | float]
    time: FiniteFloat


class _Run(_Fields):
    workspace: str
    digest: str
    cameras: list[str]
    rates: dict[str, Annotated[FiniteFloat, Field(gt=0)]] = {}
    steps: list[_ProgramStep] = []


class _Box(_Fields):
    frame: str
    size: Numbers3
    pose: Annotated[list[Numbers4], Field(min_length=4, max_length=4)]


class _Step(_Fields):
    boxes: dict[str, list[_Box]]


class _Primitive(_Fields):
    name: str


class _Shown(_Fields):
    value: Literal["true", "false", "blind"]
    asked: bool
    true: bool | None = None
    cameras: dict[str, Literal["true", "false", "blind"]]


class _Evidence(_Fields):
    exposed: FiniteFloat
    literals: dict[str, _Shown]


class _State(_Fields):
    q: list[FiniteFloat] = []
    held: str | None = None
    objects: dict[str, Numbers7] = {}


class _FirstState(_State):
    joints: list[str]
    q: list[FiniteFloat]
    held: str | None


class _Happening(_Fields):
    fault: str


class _Seen(_Fields):
    name: str


class _MovingOn(_Fields):
    to_see: str


class _Retry(_Fields):
    attempt: int
    of: int


_KINDS: Mapping[str, type[_Fields]] = {
    "run": _Run,
    "step": _Step,
    "primitive": _Primitive,
    "evidence": _Evidence,
    "state": _State,
    "first state": _FirstState,
    "injected": _Happening,
    "happened": _Happening,
    "fault": _Seen,
    "moving on": _MovingOn,
    "retry": _Retry,
}


def wrong_field(kind: str, fields: Mapping[str, Any]) -> str | None:
    """What is wrong with the fields of an event, in words; None where nothing is.

    kind: of the event; `first state` for the first state of a log, which says everything.
    """
    expected = _KINDS.get(kind)
    if expected is None:
        return None
    try:
        expected.model_validate(fields)
    except ValidationError as error:
        return first_words(error)
    return None


def first_words(error: ValidationError) -> str:
    """The first thing that is wrong, with the field."""
    first = error.errors()[0]
    place, message = json_name(first["loc"]), first["msg"]
    return f"`{place}`: {message[0].lower()}{message[1:]}"
