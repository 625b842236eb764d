"""Cameras, detectors and objects: the entries of a workspace file as records."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.camera.camera import Camera, CameraEntry, PoseFile, check_image
from sqrp_cli.camera.detector import Detector
from sqrp_cli.camera.markers import Marker
from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.cell.read_robot import RobotReader
from sqrp_cli.cell.scene import NO_SIZE, Held, ObjectEntry, SceneObject
from sqrp_cli.cell.workspace import WorkspaceFile, markers_of
from sqrp_cli.errors import Problem, bad_input, expected_names, no_such
from sqrp_cli.files import packages
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.frames import TOOL, WORLD, link_called
from sqrp_cli.files.input_file import read_input, source_file
from sqrp_cli.files.source import KeyPath, dotted
from sqrp_cli.files.units import SMALLEST_SIZE
from sqrp_cli.files.usual_values import CALIBRATION, HAND_EYE, unusual_values
from sqrp_cli.files.xml_file import MAX_BYTES
from sqrp_cli.geometry import inverse, pose, read_only, transform
from sqrp_cli.robot.read_urdf import read_urdf
from sqrp_cli.shapes import Box, Mesh, Part, Shape, half_extents

if TYPE_CHECKING:
    from sqrp_cli.camera.hand_eye import StaticTransform

X_BODY_OPTICAL = read_only(pose(((0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))))
"""Pose of an optical frame (x right, y down, z forward) in the body frame (x forward, y left, z up) of REP 103."""
X_AXES_OPTICAL = {"optical": np.eye(4), "body": X_BODY_OPTICAL, "opengl": np.diag([1.0, -1.0, -1.0, 1.0])}
"""Pose of an optical frame in the axes of each `convention`."""


def read_cameras(reader: RobotReader, file: WorkspaceFile) -> dict[str, Camera]:
    """The cameras by name; those with problems are left out."""
    cameras = {}
    for name, entry in file.cameras.items():
        with reader.collecting():
            path: KeyPath = ("cameras", name)
            found = None if entry.hand_eye is None else _hand_eye(reader, path, entry, entry.hand_eye)
            if found is None:
                assert entry.pose is not None  # noqa: S101 - CameraEntry accepts exactly one of the two
                frame, X_FC = entry.frame or WORLD, entry.pose.matrix()
            else:
                frame, X_FC = entry.frame or link_called(found.parent, reader.links), found.X_PC
            if frame != WORLD and frame not in reader.links:
                in_file = found if entry.frame is None else None
                place = reader.document.value_place((*path, "frame")) if in_file is None else in_file.place
                message = f"`{dotted((*path, 'frame'))}`: found `{frame}`, expected `world` or a link; "
                message += expected_names(frame, [WORLD, *reader.links])
                mend = f"say `frame:` for `{dotted(path)}`, which goes before what the file says"
                reader.problems.append(Problem("unknown-frame", message, place, mend=None if found is None else mend))
            axes = (found.axes if found is not None else None) or entry.convention or "optical"
            X_FC = read_only(X_FC @ X_AXES_OPTICAL[axes])
            pose_file = None if found is None else found.pose_file
            if entry.calibration is not None:
                from sqrp_cli.camera.calibration import doubtful_projection, read_calibration

                at = (*path, "calibration")
                lens_file = reader.resolve(entry.calibration.file, at)
                intrinsics, whole, part = read_calibration(lens_file, entry.calibration, dotted(at), entry.distortion)
                reader.digest[dotted(at)] = source_file(lens_file, whole.content)
                reader.warnings.extend(unusual_values(part, CALIBRATION))
                reader.warnings.extend(doubtful_projection(intrinsics, part))
            else:
                assert entry.image is not None  # noqa: S101 - CameraEntry accepts exactly one of the two
                intrinsics = entry.image.intrinsics()
                check_image(reader.document, (*path, "image"), intrinsics)
            cameras[name] = from_fields(
                Camera, entry, intrinsics, name=name, frame=frame, X_FC=X_FC, pose_file=pose_file
            )
    return cameras


def _hand_eye(reader: RobotReader, path: KeyPath, entry: CameraEntry, stated: PoseFile) -> StaticTransform:
    """The pose of a camera by a file, with warnings about it. Raises InputError where `world` is ambiguous."""
    from sqrp_cli.camera.hand_eye import read_hand_eye
    from sqrp_cli.ros.bag import METADATA

    key: KeyPath = (*path, "hand_eye")
    name = stated.file or stated.urdf or ""
    is_folder = os.path.isdir(reader.document.folder / name)  # noqa: PTH112
    file = reader.resolve(f"{name}/{METADATA}" if is_folder else name, key)
    carriers = (WORLD, *reader.links) if entry.frame is None else (entry.frame,)
    found = read_hand_eye(file, stated.camera or stated.link, carriers, dotted(key), entry)
    reader.digest[dotted(key)] = source_file(file, found.content)
    if None not in (found.axes, entry.convention) and found.axes != entry.convention:
        message = f"found `{entry.convention}`, but the axes of a camera in {found.pose_file} are `{found.axes}`"
        raise reader.document.error("wrong-value", (*path, "convention"), message, "leave `convention` out")
    if found.document is not None:
        reader.warnings.extend(unusual_values(found.document, HAND_EYE))
    if entry.frame is None and found.parent == WORLD == link_called(WORLD, reader.links):
        base, who = reader.links[0] if reader.links else "base_link", f"for `{dotted(path)}` say"
        message = (
            "found `world`, which is no link of the robot: it may mean the cell's world, or the frame in which the"
            " robot's driver gives its poses, such as its base"
        )
        mend = f"{who} `frame: world` if it is the cell's world, or the link, such as `frame: {base}`"
        raise bad_input("ambiguous-word", message, found.place, mend=mend)
    if entry.convention is None and found.axes is None and "optical" not in found.child:
        message = f"the pose is that of `{found.child}`, which does not sound like an optical frame"
        mend = "say `convention: optical` (z forward, y down) or `convention: body` (x forward, z up)"
        place = reader.document.value_place(key)
        reader.warnings.append(Problem("doubtful-axes", message, place, severity="warning", mend=mend))
    return found


def read_objects(reader: RobotReader, file: WorkspaceFile) -> dict[str, SceneObject]:
    """The objects by name."""
    held = [name for name, entry in file.objects.items() if isinstance(entry.pose, Held)]
    for name, entry in file.objects.items():
        path: KeyPath = ("objects", name)
        if name in (*reader.links, WORLD, TOOL, "home"):
            what = "a link of the robot" if name in reader.links else "a word with a meaning of its own"
            message, at = f"`{name}` is {what}; take another name", reader.document.key_place(path)
            reader.problems.append(Problem("ambiguous-name", message, at))
        if entry.on == name:
            message = f"found `{name}`, which is the object itself; expected another object"
            reader.report("on-itself", (*path, "on"), message, f"name what `{name}` stands on, or leave `on` out")
        elif entry.on is not None and entry.on not in file.objects:
            others = [other for other in file.objects if other != name]
            reader.report("unknown-object", (*path, "on"), no_such(entry.on, "object", others))
        if isinstance(entry.pose, Held) and (entry.fixed or name != held[0]):
            why = "the object is fixed" if entry.fixed else f"the tool holds `{held[0]}`"
            reader.report("wrong-value", (*path, "pose"), f"found `held`, expected a pose, because {why}")
        if entry.fixed and entry.pose is None:
            message = "found `unknown`, expected a pose, because the object is fixed"
            reader.report("wrong-value", (*path, "pose"), message)
    objects = {name: _object(reader, name, entry) for name, entry in file.objects.items()}
    for index, fixtures in enumerate(file.fixtures):
        with reader.collecting():
            from sqrp_cli.cell.fixture_file import read_fixtures  # few workspaces have some

            scene = reader.resolve(fixtures.file, ("fixtures", index))
            content, found = read_input(scene, MAX_BYTES), dict[str, SceneObject]()
            standing = read_fixtures(scene, content, reader.roots, reader.warnings)
            reader.digest[f"fixtures.{index}"] = source_file(scene, content)
            for one in standing:
                # A name that formulas and tasks can use, and nothing else has.
                base = re.sub(r"[^A-Za-z0-9_-]", "_", one.name)[:60]
                base = base if base[:1].isalpha() else f"fixture_{base}".rstrip("_")
                used = {*objects, *found, *reader.links, WORLD, TOOL, "home"}
                numbered = (f"{base}_{number}" for number in range(2, len(used) + 3))
                name = next(free for free in (base, *numbered) if free not in used)
                parts = [Part(f"{name}/{i}", name, shape, X) for i, (shape, X) in enumerate(one.shapes)]
                for part in parts:
                    if isinstance(part.shape, Mesh):
                        reader.add_mesh(f"fixtures.{index}.{part.name}", part.shape, one.place)
                stands = ObjectEntry(type="obstacle", pose=read_only(fixtures.pose.matrix()), fixed=True)
                found[name] = _sized(name, stands, parts)
            objects |= found
    return objects


def _object(reader: RobotReader, name: str, entry: ObjectEntry) -> SceneObject:
    """An object with the solid pieces that its entry states, and those of its URDF, with its joints at 0."""
    parts: list[Part] = []
    for index, piece in enumerate(entry.parts):
        path: KeyPath = ("objects", name, "parts", index)
        with reader.collecting():
            shape: Shape | None = piece.shape()
            if shape is None:
                at = (*path, "mesh")
                shape = mesh = Mesh(reader.resolve(piece.mesh or "", at), piece.scale)
                reader.add_mesh(dotted(path), mesh, reader.document.value_place(at))
            parts.append(Part(f"{name}/{piece.name or index}", name, shape, read_only(piece.pose.matrix())))
    if entry.urdf is not None:
        path = ("objects", name, "urdf")
        with reader.collecting():
            urdf = read_urdf(*reader.described(entry.urdf, path))
            found = urdf.parts("collision", partial(packages.resolve_mesh, reader.roots))
            reader.digest[dotted(path)] = source_file(urdf.path, urdf.content)
            for part in found:
                if isinstance(part.shape, Mesh):
                    reader.add_mesh(f"{dotted(path)}.{part.name}", part.shape, reader.document.value_place(path))
            reader.warnings.extend(urdf.warnings)
            if not found:
                reader.report("no-links", path, f"`{urdf.path.name}` has no link with geometry")
            for part in found:
                X_OG = read_only(urdf.pose_in(urdf.root, part.parent) @ part.X_PG)
                parts.append(Part(f"{name}/{part.name}", name, part.shape, X_OG))
    if entry.size != NO_SIZE:
        parts = parts or [Part(name, name, Box(entry.size), read_only(pose()))]
        return from_fields(SceneObject, entry, name=name, parts=tuple(parts))
    if parts:
        return _sized(name, entry, parts)
    if not (entry.parts or entry.urdf):  # else their problems are reported
        place = reader.document.key_place(("objects", name))
        mend = "state it, or `parts` or a `urdf` from which it is taken"
        reader.problems.append(Problem("missing-key", f"`objects.{name}` lacks the key `size`", place, mend=mend))
    return from_fields(SceneObject, entry, name=name, parts=(), size=(1.0, 1.0, 1.0))


def _sized(name: str, entry: ObjectEntry, parts: Sequence[Part]) -> SceneObject:
    """An object of the size of its parts, in the middle of them. Raises InputError for a mesh that is damaged."""
    ends = []
    for part in parts:
        if isinstance(part.shape, Mesh):
            corners = transform(part.X_PG, read_mesh(part.shape.path, part.shape.scale).vertices)
            ends.append((corners.min(axis=0), corners.max(axis=0)))
        else:
            half = half_extents(part.shape, part.X_PG[:3, :3])
            ends.append((part.X_PG[:3, 3] - half, part.X_PG[:3, 3] + half))
    low, high = np.array(ends)[:, 0].min(axis=0), np.array(ends)[:, 1].max(axis=0)
    thin = np.maximum(SMALLEST_SIZE - (high - low), 0.0)
    low, high = low - thin / 2, high + thin / 2
    X_FO = pose(np.eye(3), (low + high) / 2)
    moved = tuple(replace(part, X_PG=read_only(inverse(X_FO) @ part.X_PG)) for part in parts)
    size = tuple((high - low).tolist())
    X_WO = read_only(entry.pose @ X_FO) if isinstance(entry.pose, np.ndarray) else entry.pose
    return from_fields(SceneObject, entry, name=name, parts=moved, size=size, pose=X_WO, X_FO=read_only(X_FO))


def read_detectors(
    reader: RobotReader,
    file: WorkspaceFile,
    cameras: Mapping[str, Camera],
    on_links: Mapping[str, Marker],
    objects: Mapping[str, SceneObject],
) -> dict[str, Detector]:
    """The detectors by name; those with problems are left out. on_links: the markers on links."""
    markers, found = markers_of(on_links, objects), {}
    for name, entry in file.detectors.items():
        try:
            found[name] = Detector.of(entry, cameras, markers)
        except ValueError as error:
            reader.report("missing-key", ("detectors", name), str(error), "state `distance` and `min_pixels`")
    return found
