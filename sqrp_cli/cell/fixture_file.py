"""What stands around a robot, from a scene of MoveIt, or a world in SDF or MJCF.

Scenes of MoveIt (`.scene`), as RViz exports them, are text: the scene's name, then for each object a line `* NAME`, in
newer files its pose, the number of shapes, and of each shape its kind, its figures, its pose (position, quaternion x y
z w) and its colour; newer files then list subframes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from sqrp_cli.cell.worlds import FixtureReader, FixturesRead, Standing, read_mjcf, read_sdf
from sqrp_cli.errors import InputError, Place, bad_input, expected_names
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


def read_scene(path: Path, content: bytes, roots: Sequence[Path]) -> FixturesRead:  # noqa: ARG001 - it names no files
    """The objects of a scene, and warnings about what was left out or replaced.

    Raises InputError, with the line, where the text is not as a scene has it.
    """
    reader = _SceneReader(path, decoded(path, content).splitlines())
    return FixturesRead([one for one in reader.read() if one.shapes], reader.warnings, content)


class _SceneReader(FixtureReader):
    """Reads line by line."""

    def __init__(self, path: Path, lines: Sequence[str]) -> None:
        super().__init__(path)
        self.lines, self.at = lines, 0

    def read(self) -> list[Standing]:
        if not self.lines or any("\0" in line for line in self.lines[:1]):
            raise self._error("the file is empty, expected a scene of MoveIt")
        self.at = 1  # the scene's name
        objects = []
        while self.at < len(self.lines):
            line = self.lines[self.at].strip()
            if line == ".":
                break
            if line.startswith("* "):
                objects.append(self._object(line[2:].strip()))
            elif line:
                raise self._error(f"found `{line[:40]}`, expected `* NAME` of an object, or `.` at the end")
            else:
                self.at += 1
        return objects

    def _object(self, name: str) -> Standing:
        place = self._place()
        self.at += 1
        X = self._pose() if len(self._peek().split()) == 3 else np.eye(4)  # else the number of shapes
        shapes = [self._shape(name) for _ in range(self._count("the number of shapes", 1000))]
        if self._peek() and not self._peek().startswith(("* ", ".")):
            for _ in range(self._count("the number of subframes", 1000)):
                self._line()
                self._pose()
        found = tuple((shape, read_only(X @ X_OS)) for shape, X_OS in filter(None, shapes))
        return Standing(name, found, place)

    def _shape(self, name: str) -> tuple[Shape, Array] | None:
        kind = self._line()
        if kind == "mesh":
            # The box around a mesh: no shape can have its triangles in a scene.
            words = self._line().split()
            if len(words) != 2 or not all(word.isdigit() and int(word) <= MOST_NUMBERS for word in words):
                self.at -= 1
                raise self._error(f"found `{' '.join(words)[:40]}`, expected the numbers of vertices and triangles")
            vertices = np.array([self._numbers(3) for _ in range(int(words[0]))]).reshape(-1, 3)
            for _ in range(int(words[1])):
                self._numbers(3)
            if len(vertices) == 0:
                raise self._error(f"the mesh of `{name}` has no vertices")
            low, high = vertices.min(axis=0), vertices.max(axis=0)
            x, y, z = np.maximum(high - low, SMALLEST_SIZE).tolist()
            mend = "state it as an object: `parts: [{mesh: FILE}]`"
            self.warn(f"the mesh of `{name}` is taken as the box around it", self._place(), mend)
            shape: Shape | None = Box((x, y, z))
            X_inner = pose(np.eye(3), (low + high) / 2)
        elif kind == "plane":
            self._numbers(4)
            shape, X_inner = None, np.eye(4)
            self.warn(f"the plane of `{name}` has no end, and is left out", self._place())
        elif kind in _FIGURES:
            figures = self._numbers(_FIGURES[kind], least=SMALLEST_SIZE)
            if kind == "cone":
                self.warn(f"the cone of `{name}` is taken as the cylinder around it", self._place())
            shape, X_inner = shape_of("cylinder" if kind == "cone" else kind, figures), np.eye(4)
        else:
            self.at -= 1
            expected = expected_names(kind, (*_FIGURES, "mesh", "plane"))
            raise self._error(f"found the shape `{kind[:40]}`; {expected}")
        X = self._pose()
        self._numbers(4)  # its colour
        return None if shape is None else (shape, X @ X_inner)

    def _pose(self) -> Array:
        position, quaternion = self._numbers(3), self._numbers(4, most=1.001)
        length = float(np.linalg.norm(quaternion))
        if abs(length - 1.0) > 0.01:
            self.at -= 1
            raise self._error(f"found a quaternion of length {length:.3g}, expected 1 (order x, y, z, w)")
        return pose(quaternion_to_matrix(quaternion), position)

    def _count(self, what: str, most: int) -> int:
        word = self._line()
        if not word.isdigit() or int(word) > most:
            self.at -= 1
            raise self._error(f"found `{word[:40]}`, expected {what}")
        return int(word)

    def _numbers(self, count: int, least: float = -LARGEST_LENGTH, most: float = LARGEST_LENGTH) -> list[float]:
        line = self._line()
        numbers = [as_number(word) for word in line.split()]
        if len(numbers) != count or not all(least <= number <= most for number in numbers):
            self.at -= 1
            raise self._error(f"found `{line[:40]}`, expected {count} number{'s' * (count > 1)} in metres")
        return numbers

    def _peek(self) -> str:
        return self.lines[self.at].strip() if self.at < len(self.lines) else ""

    def _line(self) -> str:
        if self.at >= len(self.lines):
            raise self._error("the file ends within an object")
        self.at += 1
        return self.lines[self.at - 1].strip()

    def _place(self) -> Place:
        return Place(self.path, min(self.at + 1, max(len(self.lines), 1)))

    def _error(self, message: str) -> InputError:
        return bad_input("wrong-scene", message, self._place())


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
    found = _READERS[path.suffix.lower()](path, content, roots)
    if not 0 < len(found.objects) <= MAX_OBJECTS:
        message = f"this file has {len(found.objects):,} objects with shapes, expected 1 to {MAX_OBJECTS}"
        raise bad_input("unknown-fixtures", message, Place(path))
    return found
