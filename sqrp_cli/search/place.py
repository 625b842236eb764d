"""The cameras that answer a question: chosen by an integer program, checked exactly, and chosen again if need be.

`Problem`: what may be chosen. `VisibilityTable`: what each option sees. `PlaceDocument`: the choice with its proof.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import count, permutations, product
from operator import attrgetter
from time import monotonic
from typing import TypeVar

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.mounts import Site
from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.geometry import Array, Mask, read_only
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import Progress
from sqrp_cli.records import dataclass
from sqrp_cli.search.aiming import looking_at
from sqrp_cli.search.goal import Goal
from sqrp_cli.search.placing_problem import Late, Problem, Requirements, Selection, obstacle
from sqrp_cli.search.placing_program import PlacementProgram, Watch
from sqrp_cli.search.placing_result import (
    ROUNDED,
    Alternative,
    CameraPlaced,
    Compared,
    PlacedCandidate,
    PlaceDocument,
    UnseenTarget,
    proof_in_words,
)
from sqrp_cli.search.sites import Installation, JudgedWay, blocked, hidden_by, judged_way, touching_pairs, verdicts_of
from sqrp_cli.search.visibility_table import PlaceQuestion, VisibilityTable
from sqrp_cli.study.analysis import Analysis, with_delays, without_delays
from sqrp_cli.study.find import BestWay, TimeLimit, WantedWay, find_way, with_branch
from sqrp_cli.study.ranking import compared_quality
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.timeline import Timeline

MOST_SOLVED, MOST_SOLVED_ASIDE = 200, 12  # programs at most: for the question, and to say what fewer cameras would do
_SAME_TIME = 1e-3  # times that differ by less may count as the same in a ranking [s]
_FINEST = 0.005  # moves are not tried in smaller steps than this [m]; aims not in less than a degree
_HALVINGS = 4  # how often the step is halved, at most
_COMPARED = ("q_eoi", "q_avg", "time")  # the figures that tell whether `rank` takes a way with others
_QUALITIES = attrgetter("q_eoi", "q_avg")
Found = TypeVar("Found")


@dataclass(frozen=True, eq=False, kw_only=True)
class SolveResult:
    """The result of a search: a selection with its exact figures."""

    problem: Problem  # at the last samples
    requirements: Requirements
    selection: Selection | None = None  # None where none is possible, or none was found in time
    watched: Sequence[Timeline] = ()  # its ways as its cameras see them, counted as if as many fail as may
    value: float = 0.0  # the quality that counts first, exactly, if as many cameras fail as may; in 0..1
    bound: float = 0.0  # no selection has a greater one
    proven: bool = False  # whether no other one is better, in every objective; or that there is none
    fewest: int = 0  # with a goal: no fewer cameras than this meet it
    met: bool = True  # whether it meets the goal
    unseen: tuple[UnseenTarget, ...] = ()  # if not: what no choice covers
    reason: str = ""  # why no selection is possible


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
        self._stopped = False  # whether Ctrl-C came

    def place(self) -> PlaceDocument:
        """The best cameras for the tasks, with the fastest way of each candidate where no other can do better."""
        table = self.table
        table.plan()
        if not table.ways:
            why = "no candidate can be done" + (" in that time" if table.too_slow else "")
            nothing = SolveResult(problem=table.problem(0), requirements=self.question.requirements, reason=why)
            return self._document(nothing, table.cell_with(()))
        table.judge()
        self._until = monotonic() + self._seconds
        return self._solution(self._chosen())

    def _chosen(self) -> SolveResult:
        """The best selection; if it is certain that none meets the goal, what comes nearest to it."""
        table, requirements, goal = self.table, self.question.requirements, self.question.requirements.goal
        if goal is not None and goal.delay is not None and any(way.planned.faults for way in table.ways):
            lenses = [*self.question.mounts.lenses.values(), *(table.options[option].lens for option in table.kept)]
            if goal.delay < min((lens.response for lens in lenses), default=0.0) - 1e-9:
                return self._nearest_to_goal()  # a frame and the latency alone take longer
        found = self._search(requirements)
        best_in_all = (
            found.selection is not None
            and found.value >= 1.0 - ROUNDED
            and found.problem.worth(requirements, found.selection)[1] <= min(found.problem.tiers, default=0.0) + 1e-3
            and len(found.selection.options) <= requirements.at_least(len(table.kept))
        )
        if any(table.others) and not (self._stopped or monotonic() >= self._until or best_in_all):
            table.judge(all_ways=True)
            found = self._search(requirements, known=found.selection)
        if found.selection is None and goal is not None and not self._stopped:
            if found.proven and requirements.most is not None:
                enough = self._search(replace(requirements, most=None))
                if enough.selection is not None:
                    return replace(enough, met=False)
            return self._nearest_to_goal(proven=found.proven)
        return self._unless_blind(found)

    def _nearest_to_goal(self, *, proven: bool = True) -> SolveResult:
        """What comes nearest to a goal that no choice meets. proven: whether it is certain that none does."""
        found = self._unless_blind(self._search(replace(self.question.requirements, goal=None)))
        unseen = self.table.unseen(self.question.requirements.failure_tolerance, self.table.problem(0).shut)
        return replace(found, met=False, proven=proven and found.proven, unseen=tuple(unseen))

    def _unless_blind(self, found: SolveResult) -> SolveResult:
        """The choice with the best mean, where no choice lifts the least quality above 0; none if that is 0, too."""
        if found.selection is None or found.value > 0.0 or self._stopped:
            return found
        if found.requirements.objective == "least":
            mean = self._search(replace(found.requirements, goal=None, objective="mean"))
            if mean.value > 0.0:
                return replace(mean, requirements=found.requirements, value=0.0, bound=found.bound)
        return replace(found, selection=None, reason=obstacle(found.problem, found.requirements, blind=True))

    def _search(
        self,
        requirements: Requirements,
        *,
        known: Selection | None = None,
        aside: bool = False,
        first_only: bool = False,
    ) -> SolveResult:
        """The best selection: chosen by what it may be worth, and checked exactly, until it is worth that.

        So nothing better exists: what others may be worth is no more. Where the exact figures are less, samples are
        added at which the chosen cameras lose sight, and it is chosen again. first_only: only the first objectives.
        aside: whether it is only said what others would do.
        """
        goal, table, best, bound, value = requirements.goal, self.table, None, 1.0, 0.0
        most_solved = MOST_SOLVED_ASIDE if aside else MOST_SOLVED
        for number in count(1):
            problem = table.problem(requirements.failure_tolerance)
            start = known if best is None else best.selection
            program = PlacementProgram(problem, requirements, self._watch, start, until=self._until, gap=self._gap)
            result = partial(SolveResult, problem=problem, requirements=requirements)
            # By the first objectives alone; if the exact figures confirm them, by all. Else the table learns why.
            selection, learned, confirmed = program.solve_first(), False, False
            for further in (False,) if first_only else (False, True):
                if further and selection is not None:
                    selection = program.solve_further(selection)
                self._stopped |= program.interrupted
                bound = program.bound if goal is not None else min(bound, program.bound)
                if selection is None:
                    if best is not None:
                        return replace(best, problem=problem, bound=max(bound, best.value), proven=False)
                    why = obstacle(problem, requirements, blind=False) if program.proven else ""
                    return result(bound=bound, proven=program.proven, reason=why)
                if program.complete and not (further or first_only):  # the other objectives take no time then
                    continue
                learned, confirmed = table.add_hiding(selection), False
                if learned:
                    break
                value, watched, late = self._exact(requirements, selection)
                table.late |= late
                seen = goal is None or all(replace(goal, delay=None).met(without_delays(one)) for one in watched)
                good = seen and not late
                confirmed = good and problem.worth(requirements, selection)[0] - value <= ROUNDED
                if confirmed or (good and (best is None or value > best.value)):
                    best = result(selection=selection, watched=watched, value=value, fewest=program.fewest)
                if not confirmed:
                    added = [table.add_samples(*one) for one in zip(selection.ways, watched, strict=True)]
                    learned = bool(late) or any(added)
                    break
            over = self._stopped or monotonic() >= self._until or number == most_solved or not learned
            enough = best is not None and goal is None and 0.0 < self._gap >= bound - best.value
            if confirmed or enough or over:
                if best is None:
                    return result(bound=bound)
                proven = confirmed and program.proven and bound - value <= ROUNDED
                return replace(best, problem=problem, bound=max(bound, best.value), proven=proven)
        raise AssertionError

    def _exact(self, requirements: Requirements, selection: Selection) -> tuple[float, Sequence[Timeline], set[Late]]:
        """The quality that counts first of a selection, its ways as they are seen, and those that are too late."""
        table, goal, late = self.table, requirements.goal, set[Late]()
        cameras = [table.camera_at(option) for option in (*selection.options, *table.kept)]
        watched = table.watched(cameras, selection.ways, requirements.failure_tolerance)
        if goal is not None and goal.delay is not None:
            only = Goal(delay=goal.delay)
            exact = self._analysed(table.cell_with(cameras), watched)
            pairs = zip(selection.ways, exact, strict=True)
            late = {(selection.options, way) for way, one in pairs if not only.met(one.result)}
        value = requirements.value([_QUALITIES(one.qualities) for one in watched], table.weights)
        return value, watched, late

    def _analysed(self, cell: Cell, watched: Sequence[Timeline]) -> list[Analysis]:
        return [with_delays(cell, one, self.question.sampling) for one in watched]

    def _unless_stopped(self, step: Callable[[], Found], otherwise: Found) -> Found:
        """What a further step finds; something else after Ctrl-C, and if it comes now: what was chosen is not lost."""
        if self._stopped:
            return otherwise
        try:
            return step()
        except KeyboardInterrupt:
            self._stopped = True
            return otherwise

    def _solution(self, result: SolveResult) -> PlaceDocument:
        """The chosen cameras with all that is said of them."""
        table, problem, selection = self.table, result.problem, result.selection
        requirements, stay = self.question.requirements, [table.camera_at(option) for option in table.kept]
        if selection is None:
            firsts, cell = [of_one[0] for of_one in table.candidates], table.cell_with(stay)
            analysed = zip(firsts, self._analysed(cell, table.watched(stay, firsts)), strict=True)
            blank = [_placed_candidate(table.ways[number], one.result) for number, one in analysed]
            return self._document(result, cell, candidates=blank)
        cameras = self._cameras(result, selection)
        everyone, spare = [*(placed.camera for placed in cameras), *stay], requirements.failure_tolerance
        watched = table.watched(everyone, selection.ways) if spare else result.watched
        analyses: Sequence[Analysis] = self._analysed(table.cell_with(everyone), watched)
        if result.value < 1.0 - ROUNDED and not spare:
            cameras, analyses = self._unless_stopped(
                lambda: self._refined(result, selection, cameras, stay, analyses), (cameras, analyses)
            )
        cell = table.cell_with([*stay, *(placed.camera for placed in cameras)])
        candidates = self._placed_candidates(cell, problem, selection, analyses)
        most, fewer, without_spare = len(selection.options) - 1, None, None
        if most >= max(1, requirements.at_least(len(table.kept))):
            one_less = replace(result.requirements, goal=None, most=most)
            less = self._unless_stopped(lambda: self._search(one_less, aside=True, first_only=True), None)
            if less is not None and not self._stopped:
                fewer = Alternative(cameras=most, objective=less.value, bound=max(less.value, less.bound))
        if spare:
            none_fails = replace(requirements, failure_tolerance=0)
            cheaper = self._unless_stopped(lambda: self._search(none_fails, aside=True), None)
            if cheaper is not None and cheaper.selection is not None:
                options = cheaper.selection.options
                price = float(cheaper.problem.price[list(options)].sum())
                without_spare = Alternative(cameras=len(options), price=price, objective=cheaper.value)
        return self._document(result, cell, cameras, candidates, fewer, without_spare)

    def _document(
        self,
        result: SolveResult,
        cell: Cell,
        cameras: Sequence[CameraPlaced] = (),
        candidates: Sequence[PlacedCandidate] = (),
        fewer: Alternative | None = None,
        without_spare: Alternative | None = None,
    ) -> PlaceDocument:
        """What is found, in the cell with its cameras."""
        question, table, requirements = self.question, self.table, self.question.requirements
        problem, count = result.problem, len(question.mounts.sites)
        seen, shut = np.zeros(count), np.zeros(count, dtype=bool)
        np.maximum.at(seen, problem.site_of[problem.free], problem.alone[problem.free])
        shut[sorted(problem.shut)] = True
        delays = [one.found.latest for one in candidates if one.found.latest is not None]
        gap = result.bound - result.value
        document = from_fields(
            PlaceDocument,
            question,
            result,
            workspace=question.cell.workspace.name,
            tasks=tuple(task.text for task in question.tasks),
            mounts=count,
            want=requirements.goal or Goal(),
            cameras=tuple(cameras),
            survive=requirements.failure_tolerance,
            by=requirements.objective,
            too_slow=table.too_slow,
            quickest=min(problem.tiers, default=0.0),
            delay_worst=None if np.inf in delays else max(delays, default=None),
            unseen_faults=max((one.unseen for one in candidates if one.unseen is not None), default=None),
            price=sum(camera.price for camera in cameras),
            floor=requirements.floor,
            candidates=tuple(candidates),
            ways={f"{one.task}: {one.candidate}": one.found.way.parameters for one in candidates},
            infeasible=tuple(table.infeasible),
            compared=Compared(
                mounts=count,
                in_the_way=int(shut.sum()),
                options=len(table.options) - len(table.kept),
                ways=len(table.ways),
                samples=sum(len(way.samples) for way in table.ways),
                fastest=len(table.ways) == len(table.candidates),
            ),
            interrupted=self._stopped or None,
            question=question,
            cell=cell,
            seen=seen,
            shut=shut,
            met=result.met and result.selection is not None and not table.too_slow,
            objective=result.value,
            gap=gap if gap > ROUNDED else 0.0,
            fewest=result.fewest if table.ways and result.requirements.goal is not None else None,
            fewer=fewer,
            without_spare=without_spare,
        )
        return replace(document, proof=proof_in_words(document))

    def _cameras(self, result: SolveResult, selection: Selection) -> tuple[CameraPlaced, ...]:
        """The chosen cameras, with names that no camera that stays has."""
        table, requirements = self.table, self.question.requirements

        @cache
        def quality(*options: int) -> float:
            watched = table.watched(map(table.camera_at, options), selection.ways)
            return requirements.value([_QUALITIES(one.qualities) for one in watched], table.weights)

        names = (name for number in count(1) if (name := f"cam{number}") not in self.question.keep)
        everyone, placed = (*selection.options, *table.kept), []
        whole = (not requirements.failure_tolerance and result.value) or quality(*everyone)
        for option, name in zip(selection.options, names, strict=False):
            loss = max(0.0, whole - quality(*(one for one in everyone if one != option)))
            placed.append(CameraPlaced.at(table.options[option], name, alone=quality(option), loss=loss))
        return tuple(placed)

    def _refined(
        self,
        result: SolveResult,
        selection: Selection,
        cameras: tuple[CameraPlaced, ...],
        stay: Sequence[Camera],
        analyses: Sequence[Analysis],
    ) -> tuple[tuple[CameraPlaced, ...], Sequence[Analysis]]:
        """The cameras moved and turned between their sites, with the exact analyses, if they are better then.

        They are where the quality that counts first is greater, and each candidate that met the goal meets it still.
        """
        table, goal, moved = self.table, result.requirements.goal, []
        found = refined(table, [placed.place for placed in cameras], selection.ways)
        for placed, to in zip(cameras, found, strict=True):
            distance = float(np.linalg.norm(to.site.position - placed.place.site.position))
            there = CameraPlaced.at(to, placed.name, alone=placed.alone, loss=placed.loss)
            moved.append(replace(there, mount=placed.mount, moved=distance))
        all_cameras = [*(placed.camera for placed in moved), *stay]
        watched, cell = table.watched(all_cameras, selection.ways), table.cell_with(all_cameras)
        better = self._analysed(cell, watched)
        before, after = ([analysis.result for analysis in some] for some in (analyses, better))
        kept = goal is None or all(goal.met(now) or not goal.met(then) for then, now in zip(before, after, strict=True))
        value = self.question.requirements.value
        old, new = (value(map(_QUALITIES, some), table.weights) for some in (before, after))
        return (tuple(moved), better) if kept and new > old + 2 * ROUNDED else (cameras, analyses)

    def _placed_candidates(
        self, cell: Cell, problem: Problem, selection: Selection, analyses: Sequence[Analysis]
    ) -> tuple[PlacedCandidate, ...]:
        """The candidates with their exact figures: in the way that `rank` takes in the new cell, if it is as good."""
        question, table, placed = self.question, self.table, list[PlacedCandidate]()
        places = [table.sites[problem.site_of[option]] for option in selection.options]
        for number, analysis in zip(selection.ways, analyses, strict=True):
            way, old, taken = table.ways[number], analysis.result, None
            if not question.fastest:
                all_seen = all(compared_quality(q) == compared_quality(1.0) for q in (old.q_eoi, old.q_avg))
                # Where all is seen no way that takes longer is better.
                limit = (
                    TimeLimit(analysis.planned.motion.time + _SAME_TIME)
                    if all_seen and not way.candidate.open_paths
                    else None
                )
                asked = WantedWay(limit=limit)
                taken = find_way(cell, way.candidate, question.world, question.sampling, asked, table.plans)
            ranked = taken.result if isinstance(taken, BestWay) else None
            if isinstance(taken, BestWay) and not question.requirements.failure_tolerance:
                new = taken.result
                pairs = [(new.q_eoi, old.q_eoi), (new.q_avg, old.q_avg)]
                worse = any(a is not None and b is not None and a < b - 2 * ROUNDED for a, b in pairs)
                late = (new.latest or 0.0) > (old.latest or 0.0) + 1e-3
                swept = False
                if places and taken.analysis.planned.motion is not way.planned.motion:
                    other = judged_way(question.cell, way.task, way.candidate, taken.analysis.planned)
                    swept = bool(blocked(question.cell, other.swept, places).any())
                analysis = analysis if worse or late or swept else taken.analysis
            named = with_branch(question.cell, way.planned) if question.fastest else analysis.planned.candidate
            figures = replace(analysis.result, candidate=way.candidate, best_way=named)
            pairs = [] if ranked is None else [(getattr(ranked, q), getattr(figures, q)) for q in _COMPARED]
            others = any((a is None) != (b is None) or abs((a or 0.0) - (b or 0.0)) > 1e-6 for a, b in pairs)
            placed.append(_placed_candidate(way, figures, ranked if others else None))
        return tuple(placed)


def _placed_candidate(way: JudgedWay, found: CandidateResult, ranked: CandidateResult | None = None) -> PlacedCandidate:
    of, others = way.candidate.name, None if ranked is None else from_fields(AdvisedFigures, ranked)
    return from_fields(PlacedCandidate, found, task=way.task, candidate=of, found=found, ranked=others)


def refined(table: VisibilityTable, places: Sequence[Installation], numbers: Sequence[int]) -> tuple[Installation, ...]:
    """The cameras, each moved and turned as long as what they see at the samples is worth more.

    numbers: of the ways. Cameras that stay see with them; none touches or hides another one, and none of those.
    """
    question, ways = table.question, [table.ways[number] for number in numbers]
    cell, requirements = question.cell, question.requirements
    best = [*places, *(table.options[option] for option in table.kept)]
    seen = [[verdicts_of(cell, way, [place])[0] for way in ways] for place in places]
    seen += [[table.sees[number][option] for number in numbers] for option in table.kept]

    def worth(each: Sequence[Sequence[Mask]]) -> tuple[float, ...]:
        """The quality that counts first, then the mean, of what each camera sees of each way."""
        pairs: list[tuple[float | None, float | None]] = []
        for number, way in enumerate(ways):
            planned, (sample, _), state = way.planned, way.items, np.any(way.required, axis=1)
            covered = sum(of_camera[number].astype(np.int64) for of_camera in each) >= way.needed
            state[sample[~covered]] = False
            gaps = np.where(state[1:] & state[:-1], way.samples.gaps, 0.0)
            parts = ((gaps[planned.stage.of_interest(way.samples)[:-1]], planned.T_eoi), (gaps, planned.T))
            q_eoi, q_avg = (float(part.sum() / total) if total > 0 else None for part, total in parts)
            pairs.append((q_eoi, q_avg))
        each_objective = (requirements, replace(requirements, objective="mean"))
        return tuple(round(one.value(pairs, table.weights), 6) for one in each_objective)

    present = worth(seen)
    for halving in range(1, _HALVINGS + 1):
        for number, place in enumerate(best[: len(places)]):
            rest = [other.site for other in (*best[:number], *best[number + 1 :])]
            tried = [
                one
                for one in _around(place, 0.5**halving)
                if not any(True for other in rest for _ in touching_pairs([one.site, other]))
                and not any(blocked(cell, way.swept, [one.site])[0] for way in ways)
            ]
            if present >= (1.0, 1.0) or not tried:
                continue
            each = list(zip(*(verdicts_of(cell, way, tried) for way in ways), strict=True))
            gains = [worth([*seen[:number], one, *seen[number + 1 :]]) for one in each]
            first = max(range(len(tried)), key=gains.__getitem__)
            if gains[first] > present:
                best[number], seen[number], present = tried[first], list(each[first]), gains[first]
    for one, other in permutations(range(len(best)), 2):
        for way, sees in zip(ways, seen[other], strict=True):
            moved = min(one, other) < len(places)
            if moved and (hidden_by(way, best[one].site, best[other].site) & sees).any():
                return tuple(places)
    return tuple(best[: len(places)])


def _around(place: Installation, share: float) -> Iterator[Installation]:
    """The camera a share of a step away along its mount, and turned by a share of a step of its cone."""
    site, entry, tried = place.site, place.site.entry, list[tuple[Site, Array | None]]()
    laid = entry.rail or entry.grid
    if laid is not None:
        start, end = np.array(laid.start), np.array(laid.end)
        way = end - start
        axes = [way / max(float(np.linalg.norm(way)), 1e-9)] if entry.rail else list(np.eye(3)[np.abs(way) > 0])
        for offset in (sign * share * laid.step * axis for axis in axes for sign in (-1.0, 1.0)):
            inside = np.clip(site.position + offset, np.minimum(start, end), np.maximum(start, end))
            position = np.round(inside, 3) + 0.0
            if np.abs(position - site.position).max() >= _FINEST:
                name = f"{site.name.removesuffix(', moved')}, moved"
                tried.append((replace(site, name=name, position=read_only(position)), place.at))
    cone = None if entry.aims is None else entry.aims.cone
    if cone is not None and place.at is not None and share * cone.step >= np.radians(1):
        axis, forward = np.array(cone.axis) / np.linalg.norm(cone.axis), place.X_FC[:3, 2]
        far = float(np.linalg.norm(place.at - site.position))
        for side, sign in product((place.X_FC[:3, 0], place.X_FC[:3, 1]), (-1.0, 1.0)):
            turned = np.cos(share * cone.step) * forward + sign * np.sin(share * cone.step) * side
            if turned @ axis >= np.cos(cone.angle) - 1e-9:
                tried.append((site, np.round(site.position + far * turned, 6)))
    for there, point in tried:  # turned to the point, or in the same direction where there is none
        eye, X_FC = there.position, place.X_FC.copy()
        X_FC[:3, 3] = eye
        X_FC = X_FC if point is None else looking_at(eye[None], point[None], place.up)[0]
        yield replace(place, site=there, X_FC=read_only(X_FC), at=point)
