"""What stands around a robot, from a scene of MoveIt, or a world in SDF or MJCF.

Scenes of MoveIt (`.scene`), as RViz exports them, are text: the scene's name, then for each object a line `* NAME`, in
newer files its pose, the number of shapes, and of each shape its kind, its figures, its pose (position, quaternion x y
z w) and its colour; newer files then list subframes.

SDF: http://sdformat.org/spec. Joints stay at 0. Included models and meshes of `model://NAME/...` are looked up in the
folders of packages. Planes are left out; models that are not found too, with a warning.

MuJoCo itself reads its format, MJCF: geoms of the world are one object, those of each body in it another.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, first_names
from sqrp_cli.files import packages
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.units import LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import MAX_BYTES, Element, parse_xml
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only, rpy_to_matrix, wrong_length
from sqrp_cli.records import dataclass
from sqrp_cli.robot.mjcf import fixed_bodies
from sqrp_cli.shapes import FIGURES, Box, Mesh, Shape, shape_of

Solid = tuple[Shape, Array]  # a shape with its pose in the file's frame, shape (4, 4)
_TEXTS = frozenset({"name", "pose", "size", "radius", "length", "uri", "scale"})
MOST_NESTED = 8  # most files of which each includes the next
MAX_OBJECTS = 500  # most objects of a file
_COUNT = r"\d{1,3}|1000"  # of shapes or subframes of an object
_COUNTS = r"(?:[12]?\d{1,5}|300000)\s+(?:[12]?\d{1,5}|300000)"  # of vertices and triangles of a mesh, up to 300,000
_FIGURES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}  # how many figures a shape has


class Standing(NamedTuple):
    """An object with its solid pieces."""

    name: str  # As the file has it
    shapes: tuple[Solid, ...]
    place: Place


def read_fixtures(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> list[Standing]:
    """The objects in the content of a file; warnings: gets those about what was left out or replaced.

    roots: folders in which packages and models are looked up. Raises InputError, with the line, for any other file.
    """
    readers = {".scene": _read_scene, ".sdf": _read_sdf, ".world": _read_sdf, ".xml": _read_mjcf, ".mjcf": _read_mjcf}
    if path.suffix.lower() not in readers:
        message = f"found the ending `{path.suffix}`, expected .scene of MoveIt, .sdf, .world, or .xml of MuJoCo"
        mend = "name a URDF as `objects: {NAME: {urdf: FILE}}`"
        raise bad_input("unknown-fixtures", message, Place(path), mend=mend)
    found = [one for one in readers[path.suffix.lower()](path, content, roots, warnings) if one.shapes]
    if not 0 < len(found) <= MAX_OBJECTS:
        message = f"this file has {len(found):,} objects with shapes, expected 1 to {MAX_OBJECTS}"
        raise bad_input("unknown-fixtures", message, Place(path))
    return found


@dataclass
class _Lines:
    """The lines of a scene, and an empty one after the last; at: the next one, from 0."""

    path: Path
    lines: list[str]
    at: int = 0

    def error(self, message: str, back: int = 0) -> InputError:
        """An error in the next line, or so many lines before it."""
        return bad_input("wrong-scene", message, Place(self.path, min(self.at - back + 1, max(len(self.lines) - 1, 1))))

    def take(self, pattern: str = ".*", expected: str = "") -> str:
        """The next line. Raises InputError where there is none, or the pattern is another."""
        if self.at >= len(self.lines) - 1:
            raise self.error("the file ends within an object")
        line, self.at = self.lines[self.at], self.at + 1
        if not re.fullmatch(pattern, line):
            raise self.error(f"found `{line[:40]}`, expected {expected}", 1)
        return line

    def numbers(self, count: int, least: float = -LARGEST_LENGTH, most: float = LARGEST_LENGTH) -> list[float]:
        line = self.take()
        numbers = [as_number(word) for word in line.split()]
        if len(numbers) != count or not all(least <= number <= most for number in numbers):
            raise self.error(f"found `{line[:40]}`, expected {count} number{'s' * (count > 1)} in metres", 1)
        return numbers

    def pose(self) -> Array:
        position, quaternion = self.numbers(3), self.numbers(4, most=1.001)
        if why := wrong_length(quaternion):
            raise self.error(f"the quaternion {why}", 1)
        return pose(quaternion_to_matrix(quaternion), position)


def _read_scene(path: Path, content: bytes, _roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
    """The objects of a scene. Raises InputError, with the line, where the text is not as a scene has it."""
    texts = [*(line.strip() for line in decoded(path, content).splitlines()), ""]
    lines = _Lines(path, texts)
    if len(texts) == 1 or "\0" in texts[0]:
        raise lines.error("the file is empty, expected a scene of MoveIt")
    lines.at = 1  # the scene's name
    while lines.at < len(texts) - 1 and (line := texts[lines.at]) != ".":
        if line and not line.startswith("* "):
            raise lines.error(f"found `{line[:40]}`, expected `* NAME` of an object, or `.` at the end")
        lines.at += 1
        place, name = Place(path, lines.at), line[2:].strip()
        if not line:
            continue
        X = lines.pose() if len(texts[lines.at].split()) == 3 else np.eye(4)  # else the number of shapes
        shapes = [_scene_shape(lines, name, warnings) for _ in range(int(lines.take(_COUNT, "the number of shapes")))]
        if texts[lines.at] and not texts[lines.at].startswith(("* ", ".")):
            for _ in range(int(lines.take(_COUNT, "the number of subframes"))):
                lines.take()
                lines.pose()
        yield Standing(name, tuple((shape, read_only(X @ X_OS)) for shape, X_OS in filter(None, shapes)), place)


def _scene_shape(lines: _Lines, name: str, warnings: list[Problem]) -> Solid | None:
    """The next shape of an object of this name, and its pose in the object; None for one that is left out."""
    kind, X_inner, place = lines.take(), np.eye(4), Place(lines.path, lines.at)
    shape: Shape | None = None
    if kind == "mesh":
        # The box around a mesh: no shape can have its triangles in a scene.
        corners, triangles = map(int, lines.take(_COUNTS, "the numbers of vertices and triangles").split())
        vertices = np.array([lines.numbers(3) for _ in range(corners)]).reshape(-1, 3)
        for _ in range(triangles):
            lines.numbers(3)
        if len(vertices) == 0:
            raise lines.error(f"the mesh of `{name}` has no vertices")
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        x, y, z = np.maximum(high - low, SMALLEST_SIZE).tolist()
        shape, X_inner = Box((x, y, z)), pose(np.eye(3), (low + high) / 2)
        mend = "state it as an object: `parts: [{mesh: FILE}]`"
        warnings.append(_simplified(f"the mesh of `{name}` is taken as the box around it", place, mend))
    elif kind == "plane":
        lines.numbers(4)
        warnings.append(_simplified(f"the plane of `{name}` has no end, and is left out", place))
    elif kind in _FIGURES:
        figures = lines.numbers(_FIGURES[kind], least=SMALLEST_SIZE)
        if kind == "cone":
            warnings.append(_simplified(f"the cone of `{name}` is taken as the cylinder around it", place))
        shape = shape_of("cylinder" if kind == "cone" else kind, figures)
    else:
        expected = expected_names(kind, (*_FIGURES, "mesh", "plane"))
        raise lines.error(f"found the shape `{kind[:40]}`; {expected}", 1)
    X = lines.pose()
    lines.numbers(4)  # its colour
    return None if shape is None else (shape, X @ X_inner)


def _simplified(message: str, place: Place, mend: str | None = None) -> Problem:
    """A warning about what was left out or replaced."""
    return Problem("fixture-simplified", message, place, severity="warning", mend=mend)


def _read_sdf(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
    """The models of a world, each with its shapes; warnings: gets those about what was left out.

    Raises InputError, with the line, for XML that is no SDF, poses relative to other frames, and wrong figures.
    """

    def models(holder: Element, X: Array, files: tuple[Path, ...]) -> Iterator[_Model]:
        """The models in an element at a pose in the world; files: those that lead to it, its own the last."""
        for model in holder.all("model"):
            yield model, X @ _sdf_pose(model), files, None
        for include in holder.all("include"):
            uri = _sdf_text(include, "uri") or "no uri"
            reference = uri.replace("model://", "package://", 1)
            try:
                named = reference if reference.endswith(".sdf") else f"{reference}/model.sdf"
                file = packages.resolve(named, files[-1].parent, roots, include.place)
            except InputError as error:
                message = f"the included model `{uri[:60]}` is left out: {error.problems[0].message}"
                mend = "name the folder that holds its folder under `robot.package_roots`"
                warnings.append(_simplified(message, include.place, mend))
                continue
            if len(files) > MOST_NESTED or file in files[1:]:
                raise include.error("wrong-scene", f"`{uri[:60]}` includes itself, or is nested too deep")
            for model in parse_xml(file, read_input(file, MAX_BYTES), "sdf", _TEXTS).all("model"):
                # Its own pose counts unless the <include> has one.
                own = _sdf_pose(model if include.first("pose") is None else include)
                yield model, X @ own, (*files, file), include

    def solids(model: Element, X: Array, files: tuple[Path, ...]) -> Iterator[Solid]:
        for link in model.all("link"):
            X_link = X @ _sdf_pose(link)
            for collision in [*link.all("collision")] or [*link.all("visual")]:
                geometry = collision.need("geometry")
                shape: Shape
                holder = next(iter(geometry.children), None)
                if holder is None or holder.tag in ("plane", "empty"):
                    continue
                if holder.tag == "mesh":
                    uri = _sdf_text(holder, "uri") or ""
                    reference = f"package{uri[5:]}" if uri.startswith("model://") else uri
                    x, y, z = _sdf_numbers(holder, "scale", 3) if holder.first("scale") else (1.0, 1.0, 1.0)
                    shape = Mesh(packages.resolve(reference, files[-1].parent, roots, holder.place), (x, y, z))
                elif holder.tag in FIGURES:
                    stated = (_sdf_numbers(holder, key, count) for key, count in FIGURES[holder.tag].items())
                    shape = shape_of(holder.tag, list(chain.from_iterable(stated)))
                else:
                    message = f"a shape of the kind `{holder.tag[:40]}` is left out"
                    warnings.append(_simplified(message, geometry.place))
                    continue
                yield shape, read_only(X_link @ _sdf_pose(collision))
        for inner, X_inner, inner_files, _ in models(model, X, files):
            yield from solids(inner, X_inner, inner_files)

    root = parse_xml(path, content, "sdf", _TEXTS)
    for holder in (*root.all("world"), root):
        for model, X, files, include in models(holder, np.eye(4), (path,)):
            name = include and _sdf_text(include, "name")
            place = model.place if include is None else include.place
            yield Standing(name or model.text("name"), tuple(solids(model, X, files)), place)


_Model = tuple[Element, Array, tuple[Path, ...], Element | None]
"""A model with its pose in the world, the files that lead to it, and the <include> that names it, if one does."""


def _sdf_text(element: Element, tag: str) -> str | None:
    child = element.first(tag)
    return "".join(child.pieces).strip() if child is not None else None


def _sdf_pose(element: Element) -> Array:
    """The pose of an element in the one around it."""
    child = element.first("pose")
    if child is not None and (child.attributes.get("relative_to") or child.attributes.get("frame")):
        message = "a pose relative to another frame is not read, expected one in what is around it"
        raise child.error("wrong-scene", message)
    if child is None or not "".join(child.pieces).split():
        return np.eye(4)
    x, y, z, *turns = _sdf_numbers(element, "pose", 6, -LARGEST_LENGTH)
    return pose(rpy_to_matrix(np.radians(turns) if child.attributes.get("degrees") == "true" else turns), (x, y, z))


def _sdf_numbers(element: Element, tag: str, count: int, least: float = SMALLEST_SIZE) -> list[float]:
    """The numbers in a child of an element, [m] or [rad]. Raises InputError for others."""
    child = element.need(tag)
    words = "".join(child.pieces).split()
    numbers = [as_number(word) for word in words]
    if len(numbers) != count or not all(least <= number <= LARGEST_LENGTH for number in numbers):
        found = f"<{tag}> is `{' '.join(words)[:40]}`, expected {count} number{'s' * (count > 1)}"
        raise child.error("wrong-scene", found)
    return numbers


def _read_mjcf(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
    """The fixed bodies of a world, each with its shapes; warnings: gets those about what was left out.

    Raises InputError for XML that is no MJCF, and for what MuJoCo cannot read.
    """
    place = parse_xml(path, content, "mujoco").place
    bodies, lost = fixed_bodies(path)
    for name, solids in bodies:
        shapes = list[Solid]()
        for shape, X in solids:
            if isinstance(shape, tuple):
                shapes.append((Mesh(packages.resolve(shape[0], path.parent, roots, place), shape[1]), X))
            else:
                shapes.append((shape, X))
        yield Standing(name, tuple(shapes), place)
    warnings += [_simplified(f"{said}: {first_names(names)}", place) for said, names in lost.items()]
