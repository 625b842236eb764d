"""What is asked about cameras on mounts, and what came of it."""

from __future__ import annotations

from dataclasses import dataclass

from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.workspace.mounts import LensChoice, Mounts, Spot
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.timeline import Rehearsal
from sqrp_cli.programming.placing.problem import Demand, Worth
from sqrp_cli.programming.placing.scenes import View
from sqrp_cli.programming.placing.tensor import Verdicts
from sqrp_cli.programming.task import Candidate, Task

ROUNDED = 1e-6
"""Qualities that differ by less are the same: figures of the solver are rounded."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaceQuestion:
    """Which cameras are wanted, and for what."""

    cell: Cell
    world: World
    tasks: tuple[Task, ...]
    mounts: Mounts
    demand: Demand
    sampling: Sampling
    keep: tuple[str, ...] = ()
    """Cameras of the workspace that stay."""
    fastest: bool = False
    """Whether candidates keep the fastest branch with the first grip, as with `--ways fastest`."""
    verdicts: Verdicts | None = None
    """Where verdicts come from; None: this process."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PlacedCamera:
    """A camera that was chosen."""

    camera: Camera
    spot: Spot
    lens: LensChoice
    view: View
    price: float
    alone: float
    """The quality that counts first with no other camera, not even one that stays, and none that fails, in 0..1."""
    loss: float
    """By how much that quality falls if this camera is lost, and no other one."""
    moved: float = 0.0
    """How far from the place it is, between places [m]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class JudgedCandidate:
    """A candidate with the way that was chosen for it, and its exact figures with the chosen cameras."""

    task: str
    candidate: Candidate
    scene: Rehearsal
    """Of the way."""
    found: Assessment
    ranked: Assessment | None = None
    """The way that `rank` takes with these cameras, if that is another one with other figures."""


@dataclass(frozen=True, kw_only=True)
class WithFewer:
    """What one camera less could do."""

    cameras: int
    """How many."""
    objective: float
    """The best quality, least or mean, in 0..1."""
    bound: float
    """No choice of so many has more."""


@dataclass(frozen=True, kw_only=True)
class SpareCost:
    """What would do if no camera could fail."""

    cameras: int
    """How many."""
    price: float
    """Of all of them."""
    objective: float
    """The quality that counts first, in 0..1."""


@dataclass(frozen=True, kw_only=True)
class UnseenTarget:
    """What too few places see, so that no choice of them covers it."""

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


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement:
    """What came of a question."""

    question: PlaceQuestion
    infeasible: tuple[tuple[str, Assessment], ...]
    """Candidates that cannot be done, with their tasks; they count for nothing."""
    ways: int
    """How many ways were looked at."""
    samples: int
    """In how many samples of them."""
    options: int
    """Poses and lenses that were compared."""
    seen: Array
    """The mean quality of all candidates with one camera at each place, the best one there, in 0..1; (places,)."""
    shut: Mask
    """Whether a place cannot be used at all, (places,)."""
    cell: Cell
    """With the chosen cameras."""
    cameras: tuple[PlacedCamera, ...] = ()
    candidates: tuple[JudgedCandidate, ...] = ()
    worth: Worth | None = None
    """At the samples; None if nothing was found."""
    bound: float = 0.0
    """No choice has a greater quality, least or mean, at the samples."""
    proven: bool = False
    """Whether there is no better choice in any aim."""
    interrupted: bool = False
    met: bool = True
    """Whether there are cameras, and the wish is met, if there is one."""
    why: str = ""
    """Why there is nothing to choose; empty if there is."""
    late: bool = False
    """Whether a fault is noticed within the wished time at the samples, but not by the exact figures."""
    too_slow: bool = False
    """Whether a candidate takes longer than is wished for in all of its ways."""
    quickest: float = 0.0
    """The shortest time until any of the cameras shows a fault that it sees: a frame period and its latency [s]."""
    fastest: bool = True
    """Whether one way of each candidate was looked at: the fastest of all, or the only one that is allowed."""
    fewest: int | None = None
    """The fewest cameras that meet the wish; None without one, and if none do."""
    fewer: WithFewer | None = None
    """With one camera less, if there are several."""
    without_spare: SpareCost | None = None
    """If cameras may fail: what would do otherwise."""
    unseen: tuple[UnseenTarget, ...] = ()
    """If nothing meets the wish: what no choice of places covers."""

    @property
    def in_the_way(self) -> int:
        """How many places cannot be used, because a camera there would touch something in every way."""
        return int(self.shut.sum())

    @property
    def places(self) -> int:
        """How many places there were to choose from."""
        return len(self.question.mounts.spots)

    @property
    def objective(self) -> float:
        """The quality that counted first, at the samples, in 0..1."""
        return 0.0 if self.worth is None else self.worth.of(self.question.demand.objective)

    @property
    def gap(self) -> float:
        """Between bound and objective; 0 where nothing better exists."""
        gap = self.bound - self.objective
        return gap if gap > ROUNDED else 0.0
