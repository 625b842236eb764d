"""What is looked at before a robot moves: whether the cell is the one that the program was made for."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.hand_eye import StaticTransform
from sqrp_cli.errors import InputError, Place, expected_names
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, inverse, pose
from sqrp_cli.records import dataclass
from sqrp_cli.ros.messages import Inbox, Message, Topic
from sqrp_cli.run.cell.robot_file import ImageTopicEntry
from sqrp_cli.run.cell.ros_cell import RosCell

WATCHED, PERIODS = 1.0, 6
"""For how long the cell is watched at least [s], and for how many periods of its slowest camera."""
PATIENCE = 15.0  # Longest time of this computer for that, and for what has not come by then [s]
FEWEST = 3  # Images from which a rate is told
MOVES = 0.002  # A robot whose joints change by more meanwhile is moving [rad or m]
ANOTHER_CLOCK = 1e7  # Times that are further from ours are none of this computer's clock [s]
_TF = "tf2_msgs/msg/TFMessage"
_ON_TF = Place(Path("/tf"))
_INFO = "sensor_msgs/msg/CameraInfo"


@dataclass(frozen=True)
class CellCheck:
    """One thing that was compared."""

    about: str  # Such as `cam1`
    what: str  # Such as `rate`
    found: str  # With its unit
    expected: str  # With its unit; empty where nothing was
    problem: str | None = None  # What is wrong, in a sentence


def check_cell(cell: RosCell, start: Mapping[str, float]) -> list[CellCheck]:
    """Watch a cell for a while and compare it with its workspace; nothing is commanded.

    start: where the program begins, by joint [rad or m]. Raises MessageError for what is no message of its topic's
    type.
    """
    subscribe, reliable = cell.transport.subscribe, cell.file.reliable  # topics that are read for the checks alone
    cameras = cell.file.cameras
    infos = {
        name: subscribe(Topic(name=one.info, type=_INFO, depth=1, reliable=reliable))
        for name, one in cameras.items()
        if one.info is not None
    }
    tf = [
        subscribe(Topic(name="/tf_static", type=_TF, depth=100, reliable=True, latched=True)),
        subscribe(Topic(name="/tf", type=_TF, depth=100)),
    ][: 2 * cell.file.tf]
    seen = _watch(cell, infos, tf)
    if (trouble := cell.malformed) is not None:
        return [CellCheck("messages", "content", "", "", str(trouble))]
    if not cell.measured_joints() and not any(cell.ages.values()) and not cell.transport.senders():
        return [CellCheck("network", "senders", "none", "", f"nobody sends anything {cell.file.where}")]
    checks = [*_connections(cell), *_joints(cell, start, seen)]
    arrived = [one for inbox in tf for message, _ in inbox.take() for one in message.transforms]
    transforms = dict[str, StaticTransform]()
    for one in arrived:
        with suppress(InputError):  # what is no rotation is not used
            transforms |= {(found := StaticTransform.of(one, _ON_TF)).child: found}
    for name, about in cameras.items():
        camera = cell.cameras[name]
        said = [message for message, _ in infos[name].take()] if name in infos else []
        checks += _camera(cell, camera, said[-1] if said else None, about)
        frame = about.frame or (said[-1].header.frame_id if said else None)
        checks.append(_camera_pose(cell, camera, transforms, frame))
    return checks


def _watch(cell: RosCell, infos: Mapping[str, Inbox], tf: Sequence[Inbox]) -> list[Mapping[str, float]]:
    """Look on for long enough, and until everything has come; returns where the joints were.

    A `CameraInfo` of each camera, and what stands still of TF, if somebody sends that: connections are made one after
    another, and some messages come once in a while only.
    """
    enough = max(WATCHED, PERIODS * max(1.0 / camera.rate for camera in cell.cameras.values()))
    until = time.monotonic() + PATIENCE
    start, seen = None, []
    for ages in cell.ages.values():
        ages.clear()
    while time.monotonic() < until:
        cell.read()
        cell.frames(list(cell.cameras))
        if start is None and cell.measured_joints() and all(cell.ages.values()):
            start = cell.t
            for ages in cell.ages.values():
                ages.clear()
        if start is not None:
            seen.append(cell.measured_joints())
            watched = cell.t - start > enough and min(map(len, cell.ages.values())) >= FEWEST
            if watched and all(inbox.count for inbox in infos.values()):
                senders = cell.transport.senders()
                if all(one.count or one.topic.name not in senders for one in tf if one.topic.latched):
                    break
        cell.transport.wait(0.01)
    return seen


def _connections(cell: RosCell) -> Iterator[CellCheck]:
    """Whether somebody is there at each topic, with the same type, and nobody else commands the robot."""
    offered = cell.transport.senders()
    clock = cell.clock.inbox
    for inbox in (cell.states, *cell.images.values(), *(() if clock is None else (clock,))):
        if not inbox.count:
            topic = inbox.topic
            types = set(offered.get("/" + topic.name.lstrip("/"), ()))
            alike = [name for name, kinds in offered.items() if topic.type in kinds]
            why = f"nothing comes on `{topic.name}`"
            if types - {topic.type}:
                why = f"`{topic.name}` carries {', '.join(sorted(types))}, not {topic.type}"
            elif types and topic.reliable:
                why += "; its sender may not be reliable: set `reliable: false`"
            elif not types and alike:
                why = f"nobody sends on `{topic.name}`; {expected_names(topic.name, alike)}"
            yield CellCheck(topic.name, "messages", "none", topic.type, why)
    for topic in cell.commands:
        if cell.transport.readers(topic) == 0:
            yield CellCheck(topic.name, "readers", "none", "1", f"nobody reads `{topic.name}` to follow it")
    others = cell.transport.readers(cell.presence) - 1
    if others > 0:
        problem = "another `sqrp run` is connected to this robot, or was killed within the last 10 s"
        yield CellCheck("robot", "commanded by", f"{others} more", "", problem)


def _joints(cell: RosCell, start: Mapping[str, float], seen: list[Mapping[str, float]]) -> Iterator[CellCheck]:
    """Whether the robot stands where the program begins."""
    limits, found = cell.file.tolerances, cell.measured_joints()
    if not found:
        return
    for name in (name for name in cell.moved if name not in found):
        yield CellCheck("robot", "joints", "none", name, f"`{cell.file.joint_states}` does not say where `{name}` is")
    off = {name: found[name] - q for name, q in start.items() if name in found and name in cell.moved}
    if off:
        worst = max(off, key=lambda name: abs(off[name]))
        text, allowed = f"{np.degrees(abs(off[worst])):.2f} deg", f"{np.degrees(limits.start):.2f} deg"
        problem = f"`{worst}` is {text} from where the program starts; {allowed} are allowed"
        beyond = abs(off[worst]) > limits.start
        yield CellCheck("robot", "start", text, f"{allowed} at most", problem if beyond else None)
    moved = max((np.ptp([q[name] for q in seen if name in q]) for name in off), default=0.0) if seen else 0.0
    if moved > MOVES:
        yield CellCheck("robot", "standing", f"{moved:.3f} rad", "0", f"the robot is moving: by {moved:.3f} rad")
    yield _age(cell, "joint states", [cell.t - cell.joints.newest], 0.0)


def _age(cell: RosCell, about: str, ages: list[float], latency: float) -> CellCheck:
    age, limit = float(np.median(ages)), cell.file.tolerances.clock
    off = age - latency
    problem = None
    if abs(off) > ANOTHER_CLOCK:
        problem = (
            f"{about} have times of another clock; `use_sim_time: true` is for simulations, whose time is `/clock`"
        )
    elif abs(off) > limit:
        which = "behind" if off > 0 else "ahead"
        said = f"{about}: {1e3 * age:.0f} ms old when they come, the workspace says {1e3 * latency:.0f} ms"
        problem = f"{said}; their clock is {1e3 * abs(off):.0f} ms {which}, or they are late"
    return CellCheck(about, "age", f"{1e3 * age:.0f} ms", f"{1e3 * latency:.0f} ms", problem)


def _camera(cell: RosCell, camera: Camera, info: Message | None, about: ImageTopicEntry) -> Iterator[CellCheck]:
    """Whether the images of a camera come as often and as late, and its `CameraInfo` says, what the workspace does."""
    name, arrived, limits = camera.name, cell.ages[camera.name], cell.file.tolerances
    if len(arrived) >= FEWEST:
        rate = 1.0 / float(np.median([later - t for (t, _), (later, _) in pairwise(arrived)]) or 1e9)
        slow = f"`{name}` takes {rate:.3g} images a second, the workspace says {camera.rate:.3g}"
        wrong = slow if rate < (1.0 - limits.rate) * camera.rate else None
        yield CellCheck(name, "rate", f"{rate:.3g} Hz", f"{camera.rate:.3g} Hz", wrong)
        yield _age(cell, f"images of `{name}`", [came - t for t, came in arrived], camera.lag)
    elif cell.images[name].count:  # where none ever came, another check says so
        yield CellCheck(name, "rate", "none", f"{camera.rate:.3g} Hz", f"`{name}` hardly sends images")
    if info is None:
        problem = None if about.info is None else f"nothing comes on `{about.info}`"
        yield CellCheck(name, "CameraInfo", "none", "", problem)
        return
    size, expected = f"{info.width}x{info.height}", f"{camera.width}x{camera.height}"
    wrong = None if size == expected else f"`{name}` has images of {size} pixels, the workspace says {expected}"
    yield CellCheck(name, "image", size, expected, wrong)
    K = np.array(info.K if hasattr(info, "K") else info.k).reshape(3, 3)
    off = np.abs(K - camera.matrix)
    row, column = np.unravel_index(int(off.argmax()), off.shape)
    limit, problem = limits.focal * float(camera.matrix[0, 0]), None
    if off.max() > limit:
        entry = {(0, 0): "fx", (1, 1): "fy", (0, 2): "cx", (1, 2): "cy"}.get((int(row), int(column)), "K")
        found, said = K[row, column], camera.matrix[row, column]
        problem = f"`{name}`: {entry} of its CameraInfo is {found:.1f} px, the workspace says {said:.1f}"
    yield CellCheck(name, "K", f"{off.max():.2f} px off", f"{limit:.1f} px at most", problem)
    D = np.array(info.D if hasattr(info, "D") else info.d)
    both = np.zeros((2, max(len(D), len(camera.distortion), 1)))
    both[0, : len(D)], both[1, : len(camera.distortion)] = D, camera.distortion
    bent = float(np.abs(both[0] - both[1]).max())
    if bent > limits.focal:
        yield CellCheck(name, "D", f"{bent:.3f} off", "", f"`{name}`: its distortion is {bent:.3f} off the workspace's")


def _camera_pose(
    cell: RosCell, camera: Camera, transforms: Mapping[str, StaticTransform], frame: str | None
) -> CellCheck:
    """Whether TF has a camera where the workspace does, by way of the root that its frame and its carrier share."""
    carrier, child = cell.file.world if camera.frame == WORLD else camera.frame, (frame or "").lstrip("/")
    up: list[tuple[str, Array]] = []  # the root above carrier and camera, and the pose of each in it, (4, 4)
    for root in (carrier, child):
        X_RF = pose()
        for _ in range(len(transforms) + 1):
            if root in transforms:
                X_RF, root = transforms[root].X_PC @ X_RF, transforms[root].parent
        up.append((root, X_RF))
    (root, X_RF), (other, X_RC) = up
    if frame is None or root != other or carrier == child:
        return CellCheck(camera.name, "pose", "not in TF", "")
    off = inverse(camera.X_FC) @ (inverse(X_RF) @ X_RC)
    far = float(np.linalg.norm(off[:3, 3]))
    turned = float(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))
    limits, problem = cell.file.tolerances, None
    if far > limits.position or turned > limits.rotation:
        away = f"{1e3 * far:.1f} mm and {np.degrees(turned):.2f} deg"
        problem = f"TF has `{camera.name}` {away} from where the workspace has it"
    expected = f"{1e3 * limits.position:.0f} mm, {np.degrees(limits.rotation):.2f} deg at most"
    return CellCheck(camera.name, "pose", f"{1e3 * far:.1f} mm, {np.degrees(turned):.2f} deg off", expected, problem)
