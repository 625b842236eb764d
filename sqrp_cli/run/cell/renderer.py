"""Camera images of a model, drawn in this process: as a pinhole camera sees it, then bent by the lens."""

from __future__ import annotations

import zlib
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import Array, pose
from sqrp_cli.platform.simulator import no_opengl
from sqrp_cli.records import dataclass
from sqrp_cli.run.cell.mujoco_model import DRAWN, mujoco

NEAR, FAR = 0.01, 50.0  # Clipping planes [m]
NOISE = 1.5  # Standard deviation of every value of every pixel, of 255
_SPARE = 64
"""By how many pixels the stored noise is larger than an image: it can be laid over one in `_SPARE` ** 2 ways."""
_WIDEST = np.tan(np.radians(80.0))
"""Largest distance from the optical axis in the plane z = 1 that is drawn; beyond it images stay black."""
_MOST_PIXELS = 2048  # Largest width and height of a drawn picture
_BAND = 1_000_000  # Pixels whose distortion is undone at once


@dataclass(frozen=True, eq=False)
class PixelSolids:
    """What a camera has before it in each pixel of a picture without distortion."""

    body: NDArray[np.int64]
    """MuJoCo's number of the body, 0 for the floor and what belongs to none, shape (height, width)."""
    z: Array  # Depth along the optical axis [m], shape (height, width)
    x: Array  # Where the columns are in the plane z = 1, shape (width,)
    y: Array  # Where the rows are in the plane z = 1, shape (height,)


class Renderer:
    """Draws what cameras see of a model at given joint positions; owns an OpenGL context until it is closed."""

    def __init__(self, model: mujoco.MjModel, cameras: Sequence[Camera], seed: int) -> None:
        """Raises InputError if OpenGL cannot draw."""
        self._model, self._data = model, mujoco.MjData(model)
        self._cameras = {camera.name: camera for camera in cameras}
        self._optics = {camera.name: Optics.of(camera) for camera in cameras}
        width = max(optics.width for optics in self._optics.values())
        height = max(optics.height for optics in self._optics.values())
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        try:
            self._gl = mujoco.GLContext(width, height)
            self._gl.make_current()
            self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except Exception as error:  # each library fails in ways of its own
            raise no_opengl(f"it does not start ({str(error).splitlines()[0] if str(error) else error!r})") from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 100)
        self._shadows = bool(model.vis.quality.shadowsize)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = self._shadows
        for flag in (mujoco.mjtRndFlag.mjRND_REFLECTION, mujoco.mjtRndFlag.mjRND_HAZE):
            self._scene.flags[flag] = 0
        self._option, self._view = mujoco.MjvOption(), mujoco.MjvCamera()
        self._option.geomgroup[:] = 0
        self._option.geomgroup[DRAWN] = 1
        self._seed = seed
        rows, columns = (max(sizes) + _SPARE for sizes in zip(*((c.height, c.width) for c in cameras), strict=True))
        noise = np.random.default_rng(seed).normal(0.0, NOISE, (rows, columns, 3))
        self._noise = np.rint(noise).astype(np.int16)
        # All ways to lay the noise over the images of a camera, in the order in which they are used.
        self._laid = {
            name: np.random.default_rng((seed, zlib.crc32(name.encode()))).permutation(_SPARE**2)
            for name in self._cameras
        }

    def move(self, positions: Array) -> None:
        """Bring everything to where it is at joint positions (MuJoCo's qpos)."""
        self._data.qpos[:] = positions
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def image(self, name: str, t: float) -> NDArray[np.uint8]:
        """The image that a camera takes at time t [s], shape (height, width, 3)."""
        camera, optics = self._cameras[name], self._optics[name]
        image = self._rendered(camera, camera.X_FC, camera.gain or 1.0)
        if optics.maps is not None:  # black where the lens does not look
            image = cv2.remap(image, *optics.maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        # Noise depends on seed, camera and time alone, and is never twice in a row the same.
        row, column = divmod(int(self._laid[name][round(t * camera.rate) % _SPARE**2]), _SPARE)
        noise = self._noise[row : row + camera.height, column : column + camera.width]
        noisy: NDArray[np.uint8] = cv2.add(image, noise, dtype=cv2.CV_8U)
        return noisy

    def solids(self, name: str, X_FC: Array) -> PixelSolids:
        """What a camera at a pose X_FC (4, 4) has before it, pixel by pixel of the picture without distortion."""
        optics, scene = self._optics[name], self._scene
        flags = [flag.value for flag in (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)]
        buffer = np.empty((optics.height, optics.width), dtype=np.float32)
        scene.flags[flags] = 1
        try:
            picture = self._rendered(self._cameras[name], X_FC, depth=buffer)
        finally:
            scene.flags[flags] = 0
        low, middle, high = (channel.astype(np.int64) for channel in cv2.split(picture))
        bodies = np.zeros(scene.ngeom + 1, dtype=np.int64)
        for geom in scene.geoms[: scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                bodies[geom.segid + 1] = self._model.geom_bodyid[geom.objid]
        body = bodies[np.minimum(low + (middle << 8) + (high << 16), scene.ngeom)]
        z = NEAR / (1.0 - cv2.flip(buffer, 0).astype(float) * (1.0 - NEAR / FAR))
        (left, top), (right, bottom) = optics.low, optics.high
        x = left + (np.arange(optics.width) + 0.5) / optics.width * (right - left)
        y = top + (np.arange(optics.height) + 0.5) / optics.height * (bottom - top)
        return PixelSolids(body, z, x, y)

    def _rendered(
        self, camera: Camera, X_FC: Array, gain: float = 1.0, depth: NDArray[np.float32] | None = None
    ) -> NDArray[np.uint8]:
        """The picture that a camera sees from a pose in its frame (4, 4); depth: takes its depths, upside down."""
        body, optics = self._data.body(camera.frame), self._optics[camera.name]
        X_WC = pose(body.xmat.reshape(3, 3), body.xpos) @ X_FC
        (left, top), (right, bottom) = optics.low, optics.high
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._view, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        )
        for eye in self._scene.camera:
            eye.pos, eye.forward, eye.up = X_WC[:3, 3], X_WC[:3, 2], -X_WC[:3, 1]
            eye.orthographic = 0
            eye.frustum_near, eye.frustum_far = NEAR, FAR
            eye.frustum_center, eye.frustum_width = NEAR * (left + right) / 2, NEAR * (right - left) / 2
            eye.frustum_top, eye.frustum_bottom = -NEAR * top, -NEAR * bottom
        for light in self._scene.lights[: self._scene.nlight]:
            if self._shadows:  # before colours are clipped, unlike in the picture
                light.diffuse, light.ambient = gain * light.diffuse, gain * light.ambient
            if light.headlight:
                light.pos, light.dir = X_WC[:3, 3], X_WC[:3, 2]
        area = mujoco.MjrRect(0, 0, optics.width, optics.height)
        picture = np.empty((optics.height, optics.width, 3), dtype=np.uint8)
        mujoco.mjr_render(area, self._scene, self._context)
        mujoco.mjr_readPixels(picture, depth, area, self._context)
        picture[:] = cv2.flip(picture, 0)
        return picture

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._context.free()
        self._gl.free()


@dataclass(frozen=True, eq=False)
class Optics:
    """How to draw the image of a camera."""

    low: tuple[float, float]  # Upper left corner of the window of the plane z = 1 that is drawn, (x, y)
    high: tuple[float, float]  # Its lower right corner
    width: int  # Of the picture of that window [pixels]
    height: int  # Of the picture of that window [pixels]
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None
    """For each pixel of the image where it is in the picture, x and y, shape (height, width) of the image.

    None where the picture is the image.
    """

    @classmethod
    def of(cls, camera: Camera) -> Optics:
        """The optics of a camera: the picture is as fine as the image is in its middle."""
        fx, fy = float(camera.matrix[0, 0]), float(camera.matrix[1, 1])
        cx, cy = float(camera.matrix[0, 2]), float(camera.matrix[1, 2])
        if camera.distortion_model == "none":
            low = (-0.5 - cx) / fx, (-0.5 - cy) / fy
            high = (camera.width - 0.5 - cx) / fx, (camera.height - 0.5 - cy) / fy
            return cls(low, high, camera.width, camera.height, None)
        # Where in the plane z = 1 the centre of each pixel looks, and whether it looks anywhere. That takes hundreds of
        # bytes for each pixel, so that some rows are undone at once.
        pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)
        bands = np.array_split(pixels, range(rows := max(1, _BAND // camera.width), camera.height, rows))
        undone = [Projection(camera).plane(band.reshape(-1, 2)) for band in bands]
        plane = np.concatenate([found for found, _ in undone]).reshape(pixels.shape)
        seen = np.concatenate([shown for _, shown in undone]).reshape(pixels.shape[:2])
        inside = plane[seen & (np.abs(plane).max(axis=-1) <= _WIDEST)]
        pixel = np.array([1.0 / fx, 1.0 / fy])
        low, high = inside.min(axis=0) - pixel, inside.max(axis=0) + pixel
        size = np.minimum(np.ceil((high - low) / pixel), _MOST_PIXELS)
        where = (plane - low) / (high - low) * size - 0.5
        where[~seen] = -2.0
        x, y = (np.ascontiguousarray(where[..., axis], dtype=np.float32) for axis in (0, 1))
        return cls((low[0], low[1]), (high[0], high[1]), int(size[0]), int(size[1]), (x, y))
