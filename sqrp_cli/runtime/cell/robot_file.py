"""How to reach a real cell: the format of the file that `sqrp run --robot` reads and `sqrp cell --config` writes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import Field
from pydantic_core import PydanticCustomError

from sqrp_cli.errors import InputError, Place, Problem, expected_names
from sqrp_cli.knowledge.text.entries import Angle, Distance, Entry, In, Name, Number, Share, Stored, Text, Time
from sqrp_cli.knowledge.text.input_file import missing_file
from sqrp_cli.knowledge.text.units import TIME
from sqrp_cli.knowledge.text.validation import validate
from sqrp_cli.knowledge.text.yaml_file import read_yaml
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program

TransportName = Literal["dds", "rclpy", "ros1"]
ToolType = Literal["std_msgs/msg/Bool", "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"]
ImageType = Literal["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"]


@dataclass(frozen=True, kw_only=True)
class TrajectoryEntry(Stored):
    """Where joint trajectories go: to a topic, or to an action."""

    topic: Text | None = None
    """Of a joint_trajectory_controller, such as `/joint_trajectory_controller/joint_trajectory`."""
    action: Text | None = None
    """Of a follow_joint_trajectory action, such as `/arm_controller/follow_joint_trajectory`; with rclpy and ROS 1."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError unless one of the two is given."""
        if (self.topic is None) == (self.action is None):
            raise PydanticCustomError("ambiguous-entry", "expected exactly one of the keys `topic`, `action`")


@dataclass(frozen=True, kw_only=True)
class ImageTopicEntry(Stored):
    """The topics of a camera."""

    image: Text
    """Of its images."""
    type: ImageType = "sensor_msgs/msg/Image"
    """Of its messages: raw images or compressed ones."""
    info: Text | None = None
    """Of its `CameraInfo`; without it, matrix and resolution are not compared with the workspace."""
    frame: Text | None = None
    """Its optical frame in TF; by default, what its `CameraInfo` says."""
    clock_offset: Annotated[float, In(TIME, -1e6, 1e6)] = 0.0
    """How far its clock is ahead; subtracted from its stamps."""


@dataclass(frozen=True, kw_only=True)
class ToolEntry(Stored):
    """The topic that has the tool hold and let go."""

    topic: Text
    """Such as `/suction`."""
    type: ToolType = "std_msgs/msg/Bool"
    """Of its messages."""
    hold: bool | Number | list[Number] = True
    """What has the tool hold."""
    release: bool | Number | list[Number] = False
    """What has it let go."""


@dataclass(frozen=True, kw_only=True)
class TolerancesEntry(Stored):
    """How far the cell may be from the program and its workspace."""

    start: Angle = 0.00873
    """Of each joint from the start of the program [rad, or m]; 0.5 deg by default."""
    tracking: Angle = 0.0873
    """Of each joint from where it should be in motion [rad, or m]; 5 deg by default."""
    focal: Share = 0.01
    """Of each entry of a camera matrix, of its focal length."""
    position: Distance = 0.005
    """Of a camera."""
    rotation: Angle = 0.00873
    """Of a camera; 0.5 deg by default."""
    clock: Time = 0.1
    """Of the age of images and joint states, from what the workspace says."""
    rate: Share = 0.2
    """Of how much fewer images a second than the workspace says."""


class RobotFile(Entry):
    """How to reach a real cell."""

    transport: TransportName = Field(
        default="dds", description="dds: ROS 2 on the wire, without ROS; rclpy: a sourced ROS 2; ros1: rospy."
    )
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID of ROS 2.")
    network: Text | None = Field(
        default=None, description="With dds: address or name of the network interface to use alone, such as 127.0.0.1."
    )
    master: Text | None = Field(default=None, description="With ros1: ROS_MASTER_URI; by default, the environment's.")
    reliable: bool = Field(
        default=False,
        description="Whether lost messages are sent again; then the cameras' drivers must offer it, too.",
    )
    use_sim_time: bool = Field(default=False, description="Whether `/clock` gives the time, as in simulations.")
    trajectory: TrajectoryEntry = Field(description="Where joint trajectories go.")
    joint_states: Text = Field(default="/joint_states", description="Topic of the joints' positions.")
    joints: dict[Text, Text] | None = Field(
        default=None,
        description="The joints that the controller moves, in its order: name in the workspace, name in the messages; "
        "by default, all of the program by their own names.",
    )
    cameras: dict[Name, ImageTopicEntry] = Field(min_length=1, description="Topics of each camera of the workspace.")
    tool: ToolEntry | None = Field(default=None, description="What has the tool hold and let go.")
    force: Text | None = Field(default=None, description="Topic of a force sensor (WrenchStamped), for guarded moves.")
    tf: bool = Field(default=True, description="Whether camera poses are compared with TF, where it has them.")
    world: Text = Field(default="world", description="What TF calls the frame `world` of the workspace.")
    tolerances: TolerancesEntry = Field(default=TolerancesEntry(), description="How far the cell may be off.")

    def joint_names(self, program: Program) -> dict[str, str]:
        """The joints that are moved, in order: by name in the program, their names in messages."""
        return self.joints or {name: name for name in program.joints}


def read_robot_file(path: Path, workspace: Workspace, program: Program) -> RobotFile:
    """The file, which must fit a program and its workspace. Raises InputError with every problem."""
    if not path.is_file():
        raise InputError(missing_file(path))
    document = read_yaml(path)
    file = validate(document, RobotFile)
    problems = [*_camera_problems(file, workspace, path), *_joint_problems(file, program, path)]
    actions = {p.action for step in program.steps for p in step.primitives}
    if file.tool is None and actions & {"Grasp", "Release"}:
        message = "the program grasps, but the file has no `tool` that can be told to"
        problems.append(Problem("missing-key", message, Place(path), mend="tool: {topic: /suction}"))
    guarded = any(p.guard is not None for step in program.steps for p in step.primitives)
    if file.force is None and guarded:
        message = "the program has moves that end at contact, but the file has no topic of a `force` sensor"
        problems.append(Problem("missing-key", message, Place(path), mend="force: /wrench"))
    if file.trajectory.action is not None and file.transport == "dds":
        message = "actions need the vendor's own middleware; with dds, trajectories go to a topic"
        problems.append(Problem("conflicting-keys", message, Place(path), mend="trajectory: {topic: ...}"))
    if problems:
        raise InputError(*problems)
    return file


def _camera_problems(file: RobotFile, workspace: Workspace, path: Path) -> list[Problem]:
    cameras = workspace.cameras
    unknown = [
        Problem("unknown-camera", f"there is no camera `{name}`; {expected_names(name, cameras)}", Place(path))
        for name in file.cameras
        if name not in cameras
    ]
    missing = [name for name in cameras if name not in file.cameras]
    if missing:
        names = ", ".join(f"`{name}`" for name in missing)
        unknown.append(Problem("missing-key", f"`cameras` lacks {names} of the workspace", Place(path)))
    return unknown


def _joint_problems(file: RobotFile, program: Program, path: Path) -> list[Problem]:
    return [
        Problem(
            "unknown-joint", f"the program has no joint `{name}`; {expected_names(name, program.joints)}", Place(path)
        )
        for name in file.joints or {}
        if name not in program.joints
    ]


def as_yaml(file: RobotFile) -> str:
    """The file as text, without what is so by default."""
    head = "# How `sqrp run PROGRAM --robot FILE` reaches the cell; `sqrp schema robot` describes each key.\n"
    return head + str(yaml.safe_dump(file.model_dump(mode="json", exclude_defaults=True), sort_keys=False))
