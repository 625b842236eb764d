"""Consistency between the fields of a program: times add up, motion does not jump."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.program.record import Program, ProgramTarget, Spans, Step
from sqrp_cli.trajectory import Trajectory

SAME_TIME = 1e-6  # tolerance of times [s]

LARGEST_JUMPS = (1e-6, 1e-4, 1e-2)
"""Largest jumps of a joint's position, velocity and acceleration [rad or m, and per s, and per s^2]."""

LARGEST_SKEW = 1e-6  # largest deviation of the axes of a pose from unit length and right angles

Keys = tuple[str | int, ...]


class Flaw(NamedTuple):
    """A contradiction in a program; at: the keys from the top of the file to its place."""

    code: str
    at: Keys
    message: str


def flaws(program: Program) -> Iterator[Flaw]:
    """The contradictions of a program in itself, in the order of its steps."""
    joints = program.joints
    if not joints or len(set(joints)) < len(joints):
        yield Flaw("program-joints", ("joints",), "expected the name of every joint that moves, each once")
        return
    for number, step in enumerate(program.steps):
        at: Keys = ("steps", number)
        motion = list(_motion_flaws(step, at, len(joints)))
        found = [*_world_flaws(step.before, (*at, "before"), joints), *_world_flaws(step.after, (*at, "after"), joints)]
        found += motion
        if not motion and set(joints) == set(step.before.joints) == set(step.after.joints):
            with np.errstate(over="ignore", invalid="ignore"):
                found += _jumps(step, at, joints)
        found += _held_flaws(step, at)
        for atom, target in step.targets.items():
            inside = (*at, "targets", atom)
            for index, box in enumerate(target.boxes):
                found += _pose_flaws(box.X_FB, (*inside, "boxes", index, "pose"))
            for field, camera, intervals in _sights(target):
                edges = list(chain.from_iterable(intervals))
                if any(b < a for a, b in pairwise(edges)) or (edges and edges[-1] > step.time + SAME_TIME):
                    message = f"expected times in order from 0 to {step.time:g} s"
                    found.append(Flaw("program-times", (*inside, field, camera), message))
        yield from found
        if number and not found:  # a step must start in the final world of the step before it
            left, start = (one.model_dump(by_alias=True) for one in (program.steps[number - 1], step))
            for field in left["after"]:
                if left["after"][field] != start["before"][field]:
                    message = f"differs from `steps.{number - 1}.after.{field}`, where this step should start"
                    yield Flaw("program-worlds", (*at, "before", field), message)


def flaws_in(program: Program, workspace: Workspace) -> Iterator[Flaw]:
    """Names in a program that its workspace does not have."""
    joints = workspace.stated_world.joints
    if set(program.joints) != set(joints):
        message = f"the joints that the workspace's robot moves are {', '.join(joints)}"
        yield Flaw("program-joints", ("joints",), message)
    known: dict[str, Mapping[str, object]] = {
        "skill": workspace.skills,
        "object": workspace.objects,
        "camera": workspace.cameras,
    }
    for number, step in enumerate(program.steps):
        at: Keys = ("steps", number)
        names: list[tuple[str, str, Keys]] = [("skill", step.skill, (*at, "skill"))]
        for moment, world in (("before", step.before), ("after", step.after)):
            names += [("object", name, (*at, moment, "objects", name)) for name in world.X_WO]
            names += [] if world.held is None else [("object", world.held, (*at, moment, "held"))]
        for atom, target in step.targets.items():
            names += [("camera", camera, (*at, "targets", atom, field, camera)) for field, camera, _ in _sights(target)]
        for kind, name, place in names:
            if name not in known[kind]:
                message = f"the workspace has no {kind} `{name}`; {expected_names(name, known[kind])}"
                yield Flaw(f"unknown-{kind}", place, message)


def _sights(target: ProgramTarget) -> Iterator[tuple[str, str, Spans]]:
    """When cameras see a target, with the field that says so and the camera."""
    for field in ("seen", "usual", "refuted"):
        yield from ((field, camera, spans) for camera, spans in getattr(target, field).items())


def _held_flaws(step: Step, at: Keys) -> Iterator[Flaw]:
    """Only `Grasp` and `Release` change what the tool holds, at their end."""

    def named(held: str | None) -> str:
        return "nothing" if held is None else f"`{held}`"

    held = step.before.held
    for index, (primitive, then) in enumerate(zip(step.primitives, step.held_after, strict=True)):
        inside = (*at, "primitives", index, "held")
        if primitive.held is not None and primitive.held not in step.before.X_WO:
            expected = expected_names(primitive.held, step.before.X_WO)
            message = f"`{primitive.name}` holds `{primitive.held}`, which is nowhere before; {expected}"
            yield Flaw("program-object", inside, message)
            return
        if primitive.held != held:
            message = f"`{primitive.name}` holds {named(primitive.held)}, but the tool then holds {named(held)}"
            yield Flaw("program-held", inside, message)
            return
        held = then if primitive.action == "Grasp" else None if primitive.action == "Release" else held
    if step.after.held != held:
        message = f"found {named(step.after.held)}, but the tool then holds {named(held)}"
        yield Flaw("program-held", (*at, "after", "held"), message)


def _world_flaws(world: World, at: Keys, joints: Sequence[str]) -> Iterator[Flaw]:
    missing = [joint for joint in joints if joint not in world.joints]
    unknown = [joint for joint in world.joints if joint not in joints]
    if missing:
        yield Flaw("program-joints", (*at, "joints"), f"the position of joint `{missing[0]}` is missing")
    elif unknown:
        message = f"there is no joint `{unknown[0]}`; {expected_names(unknown[0], joints)}"
        yield Flaw("program-joints", (*at, "joints", unknown[0]), message)
    for name, X_WO in world.X_WO.items():
        yield from _pose_flaws(X_WO, (*at, "objects", name))
    if (world.held is None) != (world.X_TO is None):
        yield Flaw("program-held", (*at, "held"), "`held` and `held_pose` go together: both, or both `null`")
    if world.X_TO is not None:
        yield from _pose_flaws(world.X_TO, (*at, "held_pose"))


def _pose_flaws(X: Array, at: Keys) -> Iterator[Flaw]:
    R = X[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = np.abs(R @ R.T - np.eye(3)).max() < LARGEST_SKEW and np.linalg.det(R) > 0
    if not rigid or not np.array_equal(X[3], [0, 0, 0, 1]):
        yield Flaw("program-pose", at, "this is no pose: expected a rotation and a position over the row 0, 0, 0, 1")


def _motion_flaws(step: Step, at: Keys, count: int) -> Iterator[Flaw]:
    """Primitives must follow each other from 0 to the step's time, each as long as its trajectory of all joints."""
    if not step.primitives:
        yield Flaw("program-times", (*at, "primitives"), "expected at least one primitive action")
    now = 0.0
    for index, primitive in enumerate(step.primitives):
        inside, name = (*at, "primitives", index), f"`{primitive.name}`"
        path, law = primitive.trajectory.path, primitive.trajectory.law
        if abs(primitive.start - now) > SAME_TIME:
            message = f"{name} starts at {primitive.start:g} s, expected {now:g} s"
            yield Flaw("program-times", (*inside, "start"), message)
        duration, moving, now = primitive.end - primitive.start, law.breaks[-1], primitive.end
        if duration < 0:
            yield Flaw("program-times", (*inside, "end"), f"{name} ends before it starts")
        elif abs(moving - duration) > SAME_TIME:
            message = f"{name} lasts {duration:g} s, but its trajectory {moving:g} s"
            yield Flaw("program-times", (*inside, "end"), message)
        if (found := len(path.coefficients[0][0])) != count:
            message = f"the trajectory of {name} moves {found} joints, expected {count}"
            yield Flaw("program-joints", (*inside, "trajectory", "path", "coefficients"), message)
        if path.breaks[0] != 0 or path.breaks[-1] != 1:
            message = "expected breaks that rise from 0 to 1"
            yield Flaw("program-motion", (*inside, "trajectory", "path", "breaks"), message)
        if law.breaks[0] != 0:
            message = "expected breaks that rise from 0"
            yield Flaw("program-motion", (*inside, "trajectory", "law", "breaks"), message)
    if step.primitives and abs(now - step.time) > SAME_TIME:
        message = f"found {step.time:g} s, but the last primitive action ends at {now:g} s"
        yield Flaw("program-times", (*at, "time"), message)


def _jumps(step: Step, at: Keys, joints: Sequence[str]) -> Iterator[Flaw]:
    """Jumps of position, velocity or acceleration: inside primitives, the first of each, between them, at both ends."""
    rest, kinds = np.zeros(len(joints)), ("position", "velocity", "acceleration")

    def moving(trajectory: Trajectory, t: float) -> list[Array]:
        return [values[0] for values in trajectory.motion([t], 2)]

    def jump(before: Sequence[Array], after: Sequence[Array], at: Keys, where: str) -> Iterator[Flaw]:
        """The first of the three that jumps, with the joint that jumps most."""
        for kind, most, left, right in zip(kinds, LARGEST_JUMPS, before, after, strict=True):
            jumps = np.abs(right - left)
            if not jumps.max() <= most:  # NaN counts as a jump, too
                joint = joints[int(jumps.argmax())]
                yield Flaw("program-jump", at, f"the {kind} of `{joint}` jumps by {jumps.max():.3g} {where}")
                return

    last = [np.array([step.before.joints[joint] for joint in joints]), rest, rest]
    for index, primitive in enumerate(step.primitives):
        inside, trajectory = (*at, "primitives", index, "trajectory"), primitive.trajectory
        yield from jump(last, moving(trajectory, 0.0), inside, f"where `{primitive.name}` begins")
        path_seams = map(trajectory.law.time_at, trajectory.path.breaks[1:-1])
        for t in sorted([*trajectory.law.breaks[1:-1].tolist(), *path_seams]):
            where = f"in `{primitive.name}` at {primitive.start + t:.3f} s"
            found = list(jump(moving(trajectory, np.nextafter(t, 0.0)), moving(trajectory, t), inside, where))
            yield from found
            if found:
                break
        last = moving(trajectory, trajectory.duration)
    final = [np.array([step.after.joints[joint] for joint in joints]), rest, rest]
    yield from jump(last, final, (*at, "after", "joints"), "between the end of the motion and `after`")
