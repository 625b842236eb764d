"""Worlds of simulators: the solid shapes of what does not move in them, where the file puts them.

SDF: http://sdformat.org/spec. Joints stay at 0. Included models and meshes of `model://NAME/...` are looked up in the
folders of packages. Planes are left out; models that are not found too, with a warning.

MJCF, MuJoCo's format: https://mujoco.readthedocs.io/en/stable/XMLreference.html. Defaults of classes hold; included
files stand in their place. Geoms of the world are one object, those of each body in it another.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError, Place, Problem, expected_names
from sqrp_cli.files import packages
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.units import LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import MAX_BYTES, Element, parse_xml
from sqrp_cli.geometry import Array, axis_rotation, pose, quaternion_to_matrix, read_only, rpy_to_matrix
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import FIGURES, Mesh, Shape, shape_of


@dataclass(frozen=True, eq=False)
class Standing:
    """An object with its solid pieces."""

    name: str
    """As the file has it."""
    shapes: tuple[tuple[Shape, Array], ...]
    """Each shape with its pose in the file's frame, shape (4, 4)."""
    place: Place


class FixturesRead(NamedTuple):
    """What a file of another program says of fixed objects."""

    objects: list[Standing]
    warnings: list[Problem]
    """About what was left out or replaced."""
    content: bytes


class FixtureReader:
    """Reads one file, and collects warnings about what it leaves out or replaces."""

    def __init__(self, path: Path, warnings: list[Problem] | None = None) -> None:
        """warnings: a list that gets those of this file, too."""
        self.path = path
        self.warnings = [] if warnings is None else warnings

    def warn(self, message: str, place: Place, mend: str | None = None) -> None:
        """Collect a warning."""
        self.warnings.append(Problem("fixture-simplified", message, place, severity="warning", mend=mend))


_TEXTS = frozenset({"name", "pose", "size", "radius", "length", "uri", "scale"})

MOST_NESTED = 8  # most files of which each includes the next


def read_sdf(path: Path, content: bytes, roots: Sequence[Path]) -> FixturesRead:
    """The models of a world, each with its shapes, and warnings about what was left out.

    Raises InputError, with the line, for XML that is no SDF, poses relative to other frames, and wrong figures.
    """
    reader = _SdfReader(path, roots)
    root = parse_xml(path, content, "sdf", _TEXTS)
    holders = [*root.all("world"), root]
    models = [model for holder in holders for model in reader.models(holder)]
    return FixturesRead(models, reader.warnings, content)


class _SdfReader(FixtureReader):
    """Reads models and collects warnings."""

    def __init__(
        self, path: Path, roots: Sequence[Path], within: tuple[Path, ...] = (), warnings: list[Problem] | None = None
    ) -> None:
        """within: the files that lead to this one, itself included; warnings: gets those of this file, too."""
        super().__init__(path, warnings)
        self.roots, self.within = roots, within

    def models(self, holder: Element) -> Iterator[Standing]:
        for model in holder.all("model"):
            shapes = tuple(self._of_model(model, _pose(model)))
            if shapes:
                yield Standing(model.text("name"), shapes, model.place)
        for include in holder.all("include"):
            for model, shapes in self._included(include, np.eye(4)):
                if shapes:
                    yield Standing(_text(include, "name") or model.text("name"), shapes, include.place)

    def _included(self, include: Element, X: Array) -> Iterator[tuple[Element, tuple[tuple[Shape, Array], ...]]]:
        """The models of an included file, each with its shapes; its own pose counts unless the <include> has one."""
        uri = _text(include, "uri") or "no uri"
        reference = uri.replace("model://", "package://", 1)
        try:
            named = reference if reference.endswith(".sdf") else f"{reference}/model.sdf"
            file = packages.resolve(named, self.path.parent, self.roots, include.place)
        except InputError as error:
            message = f"the included model `{uri[:60]}` is left out: {error.problems[0].message}"
            self.warn(message, include.place, "name the folder that holds its folder under `robot.package_roots`")
            return
        if len(self.within) == MOST_NESTED or file in self.within:
            raise include.error("wrong-scene", f"`{uri[:60]}` includes itself, or is nested too deep")
        inner = _SdfReader(file, self.roots, (*self.within, file), self.warnings)
        for model in parse_xml(file, read_input(file, MAX_BYTES), "sdf", _TEXTS).all("model"):
            own = _pose(model if include.first("pose") is None else include)
            yield model, tuple(inner._of_model(model, X @ own))

    def _of_model(self, model: Element, X: Array) -> Iterator[tuple[Shape, Array]]:
        """The shapes of a model at a pose in the world."""
        for link in model.all("link"):
            X_link = X @ _pose(link)
            for collision in [*link.all("collision")] or [*link.all("visual")]:
                shape = self._shape(collision.need("geometry"))
                if shape is not None:
                    yield shape, read_only(X_link @ _pose(collision))
        for inner in model.all("model"):
            yield from self._of_model(inner, X @ _pose(inner))
        for include in model.all("include"):
            for _, shapes in self._included(include, X):
                yield from shapes

    def _shape(self, geometry: Element) -> Shape | None:
        holder = next(iter(geometry.children), None)
        if holder is None or holder.tag in ("plane", "empty"):
            return None
        if holder.tag == "mesh":
            uri = _text(holder, "uri") or ""
            x, y, z = _numbers(holder, "scale", 3) if holder.first("scale") is not None else (1.0, 1.0, 1.0)
            reference = uri.replace("model://", "package://", 1) if uri.startswith("model://") else uri
            file = packages.resolve(reference, self.path.parent, self.roots, holder.place)
            read_mesh(file, (x, y, z))
            return Mesh(file, (x, y, z))
        if holder.tag not in FIGURES:
            self.warn(f"a shape of the kind `{holder.tag[:40]}` is left out", geometry.place)
            return None
        figures = FIGURES[holder.tag].items()
        return shape_of(holder.tag, [number for key, count in figures for number in _numbers(holder, key, count)])


def _text(element: Element, tag: str) -> str | None:
    child = element.first(tag)
    return "".join(child.pieces).strip() if child is not None else None


def _pose(element: Element) -> Array:
    """The pose of an element in the one around it."""
    child = element.first("pose")
    if child is None:
        return np.eye(4)
    if child.attributes.get("relative_to") or child.attributes.get("frame"):
        message = "a pose relative to another frame is not read, expected one in what is around it"
        raise child.error("wrong-scene", message)
    words = "".join(child.pieces).split()
    if not words:
        return np.eye(4)
    x, y, z, *turns = _parsed(child, words, 6, -LARGEST_LENGTH)
    if child.attributes.get("degrees") == "true":
        turns = np.radians(turns).tolist()
    return pose(rpy_to_matrix((turns[0], turns[1], turns[2])), (x, y, z))


def _numbers(element: Element, tag: str, count: int) -> tuple[float, ...]:
    child = element.need(tag)
    return tuple(_parsed(child, "".join(child.pieces).split(), count, SMALLEST_SIZE))


def _parsed(element: Element, words: Sequence[str], count: int, least: float) -> list[float]:
    numbers = [as_number(word) for word in words]
    if len(numbers) != count or not all(least <= number <= LARGEST_LENGTH for number in numbers):
        found = " ".join(words)[:40]
        raise element.error("wrong-scene", f"<{element.tag}> is `{found}`, expected {count} number{'s' * (count > 1)}")
    return numbers


_SIZES = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}  # how many sizes a shape has, halves of its lengths
_PARALLEL = 1e-9  # length below which a vector has no direction
_INCLUDED = ("mujoco", "mujocoinclude")  # what the root of an included file is called


def read_mjcf(path: Path, content: bytes, roots: Sequence[Path]) -> FixturesRead:
    """The fixed bodies of a world, and warnings about what was left out.

    Raises InputError, with the line, for XML that is no MJCF, wrong figures and notations that are not read.
    """
    root = parse_xml(path, content, "mujoco")
    _include(root, path.parent, {path})
    reader = _MjcfReader(path, root, roots)
    return FixturesRead(reader.read(), reader.warnings, content)


def _include(holder: Element, folder: Path, known: set[Path]) -> None:
    """Put the content of included files in the place of every <include>; folder: of the main file.

    known: files so far. Raises InputError for a file that is missing, no MJCF, or included twice, which MuJoCo refuses.
    """
    for index in reversed([index for index, child in enumerate(holder.children) if child.tag == "include"]):
        include = holder.children[index]
        file = packages.resolve(include.text("file"), folder, (), include.place)
        if file in known:
            raise include.error("wrong-scene", f"`{include.text('file')}` is included twice", "include each file once")
        known.add(file)
        root = parse_xml(file, read_input(file, MAX_BYTES), None)
        if root.tag not in _INCLUDED:
            raise root.error("wrong-root", f"the file begins with <{root.shown_tag}>, expected <mujoco>")
        _include(root, folder, known)
        holder.children[index : index + 1] = root.children
    for child in holder.children:
        _include(child, folder, known)


class _MjcfReader(FixtureReader):
    """Reads bodies and collects warnings."""

    def __init__(self, path: Path, root: Element, roots: Sequence[Path]) -> None:
        super().__init__(path)
        self.root, self.roots = root, roots
        self.compiler = {key: value for one in root.all("compiler") for key, value in one.attributes.items()}
        self.defaults: dict[str, Mapping[str, str]] = {"main": {}}
        for default in root.all("default"):
            self._read_default(default, {})
        self.meshes = {
            mesh.attributes.get("name") or Path(mesh.text("file")).stem: mesh
            for asset in root.all("asset")
            for mesh in asset.all("mesh")
            if "file" in mesh.attributes
        }

    def read(self) -> list[Standing]:
        found = []
        for world in self.root.all("worldbody"):
            own = tuple(self._geoms(world, np.eye(4), None))
            found += [Standing(self.path.stem, own, world.place)] if own else []
            for body in world.all("body"):
                shapes = tuple(self._body(body, np.eye(4), None))
                name = body.attributes.get("name") or f"{self.path.stem}_body"
                found += [Standing(name, shapes, body.place)] if shapes else []
        return found

    def _read_default(self, default: Element, inherited: Mapping[str, str]) -> None:
        own = {key: value for geom in default.all("geom") for key, value in geom.attributes.items()}
        merged = {**inherited, **own}
        self.defaults[default.attributes.get("class", "main")] = merged
        for inner in default.all("default"):
            self._read_default(inner, merged)

    def _body(self, body: Element, X: Array, inherited: str | None) -> Iterator[tuple[Shape, Array]]:
        if any(body.first(tag) is not None for tag in ("joint", "freejoint")):
            self.warn(f"{body} can move, and is left out", body.place, "state it as an object of the workspace")
            return
        X, named = X @ self._pose(body, body.attributes), body.attributes.get("childclass", inherited)
        yield from self._geoms(body, X, named)
        for inner in body.all("body"):
            yield from self._body(inner, X, named)

    def _geoms(self, holder: Element, X: Array, named: str | None) -> Iterator[tuple[Shape, Array]]:
        geoms = []
        for geom in holder.all("geom"):
            wanted = geom.attributes.get("class", named) or "main"
            if wanted not in self.defaults:
                message = f"{geom} is of the class `{wanted}`, which no <default> has"
                raise geom.error("wrong-scene", f"{message}; {expected_names(wanted, self.defaults)}")
            geoms.append((geom, {**self.defaults[wanted], **geom.attributes}))
        solid = [pair for pair in geoms if pair[1].get("contype", "1") != "0" or pair[1].get("conaffinity", "1") != "0"]
        for geom, attributes in solid or geoms:
            placed = self._geom(geom, attributes)
            if placed is not None:
                yield placed[0], read_only(X @ placed[1])
        for frame in holder.all("frame"):
            inner = frame.attributes.get("childclass", named)
            yield from self._geoms(frame, X @ self._pose(frame, frame.attributes), inner)
            for body in frame.all("body"):
                yield from self._body(body, X @ self._pose(frame, frame.attributes), inner)

    def _geom(self, geom: Element, attributes: Mapping[str, str]) -> tuple[Shape, Array] | None:
        kind = attributes.get("type", "mesh" if "mesh" in attributes else "sphere")
        if kind == "mesh":
            name = attributes.get("mesh", "")
            if name not in self.meshes:
                expected = expected_names(name, self.meshes)
                raise geom.error("wrong-scene", f"{geom} has the unknown mesh `{name}`; {expected}")
            mesh = self.meshes[name]
            folder = self.compiler.get("meshdir") or self.compiler.get("assetdir") or ""
            reference = os.path.join(folder, mesh.text("file"))  # noqa: PTH118
            file = packages.resolve(reference, self.path.parent, self.roots, mesh.place)
            x, y, z = mesh.numbers("scale", 3, (1.0, 1.0, 1.0))
            read_mesh(file, (x, y, z))
            return Mesh(file, (x, y, z)), self._pose(geom, attributes)
        if kind not in _SIZES:
            if kind != "plane":
                self.warn(f"a geom of the type `{kind[:40]}` is left out", geom.place)
            return None
        if "fromto" in attributes:
            # A shape along a line from one point to another.
            if kind not in ("capsule", "cylinder"):
                raise geom.error("wrong-scene", f"`fromto` of a {kind} is not read, expected `pos` and `size`")
            ends = np.array(self._numbers(geom, attributes, "fromto", 6)).reshape(2, 3)
            along = ends[0] - ends[1]
            length = float(np.linalg.norm(along))
            if length < 1e-9:
                raise geom.error("wrong-scene", f"{geom}: `fromto` has two points in one place")
            R = self._upright(geom, np.cross(along, np.eye(3)[int(np.abs(along).argmin())]), along)
            radius = self._numbers(geom, attributes, "size", None)[0]
            return _shape(kind, [radius, length / 2]), pose(R, ends.mean(axis=0))
        sizes = self._numbers(geom, attributes, "size", None)
        if len(sizes) < _SIZES[kind] or min(sizes[: _SIZES[kind]]) <= 0.0:
            message = f"{geom} has the size `{attributes.get('size', '')}`, expected {_SIZES[kind]} above 0"
            raise geom.error("wrong-scene", message)
        return _shape(kind, sizes), self._pose(geom, attributes)

    def _pose(self, element: Element, attributes: Mapping[str, str]) -> Array:
        position = self._numbers(element, attributes, "pos", 3) if "pos" in attributes else [0.0, 0.0, 0.0]
        return pose(self._rotation(element, attributes), position)

    def _rotation(self, element: Element, attributes: Mapping[str, str]) -> Array:
        turn = 1.0 if self.compiler.get("angle") == "radian" else np.pi / 180
        if "quat" in attributes:
            w, x, y, z = self._numbers(element, attributes, "quat", 4)
            length = _length(element, "`quat`", [w, x, y, z])
            return quaternion_to_matrix((x / length, y / length, z / length, w / length))
        if "axisangle" in attributes:
            x, y, z, angle = self._numbers(element, attributes, "axisangle", 4)
            sine = np.sin(angle * turn / 2) / _length(element, "the axis of `axisangle`", [x, y, z])
            return quaternion_to_matrix((x * sine, y * sine, z * sine, np.cos(angle * turn / 2)))
        if "xyaxes" in attributes:
            axes = np.array(self._numbers(element, attributes, "xyaxes", 6)).reshape(2, 3)
            return self._upright(element, axes[0], np.cross(axes[0], axes[1]))
        if "zaxis" in attributes:
            up = np.array(self._numbers(element, attributes, "zaxis", 3))
            # The least turn of the z axis to this one keeps what is across both.
            across = np.cross([0.0, 0.0, 1.0], up)
            across = across if np.linalg.norm(across) > _PARALLEL else np.array([1.0, 0.0, 0.0])
            turned = self._upright(element, across, up)
            return turned @ self._upright(element, across, np.array([0.0, 0.0, 1.0])).T
        R = np.eye(3)
        if "euler" in attributes:
            angles = self._numbers(element, attributes, "euler", 3)
            order = self.compiler.get("eulerseq", "xyz")
            if len(order) != 3 or not set(order.lower()) <= set("xyz"):
                message = f"`eulerseq` is `{order[:40]}`, expected three of the letters x, y, z, X, Y and Z"
                compilers = [one for one in self.root.all("compiler") if "eulerseq" in one.attributes]
                raise compilers[-1].error("wrong-scene", message)
            for letter, angle in zip(order, angles, strict=True):
                step = axis_rotation("xyz".index(letter.lower()), angle * turn)
                R = R @ step if letter.islower() else step @ R
        return R

    def _upright(self, element: Element, x: Array, z: Array) -> Array:
        """The rotation with these axes, z across x; (3, 3)."""
        x_length, z_length = np.linalg.norm(x), np.linalg.norm(z)
        if min(x_length, z_length) < _PARALLEL:
            raise element.error("wrong-scene", f"{element}: an axis has length 0, or both have one direction")
        x, z = x / x_length, z / z_length
        return np.column_stack([x, np.cross(z, x), z])

    def _numbers(self, element: Element, attributes: Mapping[str, str], key: str, count: int | None) -> list[float]:
        text = attributes.get(key, "")
        numbers = [as_number(word) for word in text.split()]
        if not numbers or (count is not None and len(numbers) != count) or not np.isfinite(numbers).all():
            expected = "numbers" if count is None else f"{count} numbers"
            raise element.error("wrong-scene", f"{element}: `{key}` is `{text[:40]}`, expected {expected}")
        return numbers


def _length(element: Element, what: str, vector: Sequence[float]) -> float:
    """Of a vector. Raises InputError where it has none."""
    length = float(np.linalg.norm(vector))
    if length < _PARALLEL:
        raise element.error("wrong-scene", f"{element}: {what} has length 0")
    return length


def _shape(kind: str, sizes: Sequence[float]) -> Shape:
    """A shape of MuJoCo's half lengths."""
    halves = 0 if kind == "box" else 1  # a radius comes first of all others
    return shape_of(kind, [*sizes[:halves], *(2 * size for size in sizes[halves : _SIZES[kind]])])
