"""An independent view of a scene: MuJoCo reads the URDFs, moves the links and renders depth and segmentation images.

Nothing here uses the kinematics, the solids or the visibility of the package.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.geometry import Array
from sqrp_cli.robot.robot import Robot
from sqrp_cli.shapes import Box, Cylinder, Part

NO_SCREEN = "MuJoCo cannot render without a screen; on Debian: apt install libegl1 libgl1 libgl1-mesa-dri"

os.environ.setdefault("MUJOCO_GL", "egl")
try:
    import mujoco
except (ImportError, AttributeError, OSError) as error:  # without libEGL, importing it fails in one of these ways
    raise ImportError(NO_SCREEN) from error

FAR = 20.0
"""Far clipping plane [m]."""

_HIDDEN_GROUP = 5


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera sees through a square window of the plane z = 1, n pixels wide.

    u, v: directions (u, v, 1) of the pixels' centres in the optical frame, shape (n, n). depth: optical z of what is
    first met there [m], shape (n, n). part: index of its part, -1 for nothing, shape (n, n).
    """

    u: Array
    v: Array
    depth: Array
    part: NDArray[np.int64]


class MujocoScene:
    """A robot with its tool, and further parts on `world`, links or things, in MuJoCo.

    names: of the parts, by the index that `Picture.part` gives: the link for the robot and tool, else the part's name.
    """

    def __init__(self, robot: Robot, parts: Sequence[Part], held: Part | None, resolution: int) -> None:
        """held: a part with a parent of its own, which `place` moves. resolution: pixels along a picture's side."""
        spec = mujoco.MjSpec.from_string(_urdf(robot))
        names: list[str] = []
        for body in spec.bodies:
            for geom in body.geoms:
                geom.name = f"part{len(names)}"
                names.append(body.name if body.name != "world" else _root(robot))
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        for part in parts:
            body = spec.worldbody if part.parent == "world" else spec.body(part.parent)
            _add(body, part, f"part{len(names)}")
            names.append(part.name)
        if held is not None:
            body = spec.worldbody.add_body(name=held.parent, mocap=True)
            _add(body, held, f"part{len(names)}")
            names.append(held.name)
        spec.visual.global_.offwidth = spec.visual.global_.offheight = resolution
        spec.visual.quality.offsamples = 0
        spec.visual.quality.shadowsize = 0
        spec.visual.quality.numslices, spec.visual.quality.numstacks = 96, 2
        self.names = tuple(names)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self._part_of_geom = np.array([int(self.model.geom(i).name[4:]) for i in range(self.model.ngeom)])
        self._resolution = resolution
        self._open()

    def _open(self) -> None:
        try:
            self._gl = mujoco.GLContext(self._resolution, self._resolution)
            self._gl.make_current()
            self._context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:
            raise RuntimeError(NO_SCREEN) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(self.model, maxgeom=1000)
        flags = mujoco.mjtRndFlag
        for flag in range(flags.mjNRNDFLAG):
            self._scene.flags[flag] = flag in (flags.mjRND_SEGMENT, flags.mjRND_IDCOLOR)
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._option.geomgroup[:] = 1
        self._option.geomgroup[_HIDDEN_GROUP] = 0

    def close(self) -> None:
        self._context.free()
        self._gl.free()

    def move(self, joints: Mapping[str, float]) -> None:
        """Bring the joints to positions [rad or m]."""
        for name, value in joints.items():
            self.data.joint(name).qpos[0] = value
        mujoco.mj_kinematics(self.model, self.data)

    def place(self, body: str, X_WO: Array) -> None:
        """Bring the body of the held part to a pose."""
        mocap = self.model.body(body).mocapid[0]
        self.data.mocap_pos[mocap] = X_WO[:3, 3]
        self.data.mocap_quat[mocap] = _quaternion(X_WO)
        mujoco.mj_kinematics(self.model, self.data)

    def body_pose(self, body: str) -> Array:
        """World pose of a link, shape (4, 4)."""
        X_WL = np.eye(4)
        X_WL[:3, :3] = self.data.body(body).xmat.reshape(3, 3)
        X_WL[:3, 3] = self.data.body(body).xpos
        return X_WL

    def show(self, transparent: Iterable[int]) -> None:
        """Make the scene as it now is ready for pictures, without some parts."""
        self.model.geom_group[:] = np.where(np.isin(self._part_of_geom, list(transparent)), _HIDDEN_GROUP, 0)
        mujoco.mjv_updateScene(
            self.model, self.data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        drawn = self._scene.geoms[: self._scene.ngeom]
        self._part_of_color = np.full(self._scene.ngeom + 2, -1, dtype=np.int64)
        for geom in drawn:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                self._part_of_color[geom.segid + 1] = self._part_of_geom[geom.objid]

    def picture(self, X_WC: Array, low: Array, side: float, near: float) -> Picture:
        """What an optical frame sees through the window from `low` (u, v) to `low + side` in its plane z = 1.

        near: clipping plane [m]; nothing nearer is drawn. The depth is good to 6e-8 z^2 / near.
        """
        n = self._resolution
        for camera in self._scene.camera:
            camera.pos, camera.forward, camera.up = X_WC[:3, 3], X_WC[:3, 2], -X_WC[:3, 1]
            camera.orthographic = 0
            camera.frustum_near, camera.frustum_far = near, FAR
            camera.frustum_center = near * (low[0] + side / 2)
            camera.frustum_width = near * side / 2
            camera.frustum_top, camera.frustum_bottom = -near * low[1], -near * (low[1] + side)
        area = mujoco.MjrRect(0, 0, n, n)
        color, raw = np.empty((n, n, 3), dtype=np.uint8), np.empty((n, n), dtype=np.float32)
        mujoco.mjr_render(area, self._scene, self._context)
        mujoco.mjr_readPixels(color, raw, area, self._context)
        red, green, blue = (color[::-1, :, channel].astype(np.int32) for channel in range(3))
        code = red + 256 * green + 65536 * blue
        # Window depth is 1 at the near plane and 0 at the far plane, linear in 1 / z.
        depth = 1.0 / (1.0 / FAR + raw[::-1].astype(float) * (1.0 / near - 1.0 / FAR))
        centers = (np.arange(n) + 0.5) * side / n
        u, v = np.meshgrid(low[0] + centers, low[1] + centers)
        return Picture(u, v, depth, self._part_of_color[np.minimum(code, len(self._part_of_color) - 1)])


def _root(robot: Robot) -> str:
    tree = ElementTree.parse(robot.urdf.path).getroot()  # noqa: S314
    children = {joint.find("child").get("link") for joint in tree.iter("joint") if joint.find("child") is not None}
    links = [link.get("name") for link in tree.iter("link") if link.find("collision") is not None]
    return next(link for link in links if link not in children or link == "base_link")


def _urdf(robot: Robot) -> str:
    """Robot and tool as one URDF that MuJoCo reads, with absolute paths of meshes."""
    tree = ElementTree.parse(robot.urdf.path).getroot()  # noqa: S314
    if robot.tool is not None and robot.tool.file is not None:
        tool = ElementTree.parse(robot.tool.file).getroot()  # noqa: S314
        carried = {joint.find("child").get("link") for joint in tool.iter("joint")}
        mount = next(link.get("name") for link in tool.iter("link") if link.get("name") not in carried)
        tree.extend([*tool.iter("link"), *tool.iter("joint")])
        joint = ElementTree.SubElement(tree, "joint", {"name": "tool_mount_joint", "type": "fixed"})
        ElementTree.SubElement(joint, "parent", {"link": robot.tool.link})
        ElementTree.SubElement(joint, "child", {"link": mount})
        assert np.allclose(robot.tool.X_LT, np.eye(4))
    assert np.allclose(robot.X_WB, np.eye(4))
    for mesh in tree.iter("mesh"):
        package, _, rest = mesh.get("filename", "").removeprefix("package://").partition("/")
        found = [root / package / rest for root in robot.package_roots if (root / package / rest).is_file()]
        mesh.set("filename", str(found[0] if found else Path(package) / rest))
    for link in tree.iter("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    options = ElementTree.SubElement(tree, "mujoco")
    ElementTree.SubElement(options, "compiler", {"strippath": "false", "fusestatic": "false", "discardvisual": "false"})
    return ElementTree.tostring(tree, encoding="unicode")


def _add(body: mujoco.MjsBody, part: Part, name: str) -> None:
    geometry = mujoco.mjtGeom
    match part.shape:
        case Box(size):
            kind, extents = geometry.mjGEOM_BOX, [extent / 2 for extent in size]
        case Cylinder(radius, length):
            kind, extents = geometry.mjGEOM_CYLINDER, [radius, length / 2, 0]
        case _:
            raise NotImplementedError(part.shape)
    geom = body.add_geom(name=name, type=kind, size=extents, pos=part.X_PG[:3, 3], quat=_quaternion(part.X_PG))
    geom.contype = geom.conaffinity = 0


def _quaternion(X: Array) -> Array:
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(X[:3, :3]).reshape(9))
    return quaternion
