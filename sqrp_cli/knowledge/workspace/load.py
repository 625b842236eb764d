"""Phase 1 in one call: a workspace folder becomes a validated `Workspace`."""

from __future__ import annotations

import os
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.skill.read_skill import read_skill, skill_folder, skill_name
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.text.input_file import NOT_THERE, YAML_ENDINGS, ContentDigest, nearest_entry
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.knowledge.text.usual_values import WORKSPACE, unusual_values
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import parse_yaml, read_yaml
from sqrp_cli.knowledge.workspace.check_names import check_size, check_skill, check_tasks, words_of_two_meanings
from sqrp_cli.knowledge.workspace.held import with_held_by_facts
from sqrp_cli.knowledge.workspace.read_cell import CellReader
from sqrp_cli.knowledge.workspace.read_robot import RobotReader
from sqrp_cli.knowledge.workspace.workspace import Workspace, WorkspaceFile
from sqrp_cli.logic.domain import merge_domains
from sqrp_cli.platform.files import real_path
from sqrp_cli.shown import shown_name

WORKSPACE_FILE = "workspace.yaml"


def load_workspace(path: Path, content: bytes | None = None) -> Workspace:
    """Read and validate the workspace in a folder (its `workspace.yaml`) or in a file.

    path: places in the workspace's file and skills begin with it as it is given; its `Workspace.path` is absolute.
    content: replaces the content of the workspace file. Raises InputError with all problems, each with its place.
    """
    document = read_workspace_document(workspace_file(path), content)
    file_path = document.folder / document.path.name
    file = validate(document, WorkspaceFile)
    digest = ContentDigest()
    digest.add("workspace", file_path, document.content)
    robot_reader = RobotReader(document=document, digest=digest, entry=file.robot)
    robot = robot_reader.read()
    cell = CellReader(document=document, digest=digest, roots=robot_reader.roots, file=file, links=robot_reader.links)
    skills, problems = _skills(document, file, digest)
    cameras, objects = cell.cameras(), cell.objects()
    problems = [*robot_reader.problems, *problems, *cell.problems]
    if problems:
        raise InputError(*problems)
    domain = merge_domains([skill.domain for skill in skills.values()]) if skills else None
    facts, detectors = cell.facts(domain), cell.detectors(cameras, robot.markers, objects)
    problems += cell.problems
    for skill in skills.values():
        problems += check_skill(skill, robot_reader.links, list(objects), list(file.detectors))
        problems += check_size(skill, objects)
    problems += check_tasks(document, file.tasks, list(skills), list(objects))
    if problems:
        raise InputError(*problems)
    objects, taken_as_held = with_held_by_facts(objects, facts, skills.values(), document)
    return Workspace(
        name=workspace_name(file_path),
        path=file_path,
        robot=robot,
        cameras=cameras,
        detectors=detectors,
        objects=objects,
        lights=file.lights,
        state=frozenset(facts),
        skills=skills,
        tasks=tuple(file.tasks),
        padding=file.padding,
        files=digest.files,
        values=document.leaves,
        warnings=_each_once(
            *unusual_values(document, WORKSPACE),
            *robot_reader.warnings,
            *cell.warnings,
            *words_of_two_meanings(document, file, robot_reader, skills.values()),
            *taken_as_held,
            *(warning for skill in skills.values() for warning in skill.warnings),
        ),
        places=document.places,
    )


def _each_once(*warnings: Problem) -> tuple[Problem, ...]:
    """Cameras may share a calibration file."""
    return tuple(dict.fromkeys(warnings))


def read_workspace_document(path: Path, content: bytes | None = None) -> SourceDocument:
    """A workspace file as YAML; content: replaces that of the file. Raises as `read_yaml`, and for a program."""
    keys = ("robot", "cameras", "objects", "skills")
    document = read_yaml(path, keys=keys) if content is None else parse_yaml(path, content, keys=keys)
    if "sqrp_program" in document.data:
        raise InputError(_is_program(document))
    return document


def _is_program(document: SourceDocument) -> Problem:
    """The problem of a program where a workspace is expected."""
    place, named = Place(document.path), document.data.get("workspace")
    if not isinstance(named, str):
        return Problem("no-workspace", "this is a program; expected a workspace", place)
    workspace = os.path.normpath(document.path.parent / named)
    return Problem("no-workspace", f"this is a program; its workspace is {workspace}", place)


def workspace_name(file: Path) -> str:
    """What a workspace is called: the name of its folder, or of a file that is not `workspace.yaml`."""
    return shown_name(file.parent.name if file.name == WORKSPACE_FILE else file.stem)


def shortest_path(file: Path) -> Path:
    """The path that a command needs for a workspace file: its folder is enough for `workspace.yaml`."""
    return file.parent if file.name == WORKSPACE_FILE else file


def workspace_file(path: Path) -> Path:
    """The file of the workspace at a path: itself, or `workspace.yaml` in it. Raises InputError where there is none.

    It begins with the path as it is given, unless that leads up through a link: programs have one name for a file.
    """
    given = path
    if ".." in path.parts and path.exists() and str(real_path(path)) != os.path.abspath(path):  # noqa: PTH100
        path = real_path(path)
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
        raise InputError(Problem("no-workspace", f"the folder has no {WORKSPACE_FILE}; {hint}", Place(given)))
    if not path.exists():
        folder = given.parent
        while not folder.is_dir():
            folder = folder.parent
        wanted = given.relative_to(folder).parts[0]
        rest = given.relative_to(folder / wanted)
        close = nearest_entry(folder / wanted, lambda entry: _is_workspace(entry / rest))
        hint = f"; there is no folder {folder / wanted}" if rest.parts else ""
        hint = f"; did you mean `{folder / close}`?" if close else hint
        raise InputError(Problem("missing-file", f"{NOT_THERE}{hint}", Place(given)))
    return path


def _is_workspace(path: Path) -> bool:
    """Whether a path could be a workspace: a folder with a `workspace.yaml`, or another YAML file."""
    return (path / WORKSPACE_FILE).is_file() or (path.suffix in YAML_ENDINGS and path.is_file())


def _skills(
    document: SourceDocument, file: WorkspaceFile, digest: ContentDigest
) -> tuple[dict[str, Skill], list[Problem]]:
    skills: dict[str, Skill] = {}
    problems: list[Problem] = []
    for index, name in enumerate(file.skills):
        place = document.value_place(("skills", index))
        folder = Path(os.path.normpath(document.path.parent / name))
        folder = skill_folder(folder, fingers=file.robot.fingers is not None)
        called = skill_name(folder)
        if called in skills:
            problems.append(Problem("duplicate-name", f"skill `{called}` is listed twice", place))
            continue
        try:
            skills[called] = read_skill(folder, place, digest)
        except InputError as error:
            problems.extend(error.problems)
    return skills, problems
