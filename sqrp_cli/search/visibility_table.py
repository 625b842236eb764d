"""What every installation on the mounts sees in every way of the candidates: the ground on which cameras are chosen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations

import numpy as np

from sqrp_cli.camera.camera import Camera, image_of
from sqrp_cli.cell.mounts import LensEntry, MountEntry, Mounts, Site
from sqrp_cli.cell.workspace import World
from sqrp_cli.errors import Infeasible
from sqrp_cli.files.entries import from_fields
from sqrp_cli.geometry import Array, Indices, Mask
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import Progress
from sqrp_cli.records import dataclass
from sqrp_cli.search.placing_problem import Hiding, Late, Problem, Requirements, Rows, Selection, covered_way
from sqrp_cli.search.placing_result import InfeasibleCandidate, UnseenTarget
from sqrp_cli.search.sites import (
    Installation,
    JudgedWay,
    Verdicts,
    blocked,
    hidden_by,
    installations_at,
    judged_way,
    local_verdicts,
    middle_of,
    touching_pairs,
    ways_to_choose,
)
from sqrp_cli.study.drop_detection import least_delays
from sqrp_cli.study.find import Plans, TimeLimit
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.timeline import PlannedMotion, Timeline, observe
from sqrp_cli.task.feasibility import impossible_start
from sqrp_cli.task.task import Task

MOST_ADDED = 24  # most samples that are added to a way at once where nothing is covered, besides those at changes
_JUDGED_TOGETHER = 48  # installations judged as one piece of work
_TOGETHER = 200  # options whose delays are looked at together, to bound the memory


@dataclass(frozen=True, eq=False, kw_only=True)
class PlaceQuestion:
    """Which cameras are wanted, and for what."""

    cell: Cell
    world: World
    tasks: tuple[Task, ...]
    mounts: Mounts
    requirements: Requirements
    sampling: Sampling
    keep: tuple[str, ...] = ()  # cameras of the workspace that stay
    fastest: bool = False  # whether candidates keep the fastest branch with the first grip, as with `--ways first`
    verdicts: Verdicts | None = None  # where verdicts come from; None: this process


class VisibilityTable:
    """The ways of all candidates, the options of all mounts, and what each option sees of each way at its samples."""

    def __init__(self, question: PlaceQuestion, progress: Progress) -> None:
        """Nothing is planned or seen yet. progress: shows how far it is."""
        self.question, self._progress = question, progress
        self.sites = list(question.mounts.sites)  # places on mounts, then those of the cameras that stay
        self.options, self.kept = list[Installation](), list[int]()
        """Every pose at every site with every lens that fits, and which of these, by index, are cameras that stay."""
        self.site_of: Indices = np.zeros(0, dtype=np.int64)  # of each option, by index, shape (options,)
        self.beside: dict[int, str] = {}  # sites where a camera would touch one that stays, with its name
        self.plans, self.ways = Plans(), list[JudgedWay]()  # all ways of the candidates; those to choose from
        self.candidates, self.others = list[tuple[int, ...]](), list[list[PlannedMotion]]()
        """Of each candidate: which of the ways are its own, and ways that are looked at only if they may be better."""
        self.weights: Array = np.zeros(0)  # how much each candidate counts in the mean, shape (candidates,)
        self.infeasible = list[InfeasibleCandidate]()
        self.too_slow = False  # whether no camera helps, because a candidate takes longer than the goal allows
        self.sees, self._shut, self._least_delays = list[Mask](), list[Mask](), list[Array]()
        """Of each way: which options see which items, shape (options, items); at which sites a camera would touch
        something; and how long the longest delay of a fault is at least with each option [s]."""
        self.late, self._hiding = set[Late](), set[Hiding]()
        """Choices that are known to miss the delay of the goal, or in which a camera hides what another one sees."""

    def plan(self) -> None:
        """The ways of every candidate, and the options: every pose at every site with every lens that fits."""
        question, cell, world = self.question, self.question.cell, self.question.world
        found = [(task, candidate) for task in question.tasks for candidate in task.candidates]
        goal, aimed_at = question.requirements.goal, list[JudgedWay]()
        with self._progress("Planning", len(found)) as advance:
            for task, candidate in found:
                motions = (
                    impossible_start(cell, candidate, world)
                    or self.plans.of(cell, candidate, world, fastest=question.fastest)[1]
                )
                advance(1)
                if goal is not None and goal.time is not None and not isinstance(motions, Infeasible):
                    _, motions = TimeLimit(goal.time).within(motions)
                    self.too_slow |= isinstance(motions, Infeasible)
                if isinstance(motions, Infeasible):
                    none = CandidateResult.infeasible(candidate, motions.reasons)
                    why = candidate.skill.in_pieces(motions.reasons[0])
                    named = InfeasibleCandidate(task=task.text, candidate=candidate.name, reason=why, found=none)
                    self.infeasible.append(named)
                    continue
                (first, *others), of_first_grip = ways_to_choose(motions)
                self.candidates.append((len(self.ways),))
                self.ways.append(judged_way(cell, task.text, candidate, first))
                self.others.append(others)
                same = of_first_grip is first  # what is aimed at does not depend on a choice of ways
                aimed_at.append(self.ways[-1] if same else judged_way(cell, task.text, candidate, of_first_grip))
        tasks, stated = [way.task for way in self.ways], question.mounts.weights
        self.weights = np.array([stated.get(task, 1.0) / tasks.count(task) for task in tasks])
        mounted, middle, middles = len(self.sites), middle_of(aimed_at), [middle_of([way]) for way in aimed_at]
        if self.ways:
            self.options = [one for site in self.sites for one in installations_at(site, middle, middles)]
        for name in question.keep:
            camera = cell.workspace.cameras[name]
            lens = from_fields(LensEntry, camera, image=image_of(camera), price=0.0)
            position = camera.X_FC[:3, 3]
            entry = MountEntry(points=[tuple(position.tolist())])
            site = Site(mount=name, name=name, frame=camera.frame, position=position, entry=entry, lenses={name: lens})
            self.kept.append(len(self.options))
            self.sites.append(site)
            self.options.append(Installation(site, camera.X_FC, None, np.array([0.0, 0.0, 1.0]), name, lens))
        number = {id(site): index for index, site in enumerate(self.sites)}
        self.site_of = np.array([number[id(option.site)] for option in self.options], dtype=np.int64)
        self.beside = {
            one: self.sites[other].name for one, other in touching_pairs(self.sites) if one < mounted <= other
        }

    def judge(self, *, all_ways: bool = False) -> None:
        """Find out what is seen of the ways that nobody has looked at, and which sites are in their way.

        all_ways: let all ways of the candidates be chosen, no longer only the first of each.
        """
        for number, more in enumerate(self.others if all_ways else ()):
            first = self.ways[self.candidates[number][0]]
            self.candidates[number] += tuple(range(len(self.ways), len(self.ways) + len(more)))
            self.ways += [judged_way(self.question.cell, first.task, first.candidate, planned) for planned in more]
            self.others[number] = []
        ways = self.ways[len(self.sees) :]
        self.sees += self._verdicts(ways)
        goal = self.question.requirements.goal
        for way in ways:
            shut = blocked(self.question.cell, way.swept, self.question.mounts.sites)
            shut[list(self.beside)] = True
            self._shut.append(shut)
            delays = np.zeros(len(self.options))  # 0 if the goal has none
            if goal is not None and goal.delay is not None:
                cameras, observer = [*map(self.camera_at, range(len(self.options)))], self.question.cell.observer
                response = min((camera.response for camera in cameras), default=0.0)
                for start in range(0, len(cameras), _TOGETHER):
                    some = replace(observer, cameras=tuple(cameras[start : start + _TOGETHER]))
                    delays[start : start + _TOGETHER] = least_delays(way.planned, some, response)
            self._least_delays.append(delays)

    def problem(self, failure_tolerance: int) -> Problem:
        """The problem of choosing, at the samples so far, if so many cameras may fail."""
        # Of each way the mean of Q_eoi and Q_avg with each option alone, 0 where that is in the way. Time between two
        # samples counts as half of it is seen for each end that is. Then the best way of each candidate.
        alone = []
        for way, sees, shut in zip(self.ways, self.sees, self._shut, strict=True):
            (sample, _), planned = way.items, way.planned
            covered = np.tile(np.any(way.required, axis=1), (len(sees), 1))
            for item in range(len(sample)):
                covered[:, sample[item]] &= sees[:, item] & (way.needed[item] <= 1)
            seen = 0.5 * (covered[:, 1:].astype(float) + covered[:, :-1]) * way.samples.gaps
            parts = [(seen[:, planned.stage.of_interest(way.samples)[:-1]], planned.T_eoi), (seen, planned.T)]
            known = [part.sum(axis=1) / total for part, total in parts if total > 0]
            quality = np.mean(known, axis=0) if known else np.ones(len(sees))
            alone.append(np.where(np.append(shut, np.zeros(len(self.kept), dtype=bool))[self.site_of], 0.0, quality))
        best = [np.max([alone[way] for way in of_one], axis=0) for of_one in self.candidates]
        responses = np.array([option.lens.response for option in self.options])
        tiers, rows = tuple(np.unique(responses).tolist()), Rows()
        prices = np.array([option.site.entry.price + option.lens.price for option in self.options])
        prices[self.kept] = 0.0
        return Problem(
            ways=tuple(
                covered_way(way, sees, responses, tiers, failure_tolerance, rows)
                for way, sees in zip(self.ways, self.sees, strict=True)
            ),
            rows=rows,
            tiers=tiers,
            candidates=tuple(self.candidates),
            weights=self.weights,
            site_of=self.site_of,
            price=prices,
            alone=np.mean(best, axis=0) if best else np.zeros(len(self.options)),
            kept=frozenset(self.kept),
            apart=frozenset(touching_pairs(self.question.mounts.sites)),
            blocked=frozenset(
                (place, way) for way, shut in enumerate(self._shut) for place in np.flatnonzero(shut).tolist()
            ),
            least_delays=np.array(self._least_delays).reshape(len(self.ways), len(self.options)),
            hiding=frozenset(self._hiding),
            late=frozenset(self.late),
            beside=self.beside,
        )

    def camera_at(self, option: int) -> Camera:
        """The camera of an option; one that stays has its name."""
        there = self.options[option]
        kept = option in self.kept
        return self.question.cell.workspace.cameras[there.site.name] if kept else there.camera(f"at {option}")

    def cell_with(self, cameras: Iterable[Camera]) -> Cell:
        """The cell with these cameras and no others."""
        cell = self.question.cell
        return cell.with_cameras_of(replace(cell.workspace, cameras={one.name: one for one in cameras}))

    def watched(self, cameras: Iterable[Camera], ways: Sequence[int], spare: int = 0) -> list[Timeline]:
        """What cameras see of ways, exactly; spare: counted is only what so many more cameras see than is needed."""
        motions = [self.ways[number].planned for number in ways]
        if spare:
            more = [[replace(one, cameras=one.cameras + spare) for one in planned.targets] for planned in motions]
            motions = [replace(planned, targets=tuple(of_one)) for planned, of_one in zip(motions, more, strict=True)]
        observer = self.cell_with(cameras).observer
        return [observe(planned, observer, self.question.sampling, full=False) for planned in motions]

    def add_samples(self, number: int, timeline: Timeline) -> bool:
        """Add samples to a way where cameras gain or lose sight between those it has; whether there are any."""
        way, covered = self.ways[number], timeline.covered
        changes = np.flatnonzero((covered[1:] != covered[:-1]) & (np.diff(timeline.samples.piece) == 0))
        lost = np.flatnonzero(timeline.observation.blind)
        rows = np.unique(np.concatenate([changes, changes + 1, lost[:: max(1, len(lost) // MOST_ADDED)]]))
        more = way.samples.with_new(timeline.samples.some(rows))
        if len(more) == len(way.samples):
            return False
        self.ways[number] = replace(way, samples=more)
        self.sees[number] = self._verdicts([self.ways[number]])[0]
        return True

    def add_hiding(self, selection: Selection) -> bool:
        """Keep in mind which of the chosen cameras hide something from another one; whether there are any."""
        found = set[Hiding]()
        for number in selection.ways:
            for option, other in permutations((*selection.options, *self.kept), 2):
                here, there = int(self.site_of[option]), int(self.site_of[other])
                if {option, other} <= set(self.kept):
                    continue
                hidden = hidden_by(self.ways[number], self.sites[here], self.sites[there])
                if (hidden & self.sees[number][other]).any():
                    others = np.flatnonzero(self.site_of == there)
                    seeing = others[(self.sees[number][others] & hidden).any(axis=1)]
                    found.add((here, tuple(seeing.tolist()), number))
        self._hiding |= found
        return bool(found)

    def unseen(self, failure_tolerance: int, shut: frozenset[int]) -> Iterator[UnseenTarget]:
        """What no choice covers: of each candidate, the first instant of each literal in the first way.

        shut: sites that cannot be used.
        """
        usable = ~np.isin(self.site_of, sorted(shut))
        for of_one in self.candidates:
            way, sees = self.ways[of_one[0]], self.sees[of_one[0]][usable]
            needed = way.needed + failure_tolerance
            known: set[int] = set()
            for item in np.flatnonzero(sees.sum(axis=0) < needed).tolist():
                sample, target = (int(of[item]) for of in way.items)
                if target not in known:
                    known.add(target)
                    yield UnseenTarget(
                        task=way.task,
                        candidate=way.candidate.name,
                        literal=str(way.planned.targets[target].atom),
                        time=float(way.samples.t[sample]),
                        seen_by=len(set(self.site_of[usable][sees[:, item]].tolist())),
                        needed=int(needed[item]),
                    )

    def _verdicts(self, ways: Sequence[JudgedWay]) -> list[Mask]:
        """Which options see which items of some ways."""
        verdicts = self.question.verdicts or partial(local_verdicts, self.question.cell, 1)
        numbers = range(len(ways))
        starts = [(n, start) for n in numbers for start in range(0, len(self.options), _JUDGED_TOGETHER)]
        sees = [np.zeros((len(self.options), len(way.needed)), dtype=bool) for way in ways]
        batches = [(ways[n], self.options[start : start + _JUDGED_TOGETHER]) for n, start in starts]
        with self._progress("Looking from every mount", len(batches)) as advance:
            for index, found in verdicts(batches):
                n, start = starts[index]
                sees[n][start : start + len(found)] = found
                advance(1)
        return sees
