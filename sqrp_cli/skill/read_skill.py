"""Reading a skill: its folder holds skill.yaml and a PDDL file named after the skill."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, first_names, nearest, no_such
from sqrp_cli.files.entries import Entry
from sqrp_cli.files.frames import TOOL
from sqrp_cli.files.input_file import SourceFile, decoded, read_input, source_file
from sqrp_cli.files.source import KeyPath, SourceDocument, describe, dotted
from sqrp_cli.files.units import Quantity
from sqrp_cli.files.usual_values import SKILL, unusual_values
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import MAX_BYTES, read_yaml
from sqrp_cli.logic.domain import Action, Domain, nested
from sqrp_cli.logic.formula import Formula, check_formula
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.pddl_parser import parse_domain
from sqrp_cli.skill import settings, skill

FreedEntry = TypeVar("FreedEntry", bound=Entry)
SKILL_FILE = "skill.yaml"
FINGERS, MARKERS = "fingers", "markers"
"""Folders in that of a skill for tools with fingers, and with markers on them, where these do it differently."""
PATH = "path"  # the parameter that every skill with joint moves has, unless they state their paths


def skill_folder(folder: Path, *, fingers: bool, markers: bool) -> Path:
    """The folder that has the files of a skill for a tool with `fingers`, and `markers` on them.

    `pickup_two_finger`, unless there is such a folder, is what `pickup` is for fingers with markers.
    """
    former = folder.with_name(folder.name.removesuffix(skill.FORMER_ENDING)) / MARKERS
    if folder.name.endswith(skill.FORMER_ENDING) and not folder.is_dir() and former.is_dir():
        return former
    suiting = [folder / MARKERS] if fingers and markers else []
    suiting += [folder / FINGERS] if fingers else []
    return next((one for one in suiting if (one / SKILL_FILE).is_file()), folder)


def skill_name(folder: Path) -> str:
    """The name of the skill in a folder."""
    return folder.parent.name if folder.name in (FINGERS, MARKERS) else folder.name


def missing_skills(missing: Sequence[tuple[Path, Place]]) -> Iterator[Problem]:
    """What is wrong where folders of skills, each with the place that names it, do not exist: of a folder at once."""
    for parent in dict.fromkeys(folder.parent for folder, _ in missing):
        here = [(folder, place) for folder, place in missing if folder.parent == parent]
        names, place = [folder.name for folder, _ in here], here[0][1]
        if not parent.is_dir():
            message = f"there is no folder {parent}, in which the skills {first_names(names)} should be"
            mend = "copy the skills there too, or mend the paths under `skills`"
            yield Problem("unknown-skill", message, place, mend=mend)
            continue
        known = [entry.name for entry in parent.iterdir() if entry.is_dir()]
        for folder, place in here:
            message = f"there is no skill folder {folder}; {expected_names(folder.name, known)}"
            yield Problem("unknown-skill", message, place)


def read_skill(folder: Path, place: Place, digest: dict[str, SourceFile]) -> skill.Skill:
    """The skill in `folder`, named after it; after the folder around it, if it is the one for tools with fingers.

    There, the PDDL file of the folder around it counts unless it has its own. place: where the workspace names the
    folder. Raises InputError with all problems of its two files; the workspace checks the names of links, objects and
    detectors.
    """
    name = skill_name(folder)
    path = folder / f"{name}.pddl"
    if name != folder.name and not path.is_file():
        path = folder.parent / path.name
    for required in (SKILL_FILE, f"{name}.pddl"):
        if path.name == required and path.is_file():
            continue
        if not (folder / required).is_file():
            close = nearest(required, (entry.name for entry in folder.iterdir()))
            message = f"the skill folder {folder} has no `{required}`" + (f"; did you mean `{close}`?" if close else "")
            raise bad_input("missing-file", message, place)
    document = read_yaml(folder / SKILL_FILE, keys=("primitives", "waypoints", "targets", "formulas"))
    content = read_input(path, MAX_BYTES)
    digest[f"skills.{path.stem}.pddl"] = source_file(path, content)
    domain = parse_domain(decoded(path, content), path)
    digest[f"skills.{name}.yaml"] = source_file(document.path, document.content)
    if name not in domain.actions:
        message = f"no action `{name}`, named like its folder; {expected_names(name, domain.actions)}"
        meant = nearest(name, domain.actions) or next(iter(domain.actions), None)
        there = Place(domain.path) if meant is None else domain.actions[meant].place
        raise bad_input("missing-action", message, there, mend="rename the action, or the folder and its file")
    return SkillReader(document, validate(document, skill.SkillFile), domain, domain.actions[name]).read(folder)


class SkillReader:
    """Checks one skill file beyond its format, and collects all problems."""

    def __init__(
        self,
        document: SourceDocument,
        file: skill.SkillFile,
        domain: Domain,
        action: Action,
        problems: Sequence[Problem] = (),
    ) -> None:
        self.document = document
        self.file = file
        self.domain = domain
        self.action = action
        self.objects = [parameter.name for parameter in action.parameters]
        self.problems: list[Problem] = [*problems]
        self.values = {name: self._motion_values(name) for name in file.motion}
        self.kinds: dict[str, list[settings.Kind]] = {name: [] for name in file.motion}
        self.implicit: dict[str, settings.MotionParameter] = {}
        self._refused: set[str] = set()
        """Motion parameters with values that a setting refuses."""

    def read(self, folder: Path) -> skill.Skill:
        """The skill, named after its folder. Raises InputError with all problems."""
        for name in (name for name in self.file.motion if name in self.objects):
            self._report("ambiguous-name", ("motion", name), "the PDDL action has a parameter of this name too")
        for name, waypoint in self.file.waypoints.items():
            self._check_fields(waypoint, ("waypoints", name))
        self._check_origins()
        for index, primitive in enumerate(self.file.primitives):
            if primitive.name in [other.name for other in self.file.primitives[:index]]:
                message = f"`{primitive.name}` names an earlier primitive action too"
                self._report("duplicate-name", ("primitives", index, "name"), message)
            self._check_fields(primitive, ("primitives", index))
        waypoints = {name: self._freed(name, waypoint) for name, waypoint in self.file.waypoints.items()}
        primitives = tuple(self._freed(primitive.name, primitive) for primitive in self.file.primitives)
        parameters = []
        for name, stated in self.values.items():
            values = tuple(value.value if isinstance(value, Quantity) else value for value in stated)
            if len(set(values)) < len(values):
                self._report("repeated-value", ("motion", name), "a value is given twice")
            parameters.append(settings.MotionParameter(name, values, tuple(dict.fromkeys(self.kinds[name]))))
        requirements = self._requirements()
        self._check_targets()
        for predicate, meaning in self.file.initially.items():
            path: KeyPath = ("initially", predicate)
            if self._known(predicate, self.domain.predicates, "predicate", path):
                signature, wanted = self.domain.predicates[predicate], skill.OBJECTS_OF[meaning]
                if len(signature.parameters) != wanted:
                    message = f"found `{meaning}`, which is said of {wanted} object{'s' * (wanted != 1)}"
                    self._report("wrong-arity", path, f"{message}, but the predicate is `{signature}`")
        if self.problems:
            raise InputError(*self.problems)
        return skill.Skill(
            name=skill_name(folder),
            folder=folder,
            domain=self.domain,
            action=self.action,
            motion_parameters=(*parameters, *self.implicit.values()),
            waypoints=waypoints,
            primitives=primitives,
            requirements=requirements,
            targets=self.file.targets,
            initially=self.file.initially,
            places=self.document.places,
            warnings=tuple(unusual_values(self.document, SKILL)),
        )

    def _report(self, code: str, path: KeyPath, message: str) -> None:
        self.problems.append(self.document.problem(code, path, message))

    def _known(self, name: str, valid: Collection[str], what: str, path: KeyPath) -> bool:
        """Whether a name is among the valid ones; reports it otherwise."""
        if name not in valid:
            self._report(f"unknown-{what.replace(' ', '-')}", path, no_such(name, what, valid))
        return name in valid

    def _check_fields(self, entry: Entry, path: KeyPath) -> None:
        """Check the names and settings of a waypoint or primitive action, by the marks of its fields."""
        for at, value, mark in skill.marked(entry, path):
            if isinstance(mark, skill.Names):
                if mark.what != "frame":  # the workspace knows its objects
                    valid = self.objects if mark.what == "skill parameter" else list(self.file.waypoints)
                    self._known(str(value), [*valid, *mark.also], mark.what, at)
            elif not isinstance(value, settings.Reference):
                if isinstance(value, Quantity | str) and (complaint := mark.complaint(value)) is not None:
                    self._report(complaint[0], at, complaint[1])
            elif (name := value.parameter) in self.file.motion:
                self.kinds[name].append(mark)
                complaints = filter(None, map(mark.complaint, self.values[name]))
                if (complaint := next(complaints, None)) is not None and name not in self._refused:
                    self._refused.add(name)  # once, however many settings use it
                    self._report(complaint[0], ("motion", name), f"{complaint[1]} (`{dotted(at)}` uses it)")
            elif name != PATH or mark is not settings.PATHS:
                known = expected_names(name, self.file.motion)
                self._report("unknown-parameter", at, f"found `${name}`, which is no parameter under `motion`; {known}")

    def _freed(self, name: str, entry: FreedEntry) -> FreedEntry:
        """A waypoint or primitive action in which every setting that is free names a parameter, such as `a1.elbow`."""
        freed: dict[str, settings.Reference] = {}
        for (field, *_), value, kind in skill.marked(entry):
            at_default = value == settings.Reference(PATH)
            # A setting is free if it is `any` (but for the branch of a move home), or a path that is not stated.
            is_any = value == settings.ANY and not (isinstance(entry, skill.JointMove) and entry.to == skill.HOME)
            if isinstance(kind, settings.Kind) and (is_any or (at_default and PATH not in self.file.motion)):
                parameter = PATH if at_default and PATH not in self.objects else f"{name}.{field}"
                self.implicit[parameter] = settings.MotionParameter(
                    parameter, (settings.DIRECT if at_default else settings.ANY,), (kind,), implicit=True
                )
                freed[str(field)] = settings.Reference(parameter)
        return entry.model_copy(update=freed)

    def _motion_values(self, name: str) -> tuple[Quantity | str, ...]:
        entry = self.file.motion[name]
        if isinstance(entry, settings.ValueRange):
            start, end = entry.start, entry.to
            if not isinstance(start, Quantity) or not isinstance(end, Quantity):
                word = end if isinstance(start, Quantity) else start
                message = f"found {describe(word)}, expected a number at both ends of a range"
                self._report("wrong-unit", ("motion", name), message)
                return (Quantity(0.0, None),)
            dimension = start.dimension or end.dimension
            if dimension is not end.dimension and end.dimension is not None:
                message = f"the range goes from {dimension.name if dimension else 'a number'} to {end.dimension.name}"
                self._report("wrong-unit", ("motion", name), message)
            return tuple(
                Quantity(float(value), dimension) for value in np.linspace(start.value, end.value, entry.count)
            )
        return tuple(entry.values) if isinstance(entry, settings.ListedValues) else (entry,)

    def _check_origins(self) -> None:
        """Check that no waypoint leads back to itself, and that `home` is not redefined."""
        if skill.HOME in self.file.waypoints:
            message = "`home` is the robot's home configuration; take another name"
            self._report("ambiguous-name", ("waypoints", skill.HOME), message)
        origins = {name: getattr(waypoint, "waypoint", None) for name, waypoint in self.file.waypoints.items()}
        told: list[str] = []
        for name in origins:
            way = [name]
            while (origin := origins.get(way[-1])) not in (None, skill.HOME, *way):
                way.append(str(origin))
            if origin == name != skill.HOME and name not in told:
                told += way
                message = f"leads back to itself: {' -> '.join([*way, name])}"
                self._report("cyclic-waypoint", ("waypoints", name, "from"), message)

    def _requirements(self) -> tuple[skill.Requirement, ...]:
        stated: list[tuple[str | None, skill.FormulaEntry | str, KeyPath]] = [
            *((None, entry, ("formulas", index)) for index, entry in enumerate(self.file.formulas)),
            *((name, entry, ("faults", name)) for name, entry in self.file.faults.items()),
        ]
        names = [primitive.name for primitive in self.file.primitives]
        found: list[skill.Requirement] = []
        for name, text_or_entry, path in stated:
            at: KeyPath = path if isinstance(text_or_entry, str) else (*path, "formula")
            entry = skill.FormulaEntry(formula=text_or_entry) if isinstance(text_or_entry, str) else text_or_entry
            when = entry.response.when if isinstance(entry.response, skill.RetryEntry) else None
            parsed: list[Formula | None] = []
            for text, key in ((entry.formula, at), (when, (*path, "response", "when"))):
                place = self.document.value_place(key)
                try:
                    one = None if text is None else parse_formula(text, place, indent=(place.column or 1) - 1)
                except InputError as error:
                    self.problems.extend(error.problems)
                    one = None
                parsed.append(one)
                if one is None:
                    continue
                self.problems.extend(check_formula(one, self.domain, self.action, names))
                over_time = [part for part in nested(one) if part.interval]
                if key != at and over_time:
                    message = f"`{over_time[0]}` is about a stretch of time; expected what must be seen now, such as"
                    self._report("temporal-condition", key, f"{message} `obj_on_table`")
            formula, condition = parsed
            if formula is not None:
                found.append(skill.Requirement(name, entry, formula, condition, self.document.value_place(at)))
        return tuple(found)

    def _check_targets(self) -> None:
        grasped = [primitive.object for primitive in self.file.primitives if isinstance(primitive, skill.Grasp)]
        for predicate, target in self.file.targets.items():
            self._known(predicate, self.domain.predicates, "predicate", ("targets", predicate))
            for index, box in enumerate(target.boxes):
                path: KeyPath = ("targets", predicate, "boxes", index)
                if box.name in [other.name for other in target.boxes[:index]]:
                    self._report("duplicate-name", (*path, "name"), "an earlier box has this name too")
                # `at` is a waypoint; of a box in the tool, one that grasps the object in `fits`.
                if box.at is None or not self._known(box.at, self.file.waypoints, "waypoint", (*path, "at")):
                    continue
                waypoint = self.file.waypoints[box.at]
                grasps = isinstance(waypoint, skill.GraspWaypoint) and waypoint.object == box.fits
                if box.frame == TOOL and box.fits in grasped and not grasps:
                    expected = f"expected one that grasps `{box.fits}` (with `object` and `side`)"
                    self._report("wrong-value", (*path, "at"), f"found waypoint `{box.at}`, {expected}")
