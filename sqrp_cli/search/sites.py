"""What is judged and what may be chosen: ways with samples, the cameras at each site, and what these see of those.

A site may be in the way: of the robot, of anything solid, of another camera, or of its sight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import groupby

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.mounts import SAME, AimsEntry, LensEntry, Site
from sqrp_cli.files.entries import from_fields
from sqrp_cli.files.frames import WORLD
from sqrp_cli.geometry import Array, Indices, Mask, box_corners, pose, read_only, transform
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.records import dataclass
from sqrp_cli.search.aiming import looking_at, touching
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.study.ranking import compared_time
from sqrp_cli.study.sampling import Adaptive, first_samples
from sqrp_cli.study.timeline import PlannedMotion, SampledMotion
from sqrp_cli.task.task import Candidate

EVERY = 3  # of the adaptive samples, which no target or link moves more than 1 cm between, every so many-th is judged
MOST_WAYS = 6  # most ways of a candidate to choose from


@dataclass(frozen=True, eq=False, kw_only=True)
class JudgedWay(SampledMotion):
    """A way of a candidate with the samples in which mounts are judged."""

    task: str  # as it was asked for
    candidate: Candidate  # as a person chooses it
    swept: SceneStates  # where everything is in all of the first samples, which do not depend on cameras

    @cached_property
    def items(self) -> tuple[Indices, Indices]:
        """What has to be seen: n pairs of a sample and a target, by index, shape (n,) each."""
        sample, target = np.nonzero(self.required)
        return sample, target

    @cached_property
    def needed(self) -> Indices:
        """How many cameras must see each item, shape (n,)."""
        return np.array([target.cameras for target in self.planned.targets], dtype=np.int64)[self.items[1]]


def judged_way(cell: Cell, task: str, candidate: Candidate, planned: PlannedMotion) -> JudgedWay:
    """A way with some of its first samples."""
    samples = first_samples(Adaptive(), planned.stage, Observer((), cell.observer.solids), planned.targets)
    ends = samples.ends
    number = np.arange(len(samples)) - np.maximum.accumulate(np.where(ends, np.arange(len(samples)), 0))
    rows = np.flatnonzero(ends | (number % EVERY == 0))
    swept = planned.stage.states(samples)
    return JudgedWay(planned, samples.some(rows), task=task, candidate=candidate, swept=swept)


def ways_to_choose(motions: Sequence[PlannedMotion]) -> tuple[list[PlannedMotion], PlannedMotion]:
    """Some of the ways of a candidate: the fastest, that of the first grip, then that of each other branch of the arm.

    That of the first grip, which is named, too, is the way with `--ways first`: so a choice among them is never worse
    than without a choice of ways.
    """
    ordered = sorted(motions, key=lambda planned: compared_time(planned.motion.time))
    ways = [planned.candidate for planned in (motions[0], *ordered)]
    first_grip, *grips = ({k: v for k, v in way.parameters.items() if k not in way.branch} for way in ways)
    first = ordered[grips.index(first_grip)]
    branches: dict[str, PlannedMotion] = {}
    for planned in ordered:
        branches.setdefault(repr(sorted(planned.candidate.branch.items())), planned)
    return list(dict.fromkeys([ordered[0], first, *branches.values()]))[:MOST_WAYS], first


def middle_of(ways: Sequence[JudgedWay]) -> Array:
    """The middle of all that has to be seen in some ways, in whole millimetres, shape (3,) [m]."""
    points = [np.zeros((0, 3))]
    for way in ways:
        for column, target in enumerate(way.planned.targets):
            rows = np.flatnonzero(way.required[:, column])
            for box in target.boxes:
                poses = way.states.box_poses(box)
                poses = poses if len(poses) == 1 else poses[rows]
                points.append(transform(poses, box_corners(box.size)).reshape(-1, 3))
    corners = np.concatenate(points)
    if not len(corners):
        return np.zeros(3)
    middle: Array = np.round(0.5 * (corners.min(axis=0) + corners.max(axis=0)), 3) + 0.0
    return middle


@dataclass(frozen=True, eq=False)
class Installation:
    """A camera somewhere on its mount: one that may be chosen."""

    site: Site
    X_FC: Array  # pose of the optical frame in the frame that carries it, shape (4, 4)
    at: Array | None  # the point that it looks at, in that frame, if its aim says one, shape (3,)
    up: Array  # what is up in the image then, shape (3,)
    lens_name: str
    lens: LensEntry

    def camera(self, name: str) -> Camera:
        """The camera there."""
        return from_fields(
            Camera, self.lens, self.lens.image.intrinsics(), name=name, frame=self.site.frame, X_FC=self.X_FC
        )


def installations_at(site: Site, middle: Array, middles: Sequence[Array]) -> Iterator[Installation]:
    """Every pose at a place with every lens that fits its mount.

    middle: of all that has to be seen, (3,); middles: of what each candidate shows.
    """
    aims, eye = site.entry.aims or AimsEntry(targets="middle"), site.position
    up, known, poses = np.array(aims.up, dtype=float), list[Array](), list[tuple[Array, Array | None]]()
    points = [np.array(point, dtype=float) for point in aims.at]
    if aims.targets is not None and site.frame == WORLD:
        points += [middle, *(middles if aims.targets == "each" else ())]
    if aims.cone is not None:
        points += list(np.round(eye + aims.cone.directions(), 6))
    for point in points:
        if np.linalg.norm(point - eye) > SAME and not any(np.linalg.norm(point - one) < SAME for one in known):
            known.append(point)
            poses.append((looking_at(eye[None], point[None], up)[0], point))
    poses += [(pose(one.matrix()[:3, :3], eye), None) for one in aims.fixed]
    for X_FC, at in poses:
        X_FC = read_only(X_FC)
        yield from (Installation(site, X_FC, at, up, name, lens) for name, lens in site.lenses.items())


ViewBatch = tuple[JudgedWay, Sequence[Installation]]  # A piece of the work: what some installations see in a way
Verdicts = Callable[[Sequence[ViewBatch]], Iterable[tuple[int, Mask]]]
"""Where verdicts come from, processes, a cluster, or a run before this one: of every batch its number, in any order,
and what it shows, as `verdicts_of`."""


def local_verdicts(cell: Cell, jobs: int, batches: Sequence[ViewBatch]) -> Iterator[tuple[int, Mask]]:
    """See `Verdicts`: by as many processes of this machine."""
    yield from enumerate(in_processes(lambda one: verdicts_of(cell, *one), batches, jobs))


def verdicts_of(cell: Cell, way: JudgedWay, places: Sequence[Installation]) -> Mask:
    """Whether each installation sees each item of a way, shape (installations, items).

    Those with one pose are looked at together, as what hides a box does not depend on the lens.
    """
    sees = np.zeros((len(places), len(way.needed)), dtype=bool)
    for frame in dict.fromkeys(one.site.frame for one in places) if sees.size else ():
        rows = [row for row, one in enumerate(places) if one.site.frame == frame]
        poses = {id(places[row].X_FC): places[row].X_FC for row in rows}
        lenses = {id(places[row].lens): places[row] for row in rows}
        cameras = [one.camera(one.lens_name) for one in lenses.values()]
        found = cell.observer.seen_from(
            cameras, np.stack([*poses.values()]), way.planned.targets, way.states, *way.items
        )
        of_lens, of_pose = ({key: number for number, key in enumerate(known)} for known in (lenses, poses))
        sees[rows] = [found[of_lens[id(places[row].lens)], of_pose[id(places[row].X_FC)]] for row in rows]
    return sees


def blocked(cell: Cell, states: SceneStates, sites: Sequence[Site]) -> Mask:
    """Whether the body of a camera at each place touches anything in any state, shape (sites,).

    What is fixed to the same link as a place is not looked at.
    """
    found = np.zeros(len(sites), dtype=bool)
    order = sorted(range(len(sites)), key=lambda index: (sites[index].frame, sites[index].entry.body))
    for (frame, body), group in groupby(order, key=lambda index: (sites[index].frame, sites[index].entry.body)):
        rows = np.array(list(group))
        found[rows] = touching(cell, states, frame, np.stack([sites[row].position for row in rows]), 0.5 * body)
    return found


def touching_pairs(sites: Sequence[Site]) -> Iterator[tuple[int, int]]:
    """The pairs of places in one frame at which the bodies of two cameras would touch each other."""
    places, radii = np.stack([site.position for site in sites]), np.array([0.5 * site.entry.body for site in sites])
    frames = np.unique([site.frame for site in sites], return_inverse=True)[1]
    for first in range(len(sites) - 1):
        gap = np.linalg.norm(places[first + 1 :] - places[first], axis=1) - radii[first + 1 :] - radii[first]
        for other in np.flatnonzero((gap < -1e-9) & (frames[first + 1 :] == frames[first])).tolist():
            yield first, first + 1 + other


def hidden_by(way: JudgedWay, site: Site, other: Site) -> Mask:
    """Which items of a way a camera at one place may hide from a camera at another place, shape (items,).

    Its body is a ball, and so counts what encloses each box: more than is hidden, never less.
    """
    radius, count = 0.5 * site.entry.body, len(way.samples)
    sample, target = way.items
    hidden = np.zeros(len(sample), dtype=bool)
    # Both places in the world, in the sample of each item.
    places = (transform(way.states.X_WF[one.frame], one.position[None])[:, 0] for one in (site, other))
    ball, eye = (np.broadcast_to(place, (count, 3))[sample] for place in places)
    for column, entry in enumerate(way.planned.targets):
        rows = np.flatnonzero(target == column)
        for box in entry.boxes:
            center = np.broadcast_to(way.states.box_poses(box)[:, :3, 3], (count, 3))[sample[rows]]
            reach = 0.5 * float(np.linalg.norm(box.size))
            axis = center - eye[rows]
            far = np.maximum(np.linalg.norm(axis, axis=1), 1e-9)
            axis /= far[:, None]
            along = np.einsum("ri,ri->r", ball[rows] - eye[rows], axis)
            aside = np.linalg.norm(ball[rows] - eye[rows] - along[:, None] * axis, axis=1)
            width = reach * np.clip(along / far, 0.0, 1.0)
            hidden[rows] |= (along > -radius) & (along < far + reach + radius) & (aside < width + radius)
    return hidden
