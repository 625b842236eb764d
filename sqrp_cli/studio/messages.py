"""What browsers get: the page, and texts in JSON with `do` first, such as what can be moved; and what they may ask for.

What the process that computes is asked has a record each, too.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Problem, bad_option
from sqrp_cli.geometry import matrix_to_rpy
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.checks import ReportedProblem
from sqrp_cli.show.pages.assembly import assembled, asset, tidy
from sqrp_cli.studio.moves import Move, aim, way_up
from sqrp_cli.task.task import in_words

if TYPE_CHECKING:
    from sqrp_cli.study.result import Criterion


def message(do: str, **fields: object) -> str:
    """A message: figures with all their digits, nothing invisible in names."""
    return json.dumps(tidy({"do": do, **fields}, digits=None), allow_nan=False)


def kind_of(text: str) -> str:
    """The `do` of a message."""
    return text.split('"', 4)[3]


def findings(problems: Sequence[Problem]) -> list[ReportedProblem]:
    """Problems as documents have them."""
    return [ReportedProblem.of(problem) for problem in problems]


def parameters(workspace: Workspace, task: str) -> list[dict[str, object]]:
    """The motion parameters of a task's skill, with their values and the words that they may have instead."""
    skill = workspace.skills.get(task.split()[0].lower()) if task.split() else None
    if skill is None:
        return []
    return [
        {
            "name": one.name,
            "values": [in_words(skill, {one.name: value})[one.name].replace(" ", "") for value in one.values],
            "words": [word for kind in one.kinds for word in kind.words],
        }
        for one in skill.motion_parameters
    ]


def handles(workspace: Workspace) -> dict[str, Any]:
    """What can be moved, and where it is as people would type it."""
    cameras = {
        name: Move(
            kind="camera",
            name=name,
            position=camera.X_FC[:3, 3].tolist(),
            look_at=aim(workspace, camera).tolist(),
            fov=2.0 * math.atan(0.5 * camera.width / float(camera.matrix[0, 0])),
        )
        for name, camera in workspace.cameras.items()
    }
    objects = {
        name: Move(kind="object", name=name, position=X[:3, 3].tolist(), yaw=matrix_to_rpy(X[:3, :3])[2])
        for name, one in workspace.objects.items()
        if (X := one.X_WO) is not None and f"objects.{name}.pose" in workspace.places
    }
    X_WB = workspace.robot.X_WB
    base = Move(kind="base", name="", position=X_WB[:3, 3].tolist(), yaw=matrix_to_rpy(X_WB[:3, :3])[2])
    frames = {name: camera.frame for name, camera in workspace.cameras.items()}
    ups = {name: way_up(workspace, camera).tolist() for name, camera in workspace.cameras.items()}
    return {"camera": cameras, "object": objects, "base": {"": base}, "frames": frames, "ups": ups}


SCRIPTS = ("gizmo", "fields", "runs", "studio")  # its own scripts, each after those that it needs


def studio_page(title: str, socket: str) -> str:
    """The text of the page. socket: where its scripts may connect to."""
    return assembled(
        title,
        "\n".join(asset(f"{name}.js", "sqrp_cli.studio") for name in SCRIPTS),
        data={},
        style=asset("studio.css", "sqrp_cli.studio"),
        further=asset("studio.html", "sqrp_cli.studio"),
        policy=f"; connect-src {socket}; img-src data:; base-uri 'none'; form-action 'none'",
    )


Words = Annotated[str, Field(max_length=2000, pattern=r"^[^\x00]*$")]  # no name of a file has a zero byte


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

    content: bytes  # of the workspace file
    task: str
    by: Criterion


@dataclass(frozen=True, kw_only=True)
class Rank(Asked):
    """To rank it."""

    number: int  # of the question; answers carry it
    of_saved: bool = False  # whether only figures are wanted, to compare others with


Question = Rank | Choose | Hold  # what the process that computes is asked
