"""Findings in a workspace that is readable but cannot work as intended."""

from __future__ import annotations

from collections.abc import Iterator

from sqrp_cli.checks import boxes
from sqrp_cli.checks.cameras import (
    blind_cameras,
    detectors_out_of_range,
    doubtful_images,
    implausible_lenses,
    thresholds_out_of_reach,
)
from sqrp_cli.checks.formulas import (
    contradictions,
    faults_of_the_plan,
    formulas_against_the_action,
    impossible_preconditions,
)
from sqrp_cli.checks.placement import floating_objects, overlapping_objects
from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.skill.skill import Skill
from sqrp_cli.knowledge.workspace.held import holding_skills
from sqrp_cli.knowledge.workspace.workspace import Workspace


def lint(workspace: Workspace) -> tuple[Problem, ...]:
    """All findings, those of the skills first, then those of cameras and objects.

    `checks/findings.yaml` explains each. The reader already refuses intervals that end before they start and frames
    that do not exist.
    """
    findings: list[Problem] = list(_without_skills(workspace))
    for skill in workspace.skills.values():
        findings += boxes.without_target(skill)
        findings += boxes.fault_boxes_that_move(skill)
        findings += contradictions(skill)
        findings += faults_of_the_plan(skill)
        findings += impossible_preconditions(skill)
        findings += formulas_against_the_action(skill)
        findings += boxes.too_few_cameras(workspace, skill)
        findings += boxes.empty_boxes(workspace, skill)
        findings += boxes.too_small_boxes(workspace, skill)
        findings += _unused_parameters(skill)
    findings += _held_against_the_facts(workspace)
    findings += thresholds_out_of_reach(workspace)
    findings += detectors_out_of_range(workspace)
    findings += doubtful_images(workspace)
    findings += implausible_lenses(workspace)
    findings += blind_cameras(workspace)
    findings += boxes.colors(workspace)
    findings += overlapping_objects(workspace)
    findings += floating_objects(workspace)
    return tuple(findings)


def _without_skills(workspace: Workspace) -> Iterator[Problem]:
    if not workspace.skills:
        message, mend = "the workspace has no skills, so nothing can be done in it", "name their folders under `skills`"
        place = workspace.places.get("skills", workspace.whole_file)
        yield Problem("no-skills", message, place, severity="warning", mend=mend)


def _held_against_the_facts(workspace: Workspace) -> Iterator[Problem]:
    """Facts that only a grasp makes true, about an object that is not in the tool; and vice versa."""
    grasps = holding_skills(workspace.skills.values(), workspace.objects)
    stated = {fact.arguments[0]: fact for fact in sorted(workspace.state, key=str) if fact.predicate in grasps}
    for name, fact in stated.items():
        if workspace.objects[name].X_TO is None:
            place = workspace.places.get(f"objects.{name}.pose")
            message = f"the state has `{fact}`, but by its pose `{name}` is not in the tool"
            mend = "write `pose: {held: +z}` (the side by which it is held), or remove the fact"
            yield Problem("held-against-the-facts", message, place, mend=mend)
    for name, item in workspace.objects.items():
        if item.X_TO is not None and grasps and name not in stated:
            place = workspace.places.get(f"objects.{name}.pose")
            facts = " or ".join(f"`{predicate}({name})`" for predicate in sorted(grasps))
            message = f"by its pose `{name}` is in the tool, but the state does not say {facts}"
            yield Problem("held-against-the-facts", message, place, mend="add it to the state")


def _unused_parameters(skill: Skill) -> Iterator[Problem]:
    for parameter in skill.motion_parameters:
        if not parameter.kinds:
            message = f"skill `{skill.name}`: no waypoint or primitive action uses the parameter `{parameter.name}`"
            mend = f"write `${parameter.name}` where it is meant, or remove it"
            place = skill.places.get(f"motion.{parameter.name}")
            yield Problem("unused-parameter", message, place, severity="warning", mend=mend)
