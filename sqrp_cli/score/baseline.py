"""The baseline file: scores to compare later ones with, and what changed since in the files of a workspace."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import PlainValidator, TypeAdapter, ValidationError

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Place, bad_input
from sqrp_cli.figures import Seconds, Share
from sqrp_cli.files.entries import FileRecord, from_fields, refused
from sqrp_cli.files.input_file import missing_file, read_input, read_text
from sqrp_cli.files.json_file import json_document, parse_json
from sqrp_cli.files.source import LeafValue, describe
from sqrp_cli.files.units import read_quantity
from sqrp_cli.files.validation import problems_of
from sqrp_cli.files.xml_file import Element, parse_xml, read_xml
from sqrp_cli.files.yaml_file import MAX_BYTES as MAX_YAML_BYTES
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.records import dataclass
from sqrp_cli.score.compute import Computer
from sqrp_cli.score.kept import Outcome
from sqrp_cli.score.result import WORKSPACE, Change, TaskScore
from sqrp_cli.score.score import ScoredCell
from sqrp_cli.shown import json_line
from sqrp_cli.study.blind_spans import Coverage
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Adaptive, Sampling
from sqrp_cli.task.grips import choice_in_words

MAX_BYTES = 100_000_000  # largest baseline that is read, and written
MOST_PROBLEMS = 10  # most problems of a baseline that are reported
LEAST_ALIKE = 0.5  # least share of equal values by which a workspace is taken for one of another name in a baseline
_SECTION = re.compile(r":(requirements|types|constants|predicates|functions|action|parameters|precondition|effect)\b")
_FOR_ALL_JOINTS = re.compile(r"robot\.limits\.\w+")
"""A limit; its unit says whether it is for turning or sliding joints; without a unit it is for all."""
_FILE_KEYS = frozenset({"urdf", "mjcf", "srdf", "mesh", "calibration", "hand_eye"})
"""Keys of a workspace file that name other files; the content of those counts, not their place."""

_SAMPLING = re.compile(
    r"Adaptive\(tolerance=(?P<tolerance>.+)\)|FixedCount\(samples=(?P<samples>.+)\)|FixedStep\(dt=(?P<dt>.+)\)"
)
"""The text of a sampling, with its number by the name of its option."""


def _sampling(value: object) -> str:
    if isinstance(value, str) and _SAMPLING.fullmatch(value):
        return value
    raise refused("wrong-value", f"found {describe(value)}, expected how motions were sampled, such as `{Adaptive()}`")


def _scalar(value: object) -> LeafValue:
    if isinstance(value, LeafValue):
        return value
    raise refused("wrong-type", f"found {describe(value)}, expected one value")


@dataclass(frozen=True, kw_only=True)
class WayRecord(FileRecord):
    """The best candidate for a choice of objects."""

    candidate: str
    choice: str | None = None
    """The way behind the figures, such as `left, flipped`; None if infeasible."""
    feasible: bool
    reasons: tuple[str, ...] = ()
    time: Seconds | None = None
    q_avg: Share | None = None
    q_eoi: Share | None = None
    delay: Seconds | None = None
    """The longest time that a fault may remain unnoticed [s]; None without faults, and where one may never be."""
    unseen: Share | None = None
    """The largest share of times after which a fault may never be noticed; None without faults."""
    coverage: Coverage | None = None
    """Over time, if it is known."""

    @staticmethod
    def of(found: CandidateResult, coverage: Coverage | None) -> WayRecord:
        """The record of a candidate."""
        choice = choice_in_words(found.candidate, found.way) if found.feasible else None
        about = {"candidate": found.candidate.name, "choice": choice, "delay": found.delay_worst, "coverage": coverage}
        return from_fields(WayRecord, found, **about)


@dataclass(frozen=True)
class TaskRecord(FileRecord):
    """A task with every way of doing it."""

    best: str | None
    """Name of the best candidate; None: none is feasible."""
    ways: Mapping[str, WayRecord]


@dataclass(frozen=True)
class WorkspaceRecord(FileRecord):
    """A workspace with its tasks by their text."""

    digest: str
    """Of what was understood of it, see `Workspace.digest`."""
    files: Mapping[str, str]
    """The digest of each file by its role."""
    tasks: Mapping[str, TaskRecord]


@dataclass(frozen=True, kw_only=True)
class Baseline(FileRecord):
    """Scores of workspaces by name."""

    format: Literal["sqrp baseline 1"] = "sqrp baseline 1"
    sampling: Annotated[str, PlainValidator(_sampling)]
    """How motions were sampled, such as `Adaptive(tolerance=0.001)`."""
    workspaces: Mapping[str, WorkspaceRecord]
    fields: Mapping[str, Mapping[str, Annotated[Any, PlainValidator(_scalar)]]] = field(default_factory=dict)
    """Fields of files, by their digest."""

    @classmethod
    def of(cls, cells: Sequence[ScoredCell], scores: Sequence[TaskScore], computer: Computer) -> Baseline:
        """The baseline of these scores, without workspaces and tasks that have errors.

        computer: has the coverage of their ways, see `comparison.look_up`.
        """
        workspaces: dict[str, WorkspaceRecord] = {}
        known: dict[str, Mapping[str, LeafValue]] = {}
        for cell in cells:
            if cell.workspace is None:
                continue
            files = {role: file.digest for role, file in sorted(cell.workspace.files.items())}
            new = {digest: role for role, digest in files.items() if digest not in known}
            known |= {digest: fields_of(cell.workspace, role) for digest, role in new.items()}
            tasks = {
                result.task: TaskRecord(
                    best=None if result.best is None else result.best.candidate.name,
                    ways={name: WayRecord.of(way, seen(computer, result, way)) for name, way in result.ways.items()},
                )
                for result in scores
                if result.workspace == cell.name and result.task is not None and result.status != "error"
            }
            workspaces[cell.name] = WorkspaceRecord(cell.workspace.digest, files, tasks)
        kept = {digest: found for digest, found in known.items() if found}
        return cls(sampling=repr(computer.means.sampling), workspaces=workspaces, fields=kept)

    def save(self, path: Path) -> None:
        """Write it, the same bytes for the same scores.

        Raises InputError where it cannot be written, or would be too large to be read again.
        """
        text = json_line(TypeAdapter(Baseline).dump_python(self, mode="json"), indent=1) + "\n"
        if len(text.encode()) > MAX_BYTES:
            message = f"this baseline would have more than {MAX_BYTES:,} bytes, the limit"
            raise bad_input("file-too-large", message, Place(path), mend="make several, of fewer workspaces each")
        write_atomically(path, text)

    @classmethod
    def load(cls, path: Path, sampling: Sampling) -> Baseline:
        """Read a baseline. Raises InputError for a file that `save` did not write, or from another sampling.

        Errors name line and key, such as `workspaces.cell.tasks["pickup green"].ways.g1.q_avg`.
        """
        if not path.is_file():
            mend = None if path.is_dir() else f"make it with: sqrp score ... --save-baseline {path}"
            raise InputError(replace(missing_file(path), mend=mend))
        try:
            text = read_text(path, MAX_BYTES)
            data = parse_json(path, text)
            if isinstance(data, dict) and isinstance(data.get("document"), str):
                raise bad_input("bad-baseline", f"it is a result of `sqrp {data['document']}`", Place(path))
            try:
                baseline = TypeAdapter(Baseline).validate_python(data)
            except ValidationError as error:
                raise InputError(*problems_of(json_document(path, text, data), error)) from error
        except InputError as error:
            # It may be anything, so the mend must not overwrite it.
            mend = f"make one with: sqrp score ... --save-baseline {path.with_name(f'{path.stem}-new.json')}"
            none = "this is no baseline, or a damaged one: "
            problems = error.problems[:MOST_PROBLEMS]
            raise InputError(
                *(replace(one, code="bad-baseline", message=none + one.message, mend=mend) for one in problems)
            ) from error
        if baseline.sampling != repr(sampling):
            options = []
            for text in (baseline.sampling, repr(sampling)):
                match = _SAMPLING.fullmatch(text)
                ((name, number),) = ((k, v) for k, v in (match.groupdict() if match else {}).items() if v)
                usual = " (the default)" if text == repr(Adaptive()) else ""
                options.append(f"--{name} {f'{100 * float(number):g}' if name == 'tolerance' else number}{usual}")
            made, used = options
            message = f"the baseline was made with {made}, but this run samples with {used}"
            mend = "give the options --samples, --dt or --tolerance that it was made with, or make it again"
            raise bad_input("other-sampling", message, Place(path), mend=mend)
        return baseline

    def identified(self, cells: Sequence[ScoredCell]) -> dict[str, str]:
        """The name here of each workspace that the baseline knows, by its name now.

        A workspace is the one that meant the same; else the one of its name; else, as its folder may be renamed and its
        file edited at once, the one with most equal values, if at least `LEAST_ALIKE` of all are equal.
        """
        found: dict[str, str] = {}
        known = self.workspaces
        meant = {one: one.workspace.digests for one in cells if one.workspace is not None}
        same = [(cell, name) for cell in meant for name, record in known.items() if record.digest in meant[cell]]
        named = [(cell, cell.name) for cell in cells if cell.name in known]
        for cell, name in [*sorted(same, key=lambda pair: pair[0].name != pair[1]), *named]:
            if cell.name not in found and name not in found.values():
                found[cell.name] = name
        left, free = [one for one in cells if one.name not in found], known.keys() - found.values()
        alike: dict[tuple[ScoredCell, str], float] = {}  # the share of the values of either file that are equal in both
        for cell, name in product(left, [name for name in known if name in free]):
            before = self.fields.get(known[name].files.get(WORKSPACE, ""), {})
            now = {} if cell.workspace is None else cell.workspace.values
            equal = sum(path in now and now[path] == value for path, value in before.items())
            alike[cell, name] = equal / max(1, len(before.keys() | now.keys()))
        for cell, name in sorted((pair for pair in alike if alike[pair] >= LEAST_ALIKE), key=lambda pair: -alike[pair]):
            if cell.name not in found and name not in found.values():
                found[cell.name] = name
        return found


def seen(computer: Computer, score: TaskScore, way: CandidateResult) -> Coverage | None:
    """The coverage over time of a way of doing a task; None where it is infeasible or was not computed."""
    outcome = computer.outcome(replace(score.request, candidate=way.way, coverage=True))
    return outcome.coverage if isinstance(outcome, Outcome) else None


def workspace_changes(
    digest: str, before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> tuple[Change, ...]:
    """The differences that may matter; none if it is known by `digest`, of what was understood before.

    before: the digest of each file by its role. known: fields of files by digest. Tasks and their thresholds are not
    compared.
    """
    if digest in now.digests:
        return ()
    changes: list[Change] = []
    digests = {role: file.digest for role, file in now.files.items()}
    for role in sorted({*before, *digests}, key=lambda role: (role != WORKSPACE, role)):
        old, new = before.get(role), digests.get(role)
        if old == new:
            continue
        fields, said = fields_of(now, role) if new is not None else {}, known.get(old or "", {})
        if fields and said:
            pairs = ((field, said.get(field), fields.get(field)) for field in dict.fromkeys((*said, *fields)))
            changes += (Change(role, *pair) for pair in pairs if _differs(role, *pair))
        else:
            changes.append(Change(file=role, field=None, before=old and old[:12], now=new and new[:12]))
    return tuple(changes)


def fields_of(workspace: Workspace, role: str) -> dict[str, LeafValue]:
    """The fields of the file with a role; none for a file without fields, such as a mesh."""
    if role == WORKSPACE:
        return dict(workspace.values)
    path = workspace.files[role].path
    try:
        match path.suffix.lower():
            case ".yaml" | ".yml":
                return dict(read_yaml(path, frozenset({"!!opencv-matrix"})).leaves)
            case _ if role in ("robot.urdf", "robot.mjcf") and (expanded := workspace.robot.urdf.expanded) is not None:
                return dict(_attributes(parse_xml(path, expanded.encode(), "robot"), ""))
            case ".urdf" | ".srdf":
                return dict(_attributes(read_xml(path, "robot"), ""))
            case ".pddl":
                # Its sections, those of an action by its name; without comments and layout.
                content = read_input(path, MAX_YAML_BYTES).decode(errors="replace")
                plain = " ".join(line.split(";")[0] for line in content.splitlines())
                words, action = " ".join(plain.replace("(", " (").replace(")", ") ").split()), ""
                said: dict[str, LeafValue] = {}
                for keyword, section in zip(*[iter(_SECTION.split(words)[1:])] * 2, strict=True):
                    text = section.replace(" )", ")").rstrip(" (").lstrip()
                    while text.count(")") > text.count("("):
                        text = text[:-1].rstrip()  # what closes the sections around
                    if keyword == "action":
                        action = f"{text}."
                    else:
                        said[f"{action}{keyword}"] = text
                return said
            case _:
                return {}
    except InputError:  # changed since it was read
        return {}


def _attributes(element: Element, path: str) -> Iterator[tuple[str, LeafValue]]:
    """Attributes by path; elements go by name if they have one, else by number if there are several."""
    for attribute, value in element.attributes.items():
        yield f"{path}{attribute}", value
    numbers: Counter[str] = Counter()
    counts = Counter(child.tag for child in element.children)
    for child in element.children:
        numbers[child.tag] += 1
        number = f".{numbers[child.tag]}" if counts[child.tag] > 1 else ""
        label = f".{child.attributes['name']}" if child.attributes.get("name") else number
        yield from _attributes(child, f"{path}{child.tag}{label}.")


def _differs(role: str, field: str, before: LeafValue, now: LeafValue) -> bool:
    """Whether a field of a file differs in meaning.

    Two spellings of a quantity, such as `5 cm` and `50 mm` or 0.05, do not differ, nor do `0 0 1` and `0 0 1.0`. In a
    workspace file nothing matters that belongs to a task, or names a file: the content of that does.
    """
    named = field.startswith(("tasks.", "skills.", "robot.package_roots.")) or field.rpartition(".")[-1] in _FILE_KEYS
    if before == now or (role == WORKSPACE and named):
        return False
    old, new = read_quantity(before), read_quantity(now)
    if old is not None and new is not None and math.isclose(old.value, new.value, rel_tol=1e-12):
        any_joint = None in (old.dimension, new.dimension) and not _FOR_ALL_JOINTS.fullmatch(field)
        if any_joint or old.dimension is new.dimension:
            return False
    try:  # attributes of an XML file may be rows of numbers
        rows = [[float(word) for word in str(value).split()] for value in (before, now)]
    except ValueError:
        return True
    return rows[0] != rows[1]
