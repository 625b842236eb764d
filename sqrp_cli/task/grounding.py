"""Skill grounding: formulas with times and objects, and targets with boxes in frames of the cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from sqrp_cli.camera.detector import Detector
from sqrp_cli.cell.scene import SceneObject
from sqrp_cli.cell.workspace import World
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.frames import TOOL, FrameName, frame_poses, link_called
from sqrp_cli.geometry import Array, inverse
from sqrp_cli.logic.formula import Formula, argument_lists, bind
from sqrp_cli.logic.formula_time import GroundOperator, ground_operators, timed_operators
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.waypoints import WaypointGrounder
from sqrp_cli.records import dataclass
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.robot import Robot
from sqrp_cli.sight.targets import SoughtBox, Target
from sqrp_cli.skill.target_box import BoxSpec
from sqrp_cli.task.task import Candidate


def bound_formulas(candidate: Candidate) -> tuple[Formula, ...]:
    """The formulas of the candidate's skill about its objects, in the order of the skill's requirements."""
    lists = argument_lists(candidate.skill.action)
    return tuple(bind(requirement.formula, candidate.binding, lists) for requirement in candidate.skill.requirements)


def ground_formulas(
    candidate: Candidate, spans: Mapping[str, tuple[float, float]], total: float
) -> tuple[GroundOperator, ...]:
    """One entry per temporal operator of the candidate's formulas.

    spans: start and end of each primitive by name [s]; total: duration of the motion [s].
    """
    return tuple(
        operator
        for requirement, formula in zip(candidate.skill.requirements, bound_formulas(candidate), strict=True)
        for operator in ground_operators(formula, spans, total, requirement.name)
    )


def formulas_outside(candidate: Candidate, motion: Motion) -> tuple[tuple[int, int], ...]:
    """The temporal operators of the candidate's formulas with an interval outside the motion.

    Each as the index of its requirement and its index among the temporal operators of that, outer before inner.
    """
    spans = {primitive.name: (primitive.start, primitive.end) for primitive in motion.primitives}
    return tuple(
        (index, number)
        for index, requirement in enumerate(candidate.skill.requirements)
        for number, (_, when) in enumerate(timed_operators(requirement.formula, spans, motion.time))
        if when is None
    )


class FramePose(NamedTuple):
    """A pose with its frame."""

    frame: str
    X_FB: Array
    """Shape (4, 4)."""


def on_robot(robot: Robot, model: RobotModel, frame: str, X_FB: Array) -> FramePose:
    """The same pose in the robot link that carries the tool, if `frame` is a fixed link of the tool.

    So readers of the output need only the robot's URDF, and that of the tool only for its fingers.
    """
    if robot.tool is None or frame not in model.tool_links or frame in model.fingers.links:
        return FramePose(frame, X_FB)
    X_WL = model.home_links
    return FramePose(robot.tool.link, inverse(X_WL[robot.tool.link]) @ X_WL[frame] @ X_FB)


@dataclass(frozen=True)
class TargetGrounder:
    """Grounds the targets of one candidate with its motion, in the world at the start of its skill."""

    candidate: Candidate
    world: World
    motion: Motion
    objects: Mapping[str, SceneObject]
    detectors: Mapping[str, Detector]
    robot: Robot
    model: RobotModel

    def targets(self, formulas: Sequence[GroundOperator]) -> tuple[Target, ...]:
        """The targets of every atom in the formulas, in order of first appearance."""
        lists = argument_lists(self.candidate.skill.action)
        found: list[Target] = []
        for atom in dict.fromkeys(literal.atom for formula in formulas for literal in formula.literals):
            spec = self.candidate.skill.targets[atom.predicate]
            named = zip(lists[atom.predicate][0], atom.arguments, strict=True)
            binding = {**self.candidate.binding, **dict(named)}
            boxes = (self._box(box, binding).with_color(str(atom), self.objects) for box in spec.boxes)
            found.append(Target(atom, spec.cameras, tuple(boxes)))
        return tuple(found)

    def _box(self, spec: BoxSpec, binding: Mapping[str, str]) -> SoughtBox:
        name = self.model.tool_frame if spec.frame == TOOL else spec.frame.owner
        owner = binding.get(name, name)
        frame: str = FrameName.at_start_of(owner) if spec.frame.at_start else owner
        size, X_FB = spec.size, spec.X_FB
        if spec.fits is not None:
            fitted = binding.get(spec.fits, spec.fits)
            width, depth, height = self.objects[fitted].size
            size = (width + 2 * spec.margin, depth + 2 * spec.margin, height + 2 * spec.margin)
            if spec.at is not None:
                X_FB = self._pose_in(frame, fitted, spec.at, binding) @ X_FB
        if size is None:
            raise ValueError(f"box {spec.name} has neither a size nor something that it fits")
        enclosed = {owner} & self.objects.keys()
        if spec.encloses is not None:
            enclosed = {link_called(binding.get(n, n), self.model.links) for n in spec.encloses if n != TOOL}
            parts = self.model.parts if TOOL in spec.encloses else ()
            enclosed |= {part.name for part in parts if part.parent in self.model.hand_links}
        frame, X_FB = on_robot(self.robot, self.model, frame, X_FB)
        return from_fields(
            SoughtBox,
            spec,
            limits=self.detectors[spec.detector],
            frame=FrameName(frame),
            size=size,
            X_FB=X_FB,
            encloses=tuple(sorted(enclosed)),
        )

    def _pose_in(self, frame: str, name: str, waypoint: str, binding: Mapping[str, str]) -> Array:
        """Pose X_FO, in a frame, of an object that is held at a waypoint.

        It is held as in the motion or, if the motion does not hold it, as a grasp at that waypoint would hold it.
        """
        held = {p.held: p.X_TO for p in self.motion.primitives if p.held is not None and p.X_TO is not None}
        if frame == self.model.tool_frame and name in held:
            return held[name]
        X_WO = self.world.X_WO
        waypoints = WaypointGrounder(
            waypoints=self.candidate.skill.waypoints,
            binding=binding,
            values=self.candidate.values,
            objects=self.objects,
            X_WH=self.model.tool_pose(self.model.home),
            X_WO=X_WO,
            X_TO=held,
        )
        X_WT = waypoints.pose(waypoint)
        X_TO = held[name] if name in held else inverse(X_WT) @ X_WO[name]
        if frame == self.model.tool_frame:
            return X_TO
        return inverse(frame_poses({}, X_WO, X_WO)[frame]) @ X_WT @ X_TO
