"""What the simulator needs of the machine: Python packages, and an OpenGL that draws without a screen.

MuJoCo reads MUJOCO_GL when it is imported, and the import itself fails if that names a library that is missing.
"""

from __future__ import annotations

import ctypes.util
import os
import sys
from importlib.util import find_spec

from sqrp_cli.errors import InputError, bad_input

_PACKAGES = {"mujoco": "mujoco", "cv2": "opencv-contrib-python-headless"}
"""Modules of the extra `sim`, with the names under which pip installs them."""
_LIBRARIES = {"egl": ("EGL", "GL"), "osmesa": ("OSMesa",)}
"""Shared libraries behind each value of MUJOCO_GL that draws without a screen, the preferred one first."""
_DEBIAN = {"egl": "libegl1 libgl1 libgl1-mesa-dri", "osmesa": "libosmesa6"}


def check_simulator() -> None:
    """Make sure that MuJoCo can be imported and render; chooses the backend if MUJOCO_GL does not.

    Raises InputError, with the command that mends it, if a package or OpenGL is missing.
    """
    check_packages()
    chosen = os.environ.get("MUJOCO_GL", "").strip().lower()
    if chosen in ("off", "0", "no", "false", "disable", "disabled"):
        raise no_opengl(f"MUJOCO_GL is `{chosen}`, so MuJoCo may not draw")
    if not chosen and not sys.platform.startswith("linux"):
        return
    for backend in [chosen] if chosen else _LIBRARIES:
        absent = [f"lib{name}" for name in _LIBRARIES.get(backend, ()) if ctypes.util.find_library(name) is None]
        if not absent:
            os.environ["MUJOCO_GL"] = backend
            return
    if not chosen:
        raise no_opengl("no library of OpenGL is installed")
    raise no_opengl(f"MUJOCO_GL is `{chosen}`, but {' and '.join(absent)} is not installed", chosen)


def check_packages() -> None:
    """Make sure that the packages of the extra `sim` are installed. Raises InputError, with the command to install."""
    missing = [package for module, package in _PACKAGES.items() if find_spec(module) is None]
    if missing:
        message = f"images need {', '.join(missing)}, which belongs to the extra `sim`"
        raise bad_input("missing-extra", message, mend=f"pip install {' '.join(missing)}")


def no_opengl(reason: str, backend: str = "egl") -> InputError:
    """The error that says how to get an OpenGL that can draw; backend: the value of MUJOCO_GL to get it for."""
    message = (
        f"the simulated cameras need an OpenGL that draws without a screen: {reason} "
        f"(on Debian: {_DEBIAN['egl']} with MUJOCO_GL=egl, or {_DEBIAN['osmesa']} with MUJOCO_GL=osmesa)"
    )
    return bad_input("no-opengl", message, mend=f"apt install {_DEBIAN[backend]} && export MUJOCO_GL={backend}")
