"""Worlds of simulators: the solid shapes of what does not move in them, where the file puts them.

SDF: http://sdformat.org/spec. Joints stay at 0. Included models and meshes of `model://NAME/...` are looked up in the
folders of packages. Planes are left out; models that are not found too, with a warning.

MuJoCo itself reads its format, MJCF: geoms of the world are one object, those of each body in it another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sqrp_cli.cell.mesh import read_mesh
from sqrp_cli.errors import InputError, Place, Problem, first_names
from sqrp_cli.files import packages
from sqrp_cli.files.input_file import read_input
from sqrp_cli.files.units import LARGEST_LENGTH, SMALLEST_SIZE, as_number
from sqrp_cli.files.xml_file import MAX_BYTES, Element, parse_xml
from sqrp_cli.geometry import Array, pose, read_only, rpy_to_matrix
from sqrp_cli.robot.mjcf import fixed_bodies
from sqrp_cli.shapes import FIGURES, Mesh, Shape, shape_of

Solid = tuple[Shape, Array]  # a shape with its pose in the file's frame, shape (4, 4)
_TEXTS = frozenset({"name", "pose", "size", "radius", "length", "uri", "scale"})
MOST_NESTED = 8  # most files of which each includes the next


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

    Raises InputError for XML that is no MJCF, and for what MuJoCo cannot read.
    """
    place = parse_xml(path, content, "mujoco").place
    bodies, lost = fixed_bodies(path)
    for name, solids in bodies:
        shapes = [(mesh_at(shape[0], path.parent, roots, place, shape[1]) if isinstance(shape, tuple) else shape, X_WS)
                  for shape, X_WS in solids]  # fmt: skip
        yield Standing(name, tuple(shapes), place)
    warnings += [simplified(f"{said}: {first_names(names)}", place) for said, names in lost.items()]
