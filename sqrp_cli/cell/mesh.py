"""Mesh files (STL, OBJ, DAE) become triangles in metres. Every part of the program takes meshes from `read_mesh`.

Only positions and faces are read; normals, textures and materials may be anything, and no other file is opened. A file
that contradicts itself is refused with the line (or triangle) of what is wrong, because half a mesh is a wrong answer.

The unit of a COLLADA file (DAE) counts; its `<up_axis>` does not: a mesh has the axes of its link or part, as in RViz.
That format: https://www.khronos.org/files/collada_spec_1_4.pdf.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterable
from functools import lru_cache
from math import isnan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, Place, bad_input, expected_names
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.units import LARGEST, LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import MAX_DEPTH, Element, parse_xml
from sqrp_cli.geometry import Array, cross, quaternion_to_matrix
from sqrp_cli.shapes import Triangles

Integers = NDArray[np.int64]
MAX_BYTES = 200_000_000  # largest STL file that is read
MAX_TEXT_BYTES = 64_000_000  # largest OBJ and DAE file: its words take ten times as much memory
MAX_TRIANGLES = 500_000  # largest mesh that is accepted
MAX_CORNERS = 1000  # most corners of a polygon
MAX_CUTS = 200_000  # most corners to try when polygons that are not convex are cut into triangles, some seconds of work
MAX_NODES = 10_000  # most nodes and placed geometries of a COLLADA file

_CONVERSIONS = (
    "make triangles of it, such as by `gmsh part.step -2 -o part.stl` (pip install gmsh) or in FreeCAD; such files are"
    " usually in mm, so state `scale: 0.001`"
)
_EXACT = (".step", ".stp", ".iges", ".igs", ".brep")
"""Endings of files of CAD programs, whose surfaces are exact and not triangles."""
_Surface = tuple[Array, Integers, float, Callable[[int], int | None]]
"""The content of a mesh file: corners in its unit, (V, 3), indices of three corners each, (F, 3), the unit [m], and
what gives the line of a point, for messages."""


def read_mesh(path: Path, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Triangles:
    """The triangles of a mesh file, scaled along x, y and z, in metres; an unchanged file is read once.

    Equal corners are one vertex, every vertex is a corner, and triangles without two sides are left out. Triangles keep
    their orientation where `scale` mirrors. The arrays are read-only.

    Raises InputError for a file that cannot be read, is damaged, empty, too large, or of another format, and for a mesh
    that reaches further than `LARGEST_LENGTH`.
    """
    points, faces, unit = _surface(path)
    vertices = points * (unit * np.array(scale))
    if not (np.abs(vertices) <= LARGEST_LENGTH).all():
        message = f"this mesh reaches further than {LARGEST_LENGTH:g} m from its origin"
        raise bad_input("mesh-too-large", message, Place(path), mend="check its `scale`")
    vertices.setflags(write=False)
    return Triangles(vertices, faces if np.prod(scale) > 0.0 else faces[:, ::-1])


def mesh_unit(path: Path) -> float:
    """The length of the unit of a mesh file [m]: what a COLLADA file says, otherwise 1. Raises as `read_mesh`."""
    return _surface(path)[2]


def _surface(path: Path) -> tuple[Array, Integers, float]:
    try:
        stat = path.stat()
    except OSError as error:
        raise bad_input("unreadable-file", f"cannot be read: {error.strerror}", Place(path)) from error
    return _read(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=1024)
def _read(path: Path, size: int, _time: int) -> tuple[Array, Integers, float]:
    suffix = path.suffix.lower()
    if suffix not in _READERS:
        message = f"found a mesh with the ending `{path.suffix}`, expected .stl, .obj or .dae"
        mend = _CONVERSIONS if suffix in _EXACT else "export it as one of these"
        raise bad_input("unknown-mesh", message, Place(path), mend=mend)
    if size > (limit := MAX_BYTES if suffix == ".stl" else MAX_TEXT_BYTES):
        message = f"this mesh has {size:,} bytes, the limit is {limit:,}"
        raise bad_input("file-too-large", message, Place(path), mend="simplify the mesh")
    points, faces, unit, line_of = _READERS[suffix](path, read_input(path, limit))
    _check_count(path, len(faces))
    finite = (np.abs(points) <= np.finfo(np.float32).max).all(axis=1)
    if not finite.all():
        bad = int(finite.argmin())
        found = " ".join(f"{number:g}" for number in points[bad])
        raise _damaged(path, f"point {bad + 1:,} is `{found}`, expected finite numbers up to 3.4e38", line_of(bad))
    # Equal points become one: sorted, they follow each other.
    order = np.lexsort(points.T)
    new = np.append(True, (np.diff(points[order], axis=0) != 0.0).any(axis=1))
    merged = np.empty(len(points), dtype=np.int64)
    merged[order] = np.cumsum(new) - 1
    faces = merged[faces]
    used, faces = np.unique(faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)], return_inverse=True)
    points, faces = points[order][new][used], faces.reshape(-1, 3)
    a, b, c = np.moveaxis(points[faces], 1, 0)
    if not cross(b - a, c - a).any():
        raise bad_input("mesh-empty", "no triangle of this mesh has an area", Place(path))
    faces.setflags(write=False)
    return points, faces, unit


def _damaged(at: Path | Element, message: str, line: int | None = None, mend: str = "export it again") -> InputError:
    """The refusal of a file, in a line of it, or of an element."""
    place = Place(at, line) if isinstance(at, Path) else Place(at.place.file, at.place.line)
    return bad_input("mesh-damaged", message, place, mend=mend)


def _check_count(path: Path, count: int) -> None:
    if count == 0:
        raise bad_input("mesh-empty", "this mesh has no triangles", Place(path))
    if count > MAX_TRIANGLES:
        message = f"this mesh has {count:,} triangles, the limit is {MAX_TRIANGLES:,}"
        raise bad_input("mesh-too-large", message, Place(path), mend="simplify the mesh")


# STL

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of a binary STL, after 80 bytes of comment and 4 of their number."""

_WORDS = re.compile(
    rb"(?:facet\s+normal\s+\S+\s+\S+\s+\S+\s+outer\s+loop\s+"
    + 3 * rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)\s+"
    + rb"endloop\s+endfacet\b|(?:end)?solid\b[^\r\n]*)\s*",
    re.IGNORECASE,
)
"""A triangle of a text STL, or the beginning or end of a solid."""


def _stl(path: Path, content: bytes) -> _Surface:
    stated = int.from_bytes(content[80:84], "little")
    promised = 84 + _FACET.itemsize * stated
    if len(content) == promised:
        _check_count(path, stated)
        corners = np.frombuffer(content, dtype=_FACET, offset=84)["corners"].reshape(-1, 3).astype(float)
        return corners, np.arange(len(corners)).reshape(-1, 3), 1.0, lambda _: None
    if content[:100].lstrip()[:5].lower() != b"solid":
        message = f"this STL file has {len(content):,} bytes, but its header promises {stated:,} triangles"
        raise _damaged(path, f"{message} (bytes 80 to 83), which are {promised:,} bytes: it is damaged")
    _check_count(path, len(re.findall(rb"endfacet", content, re.IGNORECASE)))
    facets, starts, at, last = list[tuple[bytes, ...]](), list[int](), len(content) - len(content.lstrip()), b""
    while found := _WORDS.match(content, at):
        if found[1] is not None:
            facets.append(found.groups())
            starts.append(at)
        last, at = found[0], found.end()

    def line_of(corner: int) -> int:
        return content.count(b"\n", 0, starts[corner // 3]) + 1

    if at < len(content) or last[:8].lower() != b"endsolid":
        starts.append(at)
        message = "expected `endsolid`, or a triangle: `facet normal` and three times `vertex` with three numbers"
        if not re.search(rb"end(facet|solid)", content[at:], re.IGNORECASE):
            message = "the file ends within a triangle or before `endsolid`: it is cut off"
        raise _damaged(path, message, line_of(3 * len(facets)))
    try:
        corners = np.array(facets, dtype=float).reshape(-1, 3)
    except ValueError:
        first = next(number for number, facet in enumerate(facets) if any(map(isnan, map(as_number, facet))))
        raise _damaged(path, "a corner of this triangle is not three numbers", line_of(3 * first)) from None
    return corners, np.arange(len(corners)).reshape(-1, 3), 1.0, line_of


# OBJ

_IGNORED = "vt vn vp l p g o s mg usemtl mtllib usemap maplib bevel c_interp d_interp shadow_obj trace_obj".split()  # noqa: SIM905
_KEYWORDS = frozenset(word.encode() for word in ("v", "f", *_IGNORED))


def _obj(path: Path, content: bytes) -> _Surface:
    content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    if content.count(b"\n") > 10 * MAX_TRIANGLES:
        message = f"this mesh has more than {10 * MAX_TRIANGLES:,} lines"
        raise bad_input("mesh-too-large", message, Place(path), mend="simplify the mesh")
    vertices, lines = list[list[bytes]](), list[int]()
    corners, sizes, faces_at, number, triangles = list[int](), list[int](), list[int](), 1, 0
    total, polygons = (len(re.findall(rb"^\s*%b\s" % keyword, content, re.MULTILINE)) for keyword in (b"v", b"f"))
    _check_count(path, polygons)
    # A backslash continues a line. The vertical tab in its place is a blank that can be counted.
    for line in io.BytesIO(content.replace(b"\\\n", b"\v")):
        words = line.partition(b"#")[0].split()
        keyword = words[0] if words else b"g"
        if keyword == b"v":
            if len(words) < 4 or any(map(isnan, map(as_number, words[1:]))):
                raise _damaged(path, f"found the vertex `{_shown(words[1:])}`, expected three numbers", number)
            vertices.append(words[1:4])
            lines.append(number)
        elif keyword == b"f":
            # Indices of corners; in the file they count from 1, or back from the last one so far.
            try:
                stated = [int(word.partition(b"/")[0]) for word in words[1:]]
            except ValueError:
                message = f"found the face `{_shown(words[1:])}`, expected numbers such as `7/1/1`"
                raise _damaged(path, message, number) from None
            if wrong := [index for index in stated if not (1 <= index <= total or 1 <= -index <= len(vertices))]:
                raise _damaged(path, f"found the vertex {wrong[0]:,}, of {total:,} that there are", number)
            corners += [index - 1 if index > 0 else len(vertices) + index for index in stated]
            sizes.append(len(stated))
            faces_at.append(number)
            triangles += len(stated) - 2
            if triangles > MAX_TRIANGLES:
                _check_count(path, triangles)
        elif keyword not in _KEYWORDS:
            expected = expected_names(keyword.decode(errors="replace"), ("v", "f", *_IGNORED[:9]))
            message = f"found `{_shown([keyword])}`, which is no keyword of an OBJ file of polygons; {expected}"
            raise _damaged(path, message, number)
        number += 1 + line.count(b"\v")
    points = np.array(vertices, dtype=float).reshape(-1, 3)
    each = np.array(corners, dtype=np.int64), np.array(sizes, dtype=np.int64)
    return points, _cut(path, points, *each, faces_at.__getitem__), 1.0, lines.__getitem__


def _shown(words: list[bytes]) -> str:
    return b" ".join(words[:20])[:60].decode(errors="replace")


# Polygons


def _cut(
    path: Path, points: Array, corners: Integers, sizes: Integers, line_of: Callable[[int], int | None]
) -> Integers:
    """Triangles (n, 3) of polygons, given by indices of all their corners in a row and how many each has.

    line_of: gives the line of a polygon, for messages.
    """
    mend = "triangulate the mesh when exporting it"
    triangles, budget, starts = [np.empty((0, 3), dtype=np.int64)], MAX_CUTS, np.cumsum(sizes) - sizes
    for size in np.unique(sizes).tolist():
        if not 3 <= size <= MAX_CORNERS:
            message = f"found a polygon with {size:,} corners, expected 3 to {MAX_CORNERS:,}"
            raise _damaged(path, message, line_of(int((sizes == size).argmax())), mend)
        polygons = corners[starts[sizes == size][:, None] + np.arange(size)]
        if size == 3:
            triangles.append(polygons)
            continue
        rims = points[polygons]
        sides = np.roll(rims, -1, axis=1) - rims
        normals = cross(rims - rims[:, :1], sides).sum(axis=1)
        turns = np.einsum("pcx,px->pc", cross(np.roll(sides, 1, axis=1), sides), normals)
        bent = (turns < -1e-9 * (normals**2).sum(axis=1)[:, None]).any(axis=1)
        triangles += [polygons[~bent][:, [0, k, k + 1]] for k in range(1, size - 1)]
        for polygon in np.flatnonzero(bent):
            ears, tried = _ears(rims[polygon], normals[polygon])
            triangles.append(polygons[polygon][ears])
            if (budget := budget - tried) < 0:
                message = "the polygons of this mesh that are not convex are too many"
                raise _damaged(path, message, line_of(int(np.flatnonzero(sizes == size)[polygon])), mend)
    return np.concatenate(triangles)


def _ears(rim: Array, normal: Array) -> tuple[list[tuple[int, int, int]], int]:
    """Triangles of a polygon that is not convex, by cutting off ears (Meisters 1975), and how many corners were tried.

    rim: its corners (n, 3). An ear is a corner that turns left and whose triangle no other corner is in.
    """
    u = cross(normal, np.eye(3)[np.abs(normal).argmin()])
    flat = rim @ np.column_stack([u, cross(normal, u) / np.linalg.norm(normal)])
    left, ears, at, missed, tried = list(range(len(rim))), list[tuple[int, int, int]](), 0, 0, 0

    def beyond(a: int, b: int, them: Array) -> Array:
        (x, y), (along, across) = flat[a], flat[b] - flat[a]
        return along * (them[:, 1] - y) - across * (them[:, 0] - x)  # type: ignore[no-any-return]

    while len(left) > 2:
        tried += 1
        a, b, c = (left[(at + step) % len(left)] for step in (-1, 0, 1))
        others = flat[left]
        inside = np.minimum(np.minimum(beyond(a, b, others), beyond(b, c, others)), beyond(c, a, others)) >= 0.0
        for corner in (a, b, c):  # others may be in the same place, where a cut leads to a hole
            inside &= (others != flat[corner]).any(axis=1)
        if (beyond(a, b, flat[[c]])[0] > 0.0 and not inside.any()) or missed > len(left):  # it may cross itself
            ears.append((a, b, c))
            del left[at % len(left)]
            missed = 0
        else:
            at, missed = at + 1, missed + 1
    return ears, tried


# DAE

_NUMBERS = {"matrix": 16, "rotate": 4, "translate": 3, "scale": 3}  # transformations of a node, and their numbers
_TEXTS = frozenset(("float_array", "p", "vcount", *_NUMBERS))
_UNSUPPORTED = {"instance_controller": "skins and morphs", "skew": "skewed nodes", "lookat": "nodes with <lookat>"}
_POLYGONS = ("triangles", "polylist", "polygons", "trifans", "tristrips")


def _dae(path: Path, content: bytes) -> _Surface:
    """What the scene places; all scenes, if the file does not say which."""
    root = parse_xml(path, content, "COLLADA", _TEXTS)
    asset = root.first("asset")
    unit = asset.first("unit") if asset else None
    stated = unit.attributes.get("meter", "1") if unit else "1"
    if unit is not None and not 1 / LARGEST <= as_number(stated) <= LARGEST:
        message = f'found `<unit meter="{stated[:60]}">`, expected the length of the unit in metres'
        raise bad_input("wrong-value", message, Place(path, unit.place.line), mend="export it again")
    every, parts, placements = list(root.inside()), dict[int, list[tuple[Array, Integers]]](), 0
    points, faces, count, triangles = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0, 0
    scenes, nodes, geometries = (
        _by_id(one for one in every if one.tag == tag) for tag in ("visual_scene", "node", "geometry")
    )

    def place(node: Element, X: Array, depth: int) -> None:
        nonlocal placements, count, triangles
        if depth > MAX_DEPTH:
            raise _damaged(node, f"nodes place each other in more than {MAX_DEPTH} levels, or themselves")
        for child in node.children:
            if child.tag in _UNSUPPORTED:
                raise _damaged(child, f"found {child}: {_UNSUPPORTED[child.tag]} are not supported")
            if child.tag in _NUMBERS:
                X = X @ _transformation(child)
            if child.tag not in ("node", "instance_node", "instance_geometry"):
                continue
            placements += 1
            if placements > MAX_NODES:
                message = f"this mesh places too many nodes and geometries, the limit is {MAX_NODES:,}"
                raise child.error("mesh-too-large", message, mend="join its pieces")
            if child.tag != "instance_geometry":
                place(child if child.tag == "node" else _referred(child, "url", nodes), X, depth + 1)
                continue
            geometry = _referred(child, "url", geometries)
            if id(geometry) not in parts:
                found = ((mesh, part) for mesh in geometry.all("mesh") for part in mesh.children)
                parts[id(geometry)] = [_part(*pair) for pair in found if pair[1].tag in _POLYGONS]
            mirrored = np.linalg.det(X[:3, :3]) < 0.0
            for more, corners in parts[id(geometry)]:
                points.append(more @ X[:3, :3].T + X[:3, 3])
                faces.append(count + (corners[:, ::-1] if mirrored else corners))
                count, triangles = count + len(more), triangles + len(corners)
                if triangles > MAX_TRIANGLES:
                    _check_count(path, triangles)

    scene = root.first("scene")
    instance = scene.first("instance_visual_scene") if scene else None
    listed = [one for library in root.all("library_visual_scenes") for one in library.all("visual_scene")]
    for one in listed if instance is None else [_referred(instance, "url", scenes)]:
        place(one, np.eye(4), 0)
    return np.concatenate(points), np.concatenate(faces), as_number(stated), lambda _: None


def _by_id(elements: Iterable[Element]) -> dict[str, list[Element]]:
    named: dict[str, list[Element]] = {}
    for element in elements:
        named.setdefault(f"#{element.attributes.get('id')}", []).append(element)
    return named


def _referred(element: Element, attribute: str, named: dict[str, list[Element]]) -> Element:
    name = element.text(attribute)
    found = named.get(name, [])
    if len(found) != 1:
        why = f"as {len(found)} are called" if found else f"which is not there; {expected_names(name, named)}"
        raise _damaged(element, f"{element} refers to `{name[:60]}`, {why}")
    return found[0]


def _part(mesh: Element, part: Element) -> tuple[Array, Integers]:
    """Points and triangles of a part of a mesh; each material has a part."""
    if part.first("ph"):
        raise _damaged(part, f"found {part}: polygons with holes are not supported")
    inputs = {one.text("semantic"): one for one in part.all("input")}
    if "VERTEX" not in inputs:
        raise _damaged(part, f"{part} has no input of the semantic `VERTEX`")
    points = _points(mesh, _referred(inputs["VERTEX"], "source", _by_id(mesh.all("vertices"))))
    width, column = 1 + max(_whole(one, "offset") for one in part.all("input")), _whole(inputs["VERTEX"], "offset")
    lists = list[Integers]()
    for element in part.all("p"):
        numbers = _numbers(element, np.int64)
        if len(numbers) % width:
            found = f"{element} has {len(numbers):,} numbers, expected a multiple of {width:,}"
            raise _damaged(element, f"{found}, as many as a corner has")
        corners = numbers[column::width]
        wrong = np.flatnonzero((corners < 0) | (corners >= len(points)))
        if len(wrong):
            message = f"corner {wrong[0] + 1:,} of {element} refers to VERTEX {corners[wrong[0]]:,}"
            raise _damaged(element, f"{message}, expected one from 0 to {len(points) - 1:,}")
        lists.append(corners)
    corners, count = np.concatenate([np.empty(0, dtype=np.int64), *lists]), _whole(part, "count")
    sizes = np.array([len(one) for one in lists], dtype=np.int64)
    if part.tag == "triangles":
        sizes = np.full(len(corners) // 3, 3)
    elif part.tag == "polylist" and count:
        sizes = _numbers(part.need("vcount"), np.int64)
    if len(sizes) != count or sizes.sum() != len(corners):
        message = f"`count` is {count:,}, but there are {len(sizes):,} polygons of {sizes.sum():,} corners in all"
        raise _damaged(part, f"{part}: {message}, and its <p> has {len(corners):,}")
    if part.tag not in ("trifans", "tristrips"):
        return points, _cut(part.place.file, points, corners, sizes, lambda _: part.place.line)
    faces = [np.empty((0, 3), dtype=np.int64)]
    for one in lists:
        step = np.arange(max(len(one) - 2, 0))
        odd, first = (step % 2, step) if part.tag == "tristrips" else (0, 0 * step)
        faces.append(np.column_stack([one[first + odd], one[step + 1 - odd], one[step + 2]]))
    return points, np.concatenate(faces)


def _points(mesh: Element, vertices: Element) -> Array:
    inputs = {one.text("semantic"): one for one in vertices.all("input")}
    if "POSITION" not in inputs:
        raise _damaged(vertices, f"{vertices} has no input of the semantic `POSITION`")
    source = _referred(inputs["POSITION"], "source", _by_id(mesh.all("source")))
    array = source.need("float_array")
    numbers, stated = _numbers(array, np.float64), _whole(array, "count")
    if len(numbers) != stated:
        raise _damaged(array, f"{array}: found {len(numbers):,} numbers, expected {stated:,}, its `count`")
    accessor = next((one for common in source.all("technique_common") for one in common.all("accessor")), None)
    count, stride, offset = stated // 3, 3, 0
    if accessor is not None:
        count, stride, offset = _whole(accessor, "count"), _whole(accessor, "stride", 1), _whole(accessor, "offset", 0)
    if stride < 3 or offset + count * stride > stated:
        message = f"the accessor of {source} says {offset:,} + {count:,} x {stride:,} numbers"
        raise _damaged(source, f"{message}, expected three for each point, of {stated:,} in all")
    return numbers[offset : offset + count * stride].reshape(count, stride)[:, :3]


def _transformation(element: Element) -> Array:
    """The matrix (4, 4) of a transformation of a node."""
    numbers, X = _numbers(element, np.float64), np.eye(4)
    if len(numbers) != _NUMBERS[element.tag]:
        raise _damaged(element, f"{element}: found {len(numbers)} numbers, expected {_NUMBERS[element.tag]}")
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    if element.tag == "translate":
        X[:3, 3] = numbers
    elif element.tag == "scale":
        X[range(3), range(3)] = numbers
    else:
        axis, half = numbers[:3] / max(np.linalg.norm(numbers[:3]), SMALLEST_SIZE), np.radians(numbers[3]) / 2
        X[:3, :3] = quaternion_to_matrix((*np.sin(half) * axis, np.cos(half)))
    return X


def _numbers(element: Element, kind: Any) -> NDArray[Any]:  # noqa: ANN401 - a type of NumPy
    text = "".join(element.pieces)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)  # NumPy's sign that a text is not a list of numbers
            return np.fromstring(text, dtype=kind, sep=" ") if text.strip() else np.zeros(0, kind)
    except (ValueError, DeprecationWarning):
        words = enumerate(text.split(), 1)
        number, word = next(((number, word) for number, word in words if isnan(as_number(word))), (0, ""))
        found = f"number {number:,} is `{word[:60]}`, expected a number" if number else "expected whole numbers"
        raise _damaged(element, f"{element}: {found}") from None


def _whole(element: Element, attribute: str, default: int | None = None) -> int:
    if default is not None and attribute not in element.attributes:
        return default
    text = element.text(attribute)
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise _damaged(element, f"{element}: `{attribute}` is `{text[:60]}`, expected a whole number up to 999,999,999")
    return int(text)


_READERS: dict[str, Callable[[Path, bytes], _Surface]] = {".stl": _stl, ".obj": _obj, ".dae": _dae}
