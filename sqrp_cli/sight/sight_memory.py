"""What cameras saw before, kept while robot, objects and lights stay: only a camera that has moved is asked again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field
from hashlib import blake2b
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.geometry import Array, Indices
from sqrp_cli.records import dataclass
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target

UNKNOWN, UNSEEN, SEEN = -1, 0, 1
"""Whether a camera sees all boxes of a target."""
Sights: TypeAlias = NDArray[np.int8]
"""For each of c cameras and q questions one of `UNKNOWN`, `UNSEEN` and `SEEN`, shape (c, q)."""
MOST_QUESTIONS, MOST_CAMERAS = 100_000, 64
"""Of how many questions, and of how many placed cameras, answers are kept at most: 150 bytes a question and one an
answer, so 22 MB.
"""

_DIGEST = 16
"""Bytes that stand for everything that decides what a camera sees."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Answers to questions."""

    cameras: Sequence[bytes]
    """Each placed camera in short."""
    questions: Sequence[bytes]
    """Each target in a state in short."""
    sights: Sights


@dataclass(eq=False)
class SightMemory:
    """The answers of all cameras so far. A question is a target with where it and every solid are in a state."""

    learnt: list[Seen] = field(default_factory=list)
    """What was noted; whoever passes it on empties it."""
    _numbers: dict[bytes, int] = field(default_factory=dict)
    _answers: dict[bytes, NDArray[np.int8]] = field(default_factory=dict)
    """By camera, of each question by its number; those used last come last."""
    _states: tuple[SceneStates, list[bytes]] | None = None
    """Those that were asked for last, in short."""

    def questions(
        self, targets: Sequence[Target], states: SceneStates, rows: Sequence[Indices], frames: Sequence[str]
    ) -> list[bytes]:
        """In short, each target in its states `rows`. frames: those that carry solids or cameras."""
        if self._states is None or self._states[0] is not states:
            self._states = states, _digests([states.X_WF[name] for name in frames], states.count)
        of_states = np.frombuffer(b"".join(self._states[1]), dtype=np.float64).reshape(states.count, -1)
        found: list[bytes] = []
        for target, at in zip(targets, rows, strict=True):
            poses = [states.box_poses(box) for box in target.boxes]
            here = [X_WB[at] if len(X_WB) > 1 else X_WB for X_WB in poses]
            what = [(box.size, box.normal, box.encloses, box.limits, box.seeks, box.color) for box in target.boxes]
            found += _digests(here, len(at), of_states[at], repr(what).encode())
        return found

    def recalled(self, cameras: Sequence[Camera], questions: Sequence[bytes]) -> Sights:
        """What is known."""
        numbers = np.array([self._numbers.get(question, -1) for question in questions], dtype=np.int64)
        sights = np.full((len(cameras), len(questions)), UNKNOWN, dtype=np.int8)
        for row, camera in enumerate(map(_camera, cameras)):
            if (answers := self._answers.pop(camera, None)) is not None:
                self._answers[camera] = answers
                known = np.flatnonzero((numbers >= 0) & (numbers < len(answers)))
                sights[row, known] = answers[numbers[known]]
        return sights

    def note(self, cameras: Sequence[Camera], questions: Sequence[bytes], sights: Sights) -> None:
        """Keep answers, also as `learnt`."""
        seen = Seen(list(map(_camera, cameras)), questions, sights)
        self.learnt.append(seen)
        self.take(seen)

    def take(self, seen: Seen) -> None:
        """Keep answers."""
        if len(self._numbers) + len(seen.questions) > MOST_QUESTIONS:
            self._numbers.clear()
            self._answers.clear()
        numbers = np.array([self._numbers.setdefault(key, len(self._numbers)) for key in seen.questions])
        for camera, sights in zip(seen.cameras, seen.sights, strict=True):
            answers = self._answers.pop(camera, np.empty(0, dtype=np.int8))
            more = np.full(max(0, len(self._numbers) - len(answers)), UNKNOWN, dtype=np.int8)
            self._answers[camera] = answers = np.concatenate([answers, more])
            known = sights != UNKNOWN
            answers[numbers[known]] = sights[known]
        for camera in list(self._answers)[: -MOST_CAMERAS or None]:
            del self._answers[camera]


def _camera(camera: Camera) -> bytes:
    """All of a camera that decides what it sees, in short."""
    arrays = b"".join(np.ascontiguousarray(one).tobytes() for one in (camera.X_FC, camera.matrix, camera.distortion))
    size = camera.width, camera.height
    others = (camera.frame, size, camera.distortion_model, camera.near, camera.far, camera.gain)
    return blake2b(arrays + repr(others).encode(), digest_size=_DIGEST).digest()


def _digests(X: Sequence[Array], count: int, further: Array | None = None, common: bytes = b"") -> list[bytes]:
    """Poses (count or 1, 4, 4), further figures (count, n) and what is common to all rows, in short for each row."""
    moving = [poses[:, :3].reshape(count, -1) for poses in X if len(poses) > 1]
    still = b"".join(poses[:, :3].tobytes() for poses in X if len(poses) == 1)
    start = blake2b(still + common, digest_size=_DIGEST)
    columns = moving if further is None else [*moving, further]
    if not columns:
        return [start.digest()] * count
    table = np.concatenate(columns, axis=1)
    rows, width = memoryview(table.tobytes()), table.shape[1] * table.itemsize
    found: list[bytes] = []
    for begin in range(0, count * width, width):
        row = start.copy()
        row.update(rows[begin : begin + width])
        found.append(row.digest())
    return found
