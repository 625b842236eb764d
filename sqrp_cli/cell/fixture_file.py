"""What stands around a robot, from a scene of MoveIt, or a world in SDF or MJCF.

Scenes of MoveIt (`.scene`), as RViz exports them, are text: the scene's name, then for each object a line `* NAME`, in
newer files its pose, the number of shapes, and of each shape its kind, its figures, its pose (position, quaternion x y
z w) and its colour; newer files then list subframes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sqrp_cli.cell.worlds import Solid, Standing, read_mjcf, read_sdf, simplified
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.files.input_file import decoded
from sqrp_cli.files.units import LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.geometry import Array, pose, quaternion_to_matrix, read_only, wrong_length
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Box, Shape, shape_of

MAX_OBJECTS = 500  # most objects of a file
_COUNT = r"\d{1,3}|1000"  # of shapes or subframes of an object
_COUNTS = r"(?:[12]?\d{1,5}|300000)\s+(?:[12]?\d{1,5}|300000)"  # of vertices and triangles of a mesh, up to 300,000
_FIGURES = {"box": 3, "sphere": 1, "cylinder": 2, "cone": 2}  # how many figures a shape has


def read_fixtures(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> list[Standing]:
    """The objects in the content of a file; warnings: gets those about what was left out or replaced.

    roots: folders in which packages and models are looked up. Raises InputError, with the line, for any other file.
    """
    readers = {".scene": _read_scene, ".sdf": read_sdf, ".world": read_sdf, ".xml": read_mjcf, ".mjcf": read_mjcf}
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
        warnings.append(simplified(f"the mesh of `{name}` is taken as the box around it", place, mend))
    elif kind == "plane":
        lines.numbers(4)
        warnings.append(simplified(f"the plane of `{name}` has no end, and is left out", place))
    elif kind in _FIGURES:
        figures = lines.numbers(_FIGURES[kind], least=SMALLEST_SIZE)
        if kind == "cone":
            warnings.append(simplified(f"the cone of `{name}` is taken as the cylinder around it", place))
        shape = shape_of("cylinder" if kind == "cone" else kind, figures)
    else:
        expected = expected_names(kind, (*_FIGURES, "mesh", "plane"))
        raise lines.error(f"found the shape `{kind[:40]}`; {expected}", 1)
    X = lines.pose()
    lines.numbers(4)  # its colour
    return None if shape is None else (shape, X @ X_inner)
