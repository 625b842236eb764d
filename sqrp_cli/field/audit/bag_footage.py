"""A recording of ROS: images of cameras and joint states, as they were recorded, and the program's motion in these."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Place, bad_input, bad_option, expected_names, first_names
from sqrp_cli.field.audit.footage import FolderFootage, Frame, planned_at
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.logic.formula_time import TimeInterval
from sqrp_cli.program.record import Program, Step
from sqrp_cli.recording.bags import JOINTS, MOST_STATES, joint_tracks
from sqrp_cli.ros.bag import Bag, RecordedTopic
from sqrp_cli.run.image import CameraImage, check_image_sizes
from sqrp_cli.run.monitor.nominal_step import planned_joints
from sqrp_cli.run.record.bag_recorder import AS_PLANNED
from sqrp_cli.run.record.packed_image import image_of

IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
"""Types of images; the first one is taken where a camera has both."""
PACKED = "/compressed"  # ends the topics of packed images, whose stream has the same name without it
STRAYS = 0.05
"""A robot that is farther than this [rad or m] from where the program wants it does not do as planned any more."""
MOST_FRAMES = 1_000_000  # Most images that are looked at


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
            there = [topic for topic in bag.topics if topic.type in IMAGES and topic.messages]
            there = [topic for topic in there if not topic.name.endswith("/compressedDepth")]
            self._topics = _cameras_of(there, workspace, topics, path)
            self._index(bag)
        self.recorded: Collection[str] = set(self._topics.values())
        used = {name.removesuffix(PACKED) for name in self._topics}
        self.other_topics: Sequence[str] = [
            name
            for name in _names(there)
            if name.removesuffix(PACKED) not in used and not {*workspace.cameras} & {*name.split("/")}
        ]
        check_image_sizes(workspace, self.recorded)
        arm = [name for name in program.joints if name in workspace.robot.home]
        self.starts: Sequence[float]
        self.starts, self.runs = found_steps(program, arm, self._tracks, path)
        self._until = []  # for how long the robot did as planned, by the robot's clock [s]
        for start, step in zip(self.starts, program.steps, strict=True):
            tau = np.append(np.arange(0.0, step.time, SPACING), step.time)
            planned = dict(zip(program.joints, planned_joints(step, tau).T, strict=True))
            near, t = np.ones(len(tau), dtype=bool), start + tau
            for name in arm:
                times, values = self._tracks[name]
                after = (
                    np.clip(np.searchsorted(times, t), 1, len(times) - 1) if len(times) > 1 else np.zeros(len(t), int)
                )
                near &= (t >= times[0] - GAP) & (t <= times[-1] + GAP) & (times[after] - times[after - 1] <= GAP)
                near &= np.abs(np.interp(t, times, values) - planned[name]) <= STRAYS
            strayed = np.flatnonzero(~near)
            self._until.append(start + float(tau[-1] if not len(strayed) else tau[max(strayed[0] - 1, 0)]))

    def _index(self, bag: Bag) -> None:
        """Find when each image was taken, all joint states, and when a run of SQRP told whether it went as planned."""
        images = enumerate(bag.stamped(self._topics, IMAGES, MOST_FRAMES, "images"))
        frames = [Frame(self._topics[packed.topic], (t or packed.t) * 1e-9, n) for n, (packed, _, t) in images]
        self.frames: Sequence[Frame] = sorted(frames, key=lambda frame: (frame.t, frame.camera))
        joints = bag.stamped([one.name for one in bag.topics], [JOINTS], MOST_STATES, "joint states")
        states = ((packed.topic, (t or packed.t) * 1e-9, read.name, read.position) for packed, read, t in joints)
        tracks = joint_tracks(states)
        self._tracks = dict[str, tuple[Array, Array]]()
        for (_, name), track in sorted(tracks.items(), key=lambda one: -len(one[1][0])):
            self._tracks.setdefault(name, track)  # of a joint on several topics that with the most states counts
        changes = bag.stamped([AS_PLANNED], ["std_msgs/msg/Bool"], MOST_FRAMES, "changes of the plan")
        self._told = sorted((packed.t * 1e-9, bool(read.data)) for packed, read, _ in changes)

    def joints(self, t: Array) -> Mapping[str, Array]:
        """As recorded; those of a gripper that nobody recorded are as the program wants them."""
        planned = planned_at(self._program, self.starts, t)
        return {**planned, **{name: np.interp(t, *track) for name, track in self._tracks.items()}}

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
                    image = image_of(bag.read(packed), camera, Place(self.path), where)
                    if isinstance(image, str):
                        self.damaged[number] = image
                    else:
                        yield frame, CameraImage(frame.camera, frame.t, image)
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
        if len({name.removesuffix(PACKED) for name in names}) > 1:
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


def _names(topics: Sequence[RecordedTopic]) -> list[str]:
    return sorted({topic.name for topic in topics})


SPACING = 0.02  # Between the starts of a step that are tried [s]
POINTS = 64  # Points of a step's motion that are compared
NEAR = 0.03  # A joint this close to where the program wants it follows the program [rad or m]
LEAST_SHARE = 0.35
"""Least share of a step's motion that must be there, from its beginning on: it may have been stopped on the way."""
GAP = 0.2  # Between joint states farther apart than this [s] the joints are not known
LONGEST = 12 * 3600.0
"""Longest recording that is searched [s]; that of a longer one, or of one in which a clock jumped, is refused."""
_ONE_RUN = 2.0
"""Starts that fit as well as the first one, and are not later than this after it [s], are of the same run."""
_BLOCK = 4096  # Starts that are tried at once
Tracks: TypeAlias = Mapping[str, tuple[Array, Array]]
"""Where joints were, as recorded: by name, times of the robot's clock [s] and positions, (n,); linear in between."""


def found_steps(program: Program, arm: Sequence[str], tracks: Tracks, path: Path) -> tuple[list[float], int]:
    """Find a program's motion in a recording; arm: the joints to go by.

    Returns when each step began, by the robot's clock [s], and how many times all of its steps are there, one after the
    other; of several runs the first one counts. Raises InputError where a joint was not recorded, or a step is missing.
    """
    missing = [name for name in arm if name not in tracks]
    if missing:
        there = first_names(sorted(tracks)) or "none"
        message = f"the joint states of this recording lack {', '.join(missing)}; they have {there}"
        raise bad_input("no-joints", message, Place(path))
    columns = [program.joints.index(name) for name in arm]
    times = [tracks[name][0] for name in arm]
    left = known = TimeInterval(max(float(t[0]) for t in times), min(float(t[-1]) for t in times))
    if known.length > LONGEST:
        hours = known.length / 3600
        message = f"the joint states of this recording span {hours:,.0f} hours, more than {LONGEST / 3600:.0f}"
        raise bad_input("file-too-large", message, Place(path), mend="cut the recording to the run of the program")
    fits = []
    for number, step in enumerate(program.steps, 1):
        start, share, all_starts = _best_start(step, columns, arm, tracks, left)
        if share < LEAST_SHARE:
            motion, least = f"the motion of step {number}, {step.short_task}", f"the first {LEAST_SHARE:.0%} of it"
            near = f"where they are nearest to it, at {start - known.start:.2f} s, {share:.0%} of it fits"
            message = f"{motion}, is not in the joint states of this recording: {near}; expected at least {least}"
            if start + (share + 1 / POINTS) * step.time > known.end:
                early = f"this recording ends at {known.length:.2f} s, too early in {motion}"
                message = f"{early}; expected at least {least}"
            raise bad_input("other-motion", message, Place(path))
        fits.append((start, all_starts, step))
        left = TimeInterval(start + 0.5 * step.time, known.end)
    runs, t = -1, -np.inf
    while t < np.inf:  # all steps once more, one after the other, until one is not there
        runs += 1
        for _, all_starts, step in fits:
            t = next((one for one in all_starts if one >= t), np.inf) + max(0.5 * step.time, SPACING)
    return [start for start, _, _ in fits], runs


def _best_start(
    step: Step, columns: Sequence[int], arm: Sequence[str], tracks: Tracks, span: TimeInterval
) -> tuple[float, float, list[float]]:
    """The first start of a step [s] from which on the robot follows it for the longest time.

    Also the share of it that is there, and all times about when it begins [s].

    So a retry after a fault is not taken for it, which follows other ways to where it begins. It is then refined to
    that at which the recorded motion fits best, by least squares over what follows the program.
    """
    tau = np.linspace(0.0, step.time, POINTS)
    planned = planned_joints(step, tau)[:, columns]
    starts = np.arange(span.start - SPACING, span.end + SPACING, SPACING)
    costs, shares = np.empty(len(starts)), np.empty(len(starts))
    for first in range(0, len(starts), _BLOCK):
        t = starts[first : first + _BLOCK, None] + tau
        errors = np.max([np.abs(np.interp(t, *tracks[n]) - planned[:, i]) for i, n in enumerate(arm)], axis=0)
        errors = np.where((t < span.start - SPACING) | (t > span.end + SPACING), np.inf, errors)
        costs[first : first + _BLOCK] = np.minimum(errors, NEAR).mean(axis=1)
        shares[first : first + _BLOCK] = np.logical_and.accumulate(errors < NEAR, axis=1).mean(axis=1)
    good = np.flatnonzero(shares >= max(LEAST_SHARE, shares.max() - 0.05))
    if not len(good):
        return float(starts[np.argmax(shares)]), float(shares.max(initial=0.0)), []
    # Of several runs the first one.
    run = good[starts[good] <= starts[good[0]] + _ONE_RUN]
    best = int(run[np.argmin(costs[run])])
    fresh = np.diff(starts[good], prepend=-np.inf) > _ONE_RUN
    start, h = float(starts[best]), SPACING / 2
    tau = np.arange(0.0, step.time, h)
    planned = planned_joints(step, tau)[:, columns]
    for _ in range(10):
        before, after = (np.column_stack([np.interp(start + tau + d, *tracks[n]) for n in arm]) for d in (-h, h))
        slope, error = (after - before) / (2 * h), (after + before) / 2 - planned
        kept = np.abs(error).max(axis=1) < NEAR
        weight = float((slope[kept] ** 2).sum())
        change = -float((slope[kept] * error[kept]).sum()) / weight if weight >= 1e-9 else 0.0  # 0: it stands
        start += float(np.clip(change, -SPACING, SPACING))
        if abs(change) < 1e-6:
            break
    return start, float(shares[best]), starts[good[fresh]].tolist()


Footage: TypeAlias = FolderFootage | BagFootage  # A recording of a program's run
