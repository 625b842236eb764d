"""What a browser may ask for, and what the process that computes is asked: one record each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from sqrp_cli.errors import bad_option
from sqrp_cli.studio.moves import Move

if TYPE_CHECKING:
    from sqrp_cli.programming.result import Criterion


Words = Annotated[str, Field(max_length=2000, pattern=r"^[^\x00]*$")]
"""No name of a file has a zero byte."""


class _Request(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")


class Hold(_Request):
    """A hand holds something, and moves it."""

    do: Literal["hold"] = "hold"
    move: Move
    number: int
    """Of the sketch that is asked for; its answer carries it."""


class PutDown(_Request):
    """A hand has put something down: the text changes."""

    do: Literal["put"]
    move: Move


class SetValue(_Request):
    """A value of the workspace is set by its path."""

    do: Literal["set"]
    path: Words
    value: Words
    """As YAML text."""


class Plain(_Request):
    """Something that needs no more words."""

    do: Literal["rest", "undo", "redo", "difference", "save", "advise", "place", "stop", "reread"]


class AskTask(_Request):
    """Another task, or another order of its candidates."""

    do: Literal["task"]
    text: Words
    by: Literal["q_eoi", "q_avg", "time", "delay", "expected_time"]


class Choose(_Request):
    """Another candidate is shown over time."""

    do: Literal["choose"] = "choose"
    name: Words


class Apply(_Request):
    """One of the changes that were found is made."""

    do: Literal["apply"]
    number: Annotated[int, Field(ge=1, le=1000)]


class WriteProgram(_Request):
    """The chosen candidate is appended to a program file."""

    do: Literal["program"]
    file: Words


class RunProgram(_Request):
    """A program file is run in the simulated cell."""

    do: Literal["run"]
    file: Words
    faults: Annotated[list[Words], Field(max_length=20)]


class DropFault(_Request):
    """A fault is to happen now."""

    do: Literal["fault"]
    name: Words


Request = Hold | PutDown | SetValue | Plain | AskTask | Choose | Apply | WriteProgram | RunProgram | DropFault

_REQUEST: TypeAdapter[Request] = TypeAdapter(Annotated[Request, Field(discriminator="do")])


def read_request(text: str) -> Request:
    """A message of a browser. Raises InputError for anything else."""
    try:
        return _REQUEST.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise bad_option(f"this request is not understood: {where}: {first['msg']}") from None


@dataclass(frozen=True)
class Asked:
    """What is ranked: a task in the cell of a text."""

    content: bytes
    """Of the workspace file."""
    task: str
    by: Criterion


@dataclass(frozen=True, kw_only=True)
class Rank(Asked):
    """To rank it."""

    number: int
    """Of the question; answers carry it."""
    of_saved: bool = False
    """Whether only figures are wanted, to compare others with."""


Question = Rank | Choose | Hold
"""What the process that computes is asked."""
