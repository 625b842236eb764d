"""Skill grounding: formulas with times and objects, and targets with boxes in frames of the cell."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Container, Mapping, Sequence
from dataclasses import replace
from string import ascii_lowercase

import numpy as np

from sqrp_cli.cell.recordings import EPISODE, HOLD, USUAL_DETECTORS
from sqrp_cli.cell.workspace import World
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.frames import AT_START, TOOL, frame_poses, link_called
from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.logic.domain import nested
from sqrp_cli.logic.formula import Formula, Operation, Predicate, argument_lists, bind
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators, timed_operators
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.waypoints import WaypointGrounder
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.robot import Robot
from sqrp_cli.sight.targets import SoughtBox, Target
from sqrp_cli.skill.target_box import BoxSpec
from sqrp_cli.task.task import Candidate

SAME_GRASP = 1e-6  # Poses of an object in the tool that differ by less, in each number, are one


def ground_formulas(candidate: Candidate, motion: Motion) -> tuple[GroundOperator, ...]:
    """One entry per temporal operator of the candidate's formulas, in the order of its skill's requirements.

    In a recorded motion a formula counts for each grasp that has the phases that it names, and what it says is held.
    """
    lists, recorded = argument_lists(candidate.skill.action), candidate.skill.recorded is not None
    rounds: dict[str, tuple[dict[str, tuple[float, float]], set[str]]] = {}  # phases of a grasp, and what it holds
    for one in motion.primitives:
        number = one.name.lstrip(ascii_lowercase) if recorded else ""
        known, taken = rounds.setdefault(number, ({EPISODE: (0.0, motion.time)} if recorded else {}, set()))
        known[one.name.removesuffix(number)] = one.start, one.end
        taken.update([one.held] if one.held is not None else ())
    everything = set[str]().union(*(taken for _, taken in rounds.values()))
    otherwise = _held_otherwise(motion) if recorded else {}
    found = list[GroundOperator]()
    for requirement in candidate.skill.requirements:
        formula = bind(requirement.formula, candidate.binding, lists)
        # The primitive actions that its intervals name.
        intervals = [part.interval for part in nested(requirement.formula) if part.interval is not None]
        ends = [end for interval in intervals for end in (interval.start, interval.end)]
        named = {end.primitive for end in ends if end.primitive}
        atoms = (part.atom for part in nested(formula) if isinstance(part, Predicate))
        asked = {one for atom in atoms if atom.predicate == HOLD for one in atom.arguments}
        for number, (known, taken) in rounds.items():
            of_it = everything if named <= {EPISODE} else taken
            if not recorded or (named <= known.keys() and asked <= of_it):
                held = () if named <= {EPISODE} else otherwise.get(number, ())
                own, fault = _about_grasp(formula, number, held) if held else formula, requirement.name
                if own != formula and fault is not None:
                    fault += number  # images show it otherwise, so it is another one
                found += ground_operators(own, known, motion.time, fault)
    return tuple(dict.fromkeys(found)) if recorded else tuple(found)


def _held_otherwise(motion: Motion) -> Mapping[str, Mapping[str, Array]]:
    """X_TO of objects in grasps that hold them elsewhere than their first one, by its number in names of phases."""
    first, found = dict[str, Array](), defaultdict[str, dict[str, Array]](dict)
    for one in motion.primitives:
        if one.held is None or one.X_TO is None:
            continue
        if not np.allclose(first.setdefault(one.held, one.X_TO), one.X_TO, rtol=0.0, atol=SAME_GRASP):
            found[one.name.lstrip(ascii_lowercase)][one.held] = one.X_TO
    return found


def _about_grasp(formula: Formula, number: str, held: Container[str]) -> Formula:
    """A formula of a grasp, in which `hold2(cube)` is that it is where the second one holds it; held: those objects."""
    if isinstance(formula, Operation):
        return replace(formula, parts=tuple(_about_grasp(part, number, held) for part in formula.parts))
    otherwise = formula.name == HOLD and formula.atom.arguments[0] in held
    return replace(formula, name=f"{HOLD}{number}") if otherwise else formula


def formulas_outside(candidate: Candidate, motion: Motion) -> tuple[tuple[int, int], ...]:
    """The temporal operators of the candidate's formulas with an interval outside the motion.

    Each as the index of its requirement and its index among the temporal operators of that, outer before inner.
    """
    if candidate.skill.recorded is not None:
        return ()
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in motion.primitives}
    return tuple(
        (index, number)
        for index, requirement in enumerate(candidate.skill.requirements)
        for number, (_, when) in enumerate(timed_operators(requirement.formula, spans, motion.time))
        if when is None
    )


def on_robot(robot: Robot, model: RobotModel, frame: str, X_FB: Array) -> tuple[str, Array]:
    """The same pose in the robot link that carries the tool, if `frame` is a fixed link of the tool.

    So readers of the output need only the robot's URDF, and that of the tool only for its fingers.
    """
    if robot.tool is None or frame not in model.tool_links or frame in model.fingers.links:
        return frame, X_FB
    X_WL = model.home_links
    return robot.tool.link, inverse(X_WL[robot.tool.link]) @ X_WL[frame] @ X_FB


def ground_targets(
    cell: Cell, candidate: Candidate, world: World, motion: Motion, formulas: Sequence[GroundOperator]
) -> tuple[Target, ...]:
    """The targets of every atom in formulas of a candidate with its motion, in order of first appearance.

    world: that in which its skill begins.
    """
    skill, lists, objects = candidate.skill, argument_lists(candidate.skill.action), cell.workspace.objects
    # An object that the motion does not hold is held as a grasp at the waypoint in question would hold it.
    held = {p.held: p.X_TO for p in reversed(motion.primitives) if p.held is not None and p.X_TO is not None}
    otherwise = _held_otherwise(motion)
    found: list[Target] = []
    for atom in dict.fromkeys(literal.atom for formula in formulas for literal in formula.literals):
        known, number = (atom.predicate, "") if atom.predicate in skill.targets else (HOLD, atom.predicate[len(HOLD) :])
        spec = skill.targets[known]
        binding = {**candidate.binding, **dict(zip(lists[known][0], atom.arguments, strict=True))}
        waypoints = WaypointGrounder(
            waypoints=skill.waypoints,
            binding=binding,
            values=candidate.values,
            objects=objects,
            X_WH=cell.model.tool_pose(cell.model.home),
            X_WO=world.X_WO,
            X_TO=held | dict(otherwise[number]) if number else held,
        )
        boxes = (_box(cell, box, waypoints).with_color(str(atom), objects) for box in spec.boxes)
        found.append(Target(atom, spec.cameras, tuple(boxes)))
    return tuple(found)


def _box(cell: Cell, spec: BoxSpec, waypoints: WaypointGrounder) -> SoughtBox:
    """A box of a target about the objects of a binding."""
    model, binding, X_WO = cell.model, waypoints.binding, waypoints.X_WO
    name = model.tool_frame if spec.frame == TOOL else spec.frame.removesuffix(AT_START)
    owner = binding.get(name, name)
    frame: str = f"{owner}{AT_START}" if spec.frame.endswith(AT_START) else owner
    size, X_FB = spec.size, spec.X_FB
    if spec.fits is not None:
        fitted = binding.get(spec.fits, spec.fits)
        width, depth, height = cell.workspace.objects[fitted].size
        size = (width + 2 * spec.margin, depth + 2 * spec.margin, height + 2 * spec.margin)
        if spec.at is not None and frame == model.tool_frame and fitted in waypoints.X_TO:
            X_FB = waypoints.X_TO[fitted] @ X_FB
        elif spec.at is not None:
            X_WT = waypoints.pose(spec.at)
            X_TO = waypoints.X_TO[fitted] if fitted in waypoints.X_TO else inverse(X_WT) @ X_WO[fitted]
            X_FT = pose() if frame == model.tool_frame else inverse(frame_poses({}, X_WO, X_WO)[frame]) @ X_WT
            X_FB = X_FT @ X_TO @ X_FB
    if size is None:
        raise ValueError(f"box {spec.name} has neither a size nor something that it fits")
    enclosed = {owner} & cell.workspace.objects.keys()
    if spec.encloses is not None:
        enclosed = {link_called(binding.get(n, n), model.links) for n in spec.encloses if n != TOOL}
        parts = model.parts if TOOL in spec.encloses else ()
        enclosed |= {part.name for part in parts if part.parent in model.hand_links}
    frame, X_FB = on_robot(cell.workspace.robot, model, frame, X_FB)
    return from_fields(
        SoughtBox,
        spec,
        limits={**USUAL_DETECTORS, **cell.workspace.detectors}[spec.detector],
        frame=frame,
        size=size,
        X_FB=X_FB,
        encloses=tuple(sorted(enclosed)),
    )
