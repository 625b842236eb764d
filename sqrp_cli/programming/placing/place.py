"""The cameras that answer a question: chosen by an integer program, checked exactly, and chosen again if need be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from time import monotonic
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.workspace.mounts import LensChoice, Spot
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, Watched
from sqrp_cli.programming.coverage.timeline import Rehearsal
from sqrp_cli.programming.placing.problem import Late, Problem, Requirements, Selection, obstacle
from sqrp_cli.programming.placing.program import Limits, PlacementProgram, Watch
from sqrp_cli.programming.placing.refine import Pair, refined
from sqrp_cli.programming.placing.scenes import Installation, View, blocked, price_of
from sqrp_cli.programming.placing.table import PlaceQuestion, Progress, UnseenTarget, VisibilityTable
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way, with_branch

ROUNDED = 5e-4
"""Qualities that differ by less are the same: outputs and rankings round them to 0.1 points."""

ROUNDS, ROUNDS_ASIDE = 200, 12
"""Most times that cameras are chosen: for the question, and to say what others would do."""

Found = TypeVar("Found")


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
    """How far from the site it is, between sites [m]."""


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
    """The best quality that was found, least or mean, in 0..1."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
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
    """The mean quality of all candidates with one camera at each site, the best one there, in 0..1; (sites,)."""
    shut: Mask
    """Whether a site cannot be used at all, (sites,)."""
    cell: Cell
    """With the chosen cameras."""
    cameras: tuple[PlacedCamera, ...] = ()
    candidates: tuple[JudgedCandidate, ...] = ()
    objective: float = 0.0
    """The quality that counts first, exactly, of the chosen cameras at their sites, in 0..1."""
    bound: float = 0.0
    """No choice of cameras and ways has a greater one."""
    proven: bool = False
    """Whether there is no better choice in any aim."""
    interrupted: bool = False
    met: bool = True
    """Whether there are cameras, and the wish is met, if there is one."""
    why: str = ""
    """Why there is nothing to choose; empty if there is."""
    too_slow: bool = False
    """Whether a candidate takes longer than is wished for in all of its ways."""
    quickest: float = 0.0
    """The shortest time until any of the cameras shows a fault that it sees: a frame period and its latency [s]."""
    fastest: bool = True
    """Whether one way of each candidate was looked at: the fastest of all, or the only one that is allowed."""
    fewest: int | None = None
    """The fewest cameras that meet the wish, or fewer ones do not, as far as is proven; None without one."""
    fewer: WithFewer | None = None
    """With one camera less, if there are several."""
    without_spare: SpareCost | None = None
    """If cameras may fail: what would do otherwise."""
    unseen: tuple[UnseenTarget, ...] = ()
    """If nothing meets the wish: what no choice of sites covers."""

    @property
    def in_the_way(self) -> int:
        """How many sites cannot be used, because a camera there would touch something in every way."""
        return int(self.shut.sum())

    @property
    def gap(self) -> float:
        """Between bound and objective; 0 where nothing better exists."""
        gap = self.bound - self.objective
        return gap if gap > ROUNDED else 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Checked:
    """What came of a search: a selection with its exact figures."""

    problem: Problem
    """At the last samples."""
    requirements: Requirements
    selection: Selection | None
    """None where none is possible, or none was found in time."""
    value: float = 0.0
    """The quality that counts first, exactly, if as many cameras fail as may; in 0..1."""
    bound: float = 0.0
    """No selection has a greater one."""
    proven: bool = False
    """Whether no other one is better, in every aim; or that there is none."""
    fewest: int = 0
    """With a wish: no fewer cameras than this meet it."""


class CameraPlacer:
    """Answers a question by choices from a table of what is seen, which grows where it hopes for too much."""

    def __init__(
        self,
        question: PlaceQuestion,
        progress: Progress,
        watch: Watch | None = None,
        *,
        seconds: float = np.inf,
        gap: float = 0.0,
    ) -> None:
        """progress: shows how far it is. watch: told what is sought, the best value so far and the bound.

        seconds: after which the best so far is taken, counted from when all is looked at. gap: between bound and
        objective with which a choice is good enough, in 0..1.
        """
        self.question, self._watch = question, watch or (lambda _title, _best, _bound: None)
        self.table = VisibilityTable(question, progress)
        self._seconds, self._gap, self._until = seconds, gap, np.inf
        self._stopped = False
        """Whether Ctrl-C came."""

    def place(self) -> Solution:
        """The best cameras for the tasks, with the fastest way of each candidate where no other can do better."""
        table, wanted = self.table, self.question.requirements
        table.plan()
        if not table.ways:
            sites = len(self.question.mounts.spots)
            why = "no candidate can be done" + (" in that time" if table.too_slow else "")
            return replace(self._empty(np.zeros(sites), np.zeros(sites, dtype=bool)), met=False, why=why)
        table.judge()
        self._until = monotonic() + self._seconds
        if self._is_ruled_out():
            return self._closest()
        found = self._search(wanted)
        in_time = not self._stopped and monotonic() < self._until
        if any(table.others) and in_time and self._may_be_better(found):
            table.add_ways()
            found = self._search(wanted, known=found.selection)
        if found.selection is None and wanted.wish is not None and not self._stopped:
            if found.proven and wanted.most is not None:
                enough = self._search(replace(wanted, most=None))
                if enough.selection is not None:
                    return replace(self._solution(enough), met=False)
            return self._closest(proven=found.proven)
        return self._at_least_some(found)

    def _is_ruled_out(self) -> bool:
        """Whether a wished delay is shorter than the period and latency of every camera."""
        wish, table = self.question.requirements.wish, self.table
        if wish is None or wish.delay is None or not any(way.scene.faults for way in table.ways):
            return False
        return wish.delay < min((lens.response for lens in table.lenses), default=0.0) - 1e-9

    def _closest(self, *, proven: bool = True) -> Solution:
        """What comes nearest to a wish that no choice meets. proven: whether it is certain that none does."""
        nearest = self._at_least_some(self._search(replace(self.question.requirements, wish=None)))
        problem = self.table.problem(0)
        unseen = self.table.unseen(self.question.requirements.failure_tolerance, problem.shut)
        return replace(nearest, met=False, proven=nearest.proven and proven, unseen=tuple(unseen))

    def _at_least_some(self, found: Checked) -> Solution:
        """The choice with the best mean, where no choice lifts the least quality above 0; none if that is 0, too."""
        if found.selection is None or found.value > 0.0 or self._stopped:
            return self._solution(found)
        if found.requirements.objective == "least":
            mean = self._search(replace(found.requirements, wish=None, objective="mean"))
            if mean.value > 0.0:
                return self._solution(replace(mean, requirements=found.requirements, value=0.0, bound=found.bound))
        return self._solution(replace(found, selection=None), blind=True)

    def _may_be_better(self, found: Checked) -> bool:
        """Whether other ways may be better than the fastest ones, in quality, delay, or the number of cameras."""
        if found.selection is None or found.value < 1.0 - ROUNDED:
            return True
        delay = found.problem.worth(found.requirements, found.selection)[1]
        least = found.requirements.at_least(len(found.problem.kept))
        return delay > found.problem.quickest + 1e-3 or len(found.selection.options) > least

    def _search(
        self,
        wanted: Requirements,
        *,
        rounds: int = ROUNDS,
        first_only: bool = False,
        known: Selection | None = None,
    ) -> Checked:
        """The best selection: chosen by what it may be worth, and checked exactly, until it is worth that.

        So nothing better exists: what others may be worth is no more. Where the exact figures are less, samples are
        added at which the chosen cameras lose sight, and it is chosen again. first_only: only the first aim counts.
        """
        wish, table, best, bound = wanted.wish, self.table, None, 1.0
        limits = Limits(until=self._until, gap=self._gap)
        for number in count(1):
            problem = table.problem(wanted.failure_tolerance)
            program = PlacementProgram(problem, wanted, self._watch, limits)
            if (start := known if best is None else best.selection) is not None:
                program.begin_with(start)
            grown, settled = False, False
            for step in (program.first, *([] if first_only else [program.further])):
                result = step()
                self._stopped |= result.interrupted
                bound = result.bound if wish is not None else min(bound, result.bound)
                if result.selection is None:
                    return self._ended(wanted, problem, best, bound, proven=result.proven and best is None)
                grown, settled = table.add_hiding(result.selection), False
                if grown:
                    break
                value, found, late = self._exact(wanted, result.selection)
                table.late |= late
                figures = [one.without_delays for one in found]
                good = not late and (wish is None or all(replace(wish, delay=None).met(one) for one in figures))
                settled = good and problem.worth(wanted, result.selection)[0] - value <= ROUNDED
                if settled or (good and (best is None or value > best.value)):
                    best = Checked(
                        problem=problem,
                        requirements=wanted,
                        selection=result.selection,
                        value=value,
                        fewest=result.fewest,
                    )
                if not settled:
                    grown = bool(late)
                    for way, one in zip(result.selection.ways, found, strict=True):
                        grown |= table.add_samples(way, one)
                    break
            over = self._stopped or limits.over or number == rounds or not grown
            enough = best is not None and wish is None and 0.0 < self._gap >= bound - best.value
            if settled or enough or over:
                proven = settled and result.proven and bound - value <= ROUNDED
                return self._ended(wanted, problem, best, bound, proven=proven)
        raise AssertionError

    def _ended(
        self, wanted: Requirements, problem: Problem, best: Checked | None, bound: float, *, proven: bool
    ) -> Checked:
        """What came of a search. problem: the last one. best: what was found."""
        if best is None:
            return Checked(problem=problem, requirements=wanted, selection=None, bound=bound, proven=proven)
        return replace(best, problem=problem, bound=max(bound, best.value), proven=proven)

    def _exact(self, wanted: Requirements, selection: Selection) -> tuple[float, Sequence[Watched], set[Late]]:
        """The quality that counts first of a selection, its ways as they are seen, and those that are too late."""
        table, wish = self.table, wanted.wish
        cameras = [table.camera_at(option) for option in (*selection.options, *table.kept)]
        found = table.watched(cameras, selection.ways, wanted.failure_tolerance)
        figures = [one.without_delays for one in found]
        value = wanted.value([(one.q_eoi, one.q_avg) for one in figures], self._weights)
        late: set[Late] = set()
        if wish is not None and wish.delay is not None:
            studies = table.with_delays(cameras, found)
            only = replace(wish, q_eoi=None, q_avg=None, time=None)
            pairs = zip(selection.ways, studies, strict=True)
            late = {Late(selection.options, way) for way, one in pairs if not only.met(one.assessment(""))}
        return value, found, late

    @property
    def _weights(self) -> Array:
        tasks = [self.table.ways[of_one[0]].task for of_one in self.table.candidates]
        weights = self.question.mounts.weights
        return np.array([weights.get(task, 1.0) / tasks.count(task) for task in tasks])

    def _unless_stopped(self, step: Callable[[], Found], otherwise: Found) -> Found:
        """What a further step finds; something else after Ctrl-C, and if it comes now: what was chosen is not lost."""
        if self._stopped:
            return otherwise
        try:
            return step()
        except KeyboardInterrupt:
            self._stopped = True
            return otherwise

    def _solution(self, checked: Checked, *, blind: bool = False) -> Solution:
        """The chosen cameras with all that is said of them."""
        table, question, problem, selection = self.table, self.question, checked.problem, checked.selection
        wanted = question.requirements
        sites = len(question.mounts.spots)
        seen = np.zeros(sites)
        free = problem.free
        np.maximum.at(seen, problem.site[free], problem.alone[free])
        found = replace(
            self._empty(seen, np.isin(np.arange(sites), sorted(problem.shut))),
            proven=checked.proven,
            objective=checked.value,
            bound=checked.bound,
            fewest=checked.fewest if checked.requirements.wish is not None else None,
            met=not table.too_slow,
            quickest=problem.quickest,
            fastest=len(table.ways) == len(table.candidates),
        )
        stay = [table.camera_at(option) for option in table.kept]
        studies: Sequence[Study]
        if selection is None:
            why = obstacle(problem, wanted, blind=blind) if checked.proven or blind else ""
            firsts = [of_one[0] for of_one in table.candidates]
            studies = table.with_delays(stay, table.watched(stay, firsts))
            candidates = tuple(self._of_study(way, one) for way, one in zip(firsts, studies, strict=True))
            return replace(
                found, met=False, why=why, candidates=candidates, cell=table.cell_with(stay), interrupted=self._stopped
            )
        cameras = self._cameras(selection)
        studies = self._studies(cameras, stay, selection)
        if checked.value < 1.0 - ROUNDED and not wanted.failure_tolerance:
            cameras, studies = self._unless_stopped(
                lambda: self._refined(checked, selection, cameras, stay, studies), (cameras, studies)
            )
        cell = table.cell_with([*stay, *(placed.camera for placed in cameras)])
        candidates = tuple(
            self._judged(cell, problem, selection, way, one) for way, one in zip(selection.ways, studies, strict=True)
        )
        fewer = len(selection.options) - 1
        with_fewer = without_spare = None
        if fewer >= max(1, wanted.at_least(len(table.kept))):
            aside = replace(checked.requirements, wish=None, most=fewer)
            less = self._unless_stopped(lambda: self._search(aside, rounds=ROUNDS_ASIDE, first_only=True), None)
            if less is not None and not self._stopped:
                with_fewer = WithFewer(cameras=fewer, objective=less.value, bound=max(less.value, less.bound))
        if wanted.failure_tolerance:
            plain = replace(wanted, failure_tolerance=0)
            spare = self._unless_stopped(lambda: self._search(plain, rounds=ROUNDS_ASIDE), None)
            if spare is not None and spare.selection is not None:
                options = spare.selection.options
                price = float(spare.problem.price[list(options)].sum())
                without_spare = SpareCost(cameras=len(options), price=price, objective=spare.value)
        return replace(
            found,
            cameras=cameras,
            cell=cell,
            candidates=candidates,
            fewer=with_fewer,
            without_spare=without_spare,
            interrupted=self._stopped,
        )

    def _empty(self, seen: Array, shut: Mask) -> Solution:
        """The answer without cameras. seen, shut: see `Solution`."""
        table = self.table
        return Solution(
            question=self.question,
            infeasible=tuple(table.infeasible),
            ways=len(table.ways),
            samples=table.sample_count,
            options=len(table.options) - len(table.kept),
            seen=seen,
            shut=shut,
            cell=table.cell_with(()),
            too_slow=table.too_slow,
        )

    def _studies(
        self, cameras: Sequence[PlacedCamera], stay: Sequence[Camera], selection: Selection
    ) -> Sequence[Study]:
        together = [*(placed.camera for placed in cameras), *stay]
        return self.table.with_delays(together, self.table.watched(together, selection.ways))

    def _cameras(self, selection: Selection) -> tuple[PlacedCamera, ...]:
        """The chosen cameras, with names that no camera that stays has."""
        table, wanted = self.table, self.question.requirements

        def quality(options: Sequence[int]) -> float:
            figures = [one.without_delays for one in table.watched(map(table.camera_at, options), selection.ways)]
            return wanted.value([(one.q_eoi, one.q_avg) for one in figures], self._weights)

        names = (name for number in count(1) if (name := f"cam{number}") not in self.question.keep)
        whole, placed = quality((*selection.options, *table.kept)), []
        for option, name in zip(selection.options, names, strict=False):
            there = table.installation(option)
            rest = [one for one in (*selection.options, *table.kept) if one != option]
            placed.append(
                PlacedCamera(
                    camera=there.camera(name),
                    **vars(there),
                    price=price_of(there.spot, there.lens),
                    alone=quality([option]),
                    loss=max(0.0, whole - quality(rest)),
                )
            )
        return tuple(placed)

    def _refined(
        self,
        checked: Checked,
        selection: Selection,
        cameras: tuple[PlacedCamera, ...],
        stay: Sequence[Camera],
        studies: Sequence[Study],
    ) -> tuple[tuple[PlacedCamera, ...], Sequence[Study]]:
        """The cameras moved and turned between their sites, with the exact studies, if they are better then.

        They are where the quality that counts first is greater, and each candidate that met the wish meets it still.
        """
        table = self.table
        wanted, weights, wish = self.question.requirements, self._weights, checked.requirements.wish
        average = replace(wanted, objective="mean")

        def value(pairs: Sequence[Pair]) -> tuple[float, float]:
            return wanted.value(pairs, weights), average.value(pairs, weights)

        places = [Installation(placed.spot, placed.view, placed.lens) for placed in cameras]
        found = refined(table, places, selection.ways, value)
        moved = tuple(
            replace(
                placed,
                camera=there.camera(placed.camera.name),
                view=there.view,
                moved=float(np.linalg.norm(there.spot.position - placed.spot.position)),
            )
            for placed, there in zip(cameras, found, strict=True)
        )
        better = self._studies(moved, stay, selection)

        before, after = ([study.assessment("") for study in some] for some in (studies, better))
        first, now = (value([(one.q_eoi, one.q_avg) for one in some])[0] for some in (before, after))
        pairs = zip(before, after, strict=True)
        kept = wish is None or all(wish.met(new) or not wish.met(old) for old, new in pairs)
        return (moved, better) if kept and now > first + 2 * ROUNDED else (cameras, studies)

    def _of_study(self, number: int, found: Study) -> JudgedCandidate:
        way = self.table.ways[number]
        return JudgedCandidate(task=way.task, candidate=way.candidate, scene=found, found=found.assessment(""))

    def _judged(self, cell: Cell, problem: Problem, selection: Selection, number: int, found: Study) -> JudgedCandidate:
        """A candidate with its exact figures: in the way that `rank` and `score` take in the new cell, if as good."""
        question, way, ranked = self.question, self.table.ways[number], None
        if not question.fastest:
            taken = find_way(cell, way.candidate, question.world, question.sampling, WantedWay())
            if not isinstance(taken, Infeasible):
                ranked = taken.assessment
                spare = question.requirements.failure_tolerance
                if not spare and self._is_as_good(problem, selection, taken.study, found):
                    found = taken.study
        named = with_branch(question.cell, way.scene) if question.fastest else found.candidate
        figures = replace(found.assessment(""), candidate=way.candidate, best_way=named)
        differs = ranked is not None and any(
            (a is None) != (b is None) or abs((a or 0.0) - (b or 0.0)) > 1e-6
            for a, b in ((ranked.q_eoi, figures.q_eoi), (ranked.q_avg, figures.q_avg), (ranked.time, figures.time))
        )
        return replace(self._of_study(number, found), found=figures, ranked=ranked if differs else None)

    def _is_as_good(self, problem: Problem, selection: Selection, other: Study, found: Study) -> bool:
        """Whether another way has no worse figures, and the robot touches no chosen camera in it."""
        new, old = other.assessment(""), found.assessment("")
        pairs = [(new.q_eoi, old.q_eoi), (new.q_avg, old.q_avg)]
        worse = any(a is not None and b is not None and a < b - 2 * ROUNDED for a, b in pairs)
        late = (new.latest or 0.0) > (old.latest or 0.0) + 1e-3
        places = [self.table.spots[problem.site[option]] for option in selection.options]
        way = replace(self.table.ways[selection.ways[0]], scene=other)
        return not (worse or late or (places and blocked(self.question.cell, way, places).any()))
