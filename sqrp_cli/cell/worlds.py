"""Worlds of simulators: the solid shapes of what does not move in them, where the file puts them.

SDF: http://sdformat.org/spec. Joints stay at 0. Included models and meshes of `model://NAME/...` are looked up in the
folders of packages. Planes are left out; models that are not found too, with a warning.

MJCF, MuJoCo's format: https://mujoco.readthedocs.io/en/stable/XMLreference.html. Defaults of classes hold; included
files stand in their place. Geoms of the world are one object, those of each body in it another.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
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

Solid = tuple[Shape, Array]  # a shape with its pose in the file's frame, shape (4, 4)
_TEXTS = frozenset({"name", "pose", "size", "radius", "length", "uri", "scale"})
MOST_NESTED = 8  # most files of which each includes the next
_SIZES = {"box": 3, "sphere": 1, "capsule": 2, "cylinder": 2}  # how many sizes MuJoCo's shapes have, halves of lengths
_PARALLEL = 1e-9  # length below which a vector has no direction


class Standing(NamedTuple):
    """An object with its solid pieces."""

    name: str
    """As the file has it."""
    shapes: tuple[Solid, ...]
    place: Place


def simplified(message: str, place: Place, mend: str | None = None) -> Problem:
    """A warning about what was left out or replaced."""
    return Problem("fixture-simplified", message, place, severity="warning", mend=mend)


def mesh_at(reference: str, folder: Path, roots: Sequence[Path], place: Place, scale: Sequence[float]) -> Mesh:
    """The mesh that a file in a folder names at a place. Raises InputError where there is none, or it is damaged."""
    x, y, z = scale
    mesh = Mesh(packages.resolve(reference, folder, roots, place), (x, y, z))
    read_mesh(mesh.path, mesh.scale)
    return mesh


def read_sdf(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
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
                warnings.append(simplified(message, include.place, mend))
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
                    scale = _sdf_numbers(holder, "scale", 3) if holder.first("scale") else [1.0, 1.0, 1.0]
                    shape = mesh_at(reference, files[-1].parent, roots, holder.place, scale)
                elif holder.tag in FIGURES:
                    stated = (_sdf_numbers(holder, key, count) for key, count in FIGURES[holder.tag].items())
                    shape = shape_of(holder.tag, list(chain.from_iterable(stated)))
                else:
                    message = f"a shape of the kind `{holder.tag[:40]}` is left out"
                    warnings.append(simplified(message, geometry.place))
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


def read_mjcf(path: Path, content: bytes, roots: Sequence[Path], warnings: list[Problem]) -> Iterator[Standing]:
    """The fixed bodies of a world, each with its shapes; warnings: gets those about what was left out.

    Raises InputError, with the line, for XML that is no MJCF, wrong figures and notations that are not read.
    """
    root = parse_xml(path, content, "mujoco")
    _include(root, path.parent, {path})
    defaults: dict[str, Mapping[str, str]] = {"main": {}}
    waiting: list[tuple[Element, Mapping[str, str]]] = [(root, {})]
    for holder, inherited in waiting:
        for default in holder.all("default"):
            own = {key: value for geom in default.all("geom") for key, value in geom.attributes.items()}
            defaults[default.attributes.get("class", "main")] = {**inherited, **own}
            waiting.append((default, {**inherited, **own}))
    compilers = list(root.all("compiler"))
    settings = {key: value for one in compilers for key, value in one.attributes.items()}
    meshes = [mesh for asset in root.all("asset") for mesh in asset.all("mesh") if "file" in mesh.attributes]
    named = {mesh.attributes.get("name") or Path(mesh.text("file")).stem: mesh for mesh in meshes}
    bodies = _Bodies(path.parent, roots, compilers, settings, defaults, named, warnings)
    for world in root.all("worldbody"):
        for holder in (world, *world.all("body")):
            name = path.stem if holder is world else holder.attributes.get("name") or f"{path.stem}_body"
            yield Standing(name, tuple(bodies.solids(holder, np.eye(4), None)), holder.place)


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
        if root.tag not in ("mujoco", "mujocoinclude"):
            raise root.error("wrong-root", f"the file begins with <{root.tag}>, expected <mujoco>")
        _include(root, folder, known)
        holder.children[index : index + 1] = root.children
    for child in holder.children:
        _include(child, folder, known)


@dataclass(eq=False)
class _Bodies:
    """Reads the bodies of a file of MuJoCo."""

    folder: Path
    roots: Sequence[Path]
    compilers: list[Element]
    settings: Mapping[str, str]  # of all compilers
    defaults: Mapping[str, Mapping[str, str]]  # attributes of geoms by class
    meshes: Mapping[str, Element]
    warnings: list[Problem]  # gets those about what was left out

    def solids(self, holder: Element, X: Array, named: str | None) -> Iterator[Solid]:
        """The shapes of a body or frame in one at pose X, and of those in it; of the world without its bodies.

        named: the class of its geoms, if it names none. Nothing, with a warning, of a body that can move.
        """
        if holder.tag == "body" and any(holder.first(tag) is not None for tag in ("joint", "freejoint")):
            mend = "state it as an object of the workspace"
            self.warnings.append(simplified(f"{holder} can move, and is left out", holder.place, mend))
            return
        if holder.tag != "worldbody":
            X, named = X @ self._pose(holder), holder.attributes.get("childclass", named)
        geoms = []
        for geom in holder.all("geom"):
            wanted = geom.attributes.get("class", named) or "main"
            if wanted not in self.defaults:
                message = f"{geom} is of the class `{wanted}`, which no <default> has"
                raise geom.error("wrong-scene", f"{message}; {expected_names(wanted, self.defaults)}")
            geoms.append(replace(geom, attributes={**self.defaults[wanted], **geom.attributes}))
        solid = [one for one in geoms if any(one.attributes.get(key) != "0" for key in ("contype", "conaffinity"))]
        for geom in solid or geoms:
            if (placed := self._geom(geom)) is not None:
                yield placed[0], read_only(X @ placed[1])
        for inner in (*holder.all("frame"), *(holder.all("body") if holder.tag != "worldbody" else ())):
            yield from self.solids(inner, X, named)

    def _geom(self, geom: Element) -> Solid | None:
        """The shape of a geom in its body; None for one that is left out."""
        kind = geom.attributes.get("type", "mesh" if "mesh" in geom.attributes else "sphere")
        if kind == "mesh":
            name = geom.attributes.get("mesh", "")
            if name not in self.meshes:
                expected = expected_names(name, self.meshes)
                raise geom.error("wrong-scene", f"{geom} has the unknown mesh `{name}`; {expected}")
            mesh = self.meshes[name]
            folder = self.settings.get("meshdir") or self.settings.get("assetdir") or ""
            reference = os.path.join(folder, mesh.text("file"))  # noqa: PTH118
            scale = mesh.numbers("scale", 3, (1.0, 1.0, 1.0))
            return mesh_at(reference, self.folder, self.roots, mesh.place, scale), self._pose(geom)
        if kind not in _SIZES:
            if kind != "plane":
                self.warnings.append(simplified(f"a geom of the type `{kind[:40]}` is left out", geom.place))
            return None
        needed, is_line = _SIZES[kind], "fromto" in geom.attributes
        if is_line and kind not in ("capsule", "cylinder"):
            raise geom.error("wrong-scene", f"`fromto` of a {kind} is not read, expected `pos` and `size`")
        stated = geom.attributes.get("size", "")
        sizes, needed = [as_number(word) for word in stated.split()], 1 if is_line else needed
        if len(sizes) < needed or not all(0.0 < size < np.inf for size in sizes[:needed]):
            raise geom.error("wrong-scene", f"{geom} has the size `{stated[:40]}`, expected {needed} above 0")
        if is_line:  # from one point to another
            ends = np.array(geom.numbers("fromto", 6)).reshape(2, 3)
            along = ends[0] - ends[1]
            if (length := float(np.linalg.norm(along))) < _PARALLEL:
                raise geom.error("wrong-scene", f"{geom}: `fromto` has two points in one place")
            sizes, across = [sizes[0], length / 2], np.cross(along, np.eye(3)[int(np.abs(along).argmin())])
            axes = [*across / np.linalg.norm(across), *np.cross(along, across)]
            stands = {"xyaxes": axes, "pos": ends.mean(axis=0)}
            geom = replace(geom, attributes={key: " ".join(map(str, values)) for key, values in stands.items()})
        radii = 0 if kind == "box" else 1  # a radius comes before the half lengths
        shape = shape_of(kind, [*sizes[:radii], *(2 * size for size in sizes[radii : _SIZES[kind]])])
        return shape, self._pose(geom)

    def _pose(self, element: Element) -> Array:
        """The pose of an element in the one around it."""
        R, stated = np.eye(3), element.attributes
        turn = 1.0 if self.settings.get("angle") == "radian" else np.pi / 180
        quaternion = np.array([0.0, 0.0, 0.0, 1.0])
        if "quat" in stated:
            quaternion = np.roll(element.numbers("quat", 4), -1)
        elif "axisangle" in stated:
            *axis, angle = element.numbers("axisangle", 4)
            half, length = angle * turn / 2, float(np.linalg.norm(axis))
            quaternion = np.array([*np.sin(half) * np.array(axis), np.cos(half) * length])
        elif "xyaxes" in stated:
            x, y = np.array(element.numbers("xyaxes", 6)).reshape(2, 3)
            lengths = np.linalg.norm(x), np.linalg.norm(np.cross(x, y))
            if min(lengths) < _PARALLEL:
                raise element.error("wrong-scene", f"{element}: an axis has length 0, or both have one direction")
            x, z = x / lengths[0], np.cross(x, y) / lengths[1]
            R = np.column_stack([x, np.cross(z, x), z])
        elif "zaxis" in stated:  # the least turn of the z axis to this one, about what is across both
            up = np.array(element.numbers("zaxis", 3))
            across = np.cross([0.0, 0.0, 1.0], up)
            half = np.arctan2(np.linalg.norm(across), up[2]) / 2
            unit = across / np.linalg.norm(across) if np.linalg.norm(across) > _PARALLEL else np.array([1.0, 0.0, 0.0])
            quaternion = np.linalg.norm(up) * np.array([*np.sin(half) * unit, np.cos(half)])
        elif "euler" in stated:
            order = self.settings.get("eulerseq", "xyz")
            if len(order) != 3 or not set(order.lower()) <= set("xyz"):
                message = f"`eulerseq` is `{order[:40]}`, expected three of the letters x, y, z, X, Y and Z"
                place = [one for one in self.compilers if "eulerseq" in one.attributes][-1]
                raise place.error("wrong-scene", message)
            for letter, angle in zip(order, element.numbers("euler", 3), strict=True):
                step = axis_rotation("xyz".index(letter.lower()), angle * turn)
                R = R @ step if letter.islower() else step @ R
        if np.linalg.norm(quaternion) < _PARALLEL:
            raise element.error("wrong-scene", f"{element}: its quaternion, or an axis has length 0")
        return pose(R @ quaternion_to_matrix(quaternion), element.numbers("pos", 3, (0.0, 0.0, 0.0)))
