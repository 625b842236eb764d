"""How to reach a real cell: the format of the file that `sqrp run --robot` reads and `sqrp cell --config` writes."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Annotated, Literal

import yaml
from pydantic import AfterValidator, Field
from pydantic_core import PydanticCustomError

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names
from sqrp_cli.files.entries import Angle, Distance, Entry, FileRecord, In, Name, Number, Share, Text, Time
from sqrp_cli.files.input_file import missing_file
from sqrp_cli.files.source import describe
from sqrp_cli.files.units import TIME
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.program.record import Program
from sqrp_cli.records import dataclass

ToolType = Literal["std_msgs/msg/Bool", "std_msgs/msg/Float64", "std_msgs/msg/Float64MultiArray"]
ImageType = Literal["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"]
_SLOWER = "if computers are busy, let the simulated time pass more slowly, as with `sqrp cell --pace 0.1`"
_OTHER_FILES = {"sqrp_program": "a program", "skills": "a workspace"}
"""Files that are taken for this one, by a key that only they have."""
_TOPIC = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*")


def _topic_name(name: str) -> str:
    if not _TOPIC.fullmatch(name):
        expected = "a topic such as `/arm/joint_states`: letters, digits and `_`, parted by `/`"
        raise PydanticCustomError("wrong-value", f"found {describe(name)}, expected {expected}")
    return name


TopicName = Annotated[str, AfterValidator(_topic_name)]  # A name that ROS allows for topics


@dataclass(frozen=True, kw_only=True)
class TrajectoryEntry(FileRecord):
    """Where joint trajectories go."""

    topic: TopicName
    """Of a joint_trajectory_controller, such as `/joint_trajectory_controller/joint_trajectory`."""


@dataclass(frozen=True, kw_only=True)
class ImageTopicEntry(FileRecord):
    """The topics of a camera."""

    image: TopicName
    """Of its images."""
    type: ImageType = "sensor_msgs/msg/Image"
    """Of its messages: raw images or compressed ones."""
    info: TopicName | None = None
    """Of its `CameraInfo`; without it, matrix and resolution are not compared with the workspace."""
    frame: Text | None = None
    """Its optical frame in TF; by default, what its `CameraInfo` says."""
    clock_offset: Annotated[float, In(TIME, -1e6, 1e6)] = 0.0
    """How far its clock is ahead; subtracted from its stamps."""


@dataclass(frozen=True, kw_only=True)
class ToolTopicEntry(FileRecord):
    """The topic that has the tool hold and let go."""

    topic: TopicName
    """Such as `/suction`."""
    type: ToolType = "std_msgs/msg/Bool"
    """Of its messages."""
    hold: bool | Number | list[Number] = True
    """What has the tool hold."""
    release: bool | Number | list[Number] = False
    """What has it let go."""


@dataclass(frozen=True, kw_only=True)
class TolerancesEntry(FileRecord):
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
    """How to reach a real cell: ROS 2 on the wire, without an installed ROS."""

    transport: Literal["dds"] = Field(default="dds", description="DDS, of which there is no other choice.")
    domain: int = Field(default=0, ge=0, le=232, description="ROS_DOMAIN_ID of ROS 2.")
    network: Text | None = Field(
        default=None, description="Address or name of the network interface to use alone, such as 127.0.0.1."
    )
    reliable: bool = Field(
        default=False, description="Whether lost messages are sent again; then the cameras' drivers must offer it, too."
    )
    use_sim_time: bool = Field(default=False, description="Whether `/clock` gives the time, as in simulations.")
    trajectory: TrajectoryEntry = Field(description="Where joint trajectories go.")
    joint_states: TopicName = Field(default="/joint_states", description="Topic of the joints' positions.")
    joints: dict[Text, Text] | None = Field(
        default=None,
        description="The joints that the controller moves, in its order: name in the workspace, name in the messages; "
        "by default, all of the program by their own names.",
    )
    cameras: dict[Name, ImageTopicEntry] = Field(min_length=1, description="Topics of each camera of the workspace.")
    tool: ToolTopicEntry | None = Field(default=None, description="What has the tool hold and let go.")
    force: TopicName | None = Field(
        default=None, description="Topic of a force sensor (WrenchStamped), for guarded moves."
    )
    tf: bool = Field(default=True, description="Whether camera poses are compared with TF, where it has them.")
    world: Text = Field(default="world", description="What TF calls the frame `world` of the workspace.")
    tolerances: TolerancesEntry = Field(default=TolerancesEntry(), description="How far the cell may be off.")

    @property
    def where(self) -> str:
        """Where its topics are looked for, for messages."""
        return f"in domain {self.domain}" + (f" on {self.network}" if self.network else "")

    @property
    def mend_of_lateness(self) -> str:
        """What helps where messages come late by the clock of a simulated cell; empty for others."""
        return _SLOWER if self.use_sim_time else ""


def read_robot_file(path: Path, workspace: Workspace, program: Program) -> RobotFile:
    """The file, which must fit a program and its workspace. Raises InputError with every problem."""
    if not path.is_file():
        raise InputError(missing_file(path))
    document = read_yaml(path)
    other = next((what for key, what in _OTHER_FILES.items() if key in document.data), None)
    if other is not None:
        message = f"this is {other}, expected a file that says how to reach a robot"
        raise bad_input("wrong-type", message, Place(path), mend="see what it holds: sqrp schema robot")
    file = validate(document, RobotFile)
    problems: list[Problem] = []

    def wrong(code: str, message: str, *keys: str, mend: str | None = None) -> None:
        problems.append(Problem(code, message, document.key_place(keys), mend=mend))

    # `joints` names every joint that trajectories move, but fingers may be left to the tool.
    cameras, joints, fingers = workspace.cameras, file.joints, workspace.robot.fingers
    for name in file.cameras:
        if name not in cameras:
            wrong("unknown-camera", f"there is no camera `{name}`; {expected_names(name, cameras)}", "cameras", name)
    if missing := [f"`{name}`" for name in cameras if name not in file.cameras]:
        wrong("missing-key", f"`cameras` lacks {', '.join(missing)} of the workspace", "cameras")
    for name in joints or ():
        if name not in program.joints:
            message = f"the program has no joint `{name}`; {expected_names(name, program.joints)}"
            wrong("unknown-joint", message, "joints", name)
    movable = [name for name in program.joints if fingers is None or name not in fingers.open]
    if joints is not None and (left_out := [f"`{name}`" for name in movable if name not in joints]):
        wrong("missing-key", f"`joints` lacks {', '.join(left_out)}, which the program moves", "joints")
    for wire, count in Counter((joints or {}).values()).items():
        if count > 1:
            wrong("duplicate-name", f"`joints`: {count} joints are called `{wire}` in messages", "joints")
    primitives = [primitive for step in program.steps for primitive in step.primitives]
    if file.tool is None and any(one.action in ("Grasp", "Release") for one in primitives):
        message = "the program grasps, but the file has no `tool` that can be told to"
        wrong("missing-key", message, mend="tool: {topic: /suction}")
    if file.force is None and any(one.guard is not None for one in primitives):
        message = "the program has moves that end at contact, but the file has no topic of a `force` sensor"
        wrong("missing-key", message, mend="force: /wrench")
    if problems:
        raise InputError(*problems)
    return file


def as_yaml(file: RobotFile) -> str:
    """The file as text, without what is so by default."""
    head = "# How `sqrp run PROGRAM --robot FILE` reaches the cell; `sqrp schema robot` describes each key.\n"
    return head + str(yaml.safe_dump(file.model_dump(mode="json", exclude_defaults=True), sort_keys=False))
