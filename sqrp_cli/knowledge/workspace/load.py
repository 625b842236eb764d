"""Phase 1 in one call: a workspace folder becomes a validated `Workspace`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, counted, expected_names
from sqrp_cli.knowledge.frames import TOOL, WORLD, WORLD_LINK, link_called
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill.read_skill import read_skill
from sqrp_cli.knowledge.skill.skill import BoxSpec, Skill
from sqrp_cli.knowledge.text.input_file import YAML_ENDINGS, ContentDigest, nearest_entry
from sqrp_cli.knowledge.text.source import KeyPath, SourceDocument, dotted
from sqrp_cli.knowledge.text.usual_values import WORKSPACE, unusual_values
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import parse_yaml, read_yaml
from sqrp_cli.knowledge.workspace.held import with_held_by_facts
from sqrp_cli.knowledge.workspace.read_cell import CellReader
from sqrp_cli.knowledge.workspace.read_robot import RobotReader
from sqrp_cli.knowledge.workspace.workspace import ExpectedTask, Thresholds, Workspace
from sqrp_cli.knowledge.workspace.workspace_file import TaskEntry, WorkspaceFile
from sqrp_cli.logic.conditions import MAX_LITERALS, domain_sizes, largest_quantifier, literal_count
from sqrp_cli.logic.domain import merge_domains
from sqrp_cli.platform.files import real_path
from sqrp_cli.platform.paths_as_text import shown_name

WORKSPACE_FILE = "workspace.yaml"


def load_workspace(path: Path, content: bytes | None = None) -> Workspace:
    """Read and validate the workspace in a folder (its `workspace.yaml`) or in a file.

    content: what to read in place of the workspace file's own content. Raises InputError with every problem that was
    found, each with its place.
    """
    file_path = workspace_file(path)
    document = read_workspace_document(file_path, content)
    file = validate(document, WorkspaceFile)
    digest = ContentDigest()
    digest.add("workspace", file_path, document.content)
    robot_reader = RobotReader(document, file.robot, digest)
    robot = robot_reader.read()
    cell = CellReader(document, file, robot_reader.links, robot_reader.roots, digest)
    skills, problems = _skills(document, file, digest)
    detectors, cameras, objects = cell.detectors(), cell.cameras(), cell.objects()
    problems = [*robot_reader.problems, *problems, *cell.problems]
    if problems:
        raise InputError(*problems)
    domain = merge_domains([skill.domain for skill in skills.values()]) if skills else None
    facts = cell.facts(domain)
    problems += cell.problems
    for skill in skills.values():
        problems += _check_skill(skill, robot_reader.links, list(objects), list(detectors))
        problems += _check_size(skill, objects)
    tasks = tuple(_task(entry) for entry in file.tasks)
    problems += _check_tasks(document, tasks, list(skills), list(objects))
    if problems:
        raise InputError(*problems)
    objects, taken_as_held = with_held_by_facts(objects, facts, skills.values(), document)
    return Workspace(
        name=shown_name(file_path.parent.name if file_path.name == WORKSPACE_FILE else file_path.stem),
        path=file_path,
        robot=robot,
        cameras=cameras,
        detectors=detectors,
        objects=objects,
        state=frozenset(facts),
        skills=skills,
        tasks=tasks,
        padding=file.padding,
        digest=digest.hexdigest(),
        files=digest.files,
        values=document.leaves,
        warnings=_each_once(
            *unusual_values(document, WORKSPACE),
            *robot_reader.warnings,
            *cell.warnings,
            *_words_of_two_meanings(document, file, robot_reader, skills.values()),
            *taken_as_held,
            *(warning for skill in skills.values() for warning in skill.warnings),
        ),
        places=document.places,
    )


def _each_once(*warnings: Problem) -> tuple[Problem, ...]:
    """Cameras may share a calibration file."""
    return tuple(dict.fromkeys(warnings))


def read_workspace_document(path: Path, content: bytes | None = None) -> SourceDocument:
    """A workspace file as YAML; content: what to read in place of the file's own. Raises as `read_yaml`."""
    keys = ("robot", "cameras", "objects", "skills")
    return read_yaml(path, keys=keys) if content is None else parse_yaml(path, content, keys=keys)


def workspace_file(path: Path) -> Path:
    """The file of the workspace at a path: itself, or `workspace.yaml` in it. Raises InputError where there is none."""
    path = Path.cwd() / path
    if ".." in path.parts:
        path = real_path(path)  # programs name it in one way only
    if path.is_dir():
        if os.path.lexists(path / WORKSPACE_FILE):
            return path / WORKSPACE_FILE
        entries = sorted(path.iterdir())
        inside = [entry.name for entry in entries if (entry / WORKSPACE_FILE).is_file()]
        files = [entry.name for entry in entries if entry.suffix in YAML_ENDINGS]
        hint = "the folder is empty" if not entries else "it has neither YAML files nor workspaces"
        if inside:
            hint = "it has the workspaces " + ", ".join(f"`{name}`" for name in inside)
        elif files:
            hint = "it has " + ", ".join(f"`{name}`" for name in files)
        raise InputError(Problem("no-workspace", f"the folder has no {WORKSPACE_FILE}; {hint}", Place(path)))
    if not path.exists():
        folder = path.parent
        while not folder.is_dir():
            folder = folder.parent
        wanted = path.relative_to(folder).parts[0]
        rest = path.relative_to(folder / wanted)
        close = nearest_entry(folder / wanted, lambda entry: _is_workspace(entry / rest))
        hint = f"; did you mean `{folder / close}`?" if close else f"; {folder} has no `{wanted}`"
        raise InputError(Problem("missing-file", f"no such file or folder{hint}", Place(path)))
    return path


def _is_workspace(path: Path) -> bool:
    """Whether a path may be meant as a workspace: a folder with a `workspace.yaml`, or another YAML file."""
    return (path / WORKSPACE_FILE).is_file() or (path.suffix in YAML_ENDINGS and path.is_file())


def _skills(
    document: SourceDocument, file: WorkspaceFile, digest: ContentDigest
) -> tuple[dict[str, Skill], list[Problem]]:
    skills: dict[str, Skill] = {}
    problems: list[Problem] = []
    for index, name in enumerate(file.skills):
        place = document.value_place(("skills", index))
        folder = Path(os.path.normpath(document.path.parent / name))
        if folder.name in skills:
            problems.append(Problem("duplicate-name", f"skill `{folder.name}` is listed twice", place))
            continue
        try:
            skills[folder.name] = read_skill(folder, place, digest)
        except InputError as error:
            problems.extend(error.problems)
    return skills, problems


def _check_size(skill: Skill, objects: Mapping[str, SceneObject]) -> Iterator[Problem]:
    """A precondition whose quantifiers stand for more than can be looked at, told without expanding them."""
    condition, domain = skill.action.precondition, skill.domain
    types = {name: frozenset(thing.types) for name, thing in objects.items()}
    count = literal_count(condition, types, domain)
    if count > MAX_LITERALS and (quantifier := largest_quantifier(condition, types, domain)) is not None:
        sizes = domain_sizes(quantifier.variables, types, domain)
        variables = " x ".join(f"{size} (?{v.name})" for v, size in zip(quantifier.variables, sizes, strict=True))
        message = (
            f"the precondition of `{skill.action.name}` stands for {counted(count)} literals about the objects of this"
            f" workspace, the limit is {MAX_LITERALS:,}; its largest quantifier goes over {variables}"
        )
        mend = "name fewer variables in one `forall` or `exists`, or give them types that fewer objects have"
        yield Problem("pddl-too-large", message, skill.action.place, mend=mend)


def _check_skill(
    skill: Skill, links: Sequence[str], objects: Sequence[str], detectors: Sequence[str]
) -> Iterator[Problem]:
    """Names in a skill that only the workspace knows: frames, enclosed things, detectors, constants."""
    for constant in skill.domain.constants:
        if constant not in objects:
            expected = expected_names(constant, objects)
            message = f"skill `{skill.name}` has the constant `{constant}`, which is no object; {expected}"
            yield Problem("unknown-object", message, Place(skill.domain.path))
    for parameter in skill.action.parameters:
        if parameter.name in (WORLD, TOOL, *links, *objects):
            message = f"skill `{skill.name}` has a parameter `{parameter.name}`, which also names something of the cell"
            yield Problem("ambiguous-name", message, Place(skill.domain.path), mend="rename the parameter")
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            path = ("targets", predicate, "boxes", index)
            yield from _check_box(skill, box, path, links, objects, detectors)


def _check_box(
    skill: Skill, box: BoxSpec, path: KeyPath, links: Sequence[str], objects: Sequence[str], detectors: Sequence[str]
) -> Iterator[Problem]:
    parameters = [parameter.name for parameter in skill.action.parameters]
    things = [*parameters, *objects]

    def problem(code: str, message: str, *key: str | int) -> Problem:
        at = (*path, *key)
        return Problem(code, f"`{dotted(at)}`: {message}", skill.place(*at))

    def unknown(kind: str, name: str, what: str, valid: Sequence[str], *key: str | int) -> Iterator[Problem]:
        if name not in valid:
            message = f"found `{name}`, which is {what}; {expected_names(name, valid)}"
            yield problem(f"unknown-{kind}", message, *key)

    if box.frame.at_start:
        what = "no skill parameter or object, as `@start` needs"
        yield from unknown("frame", box.frame.owner, what, things, "frame")
    else:
        what = "neither `world` nor `tool`, a link, a skill parameter or an object"
        yield from unknown("frame", box.frame, what, [WORLD, TOOL, *things, *links], "frame")
    if box.at is not None and box.frame in links and box.frame != TOOL:
        message = f"found the link `{box.frame}`, expected `tool`, `world` or an object beside `at`"
        yield problem("wrong-value", message, "frame")
    if box.fits is not None:
        yield from unknown("object", box.fits, "no skill parameter or object", things, "fits")
    for index, name in enumerate(box.encloses or ()):
        what = "neither a link nor an object, a skill parameter or `tool`"
        called = link_called(name, links)
        yield from unknown("enclosed", called, what, [TOOL, *things, *links], "encloses", index)
    yield from unknown("detector", box.detector, "no detector of the workspace", detectors, "detector")


def _words_of_two_meanings(
    document: SourceDocument, file: WorkspaceFile, robot: RobotReader, skills: Iterable[Skill]
) -> Iterator[Problem]:
    """Warnings that say which was meant where a frame could as well be a link of the robot that is somewhere else."""
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
    used += [
        (
            box.frame,
            f"skill `{skill.name}`: box `{box.name}` of `{predicate}`",
            skill.place("targets", predicate, "boxes", index, "name"),
        )
        for skill in skills
        for predicate, target in skill.targets.items()
        for index, box in enumerate(target.boxes)
    ]
    for word, what, place in used:
        if word in meanings:
            meaning, other = meanings[word]
            message = f"{what}: `frame: {word}` means {meaning}; the robot has a link `{word}` too, which is elsewhere"
            mend = f"for the link write `frame: {other}`" if other else "for the link rename it in the URDF"
            yield Problem("ambiguous-word", message, place, severity="warning", mend=mend)


def _task(entry: TaskEntry) -> ExpectedTask:
    thresholds = Thresholds(
        entry.min_q_avg, entry.min_q_eoi, entry.max_time, entry.max_delay, entry.feasible, entry.winner
    )
    return ExpectedTask(entry.task, thresholds)


def _check_tasks(
    document: SourceDocument, tasks: Sequence[ExpectedTask], skills: Sequence[str], objects: Sequence[str]
) -> Iterator[Problem]:
    for index, task in enumerate(tasks):
        skill = task.task.split()[0] if task.task.split() else ""
        if skill not in skills:
            message = f"found `{skill}`, which is no skill of this workspace; {expected_names(skill, skills)}"
            yield document.problem("unknown-skill", ("tasks", index, "task"), message)
        winner = task.thresholds.winner
        if winner is not None and winner not in objects:
            message = f"found `{winner}`, which is no object; {expected_names(winner, objects)}"
            yield document.problem("unknown-object", ("tasks", index, "winner"), message)
