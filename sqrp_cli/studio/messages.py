"""What browsers get: the page, and texts in JSON with `do` first, such as what can be moved; and what they may ask for.

What the process that computes is asked is here, too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError, create_model

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Problem, bad_option
from sqrp_cli.geometry import Array, matrix_to_rpy
from sqrp_cli.records import dataclass
from sqrp_cli.show.documents.checks import ReportedProblem
from sqrp_cli.show.pages.assembly import tidy
from sqrp_cli.studio.moves import Move, aim

if TYPE_CHECKING:
    from sqrp_cli.study.result import Criterion


def message(do: str, **fields: object) -> str:
    """A message: figures with all their digits, nothing invisible in names."""
    return json.dumps(tidy({"do": do, **fields}, digits=None), allow_nan=False)


def kind_of(text: str) -> str:
    """The `do` of a message."""
    return text.split('"', 4)[3]


def findings(error: Exception) -> list[ReportedProblem]:
    """What is wrong, as documents have it."""
    internal = Problem("internal-error", f"internal error: {type(error).__name__}: {error}")
    return [*map(ReportedProblem.of, error.problems if isinstance(error, InputError) else [internal])]


def handles(workspace: Workspace) -> dict[str, Any]:
    """What can be moved, and where it is as people would type it."""

    def upright(kind: Literal["object", "base"], name: str, X: Array) -> Move:
        return Move(kind=kind, name=name, position=X[:3, 3].tolist(), yaw=matrix_to_rpy(X[:3, :3])[2])

    cameras, frames, ups = {}, {}, {}
    for name, camera in workspace.cameras.items():
        (point, up), position = aim(workspace, camera).tolist(), camera.X_FC[:3, 3].tolist()
        cameras[name] = Move(kind="camera", name=name, position=position, look_at=point, fov=camera.field_of_view)
        frames[name], ups[name] = camera.frame, up
    objects = {
        name: upright("object", name, X)
        for name, one in workspace.objects.items()
        if (X := one.X_WO) is not None and f"objects.{name}.pose" in workspace.places
    }
    base = {"": upright("base", "", workspace.robot.X_WB)}
    return {"camera": cameras, "object": objects, "base": base, "frames": frames, "ups": ups}


Words = Annotated[str, Field(max_length=2000, pattern=r"^[^\x00]*$")]  # no name of a file has a zero byte
PLAIN = ("rest", "undo", "redo", "difference", "save", "advise", "place", "stop", "reread")  # what needs no more words

_FIELDS: Mapping[str, Mapping[str, Any]] = {
    "hold": {"move": Move, "number": int},  # a hand moves something; the answer, a sketch, carries the number
    "put": {"move": Move},  # a hand has put something down: the text changes
    "set": {"path": Words, "value": Words},  # a value of the workspace by its path, as YAML text
    "task": {"text": Words, "by": Literal["q_eoi", "q_avg", "time", "delay", "expected_time"]},
    "choose": {"name": Words},  # another candidate is shown over time
    "apply": {"number": Annotated[int, Field(ge=1, le=1000)]},  # one of the changes that were found is made
    "program": {"file": Words},  # the chosen candidate is appended to a program file
    "run": {"file": Words, "faults": Annotated[list[Words], Field(max_length=20)]},  # in the simulated cell
    "fault": {"name": Words},  # it is to happen now
    **{do: {} for do in PLAIN},
}
"""What browsers may ask for: by its `do`, the other fields of such a message."""
_make: Any = create_model
_STRICT = ConfigDict(strict=True, frozen=True, extra="forbid")
_RECORDS: Any = tuple(
    _make(do, __config__=_STRICT, do=(Literal[do], ...), **{name: (kind, ...) for name, kind in own.items()})
    for do, own in _FIELDS.items()
)
_REQUESTS: TypeAdapter[Any] = TypeAdapter(Annotated[Union[_RECORDS], Field(discriminator="do")])  # noqa: UP007 - a list


def read_request(text: str) -> Any:  # noqa: ANN401 - a record with the fields that its `do` has
    """A message of a browser. Raises InputError for anything else."""
    try:
        return _REQUESTS.validate_json(text)
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


Question = (
    tuple[Literal["rank", "compare"], Asked, int]
    | tuple[Literal["hold"], Move, int]
    | tuple[Literal["show"], str, None]
)
"""What the process that computes is asked: a word first, by which a later one supersedes one that waits.

`rank` and `compare`, to rank and to rank the saved file: what is `Asked`, and the number that answers carry. `hold`, to
sketch something elsewhere: the `Move`, and a number likewise. `show`, over time: the name of a candidate.
"""
