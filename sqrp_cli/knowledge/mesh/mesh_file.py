"""A look at mesh files before they are loaded: whether they are whole and consistent, and how many triangles they have.

The loaders behind collision geometry and pictures take damaged files for smaller meshes, do not stop at large ones, and
allocate whatever a number in a file tells them to. What has passed here neither surprises them nor takes them long.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.knowledge.mesh.collada import check_dae
from sqrp_cli.knowledge.mesh.limits import MAX_BYTES, MAX_TEXT_BYTES, check_bytes, check_triangles
from sqrp_cli.knowledge.mesh.obj import check_obj
from sqrp_cli.knowledge.mesh.stl import check_stl


def check_mesh(path: Path) -> None:
    """Raises InputError, with line or byte, for a mesh file that is no STL, OBJ or DAE, too large, empty or damaged.

    Raises OSError if the file cannot be read.
    """
    stat = path.stat()
    _check(path, stat.st_size, stat.st_mtime_ns)


@lru_cache(maxsize=4096)
def _check(path: Path, size: int, _time: int) -> None:
    """As `check_mesh`; a file that has not changed is not looked through again."""
    suffix = path.suffix.lower()
    check_bytes(path, size, MAX_BYTES if suffix == ".stl" else MAX_TEXT_BYTES)
    match suffix:
        case ".stl":
            count = check_stl(path, size)
        case ".obj":
            count = check_obj(path)
        case ".dae":
            count = check_dae(path)
        case _:
            message = f"found a mesh with the ending `{path.suffix}`, expected .stl, .obj or .dae"
            mend = "export it as one of these"
            raise InputError(Problem("unknown-mesh", message, Place(path), mend=mend))
    check_triangles(path, count)
