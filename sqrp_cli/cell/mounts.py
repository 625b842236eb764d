"""Where cameras may go, and which: the format of `place.yaml`, which lies beside a workspace."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, Tag, TypeAdapter
from pydantic_core import PydanticCustomError

from sqrp_cli.camera.camera import ImageEntry, Sensing, check_image
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import InputError, Place, Problem, bad_input, expected_names, no_such
from sqrp_cli.files.entries import (
    Direction,
    Entry,
    FileRecord,
    In,
    Name,
    Pose,
    Position,
    Size,
    Text,
    one_of,
)
from sqrp_cli.files.frames import WORLD
from sqrp_cli.files.input_file import missing_file
from sqrp_cli.files.units import ANGLE, SHORTEST_DIRECTION
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.geometry import Array, read_only
from sqrp_cli.records import dataclass

CATALOGUE = Path(__file__).parents[1] / "camera" / "catalogue.yaml"
PLACE_FILE = "place.yaml"  # name of the file beside a workspace
SAME = 1e-6  # points that are closer to each other are one [m]
MOST_SPOTS = 20_000  # most places for a camera in one file
MOST_AIMS = 200  # most directions at one of them
Price = Annotated[float, In(None, 0.0, 1e8)]
Weight = Annotated[float, In(None, 0.0, 1e6)]
Step = Annotated[float, In(ANGLE, np.radians(0.5), np.radians(90))]
HalfAngle = Annotated[float, In(ANGLE, 0.0, np.radians(180))]


@dataclass(frozen=True, kw_only=True)
class SpanEntry(FileRecord):
    """Places at equal steps: on a rail along a line; on a grid along the axes of the frame, between two corners."""

    start: Annotated[Position, Field(alias="from", description="Where it begins; one corner.")]
    end: Annotated[Position, Field(alias="to", description="Where it ends; the opposite corner.")]
    step: Size
    """Between neighbouring places, of a grid along each axis."""


@dataclass(frozen=True, kw_only=True)
class ConeEntry(FileRecord):
    """Directions up to an angle from an axis, on rings."""

    axis: Direction
    """The middle direction, in the mount's frame."""
    angle: HalfAngle
    """Largest angle from the axis."""
    step: Step
    """Between neighbouring directions."""

    def directions(self) -> Array:
        """Unit vectors, the axis first, shape (n, 3)."""
        axis = np.array(self.axis) / np.linalg.norm(self.axis)
        side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        side /= np.linalg.norm(side)
        other = np.cross(axis, side)
        found = [axis]
        for ring in range(1, int(self.angle / self.step + 1e-9) + 1):
            tilt = ring * self.step
            count = max(1, round(2 * np.pi * np.sin(min(tilt, np.pi - tilt)) / self.step))
            turns = 2 * np.pi * np.arange(count)[:, None] / count
            found.extend(np.cos(tilt) * axis + np.sin(tilt) * (np.cos(turns) * side + np.sin(turns) * other))
        return np.array(found)


@dataclass(frozen=True, eq=False, kw_only=True)
class AimsEntry(FileRecord):
    """In which directions a camera may look; all that are named."""

    targets: Literal["middle", "each"] | None = None
    """middle: at the middle of everything that has to be seen; each: also at that of what each candidate shows."""
    at: tuple[Position, ...] = ()
    """At these points of the mount's frame."""
    fixed: tuple[Pose, ...] = ()
    """In these orientations of the optical frame (z forward, y down) in the mount's frame; without position."""
    cone: ConeEntry | None = None
    """In directions around an axis."""
    up: Direction = (0.0, 0.0, 1.0)
    """What is up in the image, as with `look_at`."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for no direction, and a position."""
        if not (self.targets or self.at or self.fixed or self.cone):
            raise PydanticCustomError(
                "ambiguous-entry", "expected at least one of the keys `targets`, `at`, `fixed`, `cone`"
            )
        if any(max(map(abs, one.position)) > 0 for one in self.fixed):
            raise PydanticCustomError("conflicting-keys", "a fixed aim is an orientation, without `position`")


@dataclass(frozen=True, eq=False, kw_only=True)
class MountEntry(FileRecord):
    """Places for a camera: points, a rail or a grid, in the world or on a link."""

    frame: Text = WORLD
    """`world`, or the link that carries the camera."""
    points: Annotated[list[Position], Field(min_length=1)] | None = None
    """Single places."""
    rail: SpanEntry | None = None
    """Places along a line."""
    grid: SpanEntry | None = None
    """Places in a plane or a box."""
    aims: AimsEntry | None = None
    """In which directions; by default at the targets."""
    body: Size = 0.08
    """Diameter of the ball around the optical centre that holds housing and lens: nothing may touch it, and it may not
    stand between another camera and what that one sees."""
    price: Price = 0.0
    """Of mounting a camera here, in the currency of the lenses."""
    lenses: Annotated[list[Name], Field(min_length=1)] | None = None
    """Which ones fit; by default all."""

    def __post_init__(self) -> None:
        """Raises PydanticCustomError for keys that contradict each other."""
        self.check_only_one("points", "rail", "grid")
        if self.frame != WORLD and self.aims is None:
            raise PydanticCustomError("ambiguous-entry", "a mount on a link needs `aims`: `fixed`, `at` or a `cone`")
        if self.frame != WORLD and self.aims is not None and self.aims.targets:
            raise PydanticCustomError(
                "conflicting-keys", "`targets` stand still; on a link use `fixed`, `at` or a `cone`"
            )

    def rows(self) -> tuple[Array, NDArray[np.int64]]:
        """Steps between the places of a rail or grid, (k, 3) [m], and how many places are along each, (k,).

        Single points are one row without a step.
        """
        if (span := self.rail or self.grid) is None:
            return np.zeros((1, 3)), np.array([len(self.points or ())])
        way = np.subtract(span.end, span.start)
        lengths = np.abs(way) if self.rail is None else np.array([np.linalg.norm(way)])
        axes = np.diag(np.sign(way)) if self.rail is None else way[None] / max(float(lengths[0]), SHORTEST_DIRECTION)
        return span.step * axes, np.floor(lengths / span.step + 1e-9).astype(int) + 1


@dataclass(frozen=True, kw_only=True)
class CatalogueLens(FileRecord):
    """A camera with its lens from the catalogue that comes with the package."""

    catalogue: Name
    """Its name there."""
    price: Price = 0.0
    """In any currency."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LensEntry(Sensing):
    """A camera with its lens."""

    image: ImageEntry
    """Size and field of view or focal lengths of the image."""
    price: Price = 0.0
    """In any currency."""


_AnyLens = Annotated[
    Annotated[CatalogueLens, Tag("<catalogue>")] | Annotated[LensEntry, Tag("<image>")], one_of("catalogue", "image")
]


class PlaceFile(Entry):
    """Where cameras may go, and which: what `sqrp place` chooses from."""

    mounts: dict[Name, MountEntry] = Field(min_length=1, description="Places for cameras by name.")
    lenses: dict[Name, _AnyLens] = Field(min_length=1, description="Cameras with their lenses, by name.")
    weights: dict[Text, Weight] = Field(default={})
    """How much a task counts in the mean; by its text, 1 by default."""


@cache
def catalogue() -> Mapping[str, LensEntry]:
    """Cameras with their lenses as makers describe them, by name."""
    told = ("camera", "lens", "source")  # for people: maker and model of both, and where the figures are from
    entries = read_yaml(CATALOGUE).data.items()
    stated = {name: {key: value for key, value in entry.items() if key not in told} for name, entry in entries}
    return TypeAdapter(dict[Name, LensEntry]).validate_python(stated)


@dataclass(frozen=True, eq=False, kw_only=True)
class Site:
    """One place for a camera."""

    mount: str  # the entry that it belongs to
    name: str  # such as `ceiling 17`, counted from 1; the mount's own where it has one place only
    frame: str  # `world`, or the link that carries it
    position: Array  # in that frame, shape (3,) [m]
    entry: MountEntry  # what holds for all places of the mount
    lenses: Mapping[str, LensEntry]  # those that fit, by name


@dataclass(frozen=True, eq=False, kw_only=True)
class Mounts:
    """Where cameras may go, and which."""

    sites: tuple[Site, ...]
    lenses: Mapping[str, LensEntry]  # By name; with prices as this file states them
    weights: dict[str, float]


def place_file(workspace: Workspace, given: Path | None) -> Path:
    """The file with the mounts of a workspace: the one that is given, or that beside it.

    Raises InputError where there is none.
    """
    path = given or workspace.whole_file.file.parent / PLACE_FILE
    if given is None and not path.is_file():
        message = f"there is no {PLACE_FILE} beside the workspace, which says where cameras may go, and which"
        mend = f"write {path} as docs/howto/place.md shows, or name another file: --mounts FILE"
        raise bad_input("no-mounts", message, Place(path), mend=mend)
    if not path.is_file():
        mend = f"name a file with mounts and lenses, or leave --mounts out for the {PLACE_FILE} beside the workspace"
        raise InputError(replace(missing_file(path), mend=mend))
    return path


def read_mounts(path: Path, workspace: Workspace, links: tuple[str, ...]) -> Mounts:
    """Read and validate the mounts of a workspace; links: of its robot.

    Raises InputError with all problems, each with its place.
    """
    document = read_yaml(path, keys=("mounts", "lenses"))
    file, problems = validate(document, PlaceFile), list[Problem]()
    if (count := sum(int(entry.rows()[1].prod()) for entry in file.mounts.values())) > MOST_SPOTS:
        message = f"the mounts have {count:,} places, expected at most {MOST_SPOTS:,}; make a `step` longer"
        raise document.error("too-many-mounts", ("mounts",), message)
    lenses, sites = dict[str, LensEntry](), list[Site]()
    for name, one in file.lenses.items():
        if isinstance(one, CatalogueLens) and one.catalogue not in catalogue():
            message = f"found `{one.catalogue}`; {expected_names(one.catalogue, catalogue())}"
            problems.append(document.problem("unknown-lens", ("lenses", name, "catalogue"), message))
            continue
        lenses[name] = replace(catalogue()[one.catalogue], price=one.price) if isinstance(one, CatalogueLens) else one
        check_image(document, ("lenses", name, "image"), lenses[name].image.intrinsics())
    for name, entry in file.mounts.items():
        (steps, counts), span, aims, at = entry.rows(), entry.rail or entry.grid, entry.aims, ("mounts", name)
        if entry.frame not in (WORLD, *links):
            known = expected_names(entry.frame, [WORLD, *links])
            message = f"found `{entry.frame}`, expected `world` or a link; {known}"
            problems.append(document.problem("unknown-frame", (*at, "frame"), message))
        if aims is not None and aims.cone is not None and (count := len(aims.cone.directions())) > MOST_AIMS:
            message = f"{count} directions, expected at most {MOST_AIMS}; make `step` larger"
            problems.append(document.problem("too-many-mounts", (*at, "aims", "cone"), message))
        for index, lens in enumerate(entry.lenses or ()):
            if lens not in file.lenses:
                message = no_such(lens, "lens of this file", file.lenses)
                problems.append(document.problem("unknown-lens", (*at, "lenses", index), message))
        # Of a grid x slowest, z fastest.
        first = np.array(entry.points if span is None else span.start, dtype=float)
        places = np.round(first + np.array(list(product(*map(range, counts)))) @ steps, 9) + 0.0
        fitting = {lens: lenses[lens] for lens in entry.lenses or lenses if lens in lenses}
        sites += [
            Site(
                mount=name,
                name=name if len(places) == 1 else f"{name} {number}",
                frame=entry.frame,
                position=read_only(place),
                entry=entry,
                lenses=fitting,
            )
            for number, place in enumerate(places, 1)
        ]
        only_at = () if aims is None or aims.targets or aims.fixed or aims.cone else aims.at
        if only_at and all(np.linalg.norm(places - np.array(point), axis=1).max() < SAME for point in only_at):
            message = "a camera here would look at its own place; aim at another point"
            problems.append(document.problem("wrong-value", (*at, "aims", "at"), message))
    listed = [task.task for task in workspace.tasks]
    for task in file.weights:
        if listed and task not in listed:
            message = no_such(task, "task of the workspace", listed)
            problems.append(document.problem("unknown-task", ("weights",), message))
    if problems:
        raise InputError(*problems)
    return Mounts(sites=tuple(sites), lenses=lenses, weights=dict(file.weights))
