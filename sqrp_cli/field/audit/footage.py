"""What an audit needs of a recording: images with their times, and where the robot was.

There are two clocks to keep apart: that of the robot, on which the joints are known, and that of each camera.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from sqrp_cli.camera.camera import PixelSize
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.program.record import Program
from sqrp_cli.records import dataclass
from sqrp_cli.run.image import CameraImage, check_image_sizes
from sqrp_cli.run.monitor.nominal_step import planned_joints
from sqrp_cli.run.record.images import read_frames
from sqrp_cli.run.record.packed_image import read_png


@dataclass(frozen=True)
class Frame:
    """An image of a recording."""

    camera: str
    t: float  # When it was taken, by its camera's clock [s]
    number: int  # Its place in the recording


FARTHEST = 3.0  # Largest offset of a clock that is looked for [s]
_APART = 1000.0  # Time between the steps of a folder of frames, whose times are those of the step [s]
Images = Callable[[Sequence[Frame]], Iterator[tuple[Frame, CameraImage]]]
"""Reads the images of some frames. Raises InputError for one that cannot be used."""


def read_files(
    workspace: Workspace, files: Sequence[Path], frames: Sequence[Frame]
) -> Iterator[tuple[Frame, CameraImage]]:
    """The images of some frames, in their order; files: PNG, by the numbers of frames. Raises as `Images` does."""
    for frame in frames:
        camera = workspace.cameras[frame.camera]
        image = read_png(files[frame.number], PixelSize(camera.width, camera.height), camera.name)
        yield frame, CameraImage(camera.name, frame.t, image)


class FolderFootage:
    """A folder of frames, whose times are those of the program: the robot is taken to be where the program wants it."""

    other_topics: Sequence[str] = ()
    """Topics with images of no camera of the workspace."""
    runs = 1
    """How often the program was run."""

    def __init__(self, program: Program, workspace: Workspace, folder: Path) -> None:
        """Raises InputError for a folder that cannot be used."""
        entries = list(read_frames(folder, list(workspace.cameras), len(program.steps)))
        self.images: Images = partial(read_files, workspace, [file for _, file, _, _ in entries])
        self.path, self._program, self.damaged = folder, program, dict[int, str]()
        """What is wrong with damaged images that `images` has left out so far, by their place in the recording."""
        self.recorded: Collection[str] = {camera for camera, *_ in entries}
        """Cameras of the workspace that it has images of."""
        check_image_sizes(workspace, self.recorded)
        longest = max((step.time for step in program.steps), default=0.0)
        self.starts: Sequence[float] = [index * (longest + _APART) for index in range(len(program.steps))]
        self.frames: Sequence[Frame] = [
            Frame(camera, self.starts[step - 1] + t, number)
            for number, (camera, _, step, t) in enumerate(entries)
            if t is not None
        ]
        self.unplanned = len(entries) - len(self.frames)

    def joints(self, t: Array) -> Mapping[str, Array]:
        """By the program."""
        return planned_at(self._program, self.starts, t, _APART / 2)

    def as_planned(self, t: Array) -> Mask:
        """It is taken to be."""
        return np.ones(len(t), dtype=bool)


def planned_at(program: Program, starts: Sequence[float], t: Array, early: float = 0.0) -> dict[str, Array]:
    """Where a program wants its joints at times t (m,) of the robot's clock [s]: (m,) each [rad or m].

    starts: of its steps [s]; what is at most `early` [s] before one belongs to that step.
    """
    q = np.empty((len(t), len(program.joints)))
    of = np.clip(np.searchsorted(starts, np.asarray(t) + early, side="right") - 1, 0, len(starts) - 1)
    for index, (start, step) in enumerate(zip(starts, program.steps, strict=True)):
        rows = of == index
        if rows.any():
            q[rows] = planned_joints(step, np.clip(t[rows] - start, 0.0, step.time))
    return dict(zip(program.joints, q.T, strict=True))
