"""A recording of ROS: images of cameras and joint states, as they were recorded."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sqrp_cli.errors import Place, bad_input, bad_option, expected_names, first_names
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.program.record import Program, Step
from sqrp_cli.ros.bag import Bag, Packed, RecordedTopic
from sqrp_cli.ros.messages import Message, nanoseconds
from sqrp_cli.runtime.audit.footage import Frame, planned_at
from sqrp_cli.runtime.audit.motion import SPACING, JointTracks, found_steps
from sqrp_cli.runtime.image import CameraImage, check_recorded
from sqrp_cli.runtime.monitor.nominal_step import planned_joints
from sqrp_cli.runtime.record.bag_recorder import AS_PLANNED
from sqrp_cli.runtime.record.packed_image import DamagedImageError, image_of

IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
"""Types of images; the first one is taken where a camera has both."""

JOINTS = "sensor_msgs/msg/JointState"

STRAYS = 0.05
"""A robot that is farther than this [rad or m] from where the program wants it does not do as planned any more."""

MOST_STATES = 2_000_000
"""Most joint states that are read: those of an hour at 500 Hz."""

MOST_FRAMES = 1_000_000
"""Most images that are looked at."""


@dataclass(frozen=True, eq=False)
class _Index:
    """What a recording holds, without the images themselves."""

    frames: list[Frame]
    tracks: JointTracks
    told: list[tuple[float, bool]]
    """When the run that was recorded told whether it went as planned from then on [s]; empty where nobody did."""


class BagFootage:
    """A recording whose joint states show the program's motion."""

    unplanned = 0

    def __init__(self, program: Program, workspace: Workspace, path: Path, topics: Mapping[str, str]) -> None:
        """topics: of cameras whose name their topic does not have.

        Raises InputError for a recording that cannot be read, that lacks images or joints, or in which the robot never
        moves as in the program.
        """
        self.path, self._program, self._workspace = path, program, workspace
        self.damaged: dict[int, str] = {}
        with Bag(path) as bag:
            there = [topic for topic in bag.topics if topic.type in IMAGES and topic.count]
            there = [topic for topic in there if not topic.name.endswith("/compressedDepth")]
            self._topics = _cameras_of(there, workspace, topics, path)
            index = _indexed(bag, self._topics)
        self.recorded: Collection[str] = set(self._topics.values())
        used = {_stream(name) for name in self._topics}
        self.other_topics: Sequence[str] = [
            name
            for name in _names(there)
            if _stream(name) not in used and not {*workspace.cameras} & {*name.split("/")}
        ]
        check_recorded(workspace, self.recorded)
        self.frames: Sequence[Frame] = index.frames
        self._tracks, self._told = index.tracks, index.told
        arm = [name for name in program.joints if name in workspace.robot.home]
        found = found_steps(program, arm, self._tracks, path)
        self.starts: Sequence[float] = found.starts
        self.runs = found.runs
        steps = zip(self.starts, program.steps, strict=True)
        self._until = [start + self._followed(arm, start, step) for start, step in steps]

    def joints(self, t: Array) -> Mapping[str, Array]:
        """As recorded; those of a gripper that nobody recorded are as the program wants them."""
        planned = planned_at(self._program, self.starts, t)
        return {**planned, **{name: self._tracks.position(name, t) for name in self._tracks.names}}

    def as_planned(self, t: Array) -> Mask:
        """Whether every joint of the arm has been near where the program wants it since the step began.

        A run of SQRP itself has told, too, when it left the plan, as for a part that fell: the arm goes on for a while.
        """
        planned = np.zeros(len(t), dtype=bool)
        for start, until in zip(self.starts, self._until, strict=True):
            planned |= (t >= start - 1e-6) & (t <= until + 1e-6)
        if self._told:
            since, values = zip(*self._told, strict=True)
            last = np.searchsorted(since, t + 1e-6, side="right") - 1
            planned &= np.array(values)[np.maximum(last, 0)]
        return planned

    def images(self, frames: Sequence[Frame]) -> Iterator[tuple[Frame, CameraImage]]:
        """The images of some frames, in the order of the recording, but for those that are damaged."""
        wanted = {frame.number: frame for frame in frames}
        if not wanted:
            return
        last = max(wanted)
        with Bag(self.path) as bag:
            for number, packed in enumerate(bag.messages(self._topics, IMAGES)):
                if number in wanted:
                    frame = wanted[number]
                    try:
                        yield frame, self._image(bag.read(packed), packed, frame)
                    except DamagedImageError as error:
                        self.damaged[number] = error.problems[0].message
                if number == last:
                    return

    def _image(self, message: Message, packed: Packed, frame: Frame) -> CameraImage:
        camera: Camera = self._workspace.cameras[frame.camera]
        where = f"{packed.topic} at {frame.t:.3f} s"
        return CameraImage(frame.camera, frame.t, image_of(message, camera, Place(self.path), where))

    def _followed(self, arm: Sequence[str], start: float, step: Step) -> float:
        """How long the robot did as planned from the start of a step on [s]."""
        tau = np.append(np.arange(0.0, step.time, SPACING), step.time)
        planned = dict(zip(self._program.joints, planned_joints(step, tau).T, strict=True))
        near = self._tracks.covers(arm, start + tau)
        for name in arm:
            near &= np.abs(self._tracks.position(name, start + tau) - planned[name]) <= STRAYS
        strayed = np.flatnonzero(~near)
        return float(tau[-1] if not len(strayed) else tau[max(strayed[0] - 1, 0)])


def _cameras_of(
    topics: Sequence[RecordedTopic], workspace: Workspace, given: Mapping[str, str], path: Path
) -> dict[str, str]:
    """The camera of each topic, of those with images, that is looked at. Raises InputError where there is none."""
    found: dict[str, str] = {}
    for camera in workspace.cameras:
        own = [
            one for one in topics if (one.name == given[camera] if camera in given else camera in one.name.split("/"))
        ]
        if not own and camera in given:
            message = f"there are no images on `{given[camera]}`; {expected_names(given[camera], _names(topics))}"
            raise bad_input("no-images", message, Place(path))
        if own:
            _check_one_stream(_names(own), camera, path)
            name = min(own, key=lambda topic: (IMAGES.index(topic.type), topic.name)).name
            _check_free(name, camera, found.setdefault(name, camera), given, path)
    if not found:
        cameras = ", ".join(workspace.cameras)
        there = f"it has images on {first_names(_names(topics))}" if topics else "it has no images at all"
        message = f"this recording has no images of {cameras}: {there}"
        mend = "sqrp audit PROGRAM RECORDING --topic CAMERA=TOPIC" if topics else None
        raise bad_input("no-images", message, Place(path), mend=mend)
    return found


def _stream(topic: str) -> str:
    """The name of a stream of images, packed or not."""
    return topic.removesuffix("/compressed")


def _check_one_stream(topics: Sequence[str], camera: str, path: Path) -> None:
    """Raises InputError where topics with the name of a camera have different images, as colours and depths."""
    if len({_stream(topic) for topic in topics}) > 1:
        message = f"there are images of {camera} on {first_names(topics)}; which are they?"
        raise bad_option(message, Place(path), mend=f"sqrp audit PROGRAM RECORDING --topic {camera}={topics[0]}")


def _check_free(topic: str, camera: str, other: str, given: Mapping[str, str], path: Path) -> None:
    """Raises InputError where the images of a camera are those of another one."""
    if other != camera:
        bare = camera if camera not in given else other
        message = f"`{topic}` would be the images of {other} and of {camera}; expected a topic of its own for each"
        raise bad_option(message, Place(path), mend=f"sqrp audit PROGRAM RECORDING --topic {bare}=TOPIC, too")


def _names(topics: Sequence[RecordedTopic]) -> list[str]:
    return sorted({topic.name for topic in topics})


def _indexed(bag: Bag, topics: Mapping[str, str]) -> _Index:
    """When each image was taken, and all joint states."""
    frames = [
        Frame(topics[packed.topic], _stamp(bag.read(packed), packed), number)
        for number, packed in _at_most(bag, topics, IMAGES, MOST_FRAMES, "images")
    ]
    every = [topic.name for topic in bag.topics]
    tracks = JointTracks()
    for _, packed in _at_most(bag, every, [JOINTS], MOST_STATES, "joint states"):
        message = bag.read(packed)
        tracks.add(packed.topic, _stamp(message, packed), message.name, message.position)
    frames.sort(key=lambda frame: (frame.t, frame.camera))
    changes = _at_most(bag, [AS_PLANNED], ["std_msgs/msg/Bool"], MOST_FRAMES, "changes of the plan")
    told = sorted((packed.t * 1e-9, bool(bag.read(packed).data)) for _, packed in changes)
    return _Index(frames, tracks.sorted(), told)


def _at_most(
    bag: Bag, topics: Collection[str], types: Collection[str], most: int, what: str
) -> Iterator[tuple[int, Packed]]:
    for number, packed in enumerate(bag.messages(topics, types)):
        if number >= most:
            message = f"this recording has more than {most:,} {what}; cut it to the run of the program"
            raise bad_input("file-too-large", message, Place(bag.path))
        yield number, packed


def _stamp(message: Message, packed: Packed) -> float:
    """The time in a message [s], or that of its arrival where it has none."""
    return (nanoseconds(message.header.stamp) or packed.t) * 1e-9
