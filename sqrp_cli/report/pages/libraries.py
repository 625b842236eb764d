"""From trimesh: the three.js viewer library that it ships, and simplified meshes."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.shapes import Triangles

MOST_TRIANGLES = 3000
"""Triangles of a part in a page; larger meshes are simplified to this many."""

_VIEWER = ("templates/viewer.zip", "viewer.html.template")
"""Where trimesh keeps its own viewer page: an archive among its resources, and the file in it."""


def check_libraries() -> None:
    """Raises InputError, with the command that installs them, where the libraries that a page needs are missing."""
    _trimesh()


def viewer_library() -> str:
    """The text of three.js (MIT licence), a classic script that defines `THREE`.

    Raises InputError where trimesh is missing or does not carry it.
    """
    trimesh = _trimesh()
    archive, name = _VIEWER
    files = trimesh.util.decompress(trimesh.resources.get_bytes(archive), file_type="zip")
    template = files[name].read().decode() if name in files else ""
    _, _, script = template.partition("<script>")
    notice, found, rest = script.partition("*/\n")
    # After the licence comes the library as one line; what follows is the application of trimesh.
    library, _, _ = rest.partition("\n")
    if not found or "THREE={}" not in library or "</script" in library:
        message = f"trimesh {trimesh.__version__} does not carry three.js where it was expected"
        raise InputError(Problem("no-viewer", message, mend="pip install 'trimesh==5.2.0'"))
    return f"{notice}*/\n{library}\n"


def simplified(surface: Triangles) -> Triangles:
    """A mesh with its equal vertices merged, and with at most about `MOST_TRIANGLES` triangles."""
    mesh = _trimesh().Trimesh(surface.vertices, surface.faces, process=True)
    if len(mesh.faces) > MOST_TRIANGLES:
        mesh = mesh.simplify_quadric_decimation(face_count=MOST_TRIANGLES)
    return Triangles(np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces, dtype=np.int64))


def _trimesh() -> ModuleType:
    try:
        with interrupts_later():
            import fast_simplification  # noqa: F401 # trimesh imports it only when it simplifies
            import trimesh
            import trimesh.resources
    except ImportError as error:
        message = f"a report needs the Python package `{error.name}`, which is not installed"
        raise InputError(Problem("missing-extra", message, mend="pip install trimesh fast-simplification")) from error
    module: ModuleType = trimesh
    return module
