"""Warnings about a cell that need the shapes of robot and objects: sizes, places, speeds and contacts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import compress, product
from math import floor
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from sqrp_cli.cell.mesh import mesh_unit
from sqrp_cli.cell.read_cell import X_BODY_OPTICAL
from sqrp_cli.cell.workspace import Workspace, World
from sqrp_cli.checks.cameras import points_of, sees_any, shown_objects
from sqrp_cli.checks.placement import MIN_OVERLAP, doubted_objects, warning
from sqrp_cli.errors import Infeasible, Place, Problem, first_names
from sqrp_cli.files.frames import WORLD, frame_poses
from sqrp_cli.files.units import shown_length
from sqrp_cli.geometry import Array, axis_rotation, box_corners, inverse, pose, side_pose, transform
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.inverse_kinematics import all_solutions
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.robot.reach import Unreachable
from sqrp_cli.search.aiming import CAMERA_RADIUS, touched
from sqrp_cli.shapes import LEAST_SIZE, Box, Mesh, half_extents, shrunk
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import OBJECT_FACTOR, Solid, distance, load_solid, scale_doubt
from sqrp_cli.sight.targets import SoughtBox
from sqrp_cli.skill.settings import Reference
from sqrp_cli.skill.skill import ToolMove
from sqrp_cli.study.sampling import Adaptive, first_samples
from sqrp_cli.study.timeline import SampledMotion
from sqrp_cli.study.whole_analysis import planned_steps
from sqrp_cli.task.candidate import Candidate

LARGEST, SMALLEST = 20.0, 1e-3
"""Sizes of a link's mesh, as shares of the robot's length, from which its scale is doubted."""
ALLOWED = 1e-3  # How far a part may reach outside its object's `size` [m]; sizes are often rounded
LONGEST_BRACKET = 0.6  # How far from a link that moves a camera may be that is fixed to it [m]
MOST_LOOKED_AT = 50  # Most steps of candidates of which the whole motion is looked at
FINEST = 1e-4  # Step to which the suggested size is rounded up [m]


def cell_warnings(cell: Cell) -> tuple[Problem, ...]:
    """Warnings about a cell that need the shapes of its robot and objects; `lint` gives those that need none."""
    workspace, model, contacts = cell.workspace, cell.model, list[Problem]()
    if cell.never_touching is not None and cell.unchecked_pairs:
        names = ", ".join(f"{a}-{b}" for a, b in sorted(cell.unchecked_pairs))
        message = f"there is no SRDF, and these links touch at home or wherever the arm is: {names}; not checked"
        mend, place = "state the pairs that may touch in an SRDF, `robot.srdf`", Place(workspace.robot.urdf.path)
        contacts.append(Problem("assumed-contact", message, place, severity="warning", mend=mend))
    return (
        *doubtful_meshes(workspace, model),
        *parts_outside_size(workspace),
        *overlapping_shapes(workspace),
        *cameras_inside(workspace, model, cell.observer.solids),
        *blind_cameras_on_links(cell),
        *lamps_inside(workspace, cell.observer.solids),
        *unreachable_speeds(workspace, model),
        *contacts,
    )


def doubtful_meshes(workspace: Workspace, model: RobotModel) -> Iterator[Problem]:
    """Warnings about meshes of the robot, measured against its length, and of objects, against their `size`."""
    length = float(_lengths(model).sum())
    found: list[tuple[str, Place | None, Mesh, bool, str]] = []
    for part in model.parts:
        if isinstance(part.shape, Mesh):
            size = load_solid(part).diagonal
            if size > LARGEST * length or size < SMALLEST * length:
                measured = f"the mesh of link `{part.parent}` measures {size:.3g} m, the arm {length:.3g} m"
                found.append((measured, Place(part.shape.path), part.shape, size > length, "the <mesh> of the URDF"))
    for item in workspace.objects.values():
        for index, part in enumerate(item.parts):
            if isinstance(part.shape, Mesh):
                size = load_solid(part).diagonal
                measured = scale_doubt(load_solid(part), item)
                if not measured and size > OBJECT_FACTOR * length:  # without a stated `size`, that is the mesh's own
                    measured = f"the mesh of `{item.name}` measures {size:.3g} m, the arm {length:.3g} m"
                if measured:
                    place = workspace.places.get(f"objects.{item.name}.parts.{index}.mesh")
                    found.append((measured, place, part.shape, size > max(item.size) / 2, "this part"))
    for measured, place, shape, is_large, where in found:
        unit = mesh_unit(shape.path)
        mend = f"it counts already that the file gives its unit as {unit:g} m: see the `scale` of {where}"
        if unit == 1.0:
            mend = f"if its unit is not the metre, give {where} a `scale` of {'0.001' if is_large else '1000'}"
        message = f"{measured}; its scale may be off by 1000"
        yield Problem("doubtful-mesh-size", message, place, severity="warning", mend=mend)


def parts_outside_size(workspace: Workspace) -> Iterator[Problem]:
    """A warning about each object with parts more than 1 mm outside its box, at the place of the worst part.

    Objects with a mesh of doubtful scale are left out.
    """
    for item in workspace.objects.values():
        if not any(scale_doubt(solid, item) for solid in map(load_solid, item.parts)):
            # How far each part reaches from the object's centre along its axes; its solid would be slightly too wide.
            reached = np.array(
                [
                    np.abs(load_solid(part).vertices).max(axis=0)
                    if isinstance(part.shape, Mesh)
                    else np.abs(part.X_PG[:3, 3]) + half_extents(part.shape, part.X_PG[:3, :3])
                    for part in item.parts
                ]
            )
            outside = reached - 0.5 * np.asarray(item.size)
            if outside.max() > ALLOWED + 1e-9:
                index, axis = divmod(int(outside.argmax()), 3)
                part = item.parts[index]
                shape = type(part.shape).__name__.lower()
                reached_outside = shown_length(float(outside[index, axis]))
                message = (
                    f"part `{part.name}` of `{item.name}`, a {shape}, reaches {reached_outside} outside the "
                    f"object's `size` along {'xyz'[axis]}"
                )
                others = int((outside.max(axis=1) > ALLOWED + 1e-9).sum()) - 1
                if others:
                    message += f", and {others} other part{'s' * (others > 1)} outside it too"
                needed = FINEST * np.ceil(2 * reached.max(axis=0) / FINEST - 1e-6)
                size = ", ".join(f"{value:.5g}" for value in np.maximum(needed, item.size))
                mend = f"`size: [{size}]` would hold all parts, centred as the box is"
                mend += "; or correct the part's measures or `pose`"
                yield warning("part-outside-size", message, workspace, f"objects.{item.name}.parts.{index}", mend)


def cameras_inside(workspace: Workspace, model: RobotModel, solids: Sequence[Solid]) -> Iterator[Problem]:
    """Cameras that start inside a link or an object, which hides everything from them.

    The link that carries a camera counts like any other.
    """
    X_WO = {item.name: item.X_WO for item in workspace.objects.values() if item.X_WO is not None}
    X_WF = frame_poses(model.home_links, X_WO, {})
    for camera in workspace.cameras.values():
        eye = (X_WF[camera.frame] @ camera.X_FC)[:3, 3]
        for solid in solids:
            parent = solid.part.parent
            linted = camera.frame == WORLD and parent in workspace.objects and not isinstance(solid.part.shape, Mesh)
            if linted or parent not in X_WF or not solid.contains(transform(inverse(X_WF[parent]), eye[None])[0]):
                continue
            code, what = ("camera-inside-robot", "link ") if parent in model.links else ("camera-inside-object", "")
            message = f"camera `{camera.name}` is inside {what}`{parent}` at the start, which hides everything from it"
            mend = "correct the camera's pose"
            if parent == camera.frame:
                mend += f", whose origin is that of `{parent}`; its lens must be outside of the link's shape"
            yield warning(code, message, workspace, f"cameras.{camera.name}", mend)
            break


def blind_cameras_on_links(cell: Cell) -> Iterator[Problem]:
    """Cameras on links that see no object, and those too far from a link that moves to be fixed to it.

    A camera on a link that moves is looked through at home, and with the tool 10 cm before the top of each of the first
    ten objects, turned in steps of 90 degrees, in every branch of the arm.
    """
    workspace, model, shown = cell.workspace, cell.model, shown_objects(cell.workspace)
    home, points = {WORLD: np.eye(4), **model.home_links}, points_of(shown)
    for camera in workspace.cameras.values():
        place = f"cameras.{camera.name}"
        away, moves = float(np.linalg.norm(camera.X_FC[:3, 3])), camera.frame not in (WORLD, *model.still_links)
        whose = f"camera `{camera.name}`"
        if moves and away > LONGEST_BRACKET:
            message = f"{whose} is {away:.2f} m away from `{camera.frame}`, which carries it and moves"
            mend = "name in `frame` what its pose was measured from, such as `world` or the robot's base"
            yield warning("doubtful-parent", message, workspace, place, mend)
            continue
        if camera.frame == WORLD or not shown or sees_any(camera, home[camera.frame] @ camera.X_FC, points):
            continue
        poses = [home[camera.frame]]
        for item in shown[:10] if moves else ():
            assert item.X_WO is not None  # noqa: S101 - shown objects have a pose
            for yaw in np.radians([0, 90, 180, 270]):
                X_WT = item.X_WO @ side_pose(item.size, "+z") @ pose(axis_rotation(2, yaw), (0.0, 0.0, -0.1))
                reached = all_solutions(model, X_WT, cell.seed, 1)
                poses.extend(() if isinstance(reached, Unreachable) else model.link_poses(reached)[camera.frame])
        if (moves and len(poses) == 1) or any(sees_any(camera, X_WF @ camera.X_FC, points) for X_WF in poses):
            continue  # of an arm that reaches none of these places, home alone says nothing
        when = "at home, nor with the tool 10 cm before the top of an object" if moves else f"from `{camera.frame}`"
        message = f"{whose} sees none of the objects {when}: it looks elsewhere"
        body = camera.X_FC @ X_BODY_OPTICAL
        others = [name for name, X_WF in home.items() if sees_any(camera, X_WF @ camera.X_FC, points)]
        mend = "correct its pose, which is that of the optical frame: z forward, x right, y down"
        if not moves and sees_any(camera, poses[0] @ body, points):
            mend = "add `convention: body` to the camera: with x forward, y left, z up it sees them"
        elif others and not moves:
            mend = f"say `frame: {others[0]}` if its pose was measured from there: then it sees them"
        yield warning("camera-sees-nothing", message, workspace, place, mend)


def scenes_of(cell: Cell, world: World, candidates: Iterable[Sequence[Candidate]]) -> list[SampledMotion]:
    """The motions of candidates, the steps of each one after the other from `world`, until one is infeasible.

    They end with the candidate after which there are `MOST_LOOKED_AT`.
    """
    scenes = list[SampledMotion]()
    for steps in candidates:
        for planned in planned_steps(cell, steps, world) if len(scenes) < MOST_LOOKED_AT else ():
            if not isinstance(planned, Infeasible):
                samples = first_samples(Adaptive(), planned.stage, Observer((), cell.observer.solids), planned.targets)
                scenes.append(SampledMotion(planned, samples))
    return scenes


def swept_cameras(cell: Cell, scenes: Sequence[SampledMotion]) -> Iterator[Problem]:
    """Cameras that robot, tool or part would run into, and in which steps.

    A camera counts as a ball of 6 cm around its lens. What never moves against the camera is left out, such as a
    housing, or the link that carries it.
    """
    hits: dict[str, dict[str, str]] = {}  # by camera, the part that meets it in each task
    frames = dict.fromkeys(camera.frame for camera in cell.observer.cameras)
    for scene, frame, solid in product(scenes, frames, cell.observer.solids):
        X_FP = inverse(scene.states.X_WF[frame]) @ scene.states.X_WF[solid.part.parent]
        if float(np.ptp(X_FP, axis=0).max()) > 1e-9:
            there = [camera for camera in cell.observer.cameras if camera.frame == frame]
            eyes = np.array([camera.X_FC[:3, 3] for camera in there])
            for camera in compress(there, touched(solid, X_FP, eyes, CAMERA_RADIUS).tolist()):
                hits.setdefault(camera.name, {}).setdefault(scene.planned.candidate.task, solid.name)
    for name, parts in hits.items():
        first, *others = parts
        message = f"camera `{name}` stands where `{parts[first]}` passes in `{first}`"
        message += f", and others in {first_names(others)}" if others else ""
        mend = "move it, or state its housing as a fixed object, which the robot then goes around"
        yield warning("camera-in-the-way", message, cell.workspace, f"cameras.{name}", mend)


def idle_cameras(cell: Cell, task: str, scenes: Sequence[SampledMotion], told: Iterable[Problem]) -> Iterator[Problem]:
    """Cameras that have no target of a task in their image, in any of the scenes.

    Where there may be more scenes, nothing is said. told: other findings; one of a camera that sees nothing is enough.
    """
    blind = {one.place for one in told if one.code.startswith("camera-")}
    places = {one.name: cell.workspace.places.get(f"cameras.{one.name}") for one in cell.observer.cameras}
    left = [camera for camera in cell.observer.cameras if places[camera.name] not in blind]
    boxes = [(box, one.states) for one in scenes for target in one.planned.targets for box in target.boxes]
    for box, states in boxes:
        points = transform(states.box_poses(box), box_corners(box.size))
        views = [(one, transform(inverse(states.camera_poses(one)), points)) for one in left]
        left = [one for one, points_C in views if not sees_any(one, np.eye(4), points_C.reshape(-1, 3))]
    if left and boxes and len(scenes) < MOST_LOOKED_AT:
        several = len(left) > 1
        names = ", ".join(f"`{one.name}`" for one in left)
        message = f"camera{'s' * several} {names} never show{'s' * (not several)} what has to be seen in `{task}`"
        mend = f"if {'they are' if several else 'it is'} meant for this task, aim {'them' if several else 'it'} there"
        yield Problem("idle-camera", message, places[left[0].name], severity="warning", mend=mend)


def outside_detectors(cell: Cell, scenes: Sequence[SampledMotion]) -> Iterator[Problem]:
    """What cameras have in their images, but always too small, too near or too far for its detector.

    Of each object the box that is farthest from what its detector needs, by its best view.
    """
    best: dict[str, tuple[float, Problem, tuple[str, ...]]] = {}  # of each box of a target
    for scene in scenes if cell.observer.cameras else ():
        verdicts = cell.observer.verdicts(scene.planned.targets, scene.states, shares=False, culprits=False)
        for target, of_boxes in zip(scene.planned.targets, verdicts, strict=True):
            for box, found in zip(target.boxes, of_boxes, strict=True):
                view = (*_best_view(cell, box, found, scene.states), box.encloses or (box.frame,))
                key = f"{target.atom} {box.name}"
                best[key] = max(best.get(key, view), view, key=itemgetter(0))
    found_of = dict[tuple[str, ...], Problem]()
    for _, problem, objects in sorted((one for one in best.values() if 0 < one[0] < 1), key=itemgetter(0)):
        found_of.setdefault(objects, problem)
    yield from found_of.values()


def _best_view(cell: Cell, box: SoughtBox, found: BoxVerdicts, states: SceneStates) -> tuple[float, Problem]:
    """How much of what its detector needs a box has in the best view, and what is to be said if that is less than 1.

    It is 1 where a view is enough, or only too flat, and 0 where no camera has the box in its image.
    """
    (near, far), least, cameras = box.limits.distance, box.limits.min_pixels, cell.observer.cameras
    gaps = [(states.box_poses(box) - states.camera_poses(one))[:, :3, 3] for one in cameras]
    away = np.stack([np.linalg.norm(gap, axis=1) + np.zeros(len(found.cause)) for gap in gaps], axis=1)
    size = least - found.figure  # of what is too small
    parts = {Cause.DETECTOR_NEAR: away / max(near, 1e-9), Cause.DETECTOR_FAR: far / away, Cause.TOO_SMALL: size / least}
    enough = (found.cause == Cause.NONE) | (found.cause >= Cause.OBLIQUE)
    share = np.select([found.cause == cause for cause in parts] + [enough], [*parts.values(), np.ones_like(away)], 0.0)
    row, column = divmod(int(share.argmax()), len(cameras))
    part, at, camera = float(share[row, column]), float(away[row, column]), cameras[column]
    what = ", ".join(f"`{name}`" for name in box.encloses or (box.frame,))
    match found.cause[row, column]:
        case Cause.TOO_SMALL:
            it_is, needed = f"measures at most {part * least:.1f} pixels, {at:.2f} m from", f"needs {least:.3g}"
            mend = f"look at it from {floor(100 * part * at) / 100:.2f} m or nearer, or through a lens {1 / part:.3g}"
            mend += " times as long; or take a larger part or marker"
        case Cause.DETECTOR_NEAR:
            it_is, needed = f"is {at:.2f} m or less from", f"sees from {near:.2f} m"
            mend = f"move the camera {near - at:.2f} m back"
            mend += ", or take a smaller marker" * (box.limits.kind == "aruco")
        case _:
            it_is, needed = f"is {at:.2f} m or more from", f"sees to {far:.2f} m"
            mend = f"move the camera {at - far:.2f} m nearer"
    message = f"{what} {it_is} camera `{camera.name}`, and detector `{box.detector}` {needed}"
    message += "; no other camera comes nearer to that" * (len(cameras) > 1)
    return part, warning("outside-detector-limits", message, cell.workspace, f"cameras.{camera.name}", mend)


def lamps_inside(workspace: Workspace, solids: Sequence[Solid]) -> Iterator[Problem]:
    """Lamps inside an object, which keeps all their light."""
    for name, light in workspace.lights.items():
        for solid in solids if light.position is not None else ():
            around = workspace.objects.get(solid.part.parent)
            if around is not None and around.X_WO is not None:
                position = transform(inverse(around.X_WO), np.array([light.position]))[0]
                if solid.contains(position):
                    message = f"light `{name}` is inside `{around.name}`, which keeps all its light"
                    mend = f"move one of them; if `{around.name}` is the lamp's housing, leave it out of the workspace"
                    yield warning("light-inside-object", message, workspace, f"lights.{name}", mend)
                    break


def unreachable_speeds(workspace: Workspace, model: RobotModel) -> Iterator[Problem]:
    """Warnings about straight-line speeds that the joint velocity limits allow nowhere; the moves are then slower."""
    fastest = fastest_tool(model)
    for skill in workspace.skills.values():
        for index, primitive in enumerate(skill.primitives):
            if not isinstance(primitive, ToolMove):
                continue
            setting, named = primitive.speed, {one.name: one.values for one in skill.motion_parameters}
            values = named.get(setting.parameter, ()) if isinstance(setting, Reference) else (setting,)
            speed = max((value for value in values if isinstance(value, float)), default=0.0)
            if speed > fastest:
                message = (
                    f"skill `{skill.name}`: `{primitive.name}` asks for a speed of {speed:g} m/s, but the velocity "
                    f"limits of the joints allow less than {fastest:.3g} m/s anywhere, so the move is slower"
                )
                place = skill.places.get(f"primitives.{index}.speed")
                mend = "lower the speed, or correct `robot.limits.velocity`"
                yield Problem("unreachable-speed", message, place, severity="warning", mend=mend)


def fastest_tool(model: RobotModel) -> float:
    """An upper bound of the tool frame's speed [m/s], with the arm stretched out and every joint at its limit."""
    if not model.joints_move_alone:
        return np.inf
    lengths = _lengths(model) + np.where(model.turns, 0.0, model.upper - model.lower)
    reaches = np.cumsum(lengths[::-1])[::-1]
    return float(model.velocity @ np.where(model.turns, reaches, 1.0))


def _lengths(model: RobotModel) -> Array:
    """Distances from each joint of the arm to the next and from the last to the tool, at home [m], shape (n,)."""
    points = np.concatenate([model.joint_origins(model.home), model.tool_pose(model.home)[None, :3, 3]])
    lengths: Array = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return lengths


LEAST_SHARE = 0.01
"""Least factor by which a mesh is shrunk; it applies to meshes thinner than `MIN_OVERLAP` on both sides."""
_Placed: TypeAlias = tuple[Solid, Array]
"""A solid part of an object, with the pose of the object in the world, shape (4, 4)."""


def _shrunk(one: _Placed) -> _Placed:
    """The part with `MIN_OVERLAP` taken off on every side."""
    solid, X_WO = one
    part = solid.part
    if not isinstance(part.shape, Mesh):
        return load_solid(replace(part, shape=shrunk(part.shape, MIN_OVERLAP))), X_WO
    vertices = transform(inverse(part.X_PG), solid.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    share = np.maximum(1 - 2 * MIN_OVERLAP / np.maximum(high - low, LEAST_SIZE), LEAST_SHARE)
    x, y, z = (share * part.shape.scale).tolist()
    X_PG = part.X_PG @ pose(position=(1 - share) * (low + high) / 2)
    return load_solid(replace(part, shape=Mesh(part.shape.path, (x, y, z)), X_PG=X_PG)), X_WO


def _meet(one: _Placed, other: _Placed) -> bool:
    """Whether two parts have a point in common; a mesh that is not closed has only its surface."""
    if distance(*one, *other, 0.0) is not None:
        return True
    for (solid, X_WO), (inner, X_WI) in ((one, other), (other, one)):  # is a corner of the other in a closed mesh?
        corner = transform(inverse(X_WO) @ X_WI, inner.vertices[:1])[0]
        if isinstance(solid.part.shape, Mesh) and solid.contains(corner):
            return True
    return False


def overlapping_shapes(workspace: Workspace) -> Iterator[Problem]:
    """Pairs of objects with parts more than 1 mm deep in each other.

    They still meet when either is shrunk; either, because a hollow mesh only gets narrower. Pairs of boxes and objects
    with a doubted measure are left out.
    """
    doubted = doubted_objects(workspace)
    objects = [item for item in workspace.objects.values() if item.name not in doubted]
    if all(isinstance(part.shape, Box) for item in objects for part in item.parts):
        return  # the usual case, fast even for many objects
    posed = [(item, item.X_WO) for item in objects if item.X_WO is not None]
    every = [(item, solid, X_WO) for item, X_WO in posed for solid in map(load_solid, item.parts)]
    placed = [(item.name, (solid, X_WO)) for item, solid, X_WO in every if not scale_doubt(solid, item)]
    centers = np.array([transform(X_WO, solid.center) for _, (solid, X_WO) in placed]).reshape(-1, 3)
    radii = np.array([solid.radius for _, (solid, _) in placed])
    boxes = np.array([isinstance(solid.part.shape, Box) for _, (solid, _) in placed], dtype=bool)
    reported: set[tuple[str, str]] = set()
    for index, (name, first) in enumerate(placed):
        near = np.linalg.norm(centers - centers[index], axis=1) < radii + radii[index]
        near[: index + 1] = False
        if boxes[index]:
            near &= ~boxes
        for another, second in (placed[other] for other in np.flatnonzero(near).tolist()):
            pair = (name, another)
            if name == another or pair in reported or not _meet(first, second):
                continue
            if _meet(_shrunk(first), second) and _meet(first, _shrunk(second)):
                reported.add(pair)
                one, other = (type(solid.part.shape).__name__.lower() for solid, _ in (first, second))
                message = (
                    f"objects `{pair[0]}` and `{pair[1]}` are in one place: a {one} of the first and a {other} of the "
                    f"second are more than {1e3 * MIN_OVERLAP:g} mm deep in each other"
                )
                mend = "move one of them, or correct the shapes of its `parts`"
                yield warning("overlapping-objects", message, workspace, f"objects.{pair[1]}.pose", mend)
