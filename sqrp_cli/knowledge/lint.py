"""Findings in a workspace that can be read but cannot work as its author meant it."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.lint_formulas import contradictions, fault_boxes_that_move, predicates_of
from sqrp_cli.knowledge.lint_scene import blind_cameras, overlapping_objects, too_small_boxes
from sqrp_cli.knowledge.skill import Reference, Skill
from sqrp_cli.knowledge.workspace import Workspace


def lint(workspace: Workspace) -> tuple[Problem, ...]:
    """Every finding, first those of the skills, then those of cameras and objects; none if the workspace is fine.

    Codes: literal-without-target, box-moves-with-lost-object, contradictory-formulas, too-few-cameras,
    too-small-for-every-camera, unused-parameter, camera-sees-nothing, overlapping-objects. Intervals that end before
    they start and frames that do not exist are refused when the workspace is read.
    """
    findings: list[Problem] = []
    for skill in workspace.skills.values():
        findings += _without_target(skill)
        findings += fault_boxes_that_move(skill)
        findings += contradictions(skill)
        findings += _too_few_cameras(workspace, skill)
        findings += too_small_boxes(workspace, skill)
        findings += _unused_parameters(skill)
    findings += blind_cameras(workspace)
    findings += overlapping_objects(workspace)
    return tuple(findings)


def _without_target(skill: Skill) -> Iterator[Problem]:
    reported: set[str] = set()
    for requirement in skill.requirements:
        for predicate in predicates_of(requirement.formula):
            if predicate in skill.targets or predicate in reported:
                continue
            reported.add(predicate)
            message = f"skill `{skill.name}`: `{predicate}` is in a formula, but no target says where it can be seen"
            mend = f"add `{predicate}:` with its boxes under `targets`"
            yield Problem("literal-without-target", message, requirement.place, mend=mend)


def _too_few_cameras(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    available = len(workspace.cameras)
    for target in skill.targets.values():
        if target.cameras > available:
            message = (
                f"skill `{skill.name}`: `{target.predicate}` needs {target.cameras} cameras, the cell has {available}"
            )
            place = skill.places.get(f"targets.{target.predicate}.cameras", target.place)
            yield Problem("too-few-cameras", message, place, mend="lower `cameras` of the target, or add cameras")


def _unused_parameters(skill: Skill) -> Iterator[Problem]:
    used = {
        value.parameter
        for thing in (*skill.waypoints.values(), *skill.primitives)
        for value in vars(thing).values()
        if isinstance(value, Reference)
    }
    for parameter in skill.motion_parameters:
        if parameter.name not in used:
            message = f"skill `{skill.name}`: no waypoint or primitive action uses the parameter `{parameter.name}`"
            mend = f"write `${parameter.name}` where it is meant, or remove it"
            place = skill.places.get(f"motion.{parameter.name}")
            yield Problem("unused-parameter", message, place, severity="warning", mend=mend)
