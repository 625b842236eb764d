"""Kept results: outcomes of candidates and of searches, in a folder from which a run can resume, by their keys.

They are lines of JSON, the same for the same figures; damage and edits are noticed. A key is the digest of everything
that an outcome depends on, but for the program.
"""

from __future__ import annotations

import base64
import errno
import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib import metadata, resources
from math import isfinite
from pathlib import Path
from types import UnionType
from typing import IO, Any, Literal, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace_file import check_no_workspace
from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.figures import AdvisedFigures, FaultMetrics, LateReason, Qualities
from sqrp_cli.files.input_file import read_text
from sqrp_cli.files.json_file import parse_json
from sqrp_cli.geometry import read_only
from sqrp_cli.platform.files import make_folder, naming, write_atomically
from sqrp_cli.search import advice_result as advice
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import Kind
from sqrp_cli.search.question import ProposedChange
from sqrp_cli.shown import json_line
from sqrp_cli.skill.skill import Skill
from sqrp_cli.study.blind_spans import Coverage
from sqrp_cli.study.result import BlindEnd, CandidateResult, PhaseSeen, WayFigures, WaysFound
from sqrp_cli.task.candidate import THEN, whole_skill
from sqrp_cli.task.task import Candidate
from sqrp_cli.version import __version__

MAX_BYTES = 10_000_000  # largest outcome that is read; an hour's motion takes less than a megabyte
_LIBRARIES = ("numpy", "ruckig", "ompl", "eaik")  # libraries that figures depend on

_RECORDS = {
    record.__name__: record
    for record in (
        *(AdvisedFigures, Aim, BlindEnd, Camera, Candidate, CandidateResult, FaultMetrics, LateReason),
        *(ProposedChange, Qualities),
        *(advice.AdviceFound, advice.ChangedCandidate, advice.KindOutcome, advice.Margin, advice.NearestChange),
        *(advice.TaskEffect, PhaseSeen, WayFigures, WaysFound),
    )
}
"""What lines are made of; one that names anything else is none of ours."""
_TAG = "@"  # key of what a JSON object stands for, where it is no mapping


@cache
def program_digest(root: Path | None = None) -> str:
    """Digest of the code and the libraries that compute: results of different ones are never mixed.

    root: of the package. All its code counts, however its folders are named, even what only prints: a list of what
    figures depend on would go stale.
    """
    root, hashed = root or Path(str(resources.files("sqrp_cli"))), hashlib.sha256(__version__.encode())
    for file in sorted(root.rglob("*.py")):
        hashed.update(file.relative_to(root).as_posix().encode() + b"\0" + file.read_bytes())
    for library in _LIBRARIES:
        version = "none"
        with suppress(metadata.PackageNotFoundError):
            version = metadata.version(library)
        hashed.update(f"{library} {version}\n".encode())
    return hashed.hexdigest()


def key_of(*about: object) -> str:
    """The key of what depends on some JSON values."""
    return hashlib.sha256(json.dumps(about, ensure_ascii=True).encode()).hexdigest()


def as_line(value: object) -> str:
    """Records, arrays, and plain values of these as a line of JSON, with a checksum."""
    plain = plain_of(value)
    return json_line({"value": plain, "checksum": key_of(plain)}) + "\n"


def from_line(text: str, skills: Sequence[Skill] = ()) -> Any:  # noqa: ANN401 # a value of any kind
    """The value that `as_line` wrote. skills: those that it may name. Raises ValueError for any other text."""
    try:
        document = parse_json(Path("record"), text)
        if document != {"value": document["value"], "checksum": key_of(document["value"])}:
            raise ValueError("it is not as it was written")
        return _read(document["value"], {skill.name: skill for skill in skills})
    except (InputError, LookupError, TypeError, AttributeError) as error:
        raise ValueError(f"no kept record: {error!r}") from error


def plain_of(value: Any) -> Any:  # noqa: ANN401 # a value of any kind
    """A value in plain lists and numbers; records and arrays say what they are."""
    match value:
        case float() if not isfinite(value):
            return {_TAG: "float", "of": str(value)}
        case None | bool() | int() | float() | str():
            return value
        case np.ndarray(dtype=np.bool):
            bits = base64.b64encode(np.packbits(value).tobytes()).decode()
            return {_TAG: "mask", "of": bits, "shape": list(value.shape)}
        case np.ndarray():
            return {_TAG: "array", "of": value.tolist()}
        case Skill():
            return {_TAG: "Skill", "of": value.name}
        case tuple():
            return {_TAG: "tuple", "of": [plain_of(entry) for entry in value]}
        case list():
            return [plain_of(entry) for entry in value]
        case Mapping():
            return {name: plain_of(entry) for name, entry in value.items()}
    assert is_dataclass(value)  # noqa: S101 - they are made of nothing else
    return {_TAG: type(value).__name__, **{f.name: plain_of(getattr(value, f.name)) for f in fields(value) if f.init}}


def _read(value: Any, skills: Mapping[str, Skill]) -> Any:  # noqa: ANN401 # a value of any kind
    """What `plain_of` made plain."""
    if not isinstance(value, dict):
        return [_read(entry, skills) for entry in value] if isinstance(value, list) else value
    entries = {name: _read(entry, skills) for name, entry in value.items() if name != _TAG}
    match value.get(_TAG):
        case None:
            return entries
        case "tuple":
            return tuple(entries["of"])
        case "array":
            return read_only(entries["of"])
        case "mask":
            shape, bits = tuple(entries["shape"]), np.frombuffer(base64.b64decode(entries["of"]), dtype=np.uint8)
            return np.unpackbits(bits, count=int(np.prod(shape))).astype(bool).reshape(shape)
        case "float":
            return float(entries["of"])
        case "Skill":
            names = entries["of"].split(THEN)
            return skills[names[0]] if len(names) == 1 else whole_skill([skills[one] for one in names])
        case name:
            record = _RECORDS[name]
            for field, hint in _hints(record).items():
                if field in entries and not _fits(entries[field], hint):
                    raise ValueError(f"{name}.{field} is no {hint}")
            return record(**entries)


_hints = cache(get_type_hints)


def _fits(value: Any, hint: Any) -> bool:  # noqa: ANN401 # a value and a type of any kind
    """Whether a value is of a type, as fields of records state them."""
    of, kinds = get_origin(hint), get_args(hint)
    if hint is Any or hint is None:
        return hint is Any or value is None
    if of in (Union, UnionType):
        return any(_fits(value, kind) for kind in kinds)
    if of is Literal:
        return value in kinds
    if of in (tuple, list, Mapping):
        if not isinstance(value, dict if of is Mapping else of):
            return False
        if of is tuple and kinds[1:] != (Ellipsis,):
            return len(value) == len(kinds) and all(map(_fits, value, kinds))
        entries, kind = (value.values(), kinds[1]) if of is Mapping else (value, kinds[0])
        return all(_fits(entry, kind) for entry in entries)
    number = isinstance(value, float | int if hint is float else of or hint)
    return number and (hint is bool or not isinstance(value, bool))


COVERAGE: TypeAdapter[Coverage | None] = TypeAdapter(Coverage | None, config=ConfigDict(defer_build=True))
"""Reads a coverage from plain values, and writes it as those."""


class Outcome(NamedTuple):
    """A computed candidate."""

    result: CandidateResult
    coverage: Coverage | None  # None if it was not requested, or the candidate is infeasible

    def to_text(self) -> str:
        """One line of JSON, the same for the same figures."""
        return as_line((self.result, COVERAGE.dump_python(self.coverage, mode="json")))

    @classmethod
    def from_text(cls, text: str, candidate: Candidate) -> Outcome:
        """Reads what `to_text` wrote. Raises ValueError for any other text."""
        result, numbers = from_line(text, [step.skill for step in (candidate, *candidate.steps)])
        return cls(replace(result, candidate=candidate), COVERAGE.validate_python(numbers))


class Results:
    """Outcomes as text by their keys.

    With a folder each is a file of its own there, named by its key and written whole or not at all: if a run is killed,
    the next one finds what is finished.
    """

    def __init__(self, folder: Path | None) -> None:
        """Open or make the folder. Raises InputError for one of a workspace, of another run, or without access."""
        self._texts: dict[str, str] = {}
        self.folder = folder
        self._lock: IO[str] | None = None
        if folder is not None:
            check_no_workspace(folder)
            make_folder(folder)
            with naming(folder, "results cannot be kept in this folder"):
                self._lock = file = (folder / ".lock").open("w")  # it stays open while this run uses the folder
                try:
                    import fcntl

                    fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except ImportError:  # no such locks here: two runs at a time compute some candidates twice
                    pass
                except OSError as error:
                    file.close()
                    if error.errno not in (errno.EACCES, errno.EAGAIN):
                        raise
                    message = "another `sqrp score`, `sqrp advise` or `sqrp place` is writing to this folder"
                    mend = "wait for it, or name another folder"
                    raise bad_input("folder-in-use", message, Place(folder), mend=mend) from error
            for leftover in folder.glob("*/.*.json.*"):  # of a run that was killed as it wrote
                leftover.unlink()

    def get(self, key: str) -> str | None:
        """What is kept under a key, if anything; the reader checks for damage."""
        if key not in self._texts and self.folder is not None:
            path = self.path(self.folder, key)
            if path.is_file():
                with suppress(InputError):
                    self._texts[key] = read_text(path, MAX_BYTES)
        return self._texts.get(key)

    @staticmethod
    def path(folder: Path, key: str) -> Path:
        """The file of a key; results of different programs are never mixed."""
        name = key_of(program_digest(), key)
        return folder / name[:2] / f"{name}.json"

    def keep(self, key: str, text: str) -> None:
        """Keep an outcome. Raises InputError where it cannot be written."""
        self._texts[key] = text
        if self.folder is None:
            return
        path = self.path(self.folder, key)
        with naming(self.folder, "results cannot be kept in this folder"):
            path.parent.mkdir(exist_ok=True)
            if path.is_dir():
                path.rmdir()
            elif os.path.lexists(path) and not path.is_file():  # a broken link, or a pipe
                path.unlink()
        try:
            write_atomically(path, text)
        except InputError as error:
            mend = "make room; the same command then goes on from what is finished, which is kept"
            raise InputError(*(replace(problem, mend=mend) for problem in error.problems)) from error

    def close(self) -> None:
        """Let other runs use the folder."""
        if self._lock is not None:
            self._lock.close()


def kept_search(
    results: Results,
    about: tuple[object, ...],
    skills: Sequence[Skill],
    kind: Kind,
    search: Callable[[], advice.KindOutcome],
) -> advice.KindOutcome:
    """What comes of a kind of change as it is kept, else as it is found, which is kept then; see `advise.outcomes`.

    about: all that an answer depends on beside the kind and the program, in numbers and texts. skills: of the
    workspace, which are not written. Raises InputError where an outcome cannot be written.
    """
    key = key_of("advise", kind, plain_of(about))
    with suppress(ValueError):  # none is kept, or its file is damaged or another's
        known: advice.KindOutcome = from_line(results.get(key) or "", skills)
        return known
    outcome = search()
    results.keep(key, as_line(outcome))
    return outcome
