"""What `place` finds, said once: the records that the search makes, `--json` prints, tables and pages read."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any, Literal

from sqrp_cli.document import LEFT_OUT, Pose, Record, WorkspaceDocument, live
from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.records import dataclass
from sqrp_cli.search.goal import Goal, Objective

if TYPE_CHECKING:
    from sqrp_cli.camera.camera import Camera
    from sqrp_cli.geometry import Array, Mask
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.search.sites import Installation
    from sqrp_cli.study.result import CandidateResult
else:  # no file has them
    Array = Camera = CandidateResult = Cell = Installation = Mask = Any

ROUNDED = 5e-4  # qualities that differ by less are the same: outputs and rankings round them to 0.1 points
_COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


@dataclass(frozen=True, kw_only=True)
class FewestPossible:
    """How many cameras there have to be, whatever they see."""

    cameras: int
    """On mounts, besides those that stay."""
    reason: str
    """Such as `inspect` needs two at once."""


@dataclass(frozen=True, kw_only=True)
class CameraPlaced(Record):
    """A camera on a mount."""

    name: str
    """Its name in the patched workspace."""
    mount: str
    """The place, such as `ceiling 17`: the mount and the number of its place, from 1."""
    lens: str
    """Name of the camera with its lens."""
    pose: Pose
    """Of the optical frame in `frame`, 4x4."""
    frame: str
    """`world`, or the link that carries it."""
    look_at: tuple[float, float, float] | None
    """The point in the middle of its image, in `frame` [m]; null where the mount states an orientation."""
    moved: float
    """How far it is from that place, between places, which improves the exact figures [m]; 0 where nothing does."""
    price: float
    """Of the camera and of mounting it."""
    alone: float
    """The quality that counts, least or mean, with no other camera, and none that fails, in 0..1."""
    loss: float
    """By how much that quality falls if this camera is lost, and no other one."""

    place: Installation = live()
    camera: Camera = live()

    @classmethod
    def at(cls, place: Installation, name: str, *, alone: float, loss: float) -> CameraPlaced:
        """The camera of an installation; for the others see the fields."""
        at, camera = place.at, place.camera(name)
        return cls(
            name=name,
            mount=place.site.name,
            lens=place.lens_name,
            pose=camera.X_FC.tolist(),
            frame=camera.frame,
            look_at=None if at is None else (float(at[0]), float(at[1]), float(at[2])),
            moved=0.0,
            price=place.site.entry.price + place.lens.price,
            alone=alone,
            loss=loss,
            place=place,
            camera=camera,
        )


@dataclass(frozen=True, kw_only=True)
class PlacedCandidate(AdvisedFigures):
    """A candidate with the cameras, in the way that was chosen for it: its exact figures."""

    task: str
    """As it was asked for."""
    candidate: str
    """Its name."""
    ranked: AdvisedFigures | None
    """The figures of the way that `rank` and `score` take in the patched workspace, if those are others."""

    found: CandidateResult = live()
    """The candidate with these figures."""


@dataclass(frozen=True, kw_only=True)
class InfeasibleCandidate(Record):
    """A candidate that cannot be done; it counts for nothing."""

    task: str
    """As it was asked for."""
    candidate: str
    """Its name."""
    reason: str
    """Why not."""

    found: CandidateResult = live()
    """The candidate with all reasons."""


@dataclass(frozen=True, kw_only=True)
class Compared(Record):
    """What the proof is about."""

    mounts: int
    """Places."""
    in_the_way: int
    """How many of them cannot be used: a camera there would touch something."""
    options: int
    """Poses with lenses at them."""
    ways: int
    """Ways of candidates."""
    samples: int
    """Samples of these ways."""
    fastest: bool
    """Whether they are one way of each candidate: the fastest of all, or that with `--ways first`."""


@dataclass(frozen=True, kw_only=True)
class Alternative(Record):
    """What another number of cameras could do."""

    cameras: int
    """How many."""
    objective: float
    """The best quality that was found, least or mean, in 0..1."""
    bound: float | None = field(default=None, metadata=LEFT_OUT)
    """Of one camera less: no choice of so many has more."""
    price: float | None = field(default=None, metadata=LEFT_OUT)
    """If no camera could fail: of all of them."""


@dataclass(frozen=True, kw_only=True)
class UnseenTarget(Record):
    """What too few sites see, so that no choice of them covers it."""

    task: str
    """As it was asked for."""
    candidate: str
    """Its name."""
    literal: str
    """What has to be seen, such as `hold(g1)`."""
    time: float
    """The first such instant in the candidate's motion [s]."""
    seen_by: int
    """How many places see it."""
    needed: int
    """How many cameras would have to."""

    def __str__(self) -> str:
        seen = "no mount sees it" if self.seen_by == 0 else f"only {self.seen_by} of {self.needed} needed see it"
        return f"{self.literal} at {self.time:.2f} s: {seen}"


@dataclass(frozen=True, kw_only=True, repr=False)
class PlaceDocument(WorkspaceDocument):
    """What `sqrp place` finds."""

    VIEW = "sqrp_cli.show.terminal.search_tables:print_placement"

    document: Literal["place"] = "place"
    tasks: tuple[str, ...]
    """As they were asked for."""
    mounts: int
    """Places for a camera to choose from."""
    want: Goal
    """What every candidate is to reach; null where anything will do."""
    met: bool = True
    """Whether the cameras are as they were wanted."""
    cameras: tuple[CameraPlaced, ...] = ()
    """Those on mounts."""
    keep: tuple[str, ...]
    """Cameras of the workspace that stay."""
    survive: int
    """So many cameras may fail: only what is seen then still counts in `objective`, `bound` and `fewer`."""
    by: Objective
    """Which quality counts first: the least of all Q_eoi and Q_avg of all candidates, or their mean."""
    objective: float = 0.0
    """That quality, exactly, of the cameras at their mounts, in 0..1."""
    bound: float = 0.0
    """No choice of cameras and ways has more, as long as each camera that sees something between two samples sees it at
    one of them, too."""
    gap: float = 0.0
    """Between both; 0 where they differ by less than 0.05 points: nothing better exists."""
    proven: bool = False
    """Whether nothing better exists in any objective, or that nothing meets `want`."""
    proof: str = ""
    """The same in words."""
    too_slow: bool
    """Whether a candidate takes longer than `want` in all of its ways."""
    quickest: float
    """The shortest time until any camera shows a fault that it sees: its frame period and latency [s]."""
    delay_worst: float | None
    """The longest time until a fault of any candidate is noticed, from the exact figures [s]; null without faults, and
    where one may never be noticed."""
    unseen_faults: float | None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
    price: float
    """Of all cameras on mounts."""
    fewest: int | None = None
    """Fewer cameras than this do not meet `want`; null without one."""
    fewer: Alternative | None = None
    """What one camera less could do; null if there cannot be fewer."""
    floor: FewestPossible | None
    """How many there have to be; null if any number will do."""
    reason: str = ""
    """Why no cameras can be chosen at all; empty if some can."""
    without_spare: Alternative | None = None
    """With `survive`: what would do if no camera could fail."""
    candidates: tuple[PlacedCandidate, ...] = ()
    """The exact figures of each, those of `sqrp score` for the patched workspace unless `ranked` says others."""
    ways: Mapping[str, Mapping[str, float | str]]
    """Of each candidate, `TASK: NAME`, the parameters of the way that was chosen for it."""
    infeasible: tuple[InfeasibleCandidate, ...]
    """Candidates that cannot be done."""
    unseen: tuple[UnseenTarget, ...] = ()
    """If nothing meets `want`: what no choice of mounts covers, of each candidate and literal the first instant."""
    compared: Compared
    """What the proof is about."""
    patch: str = ""
    """A unified diff of the workspace file; empty if nothing is to be changed."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before the proof was complete."""
    assumed: str = ""
    """What delays assume of detectors and cameras, in words; empty where nothing is assumed."""

    question: Any = live()
    """The `PlaceQuestion`."""
    cell: Cell = live()
    """With the chosen cameras."""
    seen: Array = live()
    """The mean quality of all candidates with one camera at each mount, the best one there, in 0..1; (mounts,)."""
    shut: Mask = live()
    """Whether a mount cannot be used at all, because a camera there would touch something in every way, (mounts,)."""
    file: Any = live()
    """The workspace file; `content`: with these cameras instead of its own, but for those that stay."""
    content: bytes = live(b"")

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.workspace}: {len(self.cameras)} cameras, {self.by} share seen {100 * self.objective:.1f} %"

    def apply(self) -> None:
        """Write the cameras into the workspace file; comments outside of its cameras stay.

        Raises InputError where it cannot be written, and where it has changed meanwhile; ValueError for a placement
        that was read from a file.
        """
        from sqrp_cli.cell.workspace_file import replace_workspace

        if self.file is None:
            raise ValueError("a placement that was read has no workspace to write; search again")
        replace_workspace(self.file, self.content)


def proof_in_words(found: PlaceDocument) -> str:
    """What is proven, in a few sentences."""
    mounts = "the only mount" if found.mounts == 1 else f"these {found.mounts} mounts"
    mounts += " with --ways first" if found.question.fastest else ""
    if found.reason:
        return f"No camera can be chosen: {found.reason}."
    if not found.cameras and not found.proven:
        return f"No choice of {mounts} was found, and that there is none is not proven."
    number = count_in_words(len(found.cameras))
    decided = found.by == "least" and found.objective == 0.0 and not found.interrupted
    mean = ", so that the mean decided" if decided and found.cameras else ""
    case = f"{'worst case' if found.by == 'least' else 'mean'} {100 * found.objective:.1f} %{mean}"
    if found.gap > 0.0:
        sentences = [f"Not proven best: {case}, and no choice of {mounts} has more than {100 * found.bound:.1f} %."]
    elif not found.cameras:
        sentences = [f"No camera on {mounts} adds anything: {case}."]
    elif found.mounts == 1:
        sentences = [f"There is one mount only: {case}."]
    else:
        rest = "" if found.proven else " Whether others that see as much are quicker or cheaper is not proven."
        sentences = [f"Proven best on {mounts}: {case}.{rest}"]
    if found.floor is not None and len(found.cameras) == found.floor.cameras:
        stay = " besides those that stay" if found.keep else ""
        sentences.append(f"Fewer cannot be{stay}: {found.floor.reason}.")
    elif str(found.want) and found.met and found.fewest is not None and 1 < found.fewest == len(found.cameras):
        sentences.append(f"Fewer than {number} do not meet the goal ({found.want}).")
    if found.fewer is not None:
        fewer = count_in_words(found.fewer.cameras)
        sentences.append(f"With {fewer} it is at most {100 * (found.fewer.bound or 0.0):.1f} %.")
    return " ".join(sentences)


def count_in_words(count: int) -> str:
    """A number as text, such as `two`."""
    return _COUNTS[count] if count < len(_COUNTS) else str(count)
