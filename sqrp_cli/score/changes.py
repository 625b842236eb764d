"""What changed since a baseline: records of tasks and ways; and files of a workspace, and fields in them."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Literal

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.document import Record
from sqrp_cli.errors import InputError
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.source import LeafValue
from sqrp_cli.files.units import read_quantity
from sqrp_cli.files.xml_file import Element, parse_xml, read_xml
from sqrp_cli.files.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.records import dataclass
from sqrp_cli.score.work.identity import says_something
from sqrp_cli.task.grips import NOTHING_SPECIAL

_SECTION = re.compile(r":(requirements|types|constants|predicates|functions|action|parameters|precondition|effect)\b")

_FOR_ALL_JOINTS = re.compile(r"robot\.limits\.\w+")
"""A limit; its unit says whether it is for turning or sliding joints; without a unit it is for all."""

WORKSPACE = "workspace"
"""The role of the workspace file itself."""


@dataclass(frozen=True)
class Change(Record):
    """A difference between two versions of a workspace."""

    file: str
    """The role of the file that changed, such as `workspace`, `robot.urdf` or `skills.pickup.yaml`."""
    field: str | None
    """The field in it; None if only the whole content can be compared."""
    before: LeafValue
    """The value, or for a whole file the first digits of its digest; None if there is no such field or file."""
    now: LeafValue
    """See `before`."""

    def __str__(self) -> str:
        what = "content" if self.field is None else self.field
        where = what if self.file == WORKSPACE else f"{self.file} {what}"
        if self.before is None:
            return f"{where} = {self.now} is new"
        if self.now is None:
            return f"{where} = {self.before} is gone"
        return f"{where}: {self.before} -> {self.now}"


Verdict = Literal["regressed", "improved", "unchanged", "new"]


@dataclass(frozen=True)
class LostView(Record):
    """A stretch of time [s] in which a literal is no longer covered, because a camera no longer sees it."""

    literal: str
    """What is to be seen, such as `hold(g4)`."""
    camera: str
    """The camera that used to see it."""
    start: float
    """From the start of the present motion [s]."""
    end: float
    """From the start of the present motion [s]."""
    why: str
    """The commonest cause, in a few words."""

    def __str__(self) -> str:
        return f"{self.camera} no longer sees {self.literal} {Stretch(self.start, self.end).when}: {self.why}"


@dataclass(frozen=True)
class Shift(Record):
    """A figure that got better or worse; values in 0..1 or s, None if undefined or infeasible."""

    metric: Literal["feasible", "q_eoi", "q_avg", "time", "delay"]
    """Which figure; `delay` is the longest time that a fault may remain unnoticed, null where it may for ever."""
    before: float | None
    """In the baseline; of `feasible`, 1 or 0."""
    now: float | None
    """At present; of `feasible`, 1 or 0."""
    worse: bool
    """Whether it got worse."""

    @property
    def size(self) -> float:
        """How far the figure moved: a difference of Q, or the share by which a time changed."""
        if self.before is None or self.now is None:
            return 0.0
        moved = abs(self.now - self.before)
        return moved / self.before if self.metric in ("time", "delay") and self.before > 0 else moved

    def __str__(self) -> str:
        match self.metric:
            case "feasible":
                return "can no longer be done" if self.worse else "can be done now"
            case "q_eoi" | "q_avg":
                verb = "fell" if self.worse else "rose"
                return f"{self.metric.replace('q_', 'Q_')} {verb} {_from_to(self.before, self.now, 100.0, 1, '%')}"
            case _:
                if self.now is None:
                    return "a fault may never be noticed any more"
                if self.before is None:
                    return f"no fault goes unnoticed any more: the worst delay is {self.now:.2f} s"
                what = "its time" if self.metric == "time" else "the worst delay of a fault"
                verb = "rose" if self.worse else "fell"
                return f"{what} {verb} {_from_to(self.before, self.now, 1.0, 2, 's')}"


@dataclass(frozen=True)
class WayChange(Record):
    """How the best candidate for a choice of objects changed."""

    way: str
    """The objects, such as `g1 tray`."""
    candidate_before: str
    """Name of the best candidate in the baseline."""
    candidate: str
    """Name of the best candidate now."""
    shifts: tuple[Shift, ...]
    """The figures that got better or worse."""
    lost: tuple[LostView, ...] = ()
    """What cameras no longer see, the longest first; empty unless something got worse on the same way as before, as
    times of different motions do not correspond."""
    reason: str = ""
    """Why it can no longer be done."""
    choice_before: str | None = None
    """The way behind the figures of the baseline, such as `left, flipped`; null if it does not say it."""
    choice: str | None = None
    """The way behind the figures now; null if it is infeasible."""

    @property
    def another_way(self) -> bool:
        """Whether the robot moves in another way than before, as far as the baseline says how it did."""
        known = self.choice is not None and self.choice_before is not None
        return self.candidate != self.candidate_before or (known and self.choice != self.choice_before)

    @property
    def worse(self) -> bool:
        """Whether anything got worse."""
        return any(shift.worse for shift in self.shifts)

    @property
    def better(self) -> bool:
        """Whether anything got better."""
        return any(not shift.worse for shift in self.shifts)

    @property
    def losses_matter(self) -> bool:
        """Whether what cameras no longer see tells why it got worse."""
        return self.worse and not self.another_way

    @property
    def severity(self) -> float:
        """Largest change for the worse: a difference of Q, or the share by which a time grew; 0 if none."""
        return max((shift.size for shift in self.shifts if shift.worse), default=0.0)

    def __str__(self) -> str:
        shown = [shift for shift in self.shifts if shift.worse] or list(self.shifts)
        parts = [", ".join(str(shift) for shift in shown)]
        if len(shown) < len(self.shifts):
            parts[0] += ", but " + ", ".join(str(shift) for shift in self.shifts if not shift.worse)
        if self.another_way:
            now, before = self._said(self.candidate, self.choice), self._said(self.candidate_before, self.choice_before)
            parts.append(f"{self.way} now goes another way: {now} instead of {before}")
        if self.reason:
            parts.append(self.reason)
        if self.lost:
            more = len(self.lost) - 1
            parts.append(f"{self.lost[0]}" + (f" ({more} more such stretch{'es' if more > 1 else ''})" if more else ""))
        return f"{self.way}: {'; '.join(parts)}"

    def _said(self, candidate: str, choice: str | None) -> str:
        """A way in words, with the name of its candidate where that differs, too."""
        if self.candidate == self.candidate_before:
            return str(choice)
        return candidate if choice in (None, NOTHING_SPECIAL) else f"{candidate}, {choice}"


@dataclass(frozen=True)
class Comparison(Record):
    """How a task compares with its baseline."""

    verdict: Verdict
    """Regressed if anything got worse; new if the baseline does not have the task."""
    ways: tuple[WayChange, ...] = ()
    """Those that changed, the worst first."""
    gone: tuple[str, ...] = ()
    """Ways of doing it that no longer exist."""


def _from_to(before: float | None, now: float | None, scale: float, digits: int, unit: str) -> str:
    """Two figures that differ, with two more digits where they would look the same."""

    def shown(figure: float | None, digits: int) -> str:
        return "-" if figure is None else f"{scale * figure:.{digits}f} {unit}"

    alike = shown(before, digits) == shown(now, digits)
    old, new = (shown(figure, digits + 2 * alike) for figure in (before, now))
    return f"from {old} to {new}"


def workspace_changes(
    digest: str, before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> tuple[Change, ...]:
    """The differences that may matter; none if `digest`, of what was understood before, is the same.

    before: the digest of each file by its role. known: fields of files by digest. Tasks and their thresholds are not
    compared.
    """
    return () if digest == now.digest else tuple(_changes(before, known, now))


def _changes(
    before: Mapping[str, str], known: Mapping[str, Mapping[str, LeafValue]], now: Workspace
) -> Iterator[Change]:
    digests = {role: file.digest for role, file in now.files.items()}
    for role in sorted({*before, *digests}, key=lambda role: (role != WORKSPACE, role)):
        old, new = before.get(role), digests.get(role)
        if old == new:
            continue
        fields = fields_of(now, role) if new is not None else {}
        if old is None or new is None or not (known.get(old) and fields):
            yield Change(file=role, field=None, before=old and old[:12], now=new and new[:12])
        else:
            yield from _changed_fields(role, known[old], fields)


def fields_of(workspace: Workspace, role: str) -> dict[str, LeafValue]:
    """The fields of the file with a role; none for a file without fields, such as a mesh."""
    if role == WORKSPACE:
        return dict(workspace.values)
    path = workspace.files[role].path
    try:
        match path.suffix.lower():
            case ".yaml" | ".yml":
                return dict(read_yaml(path, frozenset({"!!opencv-matrix"})).leaves)
            case _ if role == "robot.urdf" and (expanded := workspace.robot.urdf.expanded) is not None:
                return dict(_attributes(parse_xml(path, expanded.encode(), "robot"), ""))
            case ".urdf" | ".srdf":
                return dict(_attributes(read_xml(path, "robot"), ""))
            case ".pddl":
                return dict(_statements(path))
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


def _statements(path: Path) -> Iterator[tuple[str, LeafValue]]:
    """The sections of a PDDL file, those of an action by its name; without comments and layout."""
    lines = (line.split(";")[0] for line in read_input(path, MAX_BYTES).decode(errors="replace").splitlines())
    words = " ".join(" ".join(lines).replace("(", " (").replace(")", ") ").split())
    action = ""
    for keyword, content in zip(*[iter(_SECTION.split(words)[1:])] * 2, strict=True):
        text = content.replace(" )", ")").rstrip(" (").lstrip()
        while text.count(")") > text.count("("):
            text = text[:-1].rstrip()  # what closes the sections around
        if keyword == "action":
            action = f"{text}."
        else:
            yield f"{action}{keyword}", text


def _changed_fields(role: str, before: Mapping[str, LeafValue], now: Mapping[str, LeafValue]) -> Iterator[Change]:
    """The fields of a file that differ in meaning.

    Two spellings of a quantity, such as `5 cm` and `50 mm` or 0.05, do not differ, nor do `0 0 1` and `0 0 1.0`.
    """
    for field in dict.fromkeys((*before, *now)):
        old, new = before.get(field), now.get(field)
        same = old == new or _same_quantity(field, old, new) or _same_numbers(old, new)
        if not same and (role != WORKSPACE or says_something(field)):
            yield Change(file=role, field=field, before=old, now=new)


def _same_numbers(before: LeafValue, now: LeafValue) -> bool:
    """Whether two attributes of an XML file are the same row of numbers."""
    try:
        old, new = ([float(word) for word in str(value).split()] for value in (before, now))
    except ValueError:
        return False
    return old == new


def _same_quantity(field: str, before: LeafValue, now: LeafValue) -> bool:
    old, new = read_quantity(before), read_quantity(now)
    if old is None or new is None or not math.isclose(old.value, new.value, rel_tol=1e-12):
        return False
    if None in (old.dimension, new.dimension) and not _FOR_ALL_JOINTS.fullmatch(field):
        return True
    return old.dimension is new.dimension
