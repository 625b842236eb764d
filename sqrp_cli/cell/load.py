"""Phase 1 in one call: a workspace folder becomes a validated `Workspace`.

Names and sizes that need both the workspace and its skills are checked here, and the facts at the beginning are
found, with the object in the tool.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from math import prod
from pathlib import Path

import numpy as np

from sqrp_cli.cell.facts import facts_of_cell, read_facts, with_held_by_facts
from sqrp_cli.cell.read_cell import read_cameras, read_detectors, read_objects
from sqrp_cli.cell.read_robot import RobotReader
from sqrp_cli.cell.recordings import USUAL_DETECTORS, RecordedTask, recorded_scene_objects, recorded_task
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import ExpectedTask, Workspace, WorkspaceFile
from sqrp_cli.cell.workspace_file import read_workspace_document, workspace_file, workspace_name
from sqrp_cli.errors import InputError, Place, Problem, counted, expected_names, first_names, no_such
from sqrp_cli.files.frames import AT_START, TOOL, WORLD, WORLD_LINK, link_called
from sqrp_cli.files.input_file import SourceFile, source_file
from sqrp_cli.files.packages import from_folder
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.usual_values import WORKSPACE, unusual_values
from sqrp_cli.files.validation import validate
from sqrp_cli.logic.conditions import MAX_LITERALS, fitting_objects, literal_count
from sqrp_cli.logic.domain import Compound, merge_domains, nested
from sqrp_cli.skill.read_skill import missing_skills, read_skill, skill_folder, skill_name
from sqrp_cli.skill.skill import FORMER_ENDING, Names, Skill, marked


def check_tasks(
    document: SourceDocument, tasks: Sequence[ExpectedTask], skills: Sequence[str], objects: Sequence[str]
) -> Iterator[Problem]:
    """Check the names in the expected tasks: the skill, and the object that the best candidate should use."""
    for index, task in enumerate(tasks):
        for number, text in enumerate(task.steps or (task.task,)):
            skill = text.split()[0] if text.split() else ""
            if skill not in skills and skill.removesuffix(FORMER_ENDING) not in skills:
                message = no_such(skill, "skill of this workspace", skills)
                at = ("steps", number) if task.steps else ("task",)
                yield document.problem("unknown-skill", ("tasks", index, *at), message)
        winner = task.winner
        if winner is not None and winner not in objects:
            yield document.problem("unknown-object", ("tasks", index, "winner"), no_such(winner, "object", objects))


def check_skill(
    skill: Skill, links: Sequence[str], objects: Mapping[str, SceneObject], detectors: Sequence[str]
) -> Iterator[Problem]:
    """Check the names in a skill that only the workspace defines: frames, enclosed parts, detectors, constants.

    Also the size of a precondition whose quantifiers are expanded, without expanding them.
    """
    for constant in skill.domain.constants:
        if constant not in objects:
            expected = expected_names(constant, objects)
            message = f"skill `{skill.name}` has the constant `{constant}`, which is no object; {expected}"
            yield Problem("unknown-object", message, Place(skill.domain.path))
    for parameter in skill.action.parameters:
        if parameter.name in (WORLD, TOOL, *links, *objects):
            message = f"skill `{skill.name}` has a parameter `{parameter.name}`, which also names something of the cell"
            yield Problem("ambiguous-name", message, Place(skill.domain.path), mend="rename the parameter")
    named = [*(parameter.name for parameter in skill.action.parameters), *objects]
    # Each name: its key, what it has to be, the known ones, and what it is not if it is none of these.
    names: list[tuple[KeyPath, str, str, Sequence[str], str]] = []
    for part, entries in (("waypoints", skill.waypoints.items()), ("primitives", enumerate(skill.primitives))):
        for key, frame, mark in chain.from_iterable(marked(entry, (part, name)) for name, entry in entries):
            if isinstance(mark, Names) and mark.what == "frame":
                words = [WORLD, *mark.also]
                what = f"neither {' nor '.join(f'`{word}`' for word in words)}, a skill parameter or an object"
                names.append((key, "frame", str(frame), [*words, *named], what))
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            at: KeyPath = ("targets", predicate, "boxes", index)
            what, valid = (
                "neither `world` nor `tool`, a link, a skill parameter or an object",
                [WORLD, TOOL, *named, *links],
            )
            if box.frame.endswith(AT_START):
                what, valid = "no skill parameter or object, as `@start` needs", named
            names.append(((*at, "frame"), "frame", box.frame.removesuffix(AT_START), valid, what))
            if box.at is not None and box.frame in links and box.frame != TOOL:
                message = f"found the link `{box.frame}`, expected `tool`, `world` or an object beside `at`"
                message = f"`{dotted((*at, 'frame'))}`: {message}"
                yield Problem("wrong-value", message, skill.place(*at, "frame"))
            if box.fits is not None:
                names.append(((*at, "fits"), "object", box.fits, named, "no skill parameter or object"))
            for number, name in enumerate(box.encloses or ()):
                what, valid = "neither a link nor an object, a skill parameter or `tool`", [TOOL, *named, *links]
                names.append(((*at, "encloses", number), "enclosed", link_called(name, links), valid, what))
            names.append(((*at, "detector"), "detector", box.detector, detectors, "no detector of the workspace"))
    unknown = [(key, kind, name, known, what) for key, kind, name, known, what in names if name not in known]
    # A skill for another robot names its links in many boxes.
    lacking = dict[str, KeyPath]()  # where each is named first
    for key, kind, name, _, _ in unknown:
        if key[0] == "targets" and kind in ("frame", "enclosed"):
            lacking.setdefault(name, key)
    if len(lacking) > 1:
        message = f"skill `{skill.name}` needs the links {first_names([*lacking])}"
        mend = "use a robot or tool that has them, or change `frame` and `encloses` in the skill"
        place = skill.place(*next(iter(lacking.values())))
        yield Problem("unknown-frame", f"{message}, which this robot and its tool lack", place, mend=mend)
    for key, kind, name, known, what in unknown:
        if name not in lacking or (len(lacking) == 1 and lacking[name] == key):
            message = f"`{dotted(key)}`: found `{name}`, which is {what}; {expected_names(name, known)}"
            yield Problem(f"unknown-{kind}", message, skill.place(*key))
    condition, domain = skill.action.precondition, skill.domain
    types = {name: frozenset(obj.types) for name, obj in objects.items()}
    count = literal_count(condition, types, domain)
    quantifiers = [part.variables for part in nested(condition) if isinstance(part, Compound) and part.variables]
    if count > MAX_LITERALS and quantifiers:
        sizes = [{one.name: len(fitting_objects(one, types, domain)) for one in of_one} for of_one in quantifiers]
        largest = max(sizes, key=lambda of_one: prod(of_one.values()))
        variables = " x ".join(f"{size} (?{name})" for name, size in largest.items())
        message = (
            f"the precondition of `{skill.action.name}` stands for {counted(count)} literals about the objects of this"
            f" workspace, the limit is {MAX_LITERALS:,}; its largest quantifier goes over {variables}"
        )
        mend = "name fewer variables in one `forall` or `exists`, or give them types that fewer objects have"
        yield Problem("pddl-too-large", message, skill.action.place, mend=mend)


def words_of_two_meanings(
    document: SourceDocument, file: WorkspaceFile, robot: RobotReader, skills: Iterable[Skill]
) -> Iterator[Problem]:
    """Warnings about frame names that are also links of the robot, at another pose; they say which one is used."""
    meanings: dict[str, tuple[str, str | None]] = {}
    if WORLD_LINK in robot.links and not np.allclose(file.robot.base.matrix(), np.eye(4), rtol=0.0, atol=1e-9):
        meanings[WORLD] = ("the cell's world", WORLD_LINK)
    if TOOL in robot.links and robot.tool_frame != TOOL:
        meanings[TOOL] = (f"the tool frame, `{robot.tool_frame}`", None)
    used = [
        (entry.frame, f"camera `{name}`", document.value_place(("cameras", name, "frame")))
        for name, entry in file.cameras.items()
        if entry.frame == WORLD
    ]
    for skill in skills:
        for predicate, target in skill.targets.items():
            for index, box in enumerate(target.boxes):
                what = f"skill `{skill.name}`: box `{box.name}` of `{predicate}`"
                used.append((box.frame, what, skill.place("targets", predicate, "boxes", index, "name")))
    for word, what, place in used:
        if word in meanings:
            meaning, other = meanings[word]
            message = f"{what}: `frame: {word}` means {meaning}; the robot has a link `{word}` too, which is elsewhere"
            mend = f"for the link write `frame: {other}`" if other else "for the link rename it in the URDF"
            yield Problem("ambiguous-word", message, place, severity="warning", mend=mend)


def _read_skills(
    document: SourceDocument, file: WorkspaceFile, digest: dict[str, SourceFile], problems: list[Problem]
) -> dict[str, Skill]:
    """The skills that a workspace lists, by name; digest and problems are added to."""
    skills, missing = dict[str, Skill](), list[tuple[Path, Place]]()
    tool = {"fingers": file.robot.fingers is not None, "markers": bool(file.robot.markers)}
    for index, stated in enumerate(file.skills):
        place = document.value_place(("skills", index))
        folder = skill_folder(from_folder(document.path.parent, stated), **tool)
        called = skill_name(folder)
        if called in skills:
            problems.append(Problem("duplicate-name", f"skill `{called}` is listed twice", place))
        elif not folder.is_dir():
            missing.append((folder, place))
        else:
            try:
                skills[called] = read_skill(folder, place, digest)
            except InputError as error:
                problems.extend(error.problems)
    problems += missing_skills(missing)
    return skills


def load_workspace(path: Path, content: bytes | None = None) -> Workspace:
    """Read and validate the workspace in a folder (its `workspace.yaml`) or in a file.

    path: places in the workspace's file and skills begin with it as it is given; its `Workspace.path` is absolute.
    content: replaces the content of the workspace file. Raises InputError with all problems, each with its place.
    """
    document = read_workspace_document(workspace_file(path), content)
    file_path = document.folder / document.path.name
    file = validate(document, WorkspaceFile)
    digest: dict[str, SourceFile] = {}
    digest["workspace"] = source_file(file_path, document.content)
    reader = RobotReader(document=document, digest=digest, entry=file.robot)
    robot, problems = reader.read_robot(), reader.problems
    skills = _read_skills(document, file, digest, problems)
    cameras, objects = read_cameras(reader, file), read_objects(reader, file)
    if problems:
        raise InputError(*problems)
    objects |= {one.name: one for one in recorded_scene_objects(document, file.recordings, objects)}
    if not skills and (file.state or (file.tasks and not file.recordings)):
        message = "the workspace lists no skills, which give facts and tasks their meaning"
        raise document.error("no-skills", ("skills",), message, "list the folders of skills under `skills`")
    domain = merge_domains([skill.domain for skill in skills.values()]) if skills else None
    literals = read_facts(reader, file, domain) if domain else {}
    detectors = read_detectors(reader, file, cameras, robot.markers, objects)
    for skill in skills.values():
        problems += check_skill(skill, reader.links, objects, list(file.detectors))
    recordings = dict[str, RecordedTask]()
    for called, entry in file.recordings.items():
        if called in skills:
            at = ("recordings", called)
            problems.append(document.problem("duplicate-name", at, f"there is also a skill `{called}`"))
        with reader.collecting():
            path = from_folder(document.folder, entry.file)
            found = recorded_task(document, called, path, entry, list(detectors))
            problems += check_skill(found.skill, reader.links, objects, [*detectors, *USUAL_DETECTORS])
            recordings[called] = found
    problems += check_tasks(document, file.tasks, [*skills, *recordings], list(objects))
    if problems:
        raise InputError(*problems)
    facts = {literal.atom: index for literal, index in literals.items() if literal.positive}
    objects, taken_as_held = with_held_by_facts(objects, facts, skills.values(), document)
    derived = facts_of_cell(objects, literals, skills.values(), domain, document) if domain else {}
    warnings = [*unusual_values(document, WORKSPACE), *reader.warnings]
    warnings += [*words_of_two_meanings(document, file, reader, skills.values()), *taken_as_held]
    warnings += [warning for skill in skills.values() for warning in skill.warnings]
    return Workspace(
        name=workspace_name(file_path),
        path=file_path,
        robot=robot,
        cameras=cameras,
        detectors=detectors,
        objects=objects,
        lights=file.lights,
        state=frozenset({*facts, *derived}),
        derived=derived,
        skills=skills,
        tasks=tuple(file.tasks),
        recordings=recordings,
        padding=file.padding,
        files=digest,
        values=document.leaves,
        warnings=tuple(dict.fromkeys(warnings)),  # cameras may share a calibration file
        places=document.places,
    )
