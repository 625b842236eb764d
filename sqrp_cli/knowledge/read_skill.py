"""Reading a skill: its folder holds skill.yaml and a PDDL file named after the skill."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, expected_names, nearest
from sqrp_cli.geometry import read_only
from sqrp_cli.knowledge import setting_kind, skill_file
from sqrp_cli.knowledge.digest import ContentDigest
from sqrp_cli.knowledge.input_file import decoded, read_input
from sqrp_cli.knowledge.read_settings import SettingsReader
from sqrp_cli.knowledge.skill import (
    HOME,
    BoxSpec,
    Grasp,
    GraspWaypoint,
    JointMove,
    PoseWaypoint,
    PrimitiveAction,
    PutWaypoint,
    RaiseWaypoint,
    Release,
    Requirement,
    Response,
    RetreatWaypoint,
    Skill,
    StraightMove,
    TargetSpec,
    TurnWaypoint,
    Wait,
    Waypoint,
)
from sqrp_cli.knowledge.skill_file import BoxEntry, FormulaEntry, PrimitiveEntry, SkillFile, WaypointEntry
from sqrp_cli.knowledge.source import MAX_BYTES, Document, KeyPath, read_document
from sqrp_cli.knowledge.usual_values import SKILL, unusual_values
from sqrp_cli.knowledge.validation import validate
from sqrp_cli.logic.mtl import Always, Eventually, Formula, check_formula, children, parse_formula
from sqrp_cli.logic.pddl import Action, Domain, parse_domain

SKILL_FILE = "skill.yaml"


def read_skill(folder: Path, place: Place, digest: ContentDigest) -> Skill:
    """The skill in `folder`, whose name is the folder's.

    place: where the workspace names the folder. Raises InputError with everything that is wrong with its two files;
    names of links, objects and detectors are left to the workspace.
    """
    if not folder.is_dir():
        known = [entry.name for entry in folder.parent.iterdir() if entry.is_dir()] if folder.parent.is_dir() else []
        message = f"there is no skill folder {folder}; {expected_names(folder.name, known)}"
        raise InputError(Problem("unknown-skill", message, place))
    for required in (SKILL_FILE, f"{folder.name}.pddl"):
        if not (folder / required).is_file():
            close = nearest(required, (entry.name for entry in folder.iterdir()))
            message = f"the skill folder {folder} has no `{required}`" + (f"; did you mean `{close}`?" if close else "")
            raise InputError(Problem("missing-file", message, place))
    document = read_document(folder / SKILL_FILE, keys=("primitives", "waypoints", "targets", "formulas"))
    domain = _read_domain(folder / f"{folder.name}.pddl", digest)
    digest.add(f"skills.{folder.name}.yaml", document.path, document.content)
    if folder.name not in domain.actions:
        message = f"no action `{folder.name}`, named like its folder; {expected_names(folder.name, domain.actions)}"
        meant = nearest(folder.name, domain.actions) or next(iter(domain.actions), None)
        there = Place(domain.path) if meant is None else domain.actions[meant].place
        mend = "rename the action, or the folder and its file"
        raise InputError(Problem("missing-action", message, there, mend=mend))
    return _SkillReader(document, validate(document, SkillFile), domain, domain.actions[folder.name]).read(folder)


def _read_domain(path: Path, digest: ContentDigest) -> Domain:
    content = read_input(path, MAX_BYTES)
    digest.add(f"skills.{path.stem}.pddl", path, content)
    return parse_domain(decoded(path, content), path)


class _SkillReader:
    """Turns the entries of one skill file into records and collects every problem on the way."""

    def __init__(self, document: Document, file: SkillFile, domain: Domain, action: Action) -> None:
        self.document = document
        self.file = file
        self.domain = domain
        self.action = action
        self.objects = [parameter.name for parameter in action.parameters]
        self.settings = SettingsReader(document, file.motion)
        self.problems = self.settings.problems

    def read(self, folder: Path) -> Skill:
        for name in self.file.motion:
            if name in self.objects:
                self._report("ambiguous-name", ("motion", name), "the PDDL action has a parameter of this name too")
        waypoints = {name: self._waypoint(name, entry) for name, entry in self.file.waypoints.items()}
        self._check_waypoints()
        primitives = tuple(self._primitive(index, entry) for index, entry in enumerate(self.file.primitives))
        skill = Skill(
            name=folder.name,
            folder=folder,
            domain=self.domain,
            action=self.action,
            motion_parameters=self.settings.parameters(),
            waypoints=waypoints,
            primitives=primitives,
            requirements=self._requirements(),
            targets=self._targets(),
            places=self.document.places,
            warnings=() if self.problems else tuple(unusual_values(self.document, SKILL)),
        )
        if self.problems:
            raise InputError(*self.problems)
        return skill

    def _report(self, code: str, path: KeyPath, message: str) -> None:
        self.problems.append(self.document.problem(code, path, message))

    def _known(self, name: str, valid: list[str] | Mapping[str, object], what: str, path: KeyPath) -> bool:
        if name in valid:
            return True
        self._report(
            f"unknown-{what.replace(' ', '-')}",
            path,
            f"found `{name}`, which is no {what}; {expected_names(name, valid)}",
        )
        return False

    def _waypoint(self, name: str, entry: WaypointEntry) -> Waypoint:
        path = ("waypoints", name)
        setting = self.settings.setting
        match entry:
            case skill_file.GraspWaypointEntry():
                self._known(entry.object, self.objects, "skill parameter", (*path, "object"))
                side = setting(entry.side, setting_kind.SIDE, (*path, "side"))
                yaw = setting(entry.yaw, setting_kind.YAW, (*path, "yaw"))
                depth = setting(entry.depth, setting_kind.DISTANCE, (*path, "depth"))
                return GraspWaypoint(entry.object, side, yaw, depth)
            case skill_file.PutWaypointEntry():
                self._known(entry.put, self.objects, "skill parameter", (*path, "put"))
                self._known(entry.onto, self.objects, "skill parameter", (*path, "onto"))
                along = setting(entry.along, setting_kind.OFFSET_SHARE, (*path, "along"))
                across = setting(entry.across, setting_kind.OFFSET_SHARE, (*path, "across"))
                return PutWaypoint(
                    entry.put, entry.onto, along, across, setting(entry.yaw, setting_kind.YAW, (*path, "yaw"))
                )
            case skill_file.TurnWaypointEntry():
                turn = setting(entry.turn, setting_kind.YAW, (*path, "turn"))
                return TurnWaypoint(entry.origin, turn, setting(entry.tilt, setting_kind.YAW, (*path, "tilt")))
            case skill_file.RetreatWaypointEntry():
                return RetreatWaypoint(entry.origin, setting(entry.retreat, setting_kind.DISTANCE, (*path, "retreat")))
            case skill_file.RaiseWaypointEntry():
                return RaiseWaypoint(entry.origin, setting(entry.lift, setting_kind.DISTANCE, (*path, "raise")))
            case skill_file.PoseWaypointEntry():
                return PoseWaypoint(read_only(entry.pose.matrix()))

    def _check_waypoints(self) -> None:
        """Every `from` names another waypoint, and none leads back to itself; `home` is not redefined."""
        if HOME in self.file.waypoints:
            self._report(
                "ambiguous-name", ("waypoints", HOME), "`home` is the robot's home configuration; take another name"
            )
        origins = {name: getattr(entry, "origin", None) for name, entry in self.file.waypoints.items()}
        for name, origin in origins.items():
            path = ("waypoints", name, "from")
            if origin in (None, HOME) or not self._known(origin, [*origins, HOME], "waypoint", path):
                continue
            seen = {name: None}
            while origin is not None and origin in origins and origin not in seen:
                seen[origin] = None
                origin = origins[origin]
            if origin == name and name == next(other for other in origins if other in seen):
                self._report("cyclic-waypoint", path, f"leads back to itself: {' -> '.join([*seen, name])}")

    def _primitive(self, index: int, entry: PrimitiveEntry) -> PrimitiveAction:
        path = ("primitives", index)
        setting = self.settings.setting
        if entry.name in [other.name for other in self.file.primitives[:index]]:
            self._report("duplicate-name", (*path, "name"), f"`{entry.name}` names an earlier primitive action too")
        match entry:
            case skill_file.JointMoveEntry():
                self._known(entry.joint_move, [*self.file.waypoints, HOME], "waypoint", (*path, "joint_move"))
                return JointMove(
                    entry.name,
                    entry.joint_move,
                    setting(entry.speed, setting_kind.SPEED_SHARE, (*path, "speed")),
                    setting(entry.elbow, setting_kind.ELBOW, (*path, "elbow")),
                    setting(entry.shoulder, setting_kind.SHOULDER, (*path, "shoulder")),
                    setting(entry.wrist, setting_kind.WRIST, (*path, "wrist")),
                    setting(entry.via, setting_kind.VIA, (*path, "via")),
                )
            case skill_file.StraightMoveEntry():
                self._known(entry.straight_move, self.file.waypoints, "waypoint", (*path, "straight_move"))
                return StraightMove(
                    entry.name,
                    entry.straight_move,
                    setting(entry.speed, setting_kind.SPEED, (*path, "speed")),
                    setting(entry.acceleration, setting_kind.ACCELERATION, (*path, "acceleration")),
                    setting(entry.jerk, setting_kind.JERK, (*path, "jerk")),
                )
            case skill_file.GraspEntry():
                self._known(entry.grasp, self.objects, "skill parameter", (*path, "grasp"))
                duration = setting(entry.duration, setting_kind.DURATION, (*path, "duration"))
                return Grasp(entry.name, entry.grasp, duration)
            case skill_file.ReleaseEntry():
                return Release(entry.name, setting(entry.release, setting_kind.DURATION, (*path, "release")))
            case skill_file.WaitEntry():
                return Wait(entry.name, setting(entry.wait, setting_kind.DURATION, (*path, "wait")))

    def _requirements(self) -> tuple[Requirement, ...]:
        requirements = []
        for index, item in enumerate(self.file.formulas):
            path: KeyPath = ("formulas", index)
            entry = item if isinstance(item, FormulaEntry) else FormulaEntry(formula=item)
            text_path = (*path, "formula") if isinstance(item, FormulaEntry) else path
            requirements.append(self._requirement(None, entry, path, text_path))
        for name, entry in self.file.faults.items():
            requirements.append(self._requirement(name, entry, ("faults", name), ("faults", name, "formula")))
        return tuple(requirement for requirement in requirements if requirement is not None)

    def _requirement(
        self, name: str | None, entry: FormulaEntry, path: KeyPath, text_path: KeyPath
    ) -> Requirement | None:
        formula = self._formula(entry.formula, text_path)
        condition = None
        if isinstance(entry.response, str):
            response = Response(entry.response)
        else:
            if entry.response.when is not None:
                condition = self._condition(entry.response.when, (*path, "response", "when"))
            response = Response("retry", entry.response.retry, condition)
        if formula is None:
            return None
        return Requirement(name, formula, response, entry.settle, self.document.value_place(text_path))

    def _condition(self, text: str, path: KeyPath) -> Formula | None:
        """A formula about what is seen now."""
        condition = self._formula(text, path)
        parts = [] if condition is None else [condition]
        while parts:
            part = parts.pop()
            if isinstance(part, Always | Eventually):
                message = f"`{part}` is about a stretch of time; expected what must be seen now, such as `obj_on_table`"
                self._report("temporal-condition", path, message)
                return None
            parts += children(part)
        return condition

    def _formula(self, text: str, path: KeyPath) -> Formula | None:
        place = self.document.value_place(path)
        try:
            formula = parse_formula(text, place, indent=(place.column or 1) - 1)
        except InputError as error:
            self.problems.extend(error.problems)
            return None
        names = [entry.name for entry in self.file.primitives]
        self.problems.extend(check_formula(formula, self.domain, self.action, names))
        return formula

    def _targets(self) -> dict[str, TargetSpec]:
        targets = {}
        for predicate, entry in self.file.targets.items():
            path = ("targets", predicate)
            self._known(predicate, self.domain.predicates, "predicate", path)
            boxes = tuple(self._box((*path, "boxes", index), box) for index, box in enumerate(entry.boxes))
            for index, box in enumerate(boxes):
                if box.name in [other.name for other in boxes[:index]]:
                    self._report("duplicate-name", (*path, "boxes", index, "name"), "an earlier box has this name too")
            targets[predicate] = TargetSpec(predicate, entry.cameras, boxes, self.document.key_place(path))
        return targets

    def _box(self, path: KeyPath, entry: BoxEntry) -> BoxSpec:
        if entry.at is not None and self._known(entry.at, self.file.waypoints, "waypoint", (*path, "at")):
            waypoint = self.file.waypoints[entry.at]
            grasped = [getattr(primitive, "grasp", None) for primitive in self.file.primitives]
            grasps = isinstance(waypoint, skill_file.GraspWaypointEntry) and waypoint.object == entry.fits
            if entry.frame == "tool" and entry.fits in grasped and not grasps:
                message = (
                    f"found waypoint `{entry.at}`, expected one that grasps `{entry.fits}` (with `object` and `side`)"
                )
                self._report("wrong-value", (*path, "at"), message)
        normal = None
        if entry.normal is not None:
            x, y, z = np.asarray(entry.normal) / np.linalg.norm(entry.normal)
            normal = (float(x), float(y), float(z))
        return BoxSpec(
            name=entry.name,
            frame=entry.frame,
            fits=entry.fits,
            at=entry.at,
            margin=entry.margin,
            size=entry.size,
            X_FB=read_only(entry.pose.matrix()),
            detector=entry.detector,
            normal=normal,
            encloses=None if entry.encloses is None else tuple(entry.encloses),
            place=self.document.key_place((*path, "name")),
        )
