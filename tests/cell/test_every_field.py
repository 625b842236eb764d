"""Every field of the files that users write, damaged in every way: the message names file, line and key."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import pytest
from pydantic import BaseModel, PlainValidator, StringConstraints, Tag, TypeAdapter
from pydantic.fields import FieldInfo

from sqrp_cli.cell.load import check_skill, load_workspace
from sqrp_cli.cell.mounts import PlaceFile
from sqrp_cli.cell.workspace import WorkspaceFile
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.files.entries import Entry, FileRecord, Pose, SerializedAs
from sqrp_cli.files.frames import TOOL
from sqrp_cli.files.source import KeyPath, SourceDocument, dotted
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.run.cell.robot_file import RobotFile
from sqrp_cli.skill import skill
from sqrp_cli.skill.settings import Kind
from sqrp_cli.skill.skill import Names, SkillFile

CASES = Path(__file__).parents[1] / "cases" / "every_field"
FILES: dict[str, type[BaseModel]] = {
    "workspace.yaml": WorkspaceFile, "skill.yaml": SkillFile, "place.yaml": PlaceFile, "robot.yaml": RobotFile,
}  # fmt: skip


@dataclass(frozen=True)
class FieldUse:
    """A field of a model where a file uses it: the file, the path of its key, and whether it must be there."""

    file: str
    path: KeyPath
    model: str
    name: str
    required: bool

    def __str__(self) -> str:
        return f"{self.file}:{dotted(self.path)}"


@cache
def document(file: str) -> SourceDocument:
    return read_yaml(CASES / file)


def stated_fields(model: type) -> list[tuple[str, str, bool]]:
    """Name and key of each field of a model, and whether it must be there."""
    if issubclass(model, BaseModel):
        return [(name, info.alias or name, info.is_required()) for name, info in model.model_fields.items()]
    if is_dataclass(model):
        hints = get_type_hints(model, include_extras=True)
        marks = {part: [mark for mark in get_args(hints[part.name]) if isinstance(mark, FieldInfo) and mark.alias]
                 for part in fields(model)}  # fmt: skip
        return [(one.name, mine[0].alias if mine else one.name, one.default is MISSING) for one, mine in marks.items()]
    return []


def as_written(owner: object, name: str, data: object) -> object:
    """A field in the form that a file has it in."""
    for mark in get_args(get_type_hints(type(owner), include_extras=True)[name]):
        if isinstance(mark, SerializedAs):
            return TypeAdapter(mark.form).validate_python(data)
    return getattr(owner, name)


def models_in(kind: Any, found: set[type]) -> set[type]:
    """The models that a file of a kind is made of, besides those that were found."""
    kind = kind.form if isinstance(kind, SerializedAs) else kind
    if isinstance(kind, type) and issubclass(kind, Entry | FileRecord) and kind not in found:
        found.add(kind)
        for hint in get_type_hints(kind, include_extras=True).values():
            models_in(hint, found)
    for part in get_args(kind):
        models_in(part, found)
    return found


def uses(file: str) -> Iterator[FieldUse]:
    """The fields of a valid file's models that are stated in it."""

    def walk(value: object, data: Any, path: KeyPath) -> Iterator[FieldUse]:
        for name, key, required in stated_fields(type(value)):
            if isinstance(data, dict) and key in data:
                yield FieldUse(file, (*path, key), type(value).__name__, name, required)
                yield from walk(as_written(value, name, data[key]), data[key], (*path, key))
        if isinstance(value, dict):
            for key in value:
                yield from walk(value[key], data[key], (*path, key))
        elif isinstance(value, list | tuple) and isinstance(data, list):
            for index, item in enumerate(value):
                yield from walk(item, data[index], (*path, index))

    return walk(validate(document(file), FILES[file]), document(file).data, ())


WAITING = {
    ("CameraPose", "quaternion"), ("CameraPose", "rpy"),  # the same fields as any other pose's
    ("ToolEntry", "boxes"), ("ToolEntry", "frame"), ("ToolBoxEntry", "size"), ("ToolBoxEntry", "pose"),
    ("RobotEntry", "mjcf"),
}  # fmt: skip
"""Fields that the files do not state: a workspace has one robot and one tool, of a URDF or not."""

USES = [use for file in FILES for use in uses(file)]


def test_the_files_use_the_fields_of_every_model():
    """A new field belongs into tests/cases/every_field."""
    models = set().union(*(models_in(model, set()) for model in FILES.values()))
    assert len(models) >= 35
    known = {(model.__name__, name) for model in models for name, _, _ in stated_fields(model)}
    used = {(use.model, use.name) for use in USES}
    named = {"WorkspaceFile", "SkillFile", "CameraEntry", "BoxSpec", "SpanEntry", "LensEntry"}
    assert named <= {model for model, _ in used}
    assert known - used == WAITING


@pytest.mark.parametrize(("union", "key"), [(skill.Waypoint, "waypoints"), (skill.PrimitiveAction, "primitives")])
def test_the_skill_has_waypoints_and_primitives_of_every_kind(union, key):
    stated = document("skill.yaml").data[key]
    entries = stated.values() if isinstance(stated, dict) else stated
    tags = {mark.tag for option in get_args(get_args(union)[0]) for mark in get_args(option) if isinstance(mark, Tag)}
    assert len(tags) >= 5
    assert {tag for tag in tags if not any(tag.strip("<>") in entry for entry in entries)} == set()


def parts(hint: Any) -> Iterator[Any]:
    """A type hint with all that it is made of, marks too."""
    yield hint
    for part in get_args(hint):
        yield from parts(part)


def test_every_name_and_setting_of_a_skills_motion_has_a_mark_that_is_read():
    """One without a mark on the field or in its type would never be checked."""
    models = models_in(skill.Waypoint, set()) | models_in(skill.PrimitiveAction, set())
    count = 0
    for model in models - {Pose}:
        hints = get_type_hints(model, include_extras=True)
        for name, info in model.model_fields.items():
            where = f"{model.__name__}.{name}"
            own = [*info.metadata, *skill.marks_in(info.annotation)]
            marks = [mark for mark in own if isinstance(mark, Kind | Names)]
            asked = [part for part in parts(hints[name]) if isinstance(part, PlainValidator | StringConstraints)]
            own_word = name == "does" or info.description == "What formulas call it, as in `a1.start`."
            assert bool(marks) == (bool(asked) and not own_word), where
            count += len(marks)
    assert count >= 30


def damaged(use: FieldUse, change: Callable[[dict[str, Any], str], object]) -> list[Problem]:
    """What is said of the file after `change` of the mapping that has the field."""
    original = document(use.file)
    data = copy.deepcopy(original.data)
    owner: Any = data
    for step in use.path[:-1]:
        owner = owner[step]
    key = str(use.path[-1])
    change(owner, key)
    renamed = {(*use.path[:-1], name): original.keys[use.path] for name in owner if name not in original.keys}
    with pytest.raises(InputError) as caught:
        validate(replace(original, data=data, keys={**renamed, **original.keys}), FILES[use.file])
    return list(caught.value.problems)


def assert_named(problems: list[Problem], use: FieldUse, key: str) -> None:
    """Some problem names the file, a line within the entry that has the field, and the key."""
    keys = document(use.file).keys
    owner = keys[use.path[:-1]].line if len(use.path) > 1 else 1
    lines = [place.line for path, place in keys.items() if path[: len(use.path)] == use.path]
    within = range(owner or 1, max(line or 1 for line in lines) + 1)
    said = [(str(problem), problem.place.line if problem.place else None) for problem in problems]
    assert all(problem.place is not None and problem.place.file.name == use.file for problem in problems), said
    assert any(f"{key}" in text and (line is None or line in within) for text, line in said), (within, said)


def is_quantity(value: object) -> bool:
    return (isinstance(value, int | float) and not isinstance(value, bool)) or (
        isinstance(value, str) and value[:1].isdigit()
    )


@pytest.mark.parametrize("use", USES, ids=str)
def test_a_misspelt_key_is_named_with_the_right_one(use):
    problems = damaged(use, lambda owner, key: owner.update({f"{key}_x": owner.pop(key)}))
    key = str(use.path[-1])
    assert_named(problems, use, f"{key}_x")
    unknown = next((problem for problem in problems if problem.code == "unknown-key"), None)
    assert unknown is None or len(key) <= 3 or f"`{key}`" in unknown.message


@pytest.mark.parametrize("use", USES, ids=str)
def test_a_key_that_is_missing_or_has_a_value_of_the_wrong_kind_or_out_of_all_bounds_is_named(use):
    value = document(use.file).at(use.path)
    wrong: list[object] = [one for one in ({"zzz": [1]}, [[{}]]) if type(value) is not type(one)]
    wrong += [1e300, -1e300, 1e9] if is_quantity(value) else []
    wrong += [[*value[:-1], 1e300]] if isinstance(value, list) and value and is_quantity(value[-1]) else []
    for one in wrong:
        assert_named(damaged(use, lambda owner, key, one=one: owner.update({key: one})), use, str(use.path[-1]))
    if use.required:
        assert_named(damaged(use, lambda owner, key: owner.pop(key)), use, str(use.path[-1]))


class Shift(skill.Primitive):
    """A primitive action that names a frame, as none of ours does."""

    along: Annotated[str, Names("frame", (TOOL,))]


@pytest.mark.parametrize(("along", "codes"), [("objekt", ["unknown-frame"]), ("object", []), ("tool", [])])
def test_a_frame_that_a_primitive_names_is_checked_as_that_of_a_waypoint(cell, along, codes):
    workspace = load_workspace(cell)
    shifted = replace(workspace.skills["pickup"], primitives=(Shift(name="a1", along=along),))
    found = check_skill(shifted, ["wrist"], workspace.objects, list(workspace.detectors))
    assert [problem.code for problem in found] == codes
