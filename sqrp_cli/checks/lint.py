"""Findings in a workspace that is readable but cannot work as intended: all of them, and those in boxes of targets.

These are too small to be seen, empty, moving with a lost object, or missing.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np

from sqrp_cli.checks import cameras, formulas
from sqrp_cli.checks.placement import floating_objects, overlapping_objects
from sqrp_cli.errors import Problem, expected_names, first_names
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.frames import WORLD, FrameName
from sqrp_cli.knowledge.paint import COLORS, hue_of, look_alike
from sqrp_cli.knowledge.scene import SceneObject
from sqrp_cli.knowledge.skill.skill import Grasp, Skill
from sqrp_cli.knowledge.skill.target_box import BoxSpec
from sqrp_cli.knowledge.workspace.held import holding_skills
from sqrp_cli.knowledge.workspace.workspace import Workspace


def lint(workspace: Workspace) -> tuple[Problem, ...]:
    """All findings, those of the skills first, then those of cameras and objects.

    `checks/findings.yaml` explains each. The reader already refuses intervals that end before they start and frames
    that do not exist.
    """
    findings: list[Problem] = list(_without_skills(workspace))
    for skill in workspace.skills.values():
        findings += without_target(skill)
        findings += fault_boxes_that_move(skill)
        findings += formulas.contradictions(skill)
        findings += formulas.faults_of_the_plan(skill)
        findings += formulas.impossible_preconditions(skill)
        findings += formulas.formulas_against_the_action(skill)
        findings += too_few_cameras(workspace, skill)
        findings += empty_boxes(workspace, skill)
        findings += too_small_boxes(workspace, skill)
        findings += _unused_parameters(skill)
    findings += _held_against_the_facts(workspace)
    findings += cameras.assumed_latencies(workspace)
    findings += cameras.thresholds_out_of_reach(workspace)
    findings += cameras.detectors_out_of_range(workspace)
    findings += cameras.doubtful_images(workspace)
    findings += cameras.implausible_lenses(workspace)
    findings += cameras.blind_cameras(workspace)
    findings += colors(workspace)
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


def without_target(skill: Skill) -> Iterator[Problem]:
    """Predicates of formulas that no camera can decide, because they have no target."""
    reported: set[str] = set()
    for requirement in skill.requirements:
        for predicate in formulas.predicates_of(requirement.formula):
            if predicate in skill.targets or predicate in reported:
                continue
            reported.add(predicate)
            message = f"skill `{skill.name}`: `{predicate}` is in a formula, but no target says where it can be seen"
            mend = f"add `{predicate}:` with its boxes under `targets`"
            yield Problem("literal-without-target", message, requirement.place, mend=mend)


def too_few_cameras(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Targets that need more cameras at once than there are."""
    available = len(workspace.cameras)
    for predicate, target in skill.targets.items():
        if target.cameras > available:
            wanted = f"{target.cameras} camera{'s' if target.cameras > 1 else ''}"
            message = f"skill `{skill.name}`: `{predicate}` needs {wanted}, the cell has {available}"
            place = skill.place("targets", predicate, "cameras")
            yield Problem("too-few-cameras", message, place, mend="add cameras, or lower `cameras` of the target")


def too_small_boxes(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Boxes that no camera sees as large as their detector needs, even from the nearest possible place."""
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            detector = workspace.detectors[box.detector]
            looks = list(product(workspace.cameras.values(), _possible_objects(workspace, skill, box)))
            # Mostly one of the first is large enough, and then the others do not matter.
            if looks and all(_largest_in_image(workspace, box, *look) < detector.min_pixels for look in looks):
                largest = max(_largest_in_image(workspace, box, *look) for look in looks)
                message = (
                    f"skill `{skill.name}`: box `{box.name}` of `{predicate}` measures at most {largest:.1f} "
                    f"pixels in any camera, detector `{box.detector}` needs {detector.min_pixels:g}"
                )
                mend = "use a larger box or marker, a nearer camera or a longer lens"
                place = skill.place("targets", predicate, "boxes", index, "name")
                yield Problem("too-small-for-every-camera", message, place, mend=mend)


def colors(workspace: Workspace) -> Iterator[Problem]:
    """Objects that a detector of colours looks for, and cannot see or cannot tell from what they stand on."""
    alike, unseen = dict[str, list[str]](), dict[str | None, list[str]]()
    for item in _sought_by_color(workspace):
        support = workspace.objects.get(item.on or "")
        if (item.color is None or hue_of(item.color) is None) and not item.fixed:
            unseen.setdefault(item.color, []).append(item.name)
        elif support is not None and look_alike(item.color, support.color):
            alike.setdefault(support.name, []).append(item.name)
    for color, parts in unseen.items():
        sought, place = f"detectors of colours look for {first_names(parts)}", f"objects.{parts[0]}"
        if color is None:
            message = f"{sought}, and see nothing without a colour"
        else:
            known = expected_names(color, [name for name in COLORS if hue_of(name) is not None])
            why = ", which has no hue" if color.lower() in COLORS else f"; {known}"
            message, place = f"{sought}, and see nothing that is `{color}`{why}", f"{place}.color"
        mend = "give it a colour with a hue, or look for markers"
        yield Problem("unseen-colour", message, workspace.places.get(place), severity="warning", mend=mend)
    for name, parts in alike.items():
        what = f"{first_names(parts)} from `{name}` below, which has the same colour"
        mend = "give one of them another colour, or look for markers"
        at = workspace.places.get(f"objects.{name}.color")
        yield Problem("same-colour", f"detectors of colours cannot tell {what}", at, severity="warning", mend=mend)


def _sought_by_color(workspace: Workspace) -> Iterable[SceneObject]:
    """The objects that a detector of colours looks for, each once."""
    boxes = ((skill, box) for skill in workspace.skills.values() for one in skill.targets.values() for box in one.boxes)
    colored = (pair for pair in boxes if workspace.detectors[pair[1].detector].kind == "color")
    items = (item for skill, box in colored for item in _possible_objects(workspace, skill, box) if item is not None)
    return {item.name: item for item in items}.values()


def empty_boxes(workspace: Workspace, skill: Skill) -> Iterator[Problem]:
    """Boxes that a negative margin shrinks to nothing."""
    for predicate, target in skill.targets.items():
        for index, box in enumerate(target.boxes):
            objects = [item for item in _possible_objects(workspace, skill, box) if item is not None]
            item = min(objects, key=lambda item: min(item.size), default=None)
            if item is None or box.size is not None or min(item.size) + 2 * box.margin > 0:
                continue
            message = (
                f"skill `{skill.name}`: with a margin of {box.margin:g} m nothing is left of box `{box.name}` around "
                f"`{item.name}`, which is {min(item.size):g} m thin"
            )
            place = skill.place("targets", predicate, "boxes", index, "margin")
            yield Problem("empty-box", message, place, mend="the margin enlarges a box on every side; raise it to 0 m")


def fault_boxes_that_move(skill: Skill) -> Iterator[Problem]:
    """Boxes of fault literals that move with a grasped object, even after it is lost."""
    grasped = {primitive.object for primitive in skill.primitives if isinstance(primitive, Grasp)}
    reported: set[tuple[str, str]] = set()
    for requirement in skill.requirements:
        if requirement.name is None:
            continue
        for predicate in formulas.predicates_of(requirement.formula):
            boxes = skill.targets[predicate].boxes if predicate in skill.targets else ()
            for index, box in enumerate(boxes):
                if box.frame not in grasped or (predicate, box.name) in reported:
                    continue
                reported.add((predicate, box.name))
                message = (
                    f"skill `{skill.name}`: fault `{requirement.name}` is seen by box `{box.name}` of `{predicate}`, "
                    f"which moves with `{box.frame}`; once that is lost, the box is where it fell"
                )
                mend = f"give the box a frame that stays: `tool`, or `{FrameName.at_start_of(box.frame)}`"
                place = skill.place("targets", predicate, "boxes", index, "name")
                yield Problem("box-moves-with-lost-object", message, place, mend=mend)


def _possible_objects(workspace: Workspace, skill: Skill, box: BoxSpec) -> list[SceneObject | None]:
    """The objects that a box may belong to; [None] for a box in a frame without an object."""
    name = box.fits or box.frame.owner
    if name in workspace.objects:
        return [workspace.objects[name]]
    for parameter in skill.action.parameters:
        if parameter.name == name:
            objects = workspace.objects.values()
            return [item for item in objects if skill.domain.fits(item.types, parameter.type)]
    return [None]


def _largest_in_image(workspace: Workspace, box: BoxSpec, camera: Camera, item: SceneObject | None) -> float:
    """An upper bound of a box's size in an image [pixels]: square root of its area.

    The largest silhouette of a box has the norm of its three face areas as area; at distance r, perspective enlarges it
    by at most (f / (r - half a diagonal))^2 / cos^3 of the angle to the optical axis, widest at the image's corners.
    """
    enlarged = np.add(item.size, 2 * box.margin) if item is not None else (0.0, 0.0, 0.0)
    size = np.asarray(box.size if box.size is not None else enlarged)
    detector = workspace.detectors[box.detector]
    distance = max(detector.distance[0], _known_distance(box, camera, item))
    nearest = max(distance - 0.5 * float(np.linalg.norm(size)), camera.near)
    area = float(np.linalg.norm([size[1] * size[2], size[0] * size[2], size[0] * size[1]]))
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    tangent = np.hypot(
        max(camera.matrix[0, 2], camera.width - camera.matrix[0, 2]) / fx,
        max(camera.matrix[1, 2], camera.height - camera.matrix[1, 2]) / fy,
    )
    stretch = (1.0 + tangent**2) ** 0.75
    return float(np.sqrt(fx * fy * area) / nearest * stretch)


def _known_distance(box: BoxSpec, camera: Camera, item: SceneObject | None) -> float:
    """Distance from camera to box where both are fixed [m], else 0."""
    if camera.frame != WORLD:
        return 0.0
    if box.frame == WORLD:
        X_WF = np.eye(4)
    elif item is not None and item.X_WO is not None and (box.frame.at_start or item.fixed):
        X_WF = item.X_WO
    else:
        return 0.0
    return float(np.linalg.norm((X_WF @ box.X_FB)[:3, 3] - camera.X_FC[:3, 3]))
