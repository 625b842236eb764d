"""Check of COLLADA (DAE) files: every number that a loader uses as a size, a count or an index.

The format: https://www.khronos.org/files/collada_spec_1_4.pdf.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.errors import InputError, expected_names
from sqrp_cli.geometry import Array
from sqrp_cli.knowledge.mesh.limits import MAX_NUMBER, NUMBERS, check_corners, check_pieces, damaged
from sqrp_cli.knowledge.text.xml_file import MAX_DEPTH, Element, parse_xml

Integers = NDArray[np.int64]

MOST_INPUTS = 32
"""Most inputs of a primitive."""

_ARRAYS = ("float_array", "Name_array", "IDREF_array")
_FIXED = {"triangles": 3, "lines": 2}
"""Corners of primitives with a fixed number of them."""

_CONTINUED = ("polygons", "trifans", "tristrips", "linestrips")
"""Primitives with a list of indices for each polygon."""

_PRIMITIVES = (*_FIXED, "polylist", *_CONTINUED)
_NO_AREA = ("lines", "linestrips")
_POSES = {"matrix": 16, "rotate": 4, "translate": 3, "scale": 3, "skew": 7, "lookat": 9}
"""Transformations of a node, and their numbers."""

_TEXTS = frozenset((*_ARRAYS, *_POSES, "p", "vcount"))

_PARENTS: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(_ARRAYS, ("source",)),
    **dict.fromkeys(_PRIMITIVES, ("mesh",)),
    "accessor": ("technique_common",),
    "input": (*_PRIMITIVES, "vertices", "sampler"),
    "p": _PRIMITIVES,
    "vcount": ("polylist",),
    "mesh": ("geometry",),
    "geometry": ("library_geometries",),
    "vertices": ("mesh",),
    "visual_scene": ("library_visual_scenes",),
    "node": ("node", "visual_scene", "library_nodes"),
    "instance_geometry": ("node",),
    "instance_node": ("node",),
}
"""Where elements may be; loaders find some of them elsewhere, too."""

_BENT = {"controller": "skins and morphs", "instance_controller": "skins and morphs", "ph": "polygons with holes"}
"""Elements that no rigid mesh has and that loaders treat differently."""


@dataclass(frozen=True)
class _Load:
    """The work of the loader for a node or geometry."""

    triangles: int = 0
    pieces: int = 0

    def __add__(self, other: _Load) -> _Load:
        return _Load(self.triangles + other.triangles, self.pieces + other.pieces)


def check_dae(path: Path) -> int:
    """The number of triangles, each counted as often as it is placed. Raises InputError for a damaged file."""
    root = parse_xml(path, path.read_bytes(), "COLLADA", _TEXTS)
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # numpy's sign that a text is not a list of numbers
        load = _Collada(path, root).load()
    check_pieces(path, load.pieces, "nodes and placed geometries")
    return load.triangles


class _Collada:
    """Checks a file from its sources over its geometries to the scene that places them."""

    def __init__(self, path: Path, root: Element) -> None:
        self._path, self._root = path, root
        self._ambiguous: set[str] = set()
        self._named: dict[str, Element] = {}
        self._counts: dict[str, int] = {}
        self._geometries: dict[str, _Load] = {}
        self._weights: dict[int, _Load] = {}
        self._open: set[int] = set()

    def load(self) -> _Load:
        """The load of all scenes together."""
        self._check_places(self._root)
        for element in self._root.inside():
            tags = [child.tag for child in element.children] if element.tag == "source" else []
            if "technique_common" in tags or not set(_ARRAYS).isdisjoint(tags):
                count = _source_count(element)
                if count is not None:
                    self._counts[element.text("id")] = count
        for library in self._root.all("library_geometries"):
            for geometry in library.all("geometry"):
                load = sum((_mesh_load(mesh, self._counts) for mesh in geometry.all("mesh")), _Load())
                self._geometries[geometry.attributes.get("id", "")] = load
        scenes = [scene for library in self._root.all("library_visual_scenes") for scene in library.all("visual_scene")]
        return sum((self._weigh(scene, 0) for scene in scenes), _Load())

    def _check_places(self, element: Element) -> None:
        for child in element.children:
            if child.tag in _BENT:
                raise _wrong(child, f"found {child}: {_BENT[child.tag]} are not supported")
            if element.tag not in _PARENTS.get(child.tag, (element.tag,)):
                expected = ", ".join(f"<{tag}>" for tag in _PARENTS[child.tag])
                raise _wrong(child, f"found {child} in {element}, expected it in {expected}")
            self._name(child)
            self._check_places(child)

    def _name(self, element: Element) -> None:
        """Record an element that others refer to by its id."""
        name = element.attributes.get("id")
        if name is None or element.tag not in ("geometry", "source", "vertices", "node", *_ARRAYS):
            return
        if name in self._named and element.tag != "node":
            message = f"{element} has the id `{name}`, as the element of line {self._named[name].place.line} has"
            raise _wrong(element, message)
        if name in self._named:  # of nodes: matters only if one of them is placed by its name
            self._ambiguous.add(name)
        self._named.setdefault(name, element)

    def _weigh(self, node: Element, depth: int) -> _Load:
        """The load of a node or scene, with all that it places."""
        key = id(node)
        if key in self._open:
            raise _wrong(node, f"{node} places itself")
        if depth > MAX_DEPTH:
            raise _wrong(node, f"nodes place each other in more than {MAX_DEPTH} levels")
        if key not in self._weights:
            self._open.add(key)
            self._weights[key] = sum((self._placed(child, depth) for child in node.children), _Load(0, 1))
            self._open.remove(key)
        return self._weights[key]

    def _placed(self, child: Element, depth: int) -> _Load:
        if child.tag == "node":
            return self._weigh(child, depth + 1)
        if child.tag == "instance_node":
            return self._weigh(self._referred(child, "node"), depth + 1)
        if child.tag == "instance_geometry":
            return self._geometries[self._referred(child, "geometry").attributes["id"]]
        if child.tag in _POSES:
            _floats(child, _POSES[child.tag])
        return _Load()

    def _referred(self, instance: Element, tag: str) -> Element:
        url = instance.text("url")
        found = self._named.get(url.removeprefix("#")) if url.startswith("#") else None
        if found is None or found.tag != tag:
            names = [f"#{name}" for name, element in self._named.items() if element.tag == tag]
            raise _wrong(
                instance,
                f"{instance} refers to `{url[:60]}`, which is no {tag} of this file; {expected_names(url, names)}",
            )
        if url.removeprefix("#") in self._ambiguous:
            raise _wrong(instance, f"{instance} refers to `{url[:60]}`, which more than one node is called")
        return found


def _mesh_load(mesh: Element, counts: dict[str, int]) -> _Load:
    """The load of a mesh; counts: number of values in each source of the file."""
    own = {source.text("id"): counts[source.text("id")] for source in mesh.all("source") if source.text("id") in counts}
    vertices = list(mesh.all("vertices"))
    primitives = [child for child in mesh.children if child.tag in _PRIMITIVES]
    if len(vertices) != 1:
        raise _wrong(mesh, f"{mesh} has {len(vertices)} times <vertices>, expected once")
    known = {f"#{name}": count for name, count in own.items()}
    inputs = {element.text("semantic"): _referred_count(element, known) for element in vertices[0].all("input")}
    if "POSITION" not in inputs:
        raise _wrong(vertices[0], f"{vertices[0]} has no input of the semantic `POSITION`")
    corners = f"#{vertices[0].text('id')}"
    triangles = sum(
        _primitive_triangles(child, {**known, corners: min(inputs.values())}, corners) for child in primitives
    )
    return _Load(triangles, len(primitives))


def _referred_count(element: Element, known: dict[str, int]) -> int:
    source = element.text("source")
    if source not in known:
        message = (
            f"{element} refers to `{source[:60]}`, which is no source of this mesh; {expected_names(source, known)}"
        )
        raise _wrong(element, message)
    return known[source]


@dataclass(frozen=True)
class _Input:
    """An input of a primitive: its index within a corner, the number of values to refer to, and its semantic."""

    offset: int
    count: int
    semantic: str


def _primitive_triangles(primitive: Element, known: dict[str, int], vertices: str) -> int:
    """The number of triangles that a primitive is cut into; known: number of values of each reference."""
    inputs = _inputs(primitive, known, vertices)
    count = _integer(primitive, "count")
    lists = [(element, _indices(element)) for element in primitive.all("p")]
    if count == 0 and not any(len(numbers) for _, numbers in lists):
        return 0
    width = 1 + max(entry.offset for entry in inputs)
    sizes = _sizes(primitive, count, [(element, len(numbers)) for element, numbers in lists], width)
    for element, numbers in lists:
        _check_range(element, numbers.reshape(-1, width), inputs)
    return 0 if primitive.tag in _NO_AREA else int(sizes.sum()) - 2 * len(sizes)


def _inputs(primitive: Element, known: dict[str, int], vertices: str) -> list[_Input]:
    tags = [child.tag for child in primitive.children if child.tag in ("input", "vcount", "p")]
    if tags != sorted(tags, key=("input", "vcount", "p").index):
        raise _wrong(primitive, f"{primitive} has the order {', '.join(tags[:5])}, expected input, vcount, p")
    inputs = []
    for element in primitive.all("input"):
        offset, semantic = _integer(element, "offset"), element.text("semantic")
        if offset >= MOST_INPUTS:
            raise _wrong(element, f"{element}: `offset` is {offset:,}, expected less than {MOST_INPUTS}")
        if (semantic == "VERTEX") != (element.text("source") == vertices):
            raise _wrong(element, f"{element} with the semantic {semantic} refers to `{element.text('source')[:60]}`")
        inputs.append(_Input(offset, _referred_count(element, known), semantic))
    if [entry.semantic for entry in inputs].count("VERTEX") != 1 or len(inputs) > MOST_INPUTS:
        raise _wrong(
            primitive, f"{primitive} has {len(inputs)} inputs, expected one with the semantic `VERTEX` among them"
        )
    return inputs


def _sizes(primitive: Element, count: int, lists: list[tuple[Element, int]], width: int) -> Integers:
    """How many corners each polygon (or triangle) has; a strip of n corners counts as one of n."""
    if primitive.tag in _CONTINUED:
        if len(lists) != count:
            raise _wrong(primitive, f"{primitive} has {len(lists):,} times <p>, but `count` is {count:,}")
        sizes = [_corners(element, length, width) for element, length in lists]
        for (element, _), size in zip(lists, sizes, strict=True):
            if primitive.tag not in _NO_AREA:  # the corners of a strip are not a polygon
                check_corners(
                    element.place.file, min(size, 3) if "strips" in primitive.tag else size, element.place.line or 0
                )
        return np.array(sizes, dtype=np.int64)
    if len(lists) != 1:
        raise _wrong(primitive, f"{primitive} has {len(lists):,} times <p>, expected once")
    element, length = lists[0]
    found = _corners(element, length, width)
    stated = _stated_sizes(primitive, count, found)
    if int(stated.sum()) != found:
        raise _wrong(primitive, f"{primitive} needs {int(stated.sum()):,} corners, but its <p> has {found:,}")
    return stated


def _corners(element: Element, length: int, width: int) -> int:
    if length % width:
        raise _wrong(
            element, f"{element} has {length:,} numbers, expected a multiple of {width}, as many as a corner has"
        )
    return length // width


def _stated_sizes(primitive: Element, count: int, found: int) -> Integers:
    if primitive.tag in _FIXED:
        size = _FIXED[primitive.tag]
        if count * size != found:
            message = (
                f"{primitive}: `count` is {count:,}, which are {count * size:,} corners, but its <p> has {found:,}"
            )
            raise _wrong(primitive, message)
        return np.broadcast_to(np.int64(size), count)
    counts = [_indices(element) for element in primitive.all("vcount")]
    if len(counts) != 1 or len(counts[0]) != count:
        stated = f"{len(counts[0]):,} numbers in its <vcount>" if len(counts) == 1 else f"{len(counts)} times <vcount>"
        raise _wrong(primitive, f"{primitive} has {stated}, but `count` is {count:,}")
    for size in (counts[0].min(initial=3), counts[0].max(initial=3)):
        check_corners(primitive.place.file, int(size), primitive.place.line or 0)
    return counts[0]


def _check_range(element: Element, corners: Integers, inputs: list[_Input]) -> None:
    for entry in inputs:
        column = corners[:, entry.offset]
        if len(column) and column.max() >= entry.count:
            at = int((column >= entry.count).argmax())
            message = f"corner {at + 1:,} of {element} refers to {entry.semantic} {column[at]:,}"
            raise _wrong(element, f"{message}, expected one from 0 to {entry.count - 1:,}")


def _wrong(element: Element, message: str) -> InputError:
    return damaged(message, element.place.file, element.place.line)


def _integer(element: Element, attribute: str, default: int | None = None) -> int:
    """A whole number from 0 on with at most nine digits."""
    if default is not None and attribute not in element.attributes:
        return default
    text = element.text(attribute)
    if not (text.isascii() and text.isdigit() and len(text) <= 9):
        raise _wrong(
            element, f"{element}: `{attribute}` is `{text[:60]}`, expected a whole number from 0 to 999,999,999"
        )
    return int(text)


def _floats(element: Element, count: int) -> Array:
    """The text of an element as `count` numbers that loaders hold."""
    numbers = _numbers(element, np.dtype(np.float64))
    if len(numbers) != count or not (np.abs(numbers) <= MAX_NUMBER).all():
        bad = np.flatnonzero(~(np.abs(numbers) <= MAX_NUMBER))
        what = (
            f"number {bad[0] + 1:,} is {numbers[bad[0]]:g}, expected {NUMBERS}"
            if len(bad)
            else f"found {len(numbers):,} numbers, expected {count:,}"
        )
        raise _wrong(element, f"{element}: {what}")
    return numbers


def _indices(element: Element) -> Integers:
    """The text of an element as whole numbers from 0 on."""
    numbers: Integers = _numbers(element, np.dtype(np.int64))
    if len(numbers) and numbers.min() < 0:
        at = int((numbers < 0).argmax())
        raise _wrong(element, f"{element}: number {at + 1:,} is {numbers[at]}, expected one from 0 on")
    return numbers


def _numbers(element: Element, kind: np.dtype[Any]) -> NDArray[Any]:
    text = "".join(element.pieces)
    element.pieces.clear()
    if not text.strip():
        return np.zeros(0, kind)
    try:
        return np.fromstring(text, dtype=kind, sep=" ")
    except (ValueError, DeprecationWarning) as error:
        raise _wrong(element, f"{element}: {_first_wrong(text, kind)}") from error


def _first_wrong(text: str, kind: np.dtype[Any]) -> str:
    """The first word in a list of numbers that is not a number."""
    for number, word in enumerate(text.split(), 1):
        try:
            np.fromstring(word, dtype=kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return f"number {number:,} is `{word[:60]}`, expected a number"
    return "expected numbers"


def _source_count(source: Element) -> int | None:
    """Number of values that others may refer to; None if the source has no accessor."""
    arrays = [child for child in source.children if child.tag in _ARRAYS]
    if len(arrays) != 1:
        raise _wrong(source, f"{source} has {len(arrays)} arrays, expected one")
    length = _length(arrays[0])
    common = source.first("technique_common")
    accessor = None if common is None else common.first("accessor")
    if accessor is None:
        return None
    reference, name = accessor.text("source"), arrays[0].text("id")
    if reference != f"#{name}":
        raise _wrong(accessor, f"{accessor} refers to `{reference[:60]}`, expected `#{name}`")
    count, stride, offset = (_integer(accessor, *pair) for pair in (("count",), ("stride", 1), ("offset", 0)))
    if stride == 0 or len(list(accessor.all("param"))) > stride:
        parameters = len(list(accessor.all("param")))
        raise _wrong(
            accessor, f"{accessor} has {parameters} parameters and the stride {stride}, expected no more than that"
        )
    if offset + count * stride > length:
        message = f"{accessor} says {offset:,} + {count:,} x {stride:,} values, of {length:,} that there are"
        raise _wrong(accessor, message)
    return count


def _length(array: Element) -> int:
    """The number of values of an array, checked against its `count`."""
    count = _integer(array, "count")
    if array.tag == "float_array":
        _floats(array, count)
    else:
        found = len("".join(array.pieces).split())
        if found != count:
            raise _wrong(array, f"{array}: found {found:,} names, expected {count:,}")
    return count
