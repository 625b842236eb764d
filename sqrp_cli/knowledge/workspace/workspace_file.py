"""The format of workspace.yaml. `load` turns it into the records of this package."""

from __future__ import annotations

from math import pi, radians
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from sqrp_cli.knowledge.camera.camera import MAX_PIXELS, DistortionModel
from sqrp_cli.knowledge.camera.detector import DetectorKind
from sqrp_cli.knowledge.text.bounds import LARGEST, SMALLEST_SIZE
from sqrp_cli.knowledge.text.entries import (
    Angle,
    AnyQuantity,
    CameraPose,
    Distance,
    Entry,
    Extents,
    In,
    Name,
    Number,
    Pixels,
    Pose,
    Range,
    Scale,
    Share,
    Size,
    Text,
    Time,
    mapping_or_else,
)
from sqrp_cli.knowledge.text.units import ANGLE, FREQUENCY, LENGTH, PIXELS, SHARE, TIME
from sqrp_cli.shapes import Geometry

PixelCount = Annotated[int, Field(strict=True, gt=0, le=100_000)]
Incidence = Annotated[float, In(ANGLE, radians(0.1), pi)]
VisibleShare = Annotated[float, In(SHARE, 0.001, 1.0)]
Frequency = Annotated[float, In(FREQUENCY, 1e-3, LARGEST)]
FieldOfView = Annotated[float, In(ANGLE, radians(0.01), radians(179.9))]
FocalLength = Annotated[float, In(PIXELS, 0.1, LARGEST)]
LongestTime = Annotated[float, In(TIME, 1e-3, LARGEST)]
Padding = Annotated[float, In(LENGTH, 0.0, 10.0)]
PerJoint = Annotated[
    Annotated[dict[str, AnyQuantity], Tag("<mapping>")] | Annotated[AnyQuantity, Tag("<else>")], mapping_or_else()
]


def check_pixels(width: int, height: int) -> None:
    """Raises PydanticCustomError for an image of more than `MAX_PIXELS`."""
    if width * height > MAX_PIXELS:
        message = f"found {width:,} x {height:,} = {width * height:,} pixels, expected at most {MAX_PIXELS:,}"
        raise PydanticCustomError("image-too-large", message)


class ToolBoxEntry(Entry):
    """A box of a tool."""

    size: Extents = Field(description="Full extents along its own axes.")
    pose: Pose = Field(default=Pose(), description="Pose of its centre in the tool's root link.")


class ToolEntry(Entry):
    """A tool that is fixed to the robot: a URDF, or boxes with a frame that grasps."""

    urdf: Text | None = Field(default=None, description="The tool's own URDF; relative to this file, or package://.")
    boxes: list[ToolBoxEntry] | None = Field(
        default=None, min_length=1, max_length=100, description="Boxes that enclose the tool, instead of a URDF."
    )
    frame: Pose | None = Field(
        default=None,
        description="With `boxes`: the frame that grasps, as a pose in the tool's root link; its z axis points out of "
        "the tool. It is the tool frame, called `tool_tip`.",
    )
    link: Text = Field(description="The link of the robot that carries the tool's root link.")
    pose: Pose = Field(default=Pose(), description="Pose of the tool's root link in that link.")

    @model_validator(mode="after")
    def _urdf_or_boxes(self) -> ToolEntry:
        if (self.urdf is None) == (self.boxes is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `urdf`, `boxes`")
        if (self.boxes is None) != (self.frame is None):
            raise PydanticCustomError("conflicting-keys", "`boxes` needs `frame`, and `frame` goes with `boxes`")
        return self


PositionsEntry = Annotated[
    Annotated[dict[str, AnyQuantity], Tag("<mapping>")] | Annotated[Text, Tag("<else>")], mapping_or_else()
]
"""Positions of joints by name, or the name of a state of the SRDF that has them."""


class FingersEntry(Entry):
    """The fingers of a gripper: closed by `grasp` until they touch the object, opened by `release`."""

    open: PositionsEntry = Field(
        description="Position of each joint that drives the fingers when they are open, or the name of a state of the "
        "SRDF. Joints that mimic them follow."
    )
    closed: PositionsEntry = Field(description="The same when they are closed with nothing between them.")


MarkerId = Annotated[int, Field(strict=True, ge=0, le=1023)]


class MarkerEntry(Entry):
    """An ArUco marker on a link: around the origin of the link's frame, facing along its z axis."""

    id: MarkerId = Field(description="Which marker of the dictionary it is.")
    side: Size = Field(description="Side of the printed square.")


class LimitsEntry(Entry):
    """Limits of the joints: one value for all of them, or one for each joint by name."""

    velocity: PerJoint | None = Field(default=None, description="Default: the URDF's.")
    acceleration: PerJoint | None = Field(default=None, description="Default: 5 rad/s^2 or m/s^2.")
    jerk: PerJoint | None = Field(default=None, description="Default: 50 rad/s^3 or m/s^3.")
    stop_acceleration: PerJoint | None = Field(
        default=None, description="Of a stop because nobody watches any more. Default, and least: as of every motion."
    )
    stop_jerk: PerJoint | None = Field(
        default=None, description="Of such a stop. Default, and least: as of every motion."
    )


class RobotEntry(Entry):
    """The robot, its tool and where it stands."""

    urdf: Text = Field(description="The robot's URDF; relative to this file, or package://.")
    srdf: Text | None = Field(
        default=None, description="Its SRDF: named states and collision pairs that need no check."
    )
    package_roots: list[Text] = Field(default=[], description="Folders in which package://NAME/ is looked up first.")
    base: Pose = Field(default=Pose(), description="Pose of the robot's root link in the world.")
    tool: ToolEntry | None = Field(default=None, description="A tool on the robot, with a URDF of its own.")
    tool_frame: Text | None = Field(
        default=None,
        description="The link that grasps; its z axis points out of the tool, into the object. A tool of boxes has its "
        "own.",
    )
    home: PositionsEntry = Field(
        description="Position of every joint of the arm by its name, or the name of a state of the SRDF."
    )
    fingers: FingersEntry | None = Field(default=None, description="The fingers of its gripper, if they move.")
    markers: dict[str, MarkerEntry] = Field(default={}, description="ArUco markers on links, by the link's name.")
    limits: LimitsEntry = Field(default=LimitsEntry(), description="Limits of velocity, acceleration and jerk.")
    geometry: Geometry = Field(
        default="collision", description="The geometry of the links that is solid and hides things."
    )

    @model_validator(mode="after")
    def _one_tool_frame(self) -> RobotEntry:
        own = self.tool is not None and self.tool.frame is not None
        if own and self.tool_frame is not None:
            raise PydanticCustomError(
                "conflicting-keys", "`tool_frame` and `tool.frame` both say what grasps; keep one"
            )
        return self


class DetectorEntry(Entry):
    """The limits within which a detection algorithm is reliable."""

    kind: DetectorKind = Field(description="What it detects: ArUco markers or colours.")
    distance: Range = Field(description="Nearest and farthest distance from the camera.")
    max_incidence: Incidence = Field(
        description="Largest angle between a box's normal and the direction to the camera."
    )
    min_pixels: Pixels = Field(description="Least size in the image: square root of the area in pixels.")
    min_visible: VisibleShare = Field(default=1.0, description="Least share of the box that must be seen.")

    @model_validator(mode="after")
    def _range_in_order(self) -> DetectorEntry:
        if self.distance[0] >= self.distance[1]:
            raise PydanticCustomError("empty-range", "`distance` must go from a nearer to a farther distance")
        return self


class DistortionEntry(Entry):
    """Lens distortion as in ROS camera calibration files."""

    model: DistortionModel = Field(
        description="plumb_bob (5), rational_polynomial (8) or equidistant (4 coefficients)."
    )
    coefficients: list[Number] = Field(description="In the order of ROS: k1, k2, p1, p2, k3, ...")


class ImageEntry(Entry):
    """The image of a camera: its size, and either a field of view or the focal lengths."""

    width: PixelCount = Field(description="Columns of the image.")
    height: PixelCount = Field(description="Rows of the image.")
    horizontal_fov: FieldOfView | None = Field(
        default=None, description="Angle from the left to the right edge without lens distortion; square pixels."
    )
    fx: FocalLength | None = Field(default=None, description="Focal length along x.")
    fy: FocalLength | None = Field(default=None, description="Focal length along y; default fx.")
    cx: Number | None = Field(
        default=None, description="Principal point; default the middle of the image, (width - 1) / 2."
    )
    cy: Number | None = Field(
        default=None, description="Principal point; default the middle of the image, (height - 1) / 2."
    )
    distortion: DistortionEntry | None = Field(default=None, description="Default: none.")

    @model_validator(mode="after")
    def _size(self) -> ImageEntry:
        check_pixels(self.width, self.height)
        return self

    @model_validator(mode="after")
    def _one_focal_length(self) -> ImageEntry:
        if (self.horizontal_fov is None) == (self.fx is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `horizontal_fov`, `fx`")
        if self.horizontal_fov is not None and self.fy is not None:
            raise PydanticCustomError("conflicting-keys", "`fy` goes with `fx`, not with `horizontal_fov`")
        return self


class CameraEntry(Entry):
    """A camera."""

    frame: Text | None = Field(
        default=None,
        description="`world` (the default), the cell's; or the link that carries the camera, where `robot/world` is a "
        "link that the URDF calls `world`. With `hand_eye`: instead of the link that the file names.",
    )
    pose: CameraPose | None = Field(
        default=None, description="Pose of the optical frame (z forward, x right, y down) in `frame`."
    )
    hand_eye: Text | None = Field(
        default=None, description="A result of easy_handeye or easy_handeye2, instead of `pose`; relative to this file."
    )
    convention: Literal["optical", "body"] = Field(
        default="optical", description="Axes of the stated orientation; body: x forward, y left, z up."
    )
    image: ImageEntry | None = Field(default=None, description="Size and field of view or focal lengths of the image.")
    calibration: Text | None = Field(default=None, description="A ROS camera calibration file, instead of `image`.")
    near: Size = Field(default=0.1, description="Nearest depth at which the camera sees.")
    far: Size = Field(default=10.0, description="Farthest depth at which the camera sees.")
    rate: Frequency = Field(description="Images per second.")
    latency: Time = Field(default=0.0, description="From exposure to the image being available.")

    @model_validator(mode="after")
    def _consistent(self) -> CameraEntry:
        if (self.pose is None) == (self.hand_eye is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `pose`, `hand_eye`")
        if (self.image is None) == (self.calibration is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `image`, `calibration`")
        if self.near >= self.far:
            raise PydanticCustomError("empty-range", "`near` must be less than `far`")
        if self.convention == "body" and self.pose is not None and self.pose.look_at is not None:
            raise PydanticCustomError(
                "conflicting-keys",
                "`look_at` gives the viewing direction; `convention: body` goes with rpy or quaternion",
            )
        return self


class RoundEntry(Entry):
    """Radius and length along z of a cylinder or capsule (its straight part)."""

    radius: Size
    length: Size


class PartEntry(Entry):
    """A solid piece of an object: a box (full extents), sphere (radius), cylinder, capsule or mesh."""

    name: Name | None = Field(default=None, description="What output calls it; default: the object and a number.")
    box: Extents | None = Field(default=None, description="Full extents.")
    sphere: Size | None = Field(default=None, description="Its radius.")
    cylinder: RoundEntry | None = Field(default=None, description="About its z axis.")
    capsule: RoundEntry | None = Field(
        default=None, description="About its z axis; the length is of the straight part."
    )
    mesh: Text | None = Field(
        default=None,
        description="STL, OBJ or DAE file; relative to this file, or package://. The unit of a DAE counts.",
    )
    scale: Scale = Field(default=(1.0, 1.0, 1.0), description="Scale of the mesh, one for all axes or one for each.")
    pose: Pose = Field(default=Pose(), description="Pose of the piece in the object's frame.")

    @model_validator(mode="after")
    def _one_shape(self) -> PartEntry:
        shapes = ("box", "sphere", "cylinder", "capsule", "mesh")
        if sum(getattr(self, shape) is not None for shape in shapes) != 1:
            keys = ", ".join(f"`{shape}`" for shape in shapes)
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys {keys}", {"keys": keys})
        if min(map(abs, self.scale)) < SMALLEST_SIZE:
            raise PydanticCustomError("wrong-value", "`scale` has a zero, which would flatten the mesh")
        return self


class HeldEntry(Entry):
    """In the tool from the beginning: the tool frame in the centre of one side, as in a waypoint of a skill."""

    held: Literal["+x", "-x", "+y", "-y", "+z", "-z"] = Field(description="Outward axis of the side it is held by.")
    yaw: Angle = Field(default=0.0, description="Turn of the tool about its z axis.")
    depth: Distance = Field(default=0.0, description="How far the tool frame goes into the object, between fingers.")


def _kind_of_pose(data: object) -> str:
    if not isinstance(data, dict):
        return "<else>"
    return "<held>" if data.keys() & HeldEntry.model_fields.keys() else "<mapping>"


class ObjectEntry(Entry):
    """A thing in the cell."""

    type: Name = Field(
        description="A type of the skills or any other noun, such as `cube`. Besides, every object is a `fixture` or a "
        "`movable`, by `fixed`."
    )
    color: Text | None = Field(
        default=None, description="What a task calls it, and what detectors of colours look for."
    )
    attributes: list[Name] = Field(default=[], description="Further words that a task may use for it.")
    size: Extents = Field(description="Full extents of the box around it, along its own axes.")
    pose: Annotated[
        Annotated[Pose, Tag("<mapping>")]
        | Annotated[HeldEntry, Tag("<held>")]
        | Annotated[Literal["unknown"], Tag("<else>")],
        Discriminator(_kind_of_pose),
    ] = Field(description="Pose of the centre of that box in the world, `{held: SIDE}` in the tool, or `unknown`.")
    fixed: bool = Field(default=False, description="Whether it never moves.")
    on: Name | None = Field(default=None, description="The object that it stands on.")
    marker: MarkerId | None = Field(default=None, description="Id of the ArUco marker on it.")
    parts: list[PartEntry] = Field(default=[], description="Its solid pieces; default: the box.")


class TaskEntry(Entry):
    """A task that the cell must support, with what is expected of its best candidate."""

    task: Text = Field(description="As on the command line, such as `pickup green`.")
    min_q_avg: Share | None = Field(default=None, description="Least share of the time in which all is seen.")
    min_q_eoi: Share | None = Field(default=None, description="The same of the events of interest.")
    max_time: LongestTime | None = Field(default=None, description="Longest duration.")
    max_delay: LongestTime | None = Field(default=None, description="Longest time until a fault is noticed.")
    feasible: bool | None = Field(default=None, description="Whether a feasible candidate is expected at all.")
    winner: Name | None = Field(default=None, description="The object that the best candidate is expected to use.")


class WorkspaceFile(Entry):
    """A cell: robot, cameras, detectors, objects, what is true now, skills and expected tasks."""

    robot: RobotEntry
    detectors: dict[Name, DetectorEntry] = Field(default={}, description="Detection algorithms by name.")
    cameras: dict[Name, CameraEntry] = Field(default={}, max_length=200, description="Cameras by name.")
    skills: list[Text] = Field(default=[], description="Folders of the skills that may be used.")
    objects: dict[Name, ObjectEntry] = Field(default={}, max_length=2000, description="Things in the cell by name.")
    state: list[Text] = Field(default=[], description="The facts that hold now; every other one does not.")
    tasks: list[TaskEntry] = Field(default=[], description="Tasks that the cell must support.")
    padding: Padding = Field(default=0.0, description="Least distance that motions keep from fixed objects.")
