"""Joint states of a ROS bag: MCAP, rosbag2 or ROS 1, on one topic or several, whole or a few names at a time."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np

from sqrp_cli.errors import Place, bad_input, expected_names, first_names
from sqrp_cli.geometry import Array
from sqrp_cli.recording.episode import MOST_NUMBERS, STEP_BACK, Recording, alone, pauses
from sqrp_cli.ros.bag import Bag, check_kind

JOINTS = "sensor_msgs/msg/JointState"
MOST_STATES = 2_000_000  # Most joint states that are read: those of an hour at 500 Hz
STANDARD = "/joint_states"  # The topic on which the states of a whole robot usually are
LEAST_SHARE = 0.5  # Of the longest time for which a joint is known
JointTracks: TypeAlias = Mapping[tuple[str, str], tuple[Array, Array]]
"""Where joints were, as recorded: by topic and name, times of a clock [s] and positions, (n,); linear in between."""


def joint_tracks(states: Iterable[tuple[str, float, Sequence[str], Sequence[float]]]) -> JointTracks:
    """Where joints were; states: topic, time [s], names and positions; what is missing or not finite is left out."""
    points: dict[tuple[str, str], tuple[array[float], array[float]]] = {}
    for topic, t, names, positions in states:
        for name, position in zip(names, positions, strict=False):
            if np.isfinite(position):
                times, values = points.setdefault((topic, name), (array("d"), array("d")))
                times.append(t)
                values.append(float(position))
    firsts = {key: np.unique(np.array(times), return_index=True) for key, (times, _) in points.items()}
    return {key: (rising, np.array(points[key][1])[first]) for key, (rising, first) in firsts.items()}


def open_bag(path: Path, rate: float | None, signal: str | None) -> Recording:
    """The joint states of a bag, which is one episode; signal: the topic, by default all.

    A name that several topics have is that of `STANDARD`; on others it is led by its topic, as in `left/joint_1`. All
    are brought to the times of the joint with the most states, linearly, where all are known; a joint that is known for
    less than `LEAST_SHARE` is left out.
    """
    check_kind(path)
    tracks = _tracks(path, signal)
    several = Counter(name for _, name in tracks)
    named = {
        name if several[name] == 1 or topic == STANDARD else f"{topic.strip('/').removesuffix(STANDARD)}/{name}": track
        for (topic, name), track in tracks.items()
    }
    spans = {name: float(t[-1] - t[0]) for name, (t, _) in named.items()}
    kept = {name: track for name, track in named.items() if spans[name] >= LEAST_SHARE * max(spans.values())}
    clock = max((t for t, _ in kept.values()), key=len)
    clock = clock[(clock >= max(t[0] for t, _ in kept.values())) & (clock <= min(t[-1] for t, _ in kept.values()))]
    if not len(clock):
        message = f"the states of {first_names([*kept])} are never known at one time; expected all on one clock"
        raise bad_input("wrong-clock", message, Place(path))
    states = np.column_stack([clock, *(np.interp(clock, *track) for track in kept.values())])
    doubts = [f"`{name}` is known for {spans[name]:.2f} s only and is left out" for name in spans if name not in kept]
    paused = defaultdict[str, list[str]](list)  # names by what is told of the pauses of their topic
    for name, (t, _) in kept.items():
        for said in pauses(t):
            paused[said].append(name)
    doubts += [f"of {first_names(those)}: {said}" for said, those in paused.items() if said not in pauses(clock)]
    return alone(path, "bag", [*kept], states, rate, *doubts)


def _tracks(path: Path, signal: str | None) -> JointTracks:
    """The tracks of a bag, by the stamps of its states, or by their arrival if only some have one.

    Raises InputError without any, for clocks that go back, and counts that do not fit.
    """
    with Bag(path) as bag:
        topics = [topic.name for topic in bag.topics if topic.type == JOINTS and topic.messages]
        chosen = [topic for topic in topics if signal in (None, topic)]
        count = without = 0  # of states, and of those without a stamp

        def states(*, arrived: bool) -> Iterator[tuple[str, float, Sequence[str], Sequence[float]]]:
            nonlocal count, without
            latest, numbers, begin = dict.fromkeys(chosen, -np.inf), 0, None
            for packed, state, stamp in bag.stamped(chosen, [JOINTS], MOST_STATES, "joint states"):
                ns = packed.t if arrived else stamp or packed.t
                begin = ns if begin is None else begin
                t = (ns - begin) * 1e-9  # since 1970 it would be known to 0.2 us
                count, without, numbers = count + 1, without + (not stamp), numbers + len(state.position)
                wrong = None
                if len(state.position) not in (0, len(state.name)):  # 0: velocities alone
                    wrong = f"has {len(state.position):,} positions for {len(state.name):,} names; expected as many"
                elif numbers > MOST_NUMBERS:
                    wrong = f"is beyond {MOST_NUMBERS:,} positions of joints; expected one motion"
                elif t < latest[packed.topic] - STEP_BACK:
                    wrong = f"is {latest[packed.topic] - t:.3g} s before an earlier one; expected one motion"
                if wrong:
                    message = f"a state on `{packed.topic}` {wrong}"
                    raise bad_input("wrong-states", message, Place(path), mend="cut the bag")
                latest[packed.topic] = max(t, latest[packed.topic])
                yield packed.topic, t, state.name, state.position

        tracks = joint_tracks(states(arrived=False))
        if 0 < without < count:
            tracks = joint_tracks(states(arrived=True))
    if not tracks:
        found = f"on `{signal}`; {expected_names(signal, topics)}" if signal else f"that is a {JOINTS} with positions"
        raise bad_input("no-joints", f"this bag has no joint state {found}", Place(path))
    return tracks
