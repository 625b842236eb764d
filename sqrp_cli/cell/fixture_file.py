"""What stands around a robot, from a scene of MoveIt, or a world in SDF or MJCF.

Scenes of MoveIt (`.scene`), as RViz exports them, are text: the scene's name, then for each object a line `* NAME`, in
newer files its pose, the number of shapes, and of each shape its kind, its figures, its pose (position, quaternion x y
z w) and its colour; newer files then list subframes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic import Field

from sqrp_cli.cell.worlds import Solid, Standing, read_mjcf, read_sdf, simplified
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.files.entries import Entry, Pose, Text
from sqrp_cli.files.input_file import decoded, read_input
from sqrp_cli.files.units import LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import MAX_BYTES
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only
from sqrp_cli.shapes import Box, Shape, shape_of

MAX_OBJECTS = 500  # most objects of a file


class FixturesEntry(Entry):
    """A file with fixed objects."""

    file: Text
    """A .scene of MoveIt, an .sdf or .world, or an .xml of MuJoCo; relative to this file, or package://."""
    pose: Pose = Field(default=Pose(), description="Pose of the file's frame in the world.")


_FIGURES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}  # how many figures a shape has
MOST_NUMBERS = 300_000  # most vertices or triangles of a mesh


def read_scene(path: Path, content: bytes, _roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
    """The objects of a scene; warnings: gets those about what was left out or replaced.

    Raises InputError, with the line, where the text is not as a scene has it.
    """
    reader = _SceneReader(path, decoded(path, content).splitlines(), warnings)
    if not reader.lines or "\0" in reader.lines[0]:
        raise reader.error("the file is empty, expected a scene of MoveIt")
    reader.at = 1  # the scene's name
    while reader.at < len(reader.lines) and (line := reader.peek()) != ".":
        if line.startswith("* "):
            yield reader.object(line[2:].strip())
        elif line:
            raise reader.error(f"found `{line[:40]}`, expected `* NAME` of an object, or `.` at the end")
        else:
            reader.at += 1


class _SceneReader:
    """Reads line by line; at: the next one, from 0."""

    def __init__(self, path: Path, lines: Sequence[str], warnings: list[Problem]) -> None:
        self.path, self.lines, self.warnings, self.at = path, lines, warnings, 0

    def object(self, name: str) -> Standing:
        place = self._place()
        self.at += 1
        X = self._pose() if len(self.peek().split()) == 3 else np.eye(4)  # else the number of shapes
        shapes = [self._shape(name) for _ in range(self._count("the number of shapes"))]
        if self.peek() and not self.peek().startswith(("* ", ".")):
            for _ in range(self._count("the number of subframes")):
                self._line()
                self._pose()
        return Standing(name, tuple((shape, read_only(X @ X_OS)) for shape, X_OS in filter(None, shapes)), place)

    def _shape(self, name: str) -> Solid | None:
        kind, X_inner = self._line(), np.eye(4)
        shape: Shape | None = None
        if kind == "mesh":
            # The box around a mesh: no shape can have its triangles in a scene.
            words = self._line().split()
            if len(words) != 2 or not all(word.isdigit() and int(word) <= MOST_NUMBERS for word in words):
                raise self.error(f"found `{' '.join(words)[:40]}`, expected the numbers of vertices and triangles", 1)
            vertices = np.array([self._numbers(3) for _ in range(int(words[0]))]).reshape(-1, 3)
            for _ in range(int(words[1])):
                self._numbers(3)
            if len(vertices) == 0:
                raise self.error(f"the mesh of `{name}` has no vertices")
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            x, y, z = np.maximum(high - low, SMALLEST_SIZE).tolist()
            shape, X_inner = Box((x, y, z)), pose(np.eye(3), (low + high) / 2)
            mend = "state it as an object: `parts: [{mesh: FILE}]`"
            self.warnings.append(simplified(f"the mesh of `{name}` is taken as the box around it", self._place(), mend))
        elif kind == "plane":
            self._numbers(4)
            self.warnings.append(simplified(f"the plane of `{name}` has no end, and is left out", self._place()))
        elif kind in _FIGURES:
            figures = self._numbers(_FIGURES[kind], least=SMALLEST_SIZE)
            if kind == "cone":
                message = f"the cone of `{name}` is taken as the cylinder around it"
                self.warnings.append(simplified(message, self._place()))
            shape = shape_of("cylinder" if kind == "cone" else kind, figures)
        else:
            expected = expected_names(kind, (*_FIGURES, "mesh", "plane"))
            raise self.error(f"found the shape `{kind[:40]}`; {expected}", 1)
        X = self._pose()
        self._numbers(4)  # its colour
        return None if shape is None else (shape, X @ X_inner)

    def _pose(self) -> Array:
        position, quaternion = self._numbers(3), self._numbers(4, most=1.001)
        length = float(np.linalg.norm(quaternion))
        if abs(length - 1.0) > 0.01:
            raise self.error(f"found a quaternion of length {length:.3g}, expected 1 (order x, y, z, w)", 1)
        return pose(quaternion_to_matrix(quaternion), position)

    def _count(self, what: str) -> int:
        word = self._line()
        if not word.isdigit() or int(word) > 1000:
            raise self.error(f"found `{word[:40]}`, expected {what}", 1)
        return int(word)

    def _numbers(self, count: int, least: float = -LARGEST_LENGTH, most: float = LARGEST_LENGTH) -> list[float]:
        line = self._line()
        numbers = [as_number(word) for word in line.split()]
        if len(numbers) != count or not all(least <= number <= most for number in numbers):
            raise self.error(f"found `{line[:40]}`, expected {count} number{'s' * (count > 1)} in metres", 1)
        return numbers

    def peek(self) -> str:
        return self.lines[self.at].strip() if self.at < len(self.lines) else ""

    def _line(self) -> str:
        if self.at >= len(self.lines):
            raise self.error("the file ends within an object")
        self.at += 1
        return self.lines[self.at - 1].strip()

    def _place(self) -> Place:
        return Place(self.path, min(self.at + 1, max(len(self.lines), 1)))

    def error(self, message: str, back: int = 0) -> InputError:
        """An error in the next line, or so many lines before it."""
        self.at -= back
        return bad_input("wrong-scene", message, self._place())


class FixturesRead(NamedTuple):
    """What a file of another program says of fixed objects."""

    objects: list[Standing]
    warnings: list[Problem]
    """About what was left out or replaced."""
    content: bytes


_READERS = {".scene": read_scene, ".sdf": read_sdf, ".world": read_sdf, ".xml": read_mjcf, ".mjcf": read_mjcf}


def read_fixtures(path: Path, roots: Sequence[Path]) -> FixturesRead:
    """The objects in a file.

    roots: folders in which packages and models are looked up. Raises InputError, with the line, for any other file.
    """
    content = read_input(path, MAX_BYTES)
    if path.suffix.lower() not in _READERS:
        message = f"found the ending `{path.suffix}`, expected .scene of MoveIt, .sdf, .world, or .xml of MuJoCo"
        mend = "name a URDF as `objects: {NAME: {urdf: FILE}}`"
        raise bad_input("unknown-fixtures", message, Place(path), mend=mend)
    warnings = list[Problem]()
    found = [one for one in _READERS[path.suffix.lower()](path, content, roots, warnings) if one.shapes]
    if not 0 < len(found) <= MAX_OBJECTS:
        message = f"this file has {len(found):,} objects with shapes, expected 1 to {MAX_OBJECTS}"
        raise bad_input("unknown-fixtures", message, Place(path))
    return FixturesRead(found, warnings, content)
