"""Consistency between the fields of a program: times add up, motion does not jump."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, pairwise

import numpy as np

from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.errors import expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.program.record import Program, ProgramTarget, Spans, Step

SAME_TIME = 1e-6  # tolerance of times [s]
LARGEST_JUMPS = (1e-6, 1e-4, 1e-2)
"""Largest jumps of a joint's position, velocity and acceleration [rad or m, and per s, and per s^2]."""
LARGEST_SKEW = 1e-6  # largest deviation of the axes of a pose from unit length and right angles
Keys = tuple[str | int, ...]
Flaw = tuple[str, Keys, str]
"""A contradiction in a program: its code, the keys from the top of the file to its place, and the message."""


def flaws(program: Program) -> Iterator[Flaw]:
    """The contradictions of a program in itself, in the order of its steps."""
    joints = program.joints
    if not joints or len(set(joints)) < len(joints):
        yield "program-joints", ("joints",), "expected the name of every joint that moves, each once"
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
                    found.append(("program-times", (*inside, field, camera), message))
        yield from found
        if number and not found:  # a step must start in the final world of the step before it
            left, start = (one.model_dump(by_alias=True) for one in (program.steps[number - 1], step))
            for field in left["after"]:
                if left["after"][field] != start["before"][field]:
                    message = f"differs from `steps.{number - 1}.after.{field}`, where this step should start"
                    yield "program-worlds", (*at, "before", field), message


def flaws_in(program: Program, workspace: Workspace) -> Iterator[Flaw]:
    """Names in a program that its workspace does not have."""
    joints = workspace.stated_world.joints
    if set(program.joints) != set(joints):
        message = f"the joints that the workspace's robot moves are {', '.join(joints)}"
        yield "program-joints", ("joints",), message
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
                yield f"unknown-{kind}", place, message


def _sights(target: ProgramTarget) -> Iterator[tuple[str, str, Spans]]:
    """When cameras see a target, with the field that says so and the camera."""
    for field in ("seen", "usual", "refuted"):
        yield from ((field, camera, spans) for camera, spans in getattr(target, field).items())


def _held_flaws(step: Step, at: Keys) -> Iterator[Flaw]:
    """Only `Grasp` and `Release` change what the tool holds, at their end."""
    held, every = step.before.held, [step.after.held, step.before.held, *(one.held for one in step.primitives)]
    named = {name: "nothing" if name is None else f"`{name}`" for name in every}
    for index, (primitive, then) in enumerate(zip(step.primitives, step.held_after, strict=True)):
        inside = (*at, "primitives", index, "held")
        if primitive.held is not None and primitive.held not in step.before.X_WO:
            expected = expected_names(primitive.held, step.before.X_WO)
            message = f"`{primitive.name}` holds `{primitive.held}`, which is nowhere before; {expected}"
            yield "program-object", inside, message
            return
        if primitive.held != held:
            message = f"`{primitive.name}` holds {named[primitive.held]}, but the tool then holds {named[held]}"
            yield "program-held", inside, message
            return
        held = then if primitive.action == "Grasp" else None if primitive.action == "Release" else held
    if step.after.held != held:
        message = f"found {named[step.after.held]}, but the tool then holds {named[held]}"
        yield "program-held", (*at, "after", "held"), message


def _world_flaws(world: World, at: Keys, joints: Sequence[str]) -> Iterator[Flaw]:
    missing = [joint for joint in joints if joint not in world.joints]
    unknown = [joint for joint in world.joints if joint not in joints]
    if missing:
        yield "program-joints", (*at, "joints"), f"the position of joint `{missing[0]}` is missing"
    elif unknown:
        message = f"there is no joint `{unknown[0]}`; {expected_names(unknown[0], joints)}"
        yield "program-joints", (*at, "joints", unknown[0]), message
    for name, X_WO in world.X_WO.items():
        yield from _pose_flaws(X_WO, (*at, "objects", name))
    if (world.held is None) != (world.X_TO is None):
        yield "program-held", (*at, "held"), "`held` and `held_pose` go together: both, or both `null`"
    if world.X_TO is not None:
        yield from _pose_flaws(world.X_TO, (*at, "held_pose"))


def _pose_flaws(X: Array, at: Keys) -> Iterator[Flaw]:
    R = X[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        rigid = np.abs(R @ R.T - np.eye(3)).max() < LARGEST_SKEW and np.linalg.det(R) > 0
    if not rigid or not np.array_equal(X[3], [0, 0, 0, 1]):
        yield "program-pose", at, "this is no pose: expected a rotation and a position over the row 0, 0, 0, 1"


def _motion_flaws(step: Step, at: Keys, count: int) -> Iterator[Flaw]:
    """Primitives must follow each other from 0 to the step's time, each as long as its trajectory of all joints."""
    if not step.primitives:
        yield "program-times", (*at, "primitives"), "expected at least one primitive action"
    now = 0.0
    for index, primitive in enumerate(step.primitives):
        inside, name = (*at, "primitives", index), f"`{primitive.name}`"
        path, law = primitive.trajectory.path, primitive.trajectory.law
        if abs(primitive.start - now) > SAME_TIME:
            message = f"{name} starts at {primitive.start:g} s, expected {now:g} s"
            yield "program-times", (*inside, "start"), message
        duration, moving, now = primitive.end - primitive.start, law.breaks[-1], primitive.end
        if duration < 0:
            yield "program-times", (*inside, "end"), f"{name} ends before it starts"
        elif abs(moving - duration) > SAME_TIME:
            message = f"{name} lasts {duration:g} s, but its trajectory {moving:g} s"
            yield "program-times", (*inside, "end"), message
        if (found := len(path.coefficients[0][0])) != count:
            message = f"the trajectory of {name} moves {found} joints, expected {count}"
            yield "program-joints", (*inside, "trajectory", "path", "coefficients"), message
        if path.breaks[0] != 0 or path.breaks[-1] != 1:
            message = "expected breaks that rise from 0 to 1"
            yield "program-motion", (*inside, "trajectory", "path", "breaks"), message
        if law.breaks[0] != 0:
            message = "expected breaks that rise from 0"
            yield "program-motion", (*inside, "trajectory", "law", "breaks"), message
    if step.primitives and abs(now - step.time) > SAME_TIME:
        message = f"found {step.time:g} s, but the last primitive action ends at {now:g} s"
        yield "program-times", (*at, "time"), message


def _jumps(step: Step, at: Keys, joints: Sequence[str]) -> Iterator[Flaw]:
    """Jumps of position, velocity or acceleration: inside primitives, the first of each, between them, at both ends."""
    rest, kinds = np.zeros(len(joints)), ("position", "velocity", "acceleration")
    first, final = (np.array([world.joints[joint] for joint in joints]) for world in (step.before, step.after))
    last: Sequence[Array] = (first, rest, rest)
    # The states on both sides of each seam, its place, and where that is in words; in one list those of which the first
    # jump is told.
    seams: list[list[tuple[Sequence[Array], Sequence[Array], Keys, str]]] = []
    for index, primitive in enumerate(step.primitives):
        inside, trajectory = (*at, "primitives", index, "trajectory"), primitive.trajectory
        path_seams = map(trajectory.law.time_at, trajectory.path.breaks[1:-1])
        times = np.array(sorted([*trajectory.law.breaks[1:-1].tolist(), *path_seams]))
        around = [0.0, *np.nextafter(times, 0.0), *times, trajectory.duration]
        start, *states, end = zip(*trajectory.motion(around, 2), strict=True)
        sides = zip(times, states[: len(times)], states[len(times) :], strict=True)
        seams.append([(last, start, inside, f"where `{primitive.name}` begins")])
        where = f"in `{primitive.name}` at"
        seams.append([(left, right, inside, f"{where} {primitive.start + t:.3f} s") for t, left, right in sides])
        last = end
    seams.append([(last, (final, rest, rest), (*at, "after", "joints"), "between the end of the motion and `after`")])
    for group in seams:
        for left, right, place, where in group:
            jumps = [np.abs(after - before) for before, after in zip(left, right, strict=True)]
            worst = next((k for k, most in enumerate(LARGEST_JUMPS) if not jumps[k].max() <= most), None)
            if worst is not None:  # NaN counts as a jump, too
                joint, by = joints[int(jumps[worst].argmax())], jumps[worst].max()
                yield "program-jump", place, f"the {kinds[worst]} of `{joint}` jumps by {by:.3g} {where}"
                break
