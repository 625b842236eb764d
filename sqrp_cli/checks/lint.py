"""Findings in a workspace that is readable but cannot work as intended: all of them, and those in boxes of targets.

These are too small to be seen, empty, moving with a lost object, or missing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from itertools import product

import numpy as np

from sqrp_cli.camera.camera import Camera, assumed_latency
from sqrp_cli.camera.light import COLORS, hue_of, look_alike
from sqrp_cli.cell.facts import holding_skills
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.checks import cameras
from sqrp_cli.checks.formulas import contradictions, faults_of_the_plan, formulas_against_the_action
from sqrp_cli.checks.placement import floating_objects, overlapping_objects, warning
from sqrp_cli.errors import Problem, expected_names, first_names
from sqrp_cli.files.frames import AT_START, WORLD
from sqrp_cli.logic.domain import nested
from sqrp_cli.logic.formula import Predicate
from sqrp_cli.skill.skill import Grasp, Skill
from sqrp_cli.skill.target_box import BoxSpec


def lint(workspace: Workspace) -> tuple[Problem, ...]:
    """All findings, those of the skills first, then those of cameras and objects.

    `checks/findings.yaml` explains each. The reader already refuses intervals that end before they start and frames
    that do not exist.
    """
    findings: list[Problem] = []
    if not workspace.skills and not workspace.recordings:
        message, mend = "the workspace has no skills, so nothing can be done in it", "name their folders under `skills`"
        place = workspace.places.get("skills", workspace.whole_file)
        findings.append(Problem("no-skills", message, place, severity="warning", mend=mend))
    for skill in workspace.skills.values():
        for check in (seen_by_targets, contradictions, faults_of_the_plan, formulas_against_the_action):
            findings += check(skill)
        findings += boxes_of_targets(workspace, skill)
        for name in (parameter.name for parameter in skill.motion_parameters if not parameter.kinds):
            message = f"skill `{skill.name}`: no waypoint or primitive action uses the parameter `{name}`"
            mend, at = f"write `${name}` where it is meant, or remove it", skill.places.get(f"motion.{name}")
            findings.append(Problem("unused-parameter", message, at, severity="warning", mend=mend))
    of_cells = (_held_against_the_facts, *cameras.CHECKS, colors, overlapping_objects, floating_objects)
    return (*findings, *(problem for check in of_cells for problem in check(workspace)))


def _held_against_the_facts(workspace: Workspace) -> Iterator[Problem]:
    """Facts that only a grasp makes true, about an object that is not in the tool; and vice versa."""
    grasps = holding_skills(workspace.skills.values(), workspace.objects)
    stated = {fact.arguments[0]: fact for fact in sorted(workspace.state, key=str) if fact.predicate in grasps}
    for name, item in workspace.objects.items():
        place = workspace.places.get(f"objects.{name}.pose")
        if name in stated and item.X_TO is None:
            message = f"the state has `{stated[name]}`, but by its pose `{name}` is not in the tool"
            mend = "write `pose: {held: +z}` (the side by which it is held), or remove the fact"
            yield Problem("held-against-the-facts", message, place, mend=mend)
        if name not in stated and item.X_TO is not None and grasps:
            facts = " or ".join(f"`{predicate}({name})`" for predicate in sorted(grasps))
            message = f"by its pose `{name}` is in the tool, but the state does not say {facts}"
            yield Problem("held-against-the-facts", message, place, mend="add it to the state")


def seen_by_targets(skill: Skill) -> Iterator[Problem]:
    """Predicates of formulas that no target decides, and boxes of fault literals that move with an object once lost."""
    named = [
        (found, part.name)
        for found in skill.requirements
        for part in nested(found.formula)
        if isinstance(part, Predicate)
    ]
    first_use = dict(reversed([(name, found.place) for found, name in named if name not in skill.targets]))
    for predicate, place in reversed(first_use.items()):
        message = f"skill `{skill.name}`: `{predicate}` is in a formula, but no target says where it can be seen"
        mend = f"add `{predicate}:` with its boxes under `targets`"
        yield Problem("literal-without-target", message, place, mend=mend)
    grasped = {primitive.object for primitive in skill.primitives if isinstance(primitive, Grasp)}
    reported: set[tuple[str, str]] = set()
    for fault in (requirement for requirement in skill.requirements if requirement.name is not None):
        predicates = {name for found, name in named if found is fault}
        for predicate, index, box in _boxes(skill):
            if predicate not in predicates or box.frame not in grasped or (predicate, box.name) in reported:
                continue
            reported.add((predicate, box.name))
            message = (
                f"skill `{skill.name}`: fault `{fault.name}` is seen by box `{box.name}` of `{predicate}`, "
                f"which moves with `{box.frame}`; once that is lost, the box is where it fell"
            )
            mend = f"give the box a frame that stays: `tool`, or `{box.frame}{AT_START}`"
            place = skill.place("targets", predicate, "boxes", index, "name")
            yield Problem("box-moves-with-lost-object", message, place, mend=mend)


def boxes_of_targets(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Targets that need more cameras at once than there are; boxes that are empty, or too small from anywhere."""
    available = len(workspace.cameras)
    for predicate, target in skill.targets.items():
        if target.cameras > available:
            wanted = f"{target.cameras} camera{'s' if target.cameras > 1 else ''}"
            message = f"skill `{skill.name}`: `{predicate}` needs {wanted}, the cell has {available}"
            place = skill.place("targets", predicate, "cameras")
            yield Problem("too-few-cameras", message, place, mend="add cameras, or lower `cameras` of the target")
    possible = [(*one, _possible_objects(workspace, skill, one[2])) for one in _boxes(skill)]
    for predicate, index, box, objects in possible:
        item = min(filter(None, objects), key=lambda item: min(item.size), default=None)
        if item is not None and box.size is None and min(item.size) + 2 * box.margin <= 0:
            message = (
                f"skill `{skill.name}`: with a margin of {box.margin:g} m nothing is left of box `{box.name}` around "
                f"`{item.name}`, which is {min(item.size):g} m thin"
            )
            place = skill.place("targets", predicate, "boxes", index, "margin")
            mend = "the margin enlarges a box on every side; raise it to 0 m"
            yield Problem("empty-box", message, place, mend=mend)
    for predicate, index, box, objects in possible:
        needed = workspace.detectors[box.detector].min_pixels
        looks = list(product(workspace.cameras.values(), objects))
        # Mostly one of the first is large enough, and then the others do not matter.
        if looks and all(_largest_in_image(workspace, box, *look) < needed for look in looks):
            largest = max(_largest_in_image(workspace, box, *look) for look in looks)
            message = (
                f"skill `{skill.name}`: box `{box.name}` of `{predicate}` measures at most {largest:.1f} "
                f"pixels in any camera, detector `{box.detector}` needs {needed:g}"
            )
            mend = "use a larger box or marker, a nearer camera or a longer lens"
            place = skill.place("targets", predicate, "boxes", index, "name")
            yield Problem("too-small-for-every-camera", message, place, mend=mend)


def without_hue(workspace: Workspace) -> dict[str | None, list[str]]:
    """Objects that a detector of colours looks for in vain, by their colour."""
    found: dict[str | None, list[str]] = {}
    for item in _sought_by_color(workspace):
        if (item.color is None or hue_of(item.color) is None) and not item.fixed:
            found.setdefault(item.color, []).append(item.name)
    return found


def assumptions(workspace: Workspace, named: Collection[str], cameras: Collection[Camera] | None = None) -> str:
    """What figures assume of detectors and cameras (else the workspace's), in words. named: objects that count."""
    unseen = [name for names in without_hue(workspace).values() for name in names if name in named]
    seen = [f"a detector is assumed that sees {first_names(unseen)}, whose colour none here sees"] if unseen else []
    return "; ".join(filter(None, (*seen, assumed_latency(workspace.cameras.values() if cameras is None else cameras))))


def _sought_by_color(workspace: Workspace) -> list[SceneObject]:
    """Objects that a detector of colours looks for."""
    sought = {
        item.name: item
        for skill in workspace.skills.values()
        for _, _, box in _boxes(skill)
        if workspace.detectors[box.detector].kind == "color"
        for item in _possible_objects(workspace, skill, box)
        if item is not None
    }
    return [*sought.values()]


def colors(workspace: Workspace) -> Iterator[Problem]:
    """Objects that a detector of colours looks for, and cannot see or cannot tell from what they stand on."""
    alike, unseen = dict[str, list[str]](), without_hue(workspace)
    for item in _sought_by_color(workspace):
        support = workspace.objects.get(item.on or "")
        sought = item.name not in unseen.get(item.color, ())
        if sought and support is not None and look_alike(item.color, support.color):
            alike.setdefault(support.name, []).append(item.name)
    for color, parts in unseen.items():
        who, place = f"detectors of colours look for {first_names(parts)}", f"objects.{parts[0]}"
        if color is None:
            message = f"{who}, and see nothing without a colour"
        else:
            known = expected_names(color, [name for name in COLORS if hue_of(name) is not None])
            why = ", which has no hue" if color.lower() in COLORS else f"; {known}"
            message = f"no detector of colours sees `{color}`, the colour of {first_names(parts)}{why}"
            place = f"{place}.color"
        mend = "give it a colour with a hue, or look for markers"
        yield warning("unseen-colour", message, workspace, place, mend)
    for name, parts in alike.items():
        what = f"{first_names(parts)} from `{name}` below, which has the same colour"
        mend = "give one of them another colour, or look for markers"
        message = f"detectors of colours cannot tell {what}"
        yield warning("same-colour", message, workspace, f"objects.{name}.color", mend)


def _boxes(skill: Skill) -> Iterator[tuple[str, int, BoxSpec]]:
    """The boxes of all targets, each with its predicate and its number in the target."""
    for predicate, target in skill.targets.items():
        yield from ((predicate, index, box) for index, box in enumerate(target.boxes))


def _possible_objects(workspace: Workspace, skill: Skill, box: BoxSpec) -> list[SceneObject | None]:
    """The objects that a box may belong to; [None] for a box in a frame without an object."""
    name = box.fits or box.frame.removesuffix(AT_START)
    if name in workspace.objects:
        return [workspace.objects[name]]
    parameter = next((parameter for parameter in skill.action.parameters if parameter.name == name), None)
    if parameter is None:
        return [None]
    return [item for item in workspace.objects.values() if skill.domain.fits(item.types, parameter.type)]


def _largest_in_image(workspace: Workspace, box: BoxSpec, camera: Camera, item: SceneObject | None) -> float:
    """An upper bound of a box's size in an image [pixels]: square root of its area.

    The largest silhouette of a box has the norm of its three face areas as area; at distance r, perspective enlarges it
    by at most (f / (r - half a diagonal))^2 / cos^3 of the angle to the optical axis, widest at the image's corners.
    """
    enlarged = np.add(item.size, 2 * box.margin) if item is not None else (0.0, 0.0, 0.0)
    size = np.asarray(box.size if box.size is not None else enlarged)
    distance = workspace.detectors[box.detector].distance[0]
    X_WF = np.eye(4) if box.frame == WORLD else None
    if item is not None and (box.frame.endswith(AT_START) or item.fixed) and X_WF is None:
        X_WF = item.X_WO
    if camera.frame == WORLD and X_WF is not None:  # both are fixed, at a known distance
        distance = max(distance, float(np.linalg.norm((X_WF @ box.X_FB)[:3, 3] - camera.X_FC[:3, 3])))
    nearest = max(distance - 0.5 * float(np.linalg.norm(size)), camera.near)
    area = float(np.linalg.norm([size[1] * size[2], size[0] * size[2], size[0] * size[1]]))
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    tangent = np.hypot(
        max(camera.matrix[0, 2], camera.width - camera.matrix[0, 2]) / fx,
        max(camera.matrix[1, 2], camera.height - camera.matrix[1, 2]) / fy,
    )
    stretch = (1.0 + tangent**2) ** 0.75
    return float(np.sqrt(fx * fy * area) / nearest * stretch)
