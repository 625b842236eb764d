"""A camera: its entry in a workspace file, and the calibrated camera that results from all its files.

Numbers are in SI units and angles in radians, whatever the unit in a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import atan, radians, tan
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from sqrp_cli.files.entries import CameraPose, FileRecord, In, MappingOr, Number, SerializedAs, Size, Text, Time
from sqrp_cli.files.source import KeyPath, SourceDocument
from sqrp_cli.files.units import ANGLE, FREQUENCY, LARGEST, PIXELS
from sqrp_cli.geometry import Array, check_finite, check_poses, read_only
from sqrp_cli.records import dataclass

DistortionModel = Literal["none", "plumb_bob", "rational_polynomial", "equidistant"]
DISTORTION_LENGTHS: dict[DistortionModel, int] = {"none": 0, "plumb_bob": 5, "rational_polynomial": 8, "equidistant": 4}
"""Number of coefficients of each distortion model, in the order of ROS camera calibration files."""
MAX_PIXELS = 200_000_000  # most pixels of an image; industrial cameras have up to 150 million
PixelCount = Annotated[int, Field(strict=True, gt=0, le=100_000)]
FieldOfView = Annotated[float, In(ANGLE, radians(0.01), radians(179.9))]
FocalLength = Annotated[float, In(PIXELS, 0.1, LARGEST)]
Gain = Annotated[float, In(None, 1e-6, 1e6)]
Frequency = Annotated[float, In(FREQUENCY, 1e-3, LARGEST)]


class PixelSize(NamedTuple):
    """Of an image [pixels]."""

    width: int
    height: int

    @classmethod
    def of(cls, width: int | None, height: int | None) -> PixelSize | None:
        """A size that may be stated; None unless both numbers are."""
        return None if width is None or height is None else cls(width, height)

    @property
    def short(self) -> str:
        """As in `640x480`."""
        return f"{self.width}x{self.height}"

    def __str__(self) -> str:
        return f"{self.width} x {self.height}"


def check_pixels(width: int, height: int) -> None:
    """Raises PydanticCustomError for an image of more than `MAX_PIXELS`."""
    if width * height > MAX_PIXELS:
        message = f"found {width:,} x {height:,} = {width * height:,} pixels, expected at most {MAX_PIXELS:,}"
        raise PydanticCustomError("image-too-large", message)


@dataclass(frozen=True, eq=False, kw_only=True)
class Intrinsics:
    """Camera matrix, distortion and image size; pixel (0, 0) is the centre of the first pixel."""

    width: int  # Columns of the image [pixels]
    height: int  # Rows of the image [pixels]
    matrix: Array  # The intrinsic matrix K [pixels], shape (3, 3)
    distortion_model: DistortionModel
    distortion: Array  # As in ROS `sensor_msgs/CameraInfo`: k1, k2, p1, p2, k3, ..
    lens_file: str | None = None
    """Format of the calibration file that says so, with the camera's name in it; None: the workspace does."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Sensing(FileRecord):
    """Range, frame rate and latency of a camera, taken unchanged from the workspace file."""

    near: Annotated[Size, Field(description="Nearest depth at which the camera sees.")] = 0.1
    far: Annotated[Size, Field(description="Farthest depth at which the camera sees.")] = 10.0
    rate: Annotated[Frequency, Field(description="Images per second.")]
    latency: Time | None = None
    """From exposure to the image being available; 0 s is assumed where it is left out."""
    exposure: Annotated[Time, Field(description="How long the shutter is open; what moves meanwhile is blurred.")] = 0.0

    gain: Gain | None = None
    """Brightness of its images in the light that the cell states; default 1."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for an empty range."""
        if self.near >= self.far:
            raise PydanticCustomError("empty-range", "`near` must be less than `far`")

    @property
    def lag(self) -> float:
        """From exposure to the image being available [s]: the latency, 0 where none is stated."""
        return self.latency or 0.0

    @property
    def response(self) -> float:
        """Longest time from an event until an image of it is available [s]: one frame period and the latency."""
        return 1.0 / self.rate + self.lag


def assumed_latency(cameras: Iterable[Sensing]) -> str:
    """That a latency is assumed of cameras, in words; empty where all state theirs."""
    names = [getattr(camera, "name", "a camera") for camera in cameras if camera.latency is None]
    shown = ", ".join(names[:6]) + (f" and {len(names) - 6} more" if len(names) > 6 else "")
    return f"a latency of 0 ms is assumed of {shown}, as none is stated" if names else ""


@dataclass(frozen=True, eq=False, kw_only=True)
class Camera(Sensing, Intrinsics):
    """A camera with its calibration, place and sensing range."""

    name: str
    frame: str
    """`world`, or the link that carries the camera."""
    X_FC: Array
    """Pose of the optical frame (x right, y down, z forward) in `frame`, shape (4, 4)."""
    pose_file: str | None = None
    """Format of the file that says so; None: the workspace does."""

    def __post_init__(self) -> None:
        """Raises ValueError for an invalid pose and for figures that are not finite; `far` may be infinite."""
        what = f"camera `{self.name}`"
        check_poses(what, self.X_FC)
        check_finite(what, self.matrix, self.distortion, self.near, self.rate, self.latency)

    @property
    def field_of_view(self) -> float:
        """The horizontal angle of its image, without the distortion of its lens [rad]."""
        return 2.0 * atan(0.5 * self.width / float(self.matrix[0, 0]))


@dataclass(frozen=True, kw_only=True)
class DistortionEntry(FileRecord):
    """Lens distortion as in ROS camera calibration files."""

    model: DistortionModel
    """plumb_bob (5), rational_polynomial (8) or equidistant (4 coefficients)."""
    coefficients: list[Number]
    """In the order of ROS: k1, k2, p1, p2, k3, ..."""


@dataclass(frozen=True, kw_only=True)
class ImageEntry(FileRecord):
    """The image of a camera: its size, and either a field of view or the focal lengths."""

    width: PixelCount
    """Columns of the image."""
    height: PixelCount
    """Rows of the image."""
    horizontal_fov: FieldOfView | None = None
    """Angle from the left to the right edge without lens distortion; square pixels."""
    fx: FocalLength | None = None
    """Focal length along x."""
    fy: FocalLength | None = None
    """Focal length along y; default fx."""
    cx: Number | None = None
    """Principal point; default the middle of the image, (width - 1) / 2."""
    cy: Number | None = None
    """Principal point; default the middle of the image, (height - 1) / 2."""
    distortion: DistortionEntry | None = None
    """Default: none."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for keys that contradict each other."""
        check_pixels(self.width, self.height)
        self.check_only_one("horizontal_fov", "fx")
        if self.horizontal_fov is not None and self.fy is not None:
            raise PydanticCustomError("conflicting-keys", "`fy` goes with `fx`, not with `horizontal_fov`")

    def intrinsics(self) -> Intrinsics:
        """The intrinsics; pixels are square unless `fy` is given. The number of coefficients is not checked."""
        fx = self.fx if self.fx is not None else 0.5 * self.width / tan(0.5 * (self.horizontal_fov or 0.0))
        fy = self.fy if self.fy is not None else fx
        cx = self.cx if self.cx is not None else 0.5 * (self.width - 1)
        cy = self.cy if self.cy is not None else 0.5 * (self.height - 1)
        lens = self.distortion or DistortionEntry(model="none", coefficients=[])
        return Intrinsics(
            width=self.width,
            height=self.height,
            matrix=read_only([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
            distortion_model=lens.model,
            distortion=read_only(lens.coefficients),
        )


def image_of(camera: Intrinsics) -> ImageEntry:
    """The entry that gives these intrinsics."""
    (fx, _, cx), (_, fy, cy), _ = camera.matrix.tolist()
    lens = None
    if camera.distortion_model != "none":
        lens = DistortionEntry(model=camera.distortion_model, coefficients=camera.distortion.tolist())
    return ImageEntry(width=camera.width, height=camera.height, fx=fx, fy=fy, cx=cx, cy=cy, distortion=lens)


def check_image(document: SourceDocument, path: KeyPath, image: Intrinsics) -> None:
    """Raises InputError where the image stated at `path` is of no camera: by coefficients or principal point."""
    model, count = image.distortion_model, len(image.distortion)
    check_count(document, (*path, "distortion", "coefficients"), model, count, (DISTORTION_LENGTHS[model],))
    cx, cy = image.matrix[:2, 2]
    if not (-0.5 <= cx <= image.width - 0.5 and -0.5 <= cy <= image.height - 0.5):
        message = f"the principal point ({cx:g}, {cy:g}) is outside the image of {image.width} x {image.height} pixels"
        mend = "check `cx` and `cy`; is the calibration that of another image size?"
        raise document.error("principal-point-outside", path, message, mend)


def check_count(document: SourceDocument, path: KeyPath, name: str, count: int, expected: Sequence[int]) -> None:
    """Raises InputError unless a distortion model has one of the expected numbers of coefficients."""
    if count not in expected:
        counts = " or ".join(map(str, expected))
        message = f"found {count} distortion coefficients, expected {counts} for `{name}`"
        raise document.error("wrong-length", path, message)


@dataclass(frozen=True, kw_only=True)
class CalibrationFile(FileRecord):
    """A camera of a calibration file."""

    file: Text
    """Relative to this file, or package://."""
    camera: Annotated[Text, BeforeValidator(lambda name: str(name) if type(name) is int else name)] | None = None
    """Its name in the file, if that has several, such as `cam1`."""
    width: PixelCount | None = None
    """Columns of the image, if the file does not say."""
    height: PixelCount | None = None
    """Rows of the image, if the file does not say."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for a width without a height."""
        if (self.width is None) != (self.height is None):
            raise PydanticCustomError("conflicting-keys", "`width` and `height` go together")
        if self.width is not None and self.height is not None:
            check_pixels(self.width, self.height)


Rotation = Literal["rotvec", "rotvec deg", "rpy", "rpy deg", "zyx", "zyx deg", "xyzw", "wxyz"]
_Unit = Annotated[Size, BeforeValidator(lambda unit: f"1 {unit}" if unit in ("m", "cm", "mm") else unit)]


@dataclass(frozen=True, kw_only=True)
class PoseFile(FileRecord):
    """A camera's pose in a file. Of numbers whose file does not say what they are, the workspace does."""

    file: Text | None = None
    """Relative to this file, or package://; of a recording in a folder, the folder."""
    camera: Text | None = None
    """The camera's frame or name, if the file has several, such as `camera_color_optical_frame`."""
    urdf: Text | None = None
    """Instead of `file`: a URDF with the camera on fixed joints."""
    link: Text | None = None
    """The camera's link of that URDF."""
    pose_of: Literal["camera", "frame"] | None = None
    """camera: points of the camera times the matrix are points of the frame that carries it; frame: the other way."""
    unit: _Unit | None = None
    """Of the position: m, cm, mm, or the length of one unit, such as `0.35 m`."""
    rotation: Rotation | None = None
    """Of three numbers a rotation vector, angles about fixed x, y, z, or about z, y, x in turn (A, B, C of KUKA), in
    radians or `deg`; of four a quaternion."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError unless it names one file, and a link only of a URDF."""
        self.check_only_one("file", "urdf")
        if (self.link is not None and self.urdf is None) or (self.camera is not None and self.file is None):
            raise PydanticCustomError("conflicting-keys", "`camera` goes with `file`, `link` with `urdf`")


def _named(kind: type[PoseFile] | type[CalibrationFile]) -> SerializedAs:
    """How a file states a record of a file: as a mapping, or by the file's name alone."""
    form: Any = MappingOr[kind, Text] | None  # type: ignore[misc, valid-type]
    return SerializedAs(form, lambda stated: kind(file=stated) if isinstance(stated, str) else stated)


@dataclass(frozen=True, eq=False, kw_only=True)
class CameraEntry(Sensing):
    """A camera: where it is and how it makes an image, stated, or by files that others wrote."""

    frame: Text | None = None
    """`world` (the default), the cell's; or the link that carries the camera, where `robot/world` is a link that the
    URDF calls `world`. With `hand_eye`: instead of the link that the file names."""
    pose: CameraPose | None = None
    """Pose of the optical frame (z forward, x right, y down) in `frame`."""
    hand_eye: Annotated[PoseFile | None, _named(PoseFile)] = None
    """A file with the pose, instead of `pose`: of easy_handeye, TF messages, a launch file with a
    static_transform_publisher, a recording with /tf_static, a URDF, COLMAP's images.txt, nerfstudio's transforms.json,
    or a matrix; as a mapping where it has several, or does not say what its numbers are."""
    convention: Literal["optical", "body", "opengl"] | None = None
    """Axes of the stated orientation, optical where it is left out; body: x forward, y left, z up; opengl: z backward,
    x right, y up."""
    image: ImageEntry | None = None
    """Size and field of view or focal lengths of the image."""
    calibration: Annotated[CalibrationFile | None, _named(CalibrationFile)] = None
    """A calibration file, instead of `image`, such as of ROS, OpenCV or Kalibr; as `{file, camera, width,
    height}` where it has several cameras or no image size."""
    distortion: DistortionModel | None = None
    """With `calibration`: the distortion model, where the file does not say it; none for straight images."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for keys that contradict each other."""
        super().__post_init__()
        self.check_only_one("pose", "hand_eye")
        self.check_only_one("image", "calibration")
        if self.distortion is not None and self.calibration is None:
            raise PydanticCustomError("conflicting-keys", "`distortion` goes with `calibration`; else it is in `image`")
        if self.convention not in (None, "optical") and self.pose is not None and self.pose.look_at is not None:
            message = (
                f"`look_at` gives the viewing direction; `convention: {self.convention}` goes with rpy or quaternion"
            )
            raise PydanticCustomError("conflicting-keys", message)
