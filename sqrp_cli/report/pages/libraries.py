"""The three.js viewer library, from the files of trimesh, and simplified meshes."""

from __future__ import annotations

from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.shapes import Triangles

MOST_TRIANGLES = 3000
"""Triangles of a part in a page; larger meshes are simplified to this many."""

_SAME_PLACE = 8
"""Vertices that are equal to so many decimals of a metre are one."""

_VIEWER = ("resources/templates/viewer.zip", "viewer.html.template")
"""Where trimesh keeps its own viewer page: an archive among its files, and the file in it."""


def check_libraries() -> None:
    """Raises InputError, with the command that installs them, where the libraries that a page needs are missing."""
    for name in ("trimesh", "fast_simplification"):
        _folder(name)


def viewer_library() -> str:
    """The text of three.js (MIT licence), a classic script that defines `THREE`.

    Raises InputError where trimesh is missing or does not carry it. Trimesh itself is not imported, as it takes long.
    """
    archive, name = _VIEWER
    try:
        with ZipFile(_folder("trimesh") / archive) as files:
            template = files.read(name).decode()
    except (OSError, KeyError, BadZipFile):
        template = ""
    _, _, script = template.partition("<script>")
    notice, found, rest = script.partition("*/\n")
    # After the licence comes the library as one line; what follows is the application of trimesh.
    library, _, _ = rest.partition("\n")
    if not found or "THREE={}" not in library or "</script" in library:
        message = f"trimesh {metadata.version('trimesh')} does not carry three.js where it was expected"
        raise InputError(Problem("no-viewer", message, mend="pip install 'trimesh==5.2.0'"))
    return f"{notice}*/\n{library}\n"


def simplified(surface: Triangles) -> Triangles:
    """A mesh with its equal vertices merged, and with at most about `MOST_TRIANGLES` triangles."""
    rounded = np.round(surface.vertices, _SAME_PLACE) + 0.0  # not -0.0
    _, first, which = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
    vertices, faces = surface.vertices[first], which.reshape(-1)[surface.faces]
    if len(faces) > MOST_TRIANGLES:
        check_libraries()
        from fast_simplification import simplify

        vertices, faces = simplify(vertices, faces, target_count=MOST_TRIANGLES)
    return Triangles(np.asarray(vertices, dtype=float), np.asarray(faces, dtype=np.int64))


def _folder(name: str) -> Path:
    """Where a package is installed. Raises InputError where it is not."""
    try:
        spec = find_spec(name)
    except ValueError:  # its import is blocked
        spec = None
    if spec is None or spec.origin is None:
        message = f"a report needs the Python package `{name}`, which is not installed"
        raise InputError(Problem("missing-extra", message, mend="pip install trimesh fast-simplification"))
    return Path(spec.origin).parent
