"""The log of a run, one JSON document per line, and reading it again. It holds no wall time: same run, same bytes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from sqrp_cli.errors import Place
from sqrp_cli.files.json_file import json_name
from sqrp_cli.geometry import Array
from sqrp_cli.platform.files import naming
from sqrp_cli.recording.texts import log_lines, no_log
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.events import KINDS, VERSION, WHOLE_STATE, Event, Listener

SLACK = 0.01  # Largest step back between events [s], since the simulation's clock is discrete


@contextmanager
def written_log(path: Path, header: Event) -> Iterator[Listener]:
    """A log of a run, which what happens is given to as it happens. Raises InputError where it cannot be written.

    header: what was run and how.
    """
    with naming(path):  # line by line, so that nothing is lost where a run is interrupted
        file = path.open("w", encoding="utf-8", buffering=1)

    def write(happened: Event) -> None:
        with naming(path):
            file.write(json.dumps(happened.line(), allow_nan=False) + "\n")

    try:
        write(header)
        yield write
    finally:
        with naming(path):
            file.close()


def read_log(path: Path) -> Iterator[Event]:
    """The events of known kinds in a log, its header first.

    Raises InputError, with the line, for anything but a log.
    """
    before, joints, place = 0.0, None, None
    for place, fields in log_lines(path):
        t, kind = float(fields["t"]), fields["event"]
        if place.line == 1 and (kind, fields.get("sqrp_log")) != ("run", VERSION):
            raise no_log("this is no log of `sqrp run --log`, or one of another version", place)
        found: Event | None = None
        try:
            if kind == "report":
                found = KINDS[kind].model_validate({"t": t, "report": {**fields, "wall": {}}})
            elif kind in KINDS:
                found = (WHOLE_STATE if kind == "state" and joints is None else KINDS[kind]).model_validate(fields)
        except ValidationError as error:
            first = error.errors()[0]
            name, message = json_name(first["loc"]).removeprefix("report."), first["msg"]
            problem = f"this `{kind}` is no event of a log: `{name}`: {message[0].lower()}{message[1:]}"
            raise no_log(problem, place) from None
        if found is not None and kind == "report":
            shown, asked = (
                [[(atom, name) for atom, cameras in step.items() for name in cameras] for step in steps]
                for steps in (found.report.usual, found.report.prediction)
            )
            if shown != asked:
                problem = "the report at the end of this log has other literals under `usual` than under `prediction`"
                raise no_log(problem, place)
        if found is not None and kind == "state":
            joints = len(found.joints) if joints is None else joints
            if "q" in found.model_fields_set and len(found.q) != joints:
                raise no_log(f"this state has {len(found.q)} positions `q` of {joints} joints", place)
        if t < before - SLACK:
            raise no_log(f"this event is at {t:g} s, before that of the line above", place)
        before = max(before, t)
        if found is not None:
            yield found
    if place is None:
        raise no_log("this log is empty", Place(path))


@dataclass(frozen=True, eq=False)
class Track:
    """Where everything was during a run."""

    t: Array  # Times on the run's clock [s], shape (n,)
    joints: tuple[str, ...]  # Names of the j joints
    q: Array  # Their positions, shape (n, j) [rad or m]
    held: tuple[str | None, ...]  # What the tool held at each of the n times
    poses: Mapping[str, tuple[tuple[int, tuple[float, ...]], ...]]
    """Of each object in the world, as pairs of the index of a time and the pose from then on.

    A pose is x, y, z [m] and a quaternion x, y, z, w.
    """

    @classmethod
    def of(cls, events: Iterable[Event]) -> Track | None:
        """What a run published of it, from all its events; None if it published none."""
        states = [one for one in events if one.event == "state"]
        if not states:
            return None
        q, held = list[Sequence[float]](), list[str | None]()
        poses: dict[str, list[tuple[int, tuple[float, ...]]]] = {}
        for index, state in enumerate(states):  # the first is whole
            q.append(state.q if "q" in state.model_fields_set else q[-1])
            held.append(state.held if "held" in state.model_fields_set else held[-1])
            for name, pose in state.objects.items():
                poses.setdefault(name, []).append((index, tuple(pose)))
        return cls(
            np.array([state.t for state in states]),
            tuple(states[0].joints),
            np.array(q, dtype=float).reshape(len(states), -1),
            tuple(held),
            {name: tuple(found) for name, found in poses.items()},
        )
