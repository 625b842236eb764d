"""What advice is asked about, what is known of it before any change, and the changes that are tried."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import Margin
from sqrp_cli.search.aiming import Aim
from sqrp_cli.search.goal import Goal, Kind, Unit, shown_size
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.skill.settings import MotionValue
from sqrp_cli.study.analysis import Analysis, analysed, with_delays
from sqrp_cli.study.find import Plans
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.stage import Stage
from sqrp_cli.study.timeline import Timeline, observe
from sqrp_cli.study.whole_analysis import WholeAnalysis, mean_qualities, whole_analysis
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import Candidate

TaskWays = tuple[str, tuple[Candidate, ...]]  # A task by its text, with the ways in which its candidates are done
AnalysedWay = tuple[Candidate, WholeAnalysis | Infeasible]
"""A way of a candidate with its analysis, or why it cannot be done."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ProposedChange:
    """One change of a cell or a motion, as data."""

    kind: Kind
    target: str  # the candidate, object or camera that it is about
    values: tuple[float, ...] = ()
    """What changes: metres along x, y, z; angles to the right and up in the image, or of the view [rad]."""
    size: float = 0.0  # how large it is, in `unit`
    unit: Unit = ""
    turn: float = 0.0  # angle between the optical axes before and after it [rad], of a camera that is moved or turned
    lens_of: str = ""  # of a further camera: the one whose lens and sensing it has
    camera: Camera | None = None  # as it then is
    aim: Aim | None = None  # what it then looks at
    X_WO: Array | None = None  # where the object then is, shape (4, 4)
    parameters: Mapping[str, MotionValue] | None = None  # of the way
    said: str = ""  # the way in a few words, such as `left, flipped`
    unwritten: str = ""  # why no workspace file says it; empty if one can

    def in_cell(self, cell: Cell) -> Cell:
        """The cell with it, as far as cameras are concerned; motions stay the same."""
        if self.camera is None:
            return cell
        cameras = {**cell.workspace.cameras, self.camera.name: self.camera}
        return cell.with_cameras_of(replace(cell.workspace, cameras=cameras))

    def in_world(self, world: World) -> World:
        """The world with it."""
        return world if self.X_WO is None else replace(world, X_WO={**world.X_WO, self.target: self.X_WO})

    @property
    def words(self) -> str:
        """It as an instruction, such as `move camera `cam1` along -x and +z 10.9 cm, and turn it 5.2 deg`."""
        size, values, along = shown_size(self.size, self.unit), self.values, ""
        what = f"camera `{self.target}`" if self.camera is not None else self.target
        if self.kind in ("aim", "position", "object"):
            turns, moves = (("right", "left"), ("up", "down")), (("+x", "-x"), ("+y", "-y"), ("+z", "-z"))
            names = turns if self.kind == "aim" else moves
            axes = sorted(range(len(values)), key=lambda index: -abs(values[index]))
            whole = sum(value * value for value in values) ** 0.5
            shown = [axis for number, axis in enumerate(axes) if number == 0 or abs(values[axis]) > 0.2 * whole]
            along = " and ".join(names[axis][values[axis] <= 0] for axis in shown)
        match self.kind:
            case "way" | "path":
                return f"do {self.target} ({self.said})"
            case "aim":
                return f"turn {what} {along} {size}"
            case "lens":
                return f"{'widen' if values[0] > 0 else 'narrow'} the view of {what} by {size}"
            case "camera":
                return f"add {what} at {', '.join(f'{value:z.2f}' for value in values)} m"
            case _:
                turn = f", and turn it {shown_size(self.turn, 'rad')}" if self.turn else ""
                return f"move {what} along {along} {size}{turn}"


class Tried(NamedTuple):
    """A change that was tried."""

    change: ProposedChange
    analysis: WholeAnalysis  # of the way with it
    margin: Margin | None = None  # of a change that meets the goal; None where there is nothing to measure


Search = tuple[Sequence[Tried], str]
"""The changes of a kind that meet the goal, and no words; or what was tried in vain, and why none meets it."""


def is_fastest(found: CandidateResult) -> bool:
    """Whether the figures of a candidate are those with `--ways first`."""
    return found.way.parameters == first_grip(found.candidate).parameters and not found.way.vias


def figures_of(way: Candidate, found: WholeAnalysis | Infeasible) -> CandidateResult:
    """The figures of a way, or why it cannot be done."""
    return found.result if isinstance(found, WholeAnalysis) else CandidateResult.infeasible(way, found.reasons)


def analysed_again(cell: Cell, found: WholeAnalysis, sampling: Sampling, *, full: bool = False) -> WholeAnalysis:
    """The same motion observed by the cameras of another cell. full: with the verdicts of every camera."""
    return replace(found, steps=tuple(analysed(cell, one.planned, sampling, full=full) for one in found.steps))


@dataclass(frozen=True, eq=False, kw_only=True)
class Question:
    """What is to be met, and what may be changed; what is found of it is computed once, when a kind first needs it."""

    task: str  # as it was asked for
    cell: Cell
    world: World
    sampling: Sampling
    fastest: Candidate  # the candidate as `--ways first` has it
    best: CandidateResult  # the candidate by its best way; by the fastest one where the motion is fixed
    results: Sequence[CandidateResult]  # of all candidates of the task, `best` among them
    before: CandidateResult
    """The candidate without any change, as with `--ways first`; in its best way if that misses the goal alone."""
    goal: Goal
    aims: Mapping[str, Aim]  # what cameras look at, by name, where the workspace says so
    affected: Callable[[], Sequence[TaskWays]]
    """The tasks that a change of the cell may affect, found out only when they are needed."""
    plans: Plans | None = None  # the ways of candidates, as far as they are planned
    kinds: Sequence[Kind] | None = None
    """What may be changed; None: cameras and objects only where no other motion meets the goal."""
    fixed: bool = False  # whether the motion stays as it is
    jobs: int = 1  # processes to use at most; the answers do not depend on it

    @property
    def way(self) -> Candidate:
        """The way that changes of objects and cameras start from: the best, unless that meets the goal by itself."""
        return self.fastest if self.fixed or self.goal.met(self.best) else self.best.way

    def met_for_sure(self, tried: Tried) -> bool:
        """Whether a change meets the goal, with the samples of `explain`, too: where any camera's verdict changes."""
        if not self.goal.met(tried.analysis.result):
            return False
        cell = tried.change.in_cell(self.cell)
        return self.goal.met(analysed_again(cell, tried.analysis, self.sampling, full=True).result)

    def met_by(self, cell: Cell, seen: Sequence[Timeline]) -> bool:
        """Whether what a cell sees of the steps meets the goal: qualities first, as delays take as long as the rest."""
        goal, time = self.goal, sum(one.planned.motion.time for one in seen)
        found = mean_qualities((one.qualities, one.planned.T, one.planned.T_eoi) for one in seen)
        if not goal.may_be_met(found) or (goal.time is not None and time > goal.time):
            return False
        if goal.delay is None:
            return True
        steps = tuple(with_delays(cell, one, self.sampling) for one in seen)
        return goal.met(WholeAnalysis(self.way, steps).result)

    @cached_property
    def analysis(self) -> WholeAnalysis | Infeasible:
        """Of the way that changes start from, with the verdicts of every camera."""
        return whole_analysis(self.cell, self.way, self.world, self.sampling, full=True)

    @property
    def feasible_analysis(self) -> WholeAnalysis:
        """The same where the way can be done: else no change of a camera is searched for."""
        assert isinstance(self.analysis, WholeAnalysis)  # noqa: S101 - see `advise._why_not`
        return self.analysis

    @cached_property
    def goal_steps(self) -> tuple[Analysis, ...]:
        """The parts of its steps that the goal is about: the events of interest where that is all, else the whole.

        Those take a fraction of the whole motion's time.
        """
        goal = self.goal
        if goal.q_eoi is None or goal.q_avg is not None or goal.delay is not None:
            return self.feasible_analysis.steps
        found = []
        for step in (step for step in self.feasible_analysis.steps if step.planned.T_eoi):
            planned = step.planned
            pieces = [piece for piece in planned.stage.pieces if piece.of_interest]
            stage = Stage(planned.stage.model, planned.motion, pieces, planned.world.X_WO)
            only = replace(planned, stage=stage, faults={})
            found.append(replace(step, timeline=observe(only, self.cell.observer, self.sampling, full=False)))
        return tuple(found)

    @cached_property
    def swept(self) -> list[SceneStates]:
        """Where everything is during each of its steps: cameras must not be in the way."""
        return [step.planned.stage.states(step.timeline.samples) for step in self.feasible_analysis.steps]

    @cached_property
    def affected_ways(self) -> list[tuple[str, list[AnalysedWay]]]:
        """The tasks that a change of the cell may affect, with their ways as they are now."""
        found = list[tuple[str, list[AnalysedWay]]]()
        for text, ways in self.affected():
            each = (whole_analysis(self.cell, way, self.world, self.sampling, full=False) for way in ways)
            found.append((text, list(zip(ways, each, strict=True))))
        return found
