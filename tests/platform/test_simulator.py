"""What is said where the simulator cannot run; and that nothing else needs it."""

from __future__ import annotations

import ctypes.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sqrp_cli.platform import simulator
from sqrp_cli.platform.simulator import check_simulator
from sqrp_cli.run.record.events import VERSION, event
from sqrp_cli.run.record.log import written_log
from sqrp_cli.run.record.report import RunReport
from tests.cells import ROOT, refused

INSTALL = "pip install mujoco opencv-contrib-python-headless"


def test_a_missing_package_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulator, "find_spec", lambda _: None)
    found = refused(check_simulator)
    assert (found.code, found.mend, "`sim`" in found.message) == ("missing-extra", INSTALL, True)


@pytest.mark.parametrize(
    ("chosen", "missing", "says"),
    [
        ("", ["EGL", "OSMesa"], ["libegl1 libgl1 libgl1-mesa-dri", "libosmesa6 with MUJOCO_GL=osmesa"]),
        ("egl", ["EGL"], ["MUJOCO_GL is `egl`, but libEGL is not installed"]), ("off", ["EGL"], ["MUJOCO_GL is `off`"]),
        ("", [], "egl"), ("", ["EGL"], "osmesa"), ("osmesa", ["EGL"], "osmesa"),
    ],
)  # fmt: skip
def test_the_way_to_draw_is_chosen_by_what_there_is_or_named_with_its_debian_packages(
    monkeypatch: pytest.MonkeyPatch, chosen: str, missing: list[str], says: list[str] | str
) -> None:
    """says: the way, or parts of the message where there is none."""
    monkeypatch.setenv("MUJOCO_GL", chosen)
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None if name in missing else f"lib{name}.so.1")
    if isinstance(says, str):
        check_simulator()
        assert os.environ["MUJOCO_GL"] == says
        return
    found = refused(check_simulator)
    assert (found.code, [part in found.message for part in says]) == ("no-opengl", [True] * len(says))
    assert chosen or found.mend == "apt install libegl1 libgl1 libgl1-mesa-dri && export MUJOCO_GL=egl"


NO_DEVICE = """
from pathlib import Path
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.run.cell.simulated_cell import SimulatedCell
workspace = load_workspace(Path('workspaces/tabletop'))
with SimulatedCell(workspace, workspace.stated_world, 0) as cell:
    try:
        cell.frames(['cam1'])
    except InputError as error:
        print(error)
"""
SHARED = "import sys, sqrp_cli.run.cell.render_pool; print([name for name in ('mujoco', 'cv2') if name in sys.modules])"


@pytest.mark.parametrize(
    ("script", "printed"),
    [(NO_DEVICE, "need an OpenGL that draws without a screen: it does not start"), (SHARED, "[]")],
    ids=["the library is there, but not the device that is asked for", "drawing processes share no simulator"],
)
def test_a_process_says_what_is_there(script: str, printed: str) -> None:
    environment = {**os.environ, "MUJOCO_GL": "egl", "MUJOCO_EGL_DEVICE_ID": "99"}
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, env=environment, capture_output=True, text=True)
    assert (done.stderr, printed in done.stdout) == ("", True)


WITHOUT_EXTRA = """
import importlib.util
MISSING, found = ("mujoco", "cv2"), importlib.util.find_spec
importlib.util.find_spec = lambda name, package=None: None if name in MISSING else found(name, package)
import sys
class Missing:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in MISSING:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Missing)
from sqrp_cli.cli.commands import runs
from types import SimpleNamespace
runs.read_program = lambda *_: SimpleNamespace(files=[])  # the program itself is not what this is about
from sqrp_cli.cli.main import main
main()
"""


@pytest.mark.parametrize(
    ("words", "exit_code", "said"),
    [
        (("check", "workspaces/tabletop"), 0, ""),
        (("run", "program.yaml", "--sim"), 2, INSTALL),
        (("audit", "program.yaml", "frames"), 2, INSTALL),
        (("run", "--replay", "{log}"), 0, ""),
    ],
)
def test_without_the_extra_only_what_needs_it_says_so(
    tmp_path: Path, words: tuple[str, ...], exit_code: int, said: str
) -> None:
    log = tmp_path / "log"
    with written_log(log, event("run", 0.0, sqrp_log=VERSION, workspace="cell", digest="", cameras=[])) as write:
        write(event("report", 0.0, report=RunReport()))
    command = [sys.executable, "-c", WITHOUT_EXTRA, *(word.format(log=log) for word in words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == exit_code, done.stderr
    assert said in done.stderr
