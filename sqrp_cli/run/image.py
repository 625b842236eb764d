"""The images of a cell's cameras: what one is, and how large it may be."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import bad_input
from sqrp_cli.geometry import Array
from sqrp_cli.records import dataclass

ImageArray = NDArray[np.uint8]
"""Red, green and blue, shape (height, width, 3); pixel (0, 0) is the centre of the first one, at the top left."""
SUBPIXEL = 4  # Fractional bits of the corners of polygons that OpenCV draws
Corners = NDArray[np.int32]  # Corners of polygons in sixteenths of a pixel
MOST_SIMULATED = 16_000_000
"""Most pixels of an image that is simulated; each drawing process needs some 100 bytes for each of them."""
MOST_SIMULATED_TOGETHER = 64_000_000  # Most pixels of one image of every camera
MOST_RECORDED = 64_000_000  # Most pixels of a recorded image that is looked at
NEEDED = ("cv2", "sqrp_cli.run.perception.image_detector", "sqrp_cli.run.cell.render_pool")
"""What processes that draw and look at images import, for `platform.processes.fresh`.

MuJoCo is not among it: what it opens to draw must not be shared.
"""


@dataclass(frozen=True, eq=False)
class CameraImage:
    """One image of one camera: all that perception ever learns of a cell."""

    camera: str  # Its name
    t: float  # Time of exposure [s]
    image: ImageArray


def corners_of(polygons: Array) -> Corners:
    """Polygons (..., 2) [pixels] as OpenCV draws them."""
    corners: Corners = np.round(polygons * 2**SUBPIXEL).clip(-(2**24), 2**24).astype(np.int32)
    return corners


def check_image_sizes(workspace: Workspace, recorded: Iterable[str] | None = None) -> None:
    """Raises InputError for cameras whose images are too large to be simulated, or looked at.

    recorded: names of cameras whose images are there and are looked at; by default, images of all are simulated.
    """
    cameras, most, done = workspace.cameras, MOST_RECORDED, "looked at"
    if recorded is None:
        recorded, most, done = cameras, MOST_SIMULATED, "simulated"
    for camera in (cameras[name] for name in recorded):
        if camera.width * camera.height > most:
            message = f"the images of `{camera.name}` have {camera.width:,} x {camera.height:,} pixels"
            message += f"; images of at most {most:,} pixels are {done}"
            mend = "give the camera a smaller image, with the same field of view"
            raise bad_input("image-too-large", message, workspace.places.get(f"cameras.{camera.name}"), mend=mend)
    together = sum(camera.width * camera.height for camera in cameras.values())
    if recorded is cameras and together > MOST_SIMULATED_TOGETHER:
        message = f"the images of all cameras have {together:,} pixels; "
        message += f"simulated are at most {MOST_SIMULATED_TOGETHER:,}"
        raise bad_input("image-too-large", message, workspace.places.get("cameras"))
