"""A recording of ROS: images of cameras and joint states, as they were recorded."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Place, bad_input, bad_option, expected_names, first_names
from sqrp_cli.field.audit.footage import Frame, planned_at
from sqrp_cli.field.audit.motion import SPACING, JointTracks, found_steps
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.program.record import Program
from sqrp_cli.ros.bag import Bag, Packed, RecordedTopic
from sqrp_cli.ros.messages import Message, nanoseconds
from sqrp_cli.run.image import CameraImage, check_recorded
from sqrp_cli.run.monitor.nominal_step import planned_joints
from sqrp_cli.run.record.bag_recorder import AS_PLANNED
from sqrp_cli.run.record.packed_image import DamagedImageError, image_of

IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
"""Types of images; the first one is taken where a camera has both."""

JOINTS = "sensor_msgs/msg/JointState"

STRAYS = 0.05
"""A robot that is farther than this [rad or m] from where the program wants it does not do as planned any more."""

MOST_STATES = 2_000_000
"""Most joint states that are read: those of an hour at 500 Hz."""

MOST_FRAMES = 1_000_000
"""Most images that are looked at."""


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
            self._index(bag)
        self.recorded: Collection[str] = set(self._topics.values())
        used = {_stream(name) for name in self._topics}
        self.other_topics: Sequence[str] = [
            name
            for name in _names(there)
            if _stream(name) not in used and not {*workspace.cameras} & {*name.split("/")}
        ]
        check_recorded(workspace, self.recorded)
        arm = [name for name in program.joints if name in workspace.robot.home]
        found = found_steps(program, arm, self._tracks, path)
        self.starts: Sequence[float] = found.starts
        self.runs = found.runs
        self._until = []  # for how long the robot did as planned, by the robot's clock [s]
        for start, step in zip(self.starts, program.steps, strict=True):
            tau = np.append(np.arange(0.0, step.time, SPACING), step.time)
            planned = dict(zip(program.joints, planned_joints(step, tau).T, strict=True))
            near = self._tracks.covers(arm, start + tau)
            for name in arm:
                near &= np.abs(self._tracks.position(name, start + tau) - planned[name]) <= STRAYS
            strayed = np.flatnonzero(~near)
            self._until.append(start + float(tau[-1] if not len(strayed) else tau[max(strayed[0] - 1, 0)]))

    def _index(self, bag: Bag) -> None:
        """Find when each image was taken, all joint states, and when a run of SQRP told whether it went as planned."""

        def at_most(
            topics: Collection[str], types: Collection[str], most: int, what: str
        ) -> Iterator[tuple[int, Packed, Message, float]]:
            """Messages with their time [s], that of their arrival where they have none."""
            for number, packed in enumerate(bag.messages(topics, types)):
                if number >= most:
                    message = f"this recording has more than {most:,} {what}; cut it to the run of the program"
                    raise bad_input("file-too-large", message, Place(bag.path))
                read = bag.read(packed)
                stamp = nanoseconds(read.header.stamp) if hasattr(read, "header") else 0
                yield number, packed, read, (stamp or packed.t) * 1e-9

        images = at_most(self._topics, IMAGES, MOST_FRAMES, "images")
        frames = [Frame(self._topics[packed.topic], t, number) for number, packed, _, t in images]
        self.frames: Sequence[Frame] = sorted(frames, key=lambda frame: (frame.t, frame.camera))
        tracks = JointTracks()
        for _, packed, read, t in at_most([one.name for one in bag.topics], [JOINTS], MOST_STATES, "joint states"):
            tracks.add(packed.topic, t, read.name, read.position)
        self._tracks = tracks.sorted()
        changes = at_most([AS_PLANNED], ["std_msgs/msg/Bool"], MOST_FRAMES, "changes of the plan")
        self._told = sorted((packed.t * 1e-9, bool(read.data)) for _, packed, read, _ in changes)

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
                    where = f"{packed.topic} at {frame.t:.3f} s"
                    camera = self._workspace.cameras[frame.camera]
                    try:
                        image = image_of(bag.read(packed), camera, Place(self.path), where)
                        yield frame, CameraImage(frame.camera, frame.t, image)
                    except DamagedImageError as error:
                        self.damaged[number] = error.problems[0].message
                if number == last:
                    return


def _cameras_of(
    topics: Sequence[RecordedTopic], workspace: Workspace, given: Mapping[str, str], path: Path
) -> dict[str, str]:
    """The camera of each topic, of those with images, that is looked at.

    Raises InputError where there is none, where topics of a camera have different images, as colours and depths, and
    where one would be of two cameras.
    """
    found: dict[str, str] = {}
    mend = "sqrp audit PROGRAM RECORDING --topic"
    for camera in workspace.cameras:
        own = [
            one for one in topics if (one.name == given[camera] if camera in given else camera in one.name.split("/"))
        ]
        names = _names(own)
        if not own and camera in given:
            message = f"there are no images on `{given[camera]}`; {expected_names(given[camera], _names(topics))}"
            raise bad_input("no-images", message, Place(path))
        if len({_stream(name) for name in names}) > 1:
            message = f"there are images of {camera} on {first_names(names)}; which are they?"
            raise bad_option(message, Place(path), mend=f"{mend} {camera}={names[0]}")
        if own:
            name = min(own, key=lambda topic: (IMAGES.index(topic.type), topic.name)).name
            other = found.setdefault(name, camera)
            if other != camera:
                bare = camera if camera not in given else other
                message = (
                    f"`{name}` would be the images of {other} and of {camera}; expected a topic of its own for each"
                )
                raise bad_option(message, Place(path), mend=f"{mend} {bare}=TOPIC, too")
    if not found:
        cameras = ", ".join(workspace.cameras)
        there = f"it has images on {first_names(_names(topics))}" if topics else "it has no images at all"
        message = f"this recording has no images of {cameras}: {there}"
        raise bad_input("no-images", message, Place(path), mend=f"{mend} CAMERA=TOPIC" if topics else None)
    return found


def _stream(topic: str) -> str:
    """The name of a stream of images, packed or not."""
    return topic.removesuffix("/compressed")


def _names(topics: Sequence[RecordedTopic]) -> list[str]:
    return sorted({topic.name for topic in topics})
