"""What the tool holds at the beginning, by the facts of a workspace."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, axis_rotation, inverse, pose, read_only, side_pose
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.settings import Reference, Setting
from sqrp_cli.knowledge.skill import Grasp, GraspWaypoint, Release, Skill
from sqrp_cli.knowledge.source import Document
from sqrp_cli.logic.literal import Atom
from sqrp_cli.logic.pddl import Variable


def grasping_skills(skills: Iterable[Skill]) -> dict[str, Skill]:
    """The predicates that a skill makes true of what it ends with in the tool, such as `hold`, with the first such."""
    found: dict[str, Skill] = {}
    for skill in skills:
        held = _held_at_the_end(skill)
        for added in skill.action.effect.adds:
            if held is not None and added.terms == (Variable(held),):
                found.setdefault(added.predicate, skill)
    return found


def with_held_by_facts(
    objects: Mapping[str, SceneObject], state: frozenset[Atom], skills: Iterable[Skill], document: Document
) -> tuple[dict[str, SceneObject], tuple[Problem, ...]]:
    """The objects, with the one in the tool that the facts say is held; and a warning if its entry does not say so.

    It is held as the skill that makes the fact true would grasp it, with its parameters at their defaults.
    """
    skills_by = grasping_skills(skills)
    stated = {fact.arguments[0]: fact for fact in state if fact.predicate in skills_by}
    if len(stated) != 1 or any(thing.X_TO is not None for thing in objects.values()):
        return dict(objects), ()
    ((name, fact),) = stated.items()
    skill = skills_by[fact.predicate]
    held = _held_at_the_end(skill)
    grasp = next((w for w in skill.waypoints.values() if isinstance(w, GraspWaypoint) and w.object == held), None)
    if grasp is None:
        return dict(objects), ()
    side, X_TO = _grasped(skill, grasp, objects[name])
    message = (
        f"the state has `{fact}`, so `{name}` begins in the tool, held by its side {side} as `{skill.name}` does it"
    )
    warning = document.problem(
        "held-by-the-facts", ("objects", name, "pose"), message, f"write `pose: {{held: {side}}}`"
    )
    return {**objects, name: replace(objects[name], X_WO=None, X_TO=X_TO)}, (replace(warning, severity="warning"),)


def pose_in_tool(size: tuple[float, float, float], side: str, yaw: float, depth: float) -> Array:
    """The pose X_TO of an object of a size [m] that is held by a side, as in `skill.GraspWaypoint`, shape (4, 4)."""
    return read_only(inverse(side_pose(size, side) @ pose(axis_rotation(2, yaw), (0.0, 0.0, depth))))


def _held_at_the_end(skill: Skill) -> str | None:
    """The parameter of what a skill has grasped and not released again when it ends, or None."""
    held = None
    for primitive in skill.primitives:
        if isinstance(primitive, Grasp):
            held = primitive.object
        elif isinstance(primitive, Release):
            held = None
    return held


def _grasped(skill: Skill, grasp: GraspWaypoint, thing: SceneObject) -> tuple[str, Array]:
    defaults = {parameter.name: parameter.values[0] for parameter in skill.motion_parameters}

    def value(setting: Setting) -> float | str:
        return defaults[setting.parameter] if isinstance(setting, Reference) else setting

    side = str(value(grasp.side))
    return side, pose_in_tool(thing.size, side, float(value(grasp.yaw)), float(value(grasp.depth)))
