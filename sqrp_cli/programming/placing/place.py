"""From tasks and mounts to cameras: ways are planned, mounts judged, cameras chosen, and what was chosen is scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from itertools import count
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera, image_of
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import LensChoice, MountEntry, Spot
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, observed
from sqrp_cli.programming.coverage.fault_sights import least_fault_delays
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.placing.choose import Chosen, Search
from sqrp_cli.programming.placing.cover import Cover
from sqrp_cli.programming.placing.gain import qualities_alone
from sqrp_cli.programming.placing.placement import (
    ROUNDED,
    FewerCameras,
    JudgedCandidate,
    PlacedCamera,
    Placement,
    PlaceQuestion,
    Unseen,
    WithoutSpare,
)
from sqrp_cli.programming.placing.problem import Choice, Demand, Hiding, Placing, obstacle, unusable, worth_of
from sqrp_cli.programming.placing.refine import CameraSeat, refined
from sqrp_cli.programming.placing.room import blocked, hidden_by, pairs_apart
from sqrp_cli.programming.placing.scenes import JudgedWay, judged, middle_of, of_first_grip, varied
from sqrp_cli.programming.placing.tensor import LocalVerdicts, joined_items, portions, seen_by
from sqrp_cli.programming.placing.views import Option, View, options_of, price_of, views_of
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.ways.find import WantedWay, find_way, planned_ways, with_branch
from sqrp_cli.programming.ways.time_limit import TimeLimit

ROUNDS = 8
"""Most rounds in which samples are added at which the chosen cameras lose sight, between those that were judged."""

CLOSE = 1e-3
"""Figures at the samples that differ from the exact ones by more are sharpened, as a fraction."""

MOST_MISSING = 5
"""Most choices that are given up because their exact delays are longer than wished."""

_TOGETHER = 200
"""Options whose delays are looked at together, to bound the memory."""

MOST_ADDED = 24
"""Most samples that a round adds to a way."""

Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""A title and the number of parts; yields what counts the finished ones."""

Told = Callable[[str, float | None, float], None]
"""Told what a search seeks, the best value so far if there is one, and the bound."""

Found = TypeVar("Found")


class Placer:
    """Answers a question; what several of its steps need is computed once."""

    def __init__(self, question: PlaceQuestion, progress: Progress, watch: Told | None = None) -> None:
        """progress: shows how far it is. watch: told what is sought, the best value so far and the bound."""
        self.question, self._progress, self._watch = question, progress, watch or (lambda _title, _best, _bound: None)
        self.spots, self.lenses = list(question.mounts.spots), list(question.mounts.lenses)
        self.views, self.options, self.kept = list[View](), list[Option](), list[int]()
        self.ways: list[JudgedWay] = []
        self.candidates: list[tuple[int, ...]] = []
        self.infeasible: list[tuple[str, Assessment]] = []
        self._others: list[list[JudgedWay]] = []
        """Of each candidate, ways that are looked at only where they may be better."""
        self._plain: list[int] = []
        """Which of the ways of each candidate is the only one without a choice of ways."""
        self._aimed_at: list[JudgedWay] = []
        """Those ways: what cameras aim at does not depend on whether ways are chosen, too."""
        self._shut: list[Mask] = []
        """Of each way, at which places a camera would touch something."""
        self._late: list[Array] = []
        """Of each way, how long the longest delay of a fault is at least with each option [s]."""
        self._apart: frozenset[tuple[int, int]] = frozenset(pairs_apart(self.spots))
        self._too_slow = False
        """Whether no camera helps, because a candidate takes longer than is wished for."""
        self._stopped = False
        """Whether Ctrl-C came."""
        self._blind = False
        """Whether no choice of cameras gives any candidate a quality above 0."""
        self._known_hiding: frozenset[Hiding] = frozenset()
        self._missing: frozenset[tuple[int, ...]] = frozenset()
        """Sets of options whose exact delays are longer than wished."""
        self.sees: list[Mask] = []
        """Of each way, which options see which items, shape (options, items)."""

    def place(self) -> Placement:
        """The best cameras for the tasks, with the fastest way of each candidate where no other can do better."""
        self._plan()
        if not self.ways:
            return self._nothing()
        self._choose_from()
        self._judge(self.ways)
        demand = self.question.demand
        if self._is_ruled_out(demand.wish):
            return self._closest(demand)
        problem, chosen = self._reaching(demand)
        if self._others and not chosen.interrupted and self._may_be_better(problem, chosen):
            self._add_ways()
            self._sharpen_plain(demand)
            self._missing = frozenset()
            problem, chosen = self._reaching(demand, chosen.choice)
        if chosen.choice is None and not chosen.interrupted and demand.wish is not None:
            return self._nearest(demand)
        return self._placement(*self._at_least_some(problem, chosen, demand))

    def _reaching(self, demand: Demand, start: Choice | None = None) -> tuple[Placing, Chosen]:
        """The best choice whose exact delays are as wished for, too; the first one if none of a few is."""
        first = problem, chosen = self._wanted(demand, start)
        for _ in range(MOST_MISSING):
            if chosen.choice is None or chosen.interrupted or not self._misses(chosen.choice, demand):
                break
            self._missing |= {chosen.choice.options}
            problem, chosen = self._wanted(demand)
        else:
            return first
        if chosen.choice is None and first[1].choice is not None:
            return first
        # Those left out miss it in the ways that were chosen with them, perhaps not in others.
        return problem, replace(chosen, proven=chosen.proven and not self._missing)

    def _misses(self, choice: Choice, demand: Demand) -> bool:
        """Whether a fault may be noticed later than wished with a choice, by the exact delays."""
        if demand.wish is None or demand.wish.delay is None:
            return False
        found = (study.assessment("").delay_worst for study in self.studies(choice))
        return any(delay is not None and delay > demand.wish.delay + 1e-9 for delay in found)

    def _nearest(self, demand: Demand) -> Placement:
        """The answer where the wish cannot be met: as many cameras more as it takes, or what comes nearest."""
        if demand.most is not None:
            problem, enough = self._wanted(replace(demand, most=None))
            if enough.choice is not None:
                return replace(self._placement(problem, enough), met=False)
        return self._closest(demand)

    def _is_ruled_out(self, wish: Wish | None) -> bool:
        """Whether a wished delay is shorter than the period and latency of every camera."""
        responses = [self._camera_at(option).response for option in range(len(self.options))]
        wished = None if wish is None or not any(way.scene.faults for way in self.ways) else wish.delay
        return wished is not None and wished < min(responses, default=0.0) - 1e-9

    def _closest(self, demand: Demand) -> Placement:
        """What comes nearest to a wish that no choice meets."""
        demand = replace(demand, wish=None)
        problem, nearest = self._at_least_some(*self._sharpened(demand), demand)
        found = self._placement(problem, nearest)
        return replace(found, met=False, late=False, unseen=tuple(self._unseen(problem)))

    def _at_least_some(self, problem: Placing, chosen: Chosen, demand: Demand) -> tuple[Placing, Chosen]:
        """The choice with the best mean, where no choice lifts the least quality above 0; none if that is 0, too."""
        if chosen.choice is None or chosen.interrupted or worth_of(problem, chosen.choice).of(demand.objective) > 0.0:
            return problem, chosen
        if demand.objective == "least":
            problem, chosen = self._sharpened(replace(demand, wish=None, objective="mean"))
            chosen = replace(chosen, bound=0.0)
        self._blind = chosen.choice is not None and worth_of(problem, chosen.choice).mean <= 0.0
        return problem, replace(chosen, choice=None) if self._blind else chosen

    def _wanted(self, demand: Demand, start: Choice | None = None) -> tuple[Placing, Chosen]:
        """The best choice for a demand; the fewest cameras for a wish, at samples that show what one less can do."""
        problem, chosen = self._sharpened(demand, start=start)
        if demand.wish is None or chosen.choice is None or chosen.interrupted:
            return problem, chosen
        fewer, samples = len(chosen.choice.options) - 1, self._sample_count
        if fewer >= problem.at_least(demand):
            self._sharpened(replace(demand, wish=None, most=fewer), first_only=True)
        return (problem, chosen) if samples == self._sample_count else self._sharpened(demand, start=chosen.choice)

    @property
    def _sample_count(self) -> int:
        return sum(len(way.samples) for way in self.ways)

    def _may_be_better(self, problem: Placing, chosen: Chosen) -> bool:
        """Whether other ways may be better than the fastest ones, in quality, delay, or the number of cameras."""
        if chosen.choice is None:
            return True
        worth = worth_of(problem, chosen.choice)
        imperfect = worth.least < 1.0 - ROUNDED or worth.delay > problem.cover.quickest + CLOSE
        return imperfect or len(chosen.choice.options) > problem.at_least(self.question.demand)

    def _add_ways(self) -> None:
        """Let other ways be chosen, too."""
        first = len(self.ways)
        for number, others in enumerate(self._others):
            self.candidates[number] += tuple(range(len(self.ways), len(self.ways) + len(others)))
            self.ways += others
        self._others = []
        self._judge(self.ways[first:])

    def _sharpen_plain(self, demand: Demand) -> None:
        """Add samples where cameras that are best without a choice of ways lose sight: with it, none are worse."""
        every = self.candidates
        self.candidates = [(of_one[plain],) for of_one, plain in zip(every, self._plain, strict=True)]
        if any(of_one != (all_ways[0],) for of_one, all_ways in zip(self.candidates, every, strict=True)):
            self._sharpened(demand)
        self.candidates = every

    def _judge(self, ways: Sequence[JudgedWay]) -> None:
        """Find out what is seen of some ways, and which places are in their way."""
        self.sees += self._verdicts(ways)
        self._shut += [blocked(self.question.cell, way, self.question.mounts.spots) for way in ways]
        self._late += map(self._least_delays, ways)

    def _least_delays(self, way: JudgedWay) -> Array:
        """How long the longest delay of a way is at least with each option, (options,) [s]; 0 if none is wished."""
        wish = self.question.demand.wish
        if wish is None or wish.delay is None:
            return np.zeros(len(self.options))
        cameras = [self._camera_at(option) for option in range(len(self.options))]
        response = min((camera.response for camera in cameras), default=0.0)
        some = [cameras[first : first + _TOGETHER] for first in range(0, len(cameras), _TOGETHER)]
        solids = self.question.cell.observer.solids
        found = [least_fault_delays(way.scene, Observer(tuple(of_some), solids), response) for of_some in some]
        return np.concatenate([np.empty(0), *found])

    def _sharpened(
        self, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> tuple[Placing, Chosen]:
        """The best choice at samples at which its own figures are exact; first_only: only the first aim counts."""
        for number in range(ROUNDS):
            problem = self.posed(demand.survive)
            chosen = self._search(problem, demand, first_only=first_only, start=start)
            if chosen.choice is None or chosen.interrupted or number == ROUNDS - 1:
                break
            hiding = frozenset(self._hiding(problem, chosen.choice))
            if hiding:
                self._known_hiding |= hiding
                start = None
            elif not self._sharpen(problem, chosen.choice, demand.survive):
                break
        return problem, chosen

    def _hiding(self, problem: Placing, choice: Choice) -> Iterator[Hiding]:
        """Which of the chosen cameras hide something that another one sees, in the chosen ways."""
        for number in choice.ways:
            for option in choice.options:
                for other in (*choice.options, *sorted(problem.kept)):
                    place, at = int(problem.spot[option]), int(problem.spot[other])
                    if place == at:
                        continue
                    hidden = hidden_by(self.ways[number], self.spots[place], self.spots[at])
                    if (hidden & self.sees[number][other]).any():
                        there = np.flatnonzero(problem.spot == at)
                        seeing = there[(self.sees[number][there] & hidden).any(axis=1)]
                        yield Hiding(place, tuple(seeing.tolist()), number)

    def _plan(self) -> None:
        """The ways of every candidate."""
        question = self.question
        found = [(task, candidate) for task in question.tasks for candidate in task.candidates]
        with self._progress("Planning", len(found)) as advance:
            for task, candidate in found:
                scenes = planned_ways(question.cell, candidate, question.world, fastest=question.fastest)
                advance(1)
                wish = question.demand.wish
                if wish is not None and wish.time is not None and not isinstance(scenes, Infeasible):
                    scenes = TimeLimit(wish.time).within(scenes)
                    self._too_slow |= isinstance(scenes, Infeasible)
                if isinstance(scenes, Infeasible):
                    self.infeasible.append((task.text, Assessment.infeasible(candidate, scenes.reasons)))
                    continue
                some = varied(scenes)
                first, *others = all_ways = [judged(question.cell, task.text, candidate, scene) for scene in some]
                self.candidates.append((len(self.ways),))
                self.ways.append(first)
                self._others.append(others)
                self._plain.append(some.index(of_first_grip(scenes)))
                self._aimed_at.append(all_ways[self._plain[-1]])

    def _choose_from(self) -> None:
        """The poses, and the options."""
        question, workspace = self.question, self.question.cell.workspace
        middles = [middle_of([way]) for way in self._aimed_at]
        self.views = views_of(self.spots, middle_of(self._aimed_at), middles)
        self.options = options_of(self.spots, self.views, self.lenses)
        for name in question.keep:
            camera = workspace.cameras[name]
            lens = completed(LensChoice, camera, image=image_of(camera), price=0.0)
            entry = MountEntry(points=[tuple(camera.X_FC[:3, 3].tolist())], body=1e-3)
            at, position = len(self.spots), camera.X_FC[:3, 3]
            self.kept.append(len(self.options))
            self.options.append(Option(len(self.views), len(self.lenses)))
            self.views.append(View(at, camera.X_FC, None, np.array([0.0, 0.0, 1.0])))
            self.spots.append(
                Spot(mount=name, name=name, frame=camera.frame, position=position, entry=entry, lenses=(lens,))
            )
            self.lenses.append(lens)

    def _verdicts(self, ways: Sequence[JudgedWay]) -> list[Mask]:
        """Which options see which items of some ways."""
        question = self.question
        verdicts = question.verdicts or LocalVerdicts(question.cell)
        parts = [part for way in ways for part in portions(way, self.spots, self.views, self.lenses)]
        found: dict[int, Mask] = {}
        with self._progress("Looking from every mount", len(parts)) as advance:

            def done(number: int, sees: Mask) -> None:
                found[number] = sees
                advance(1)

            verdicts.of(parts, done)
        each = len(parts) // max(1, len(ways))
        by_way = [[found[first + number] for number in range(each)] for first in range(0, len(parts), each or 1)]
        view, lens = np.array([o.view for o in self.options]), np.array([o.lens for o in self.options])
        return [np.concatenate(of_way, axis=1)[lens, view] for of_way in by_way]

    def posed(self, survive: int) -> Placing:
        """The problem of choosing, at the samples so far, if so many cameras may fail."""
        spot = np.array([self.views[option.view].spot for option in self.options], dtype=np.int64)
        responses = np.array([self.lenses[option.lens].response for option in self.options])
        tasks = [self.ways[of_one[0]].task for of_one in self.candidates]
        weights = self.question.mounts.weights
        return Placing(
            cover=Cover.of(self.ways, self.sees, responses, survive),
            candidates=tuple(self.candidates),
            weights=np.array([weights.get(task, 1.0) / tasks.count(task) for task in tasks]),
            spot=spot,
            price=np.array(
                [
                    0.0 if number in self.kept else price_of(self.spots[place], self.lenses[option.lens])
                    for number, (place, option) in enumerate(zip(spot.tolist(), self.options, strict=True))
                ]
            ),
            kept=frozenset(self.kept),
            apart=self._apart,
            hiding=self._known_hiding,
            missing=self._missing,
            late=np.array(self._late).reshape(len(self.ways), len(self.options)),
            blocked=frozenset(
                (place, way) for way, shut in enumerate(self._shut) for place in np.flatnonzero(shut).tolist()
            ),
        )

    def _never_failing(self, problem: Placing) -> Placing:
        """The same problem if no camera may fail."""
        return self.posed(0) if self.question.demand.survive else problem

    def _search(
        self, problem: Placing, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> Chosen:
        count = "as few cameras as possible" if demand.most is None else f"{demand.most} of the cameras"
        with self._progress(f"Choosing {count}", 1):
            search = Search(problem, demand, self._watch, start)
            chosen = search.first() if first_only else search.best()
        self._stopped |= chosen.interrupted
        return chosen

    def cameras(self, problem: Placing, choice: Choice) -> tuple[PlacedCamera, ...]:
        """The chosen cameras, with names that no camera that stays has."""
        names = (name for number in count(1) if (name := f"cam{number}") not in self.question.keep)
        plain = self._never_failing(problem)
        return tuple(
            self._camera(plain, choice, option, name) for option, name in zip(choice.options, names, strict=False)
        )

    def _seat(self, option: int) -> CameraSeat:
        view = self.views[self.options[option].view]
        return CameraSeat(self.spots[view.spot], view, self.lenses[self.options[option].lens])

    def _camera(self, plain: Placing, choice: Choice, option: int, name: str) -> PlacedCamera:
        """A chosen camera; plain: the problem if no camera may fail."""
        seat, objective = self._seat(option), self.question.demand.objective
        alone = worth_of(replace(plain, kept=frozenset()), Choice((option,), choice.ways))
        without = worth_of(plain, Choice(tuple(o for o in choice.options if o != option), choice.ways))
        return PlacedCamera(
            camera=seat.camera(name),
            **vars(seat),
            price=price_of(seat.spot, seat.lens),
            alone=alone.of(objective),
            loss=max(0.0, worth_of(plain, choice).of(objective) - without.of(objective)),
        )

    def cell_with(self, cameras: Sequence[Camera]) -> Cell:
        """The cell with the cameras that stay, and these."""
        return self._cell_of([*(self.question.cell.workspace.cameras[name] for name in self.question.keep), *cameras])

    def _cell_of(self, cameras: Sequence[Camera]) -> Cell:
        cell, together = self.question.cell, {camera.name: camera for camera in cameras}
        workspace = replace(cell.workspace, cameras=together)
        return replace(cell, workspace=workspace, observer=Observer(tuple(together.values()), cell.observer.solids))

    def studies(self, choice: Choice) -> list[Study]:
        """The exact studies of the chosen ways with the chosen cameras, and those that stay."""
        return self._studies_with([self._camera_at(option) for option in (*choice.options, *self.kept)], choice)

    def _camera_at(self, option: int) -> Camera:
        """The camera of an option; one that stays has its name."""
        seat = self._seat(option)
        if option in self.kept:
            return self.question.cell.workspace.cameras[seat.spot.name]
        return seat.camera(f"at {option}")

    def _studies_with(self, cameras: Sequence[Camera], choice: Choice) -> list[Study]:
        """The exact studies of the chosen ways with these cameras and no others."""
        cell = self._cell_of(cameras)
        scenes = [self.ways[number].scene for number in choice.ways]
        return [observed(cell, scene, self.question.sampling, full=False) for scene in scenes]

    def _refined(
        self, problem: Placing, choice: Choice, cameras: tuple[PlacedCamera, ...], studies: list[Study]
    ) -> tuple[tuple[PlacedCamera, ...], list[Study]]:
        """The cameras moved and turned between their places, with the exact studies, if they are better then."""
        ways = [self.ways[number] for number in choice.ways]
        stay = [self.sees[number][sorted(problem.kept)].sum(axis=0) for number in choice.ways]
        seats = [CameraSeat(placed.spot, placed.view, placed.lens) for placed in cameras]
        with self._progress("Refining", 1):
            found = refined(seats, ways, stay, lambda some: self._seen_from(some, ways), self._free(ways))
        if any(self._hides(one, other, ways) for one in found for other in found if one is not other):
            return cameras, studies
        moved = tuple(
            replace(
                placed,
                camera=seat.camera(placed.camera.name),
                view=seat.view,
                moved=float(np.linalg.norm(seat.spot.position - placed.spot.position)),
            )
            for placed, seat in zip(cameras, found, strict=True)
        )
        stay_there = [self._camera_at(option) for option in self.kept]
        better = self._studies_with([*stay_there, *(placed.camera for placed in moved)], choice)
        return (moved, better) if _least(better) > _least(studies) + CLOSE else (cameras, studies)

    def _seen_from(self, seats: Sequence[CameraSeat], ways: Sequence[JudgedWay]) -> list[Mask]:
        """What seats see of each way, shape (seats, items) each."""
        spots = [replace(seat.spot, lenses=(seat.lens,)) for seat in seats]
        views = [replace(seat.view, spot=number) for number, seat in enumerate(seats)]
        return [seen_by(self.question.cell, way, spots, views, (seats[0].lens,))[0] for way in ways]

    def _free(self, ways: Sequence[JudgedWay]) -> Callable[[Sequence[CameraSeat], Sequence[CameraSeat]], Mask]:
        def free(tried: Sequence[CameraSeat], rest: Sequence[CameraSeat]) -> Mask:
            """Whether nothing touches a camera there, and it touches no other one."""
            spots = [seat.spot for seat in tried]
            good = np.ones(len(spots), dtype=bool)
            for way in ways if spots else ():
                good &= ~blocked(self.question.cell, way, spots)
            for number, spot in enumerate(spots):
                good[number] &= not any(True for seat in rest for _ in pairs_apart([spot, seat.spot]))
            return good

        return free

    def _hides(self, one: CameraSeat, other: CameraSeat, ways: Sequence[JudgedWay]) -> bool:
        """Whether a camera hides something that another one sees."""
        seen = self._seen_from([other], ways)
        return any(
            bool((hidden_by(way, one.spot, other.spot) & of_way[0]).any())
            for way, of_way in zip(ways, seen, strict=True)
        )

    def _sharpen(self, problem: Placing, choice: Choice, spare: int) -> bool:
        """Add samples where the chosen cameras lose or gain sight between those of a way; whether any were added.

        Then the figures at the samples are the exact ones; where any one camera may fail, those without each of them.
        """
        together = (*choice.options, *self.kept)
        plain = replace(self._never_failing(problem), kept=frozenset())
        added = False
        for some in [together] if not spare else [tuple(o for o in together if o != lost) for lost in together]:
            worth = worth_of(plain, Choice(some, choice.ways))
            studies = self._studies_with([self._camera_at(option) for option in some], choice)
            for number, study, pair in zip(choice.ways, studies, worth.qualities, strict=True):
                found = study.assessment("")
                known = zip(pair, (found.q_eoi, found.q_avg), strict=True)
                if any(a is not None and b is not None and abs(a - b) > CLOSE for a, b in known):
                    added |= self._add_samples(number, study)
        return added

    def _add_samples(self, number: int, study: Study) -> bool:
        timeline, way = study.timeline, self.ways[number]
        covered = timeline.covered
        changes = np.flatnonzero((covered[1:] != covered[:-1]) & ~np.isnan(timeline.steps))
        lost = np.flatnonzero(timeline.monitored & ~covered)
        rows = np.unique(np.concatenate([changes, changes + 1, lost[:: max(1, len(lost) // MOST_ADDED)]]))
        known = set(zip(way.samples.piece.tolist(), way.samples.t.tolist(), strict=True))
        pairs = zip(timeline.samples.piece[rows].tolist(), timeline.samples.t[rows].tolist(), strict=True)
        new = [pair for pair in pairs if pair not in known]
        if not new:
            return False
        more = replace(way, samples=Samples(np.array([p for p, _ in new]), np.array([t for _, t in new])))
        after = way.with_samples(more.samples)
        self.sees[number] = joined_items(way, self.sees[number], more, self._verdicts([more])[0], after)
        self.ways[number] = after
        return True

    def _unseen(self, problem: Placing) -> Iterator[Unseen]:
        """What no choice covers: of each candidate, the first instant of each literal in the first way."""
        usable = ~np.isin(problem.spot, sorted(unusable(problem)))
        for of_one in self.candidates:
            way, sees = self.ways[of_one[0]], self.sees[of_one[0]][usable]
            spots = problem.spot[usable]
            needed = way.needed + self.question.demand.survive
            few = np.flatnonzero(sees.sum(axis=0) < needed)
            known: set[int] = set()
            for item in few.tolist():
                sample, target = int(way.items[0][item]), int(way.items[1][item])
                if target not in known:
                    known.add(target)
                    yield Unseen(
                        task=way.task,
                        candidate=way.candidate.name,
                        literal=str(way.scene.targets[target].atom),
                        time=float(way.samples.t[sample]),
                        seen_by=len(set(spots[sees[:, item]].tolist())),
                        needed=int(needed[item]),
                    )

    def _aside(self, demand: Demand, *, first_only: bool = False) -> tuple[Placing, Chosen]:
        """The best choice for another demand; the samples that the proof of the choice is about stay as they are."""
        proven = list(self.ways), list(self.sees)
        found = self._sharpened(demand, first_only=first_only)
        self.ways, self.sees = proven
        return found

    def _fewer(self, problem: Placing, choice: Choice) -> FewerCameras | None:
        """What one camera less could do."""
        cameras = len(choice.options) - 1
        if cameras < max(1, problem.at_least(self.question.demand)):
            return None
        demand = replace(self.question.demand, wish=None, most=cameras)
        sharper, found = self._aside(demand, first_only=True)
        best = 0.0 if found.choice is None else worth_of(sharper, found.choice).of(demand.objective)
        return FewerCameras(cameras=cameras, objective=best, bound=max(best, found.bound))

    def _without_spare(self) -> WithoutSpare | None:
        """What would do if no camera could fail; None where that is not asked."""
        demand = self.question.demand
        if not demand.survive:
            return None
        problem, found = self._aside(replace(demand, survive=0))
        if found.choice is None:
            return None
        worth = worth_of(problem, found.choice)
        return WithoutSpare(cameras=len(found.choice.options), price=worth.price, objective=worth.of(demand.objective))

    def _seen_alone(self, problem: Placing) -> Array:
        """See `Placement.seen`."""
        found = np.zeros(len(self.question.mounts.spots))
        mean = qualities_alone(self._never_failing(problem))
        np.maximum.at(found, problem.spot[: len(problem.spot) - len(self.kept)], mean[: len(mean) - len(self.kept)])
        return found

    def _unless_stopped(self, step: Callable[[], Found], otherwise: Found) -> Found:
        """What a further step finds; something else after Ctrl-C, and if it comes now: what was chosen is not lost."""
        if self._stopped:
            return otherwise
        try:
            return step()
        except KeyboardInterrupt:
            self._stopped = True
            return otherwise

    def _without_more(self) -> tuple[JudgedCandidate, ...]:
        """All candidates in their fastest ways with the cameras that stay."""
        choice = Choice((), tuple(of_one[0] for of_one in self.candidates))
        pairs = zip((self.ways[number] for number in choice.ways), self.studies(choice), strict=True)
        return tuple(
            JudgedCandidate(task=way.task, candidate=way.candidate, scene=found, found=found.assessment(""))
            for way, found in pairs
        )

    def _judged(self, cell: Cell, problem: Placing, choice: Choice, number: int, found: Study) -> JudgedCandidate:
        """A candidate with its exact figures: in the way that `rank` and `score` take in the new cell, if as good."""
        question, way, ranked = self.question, self.ways[number], None
        if not question.fastest:
            taken = find_way(cell, way.candidate, question.world, question.sampling, WantedWay())
            if not isinstance(taken, Infeasible):
                ranked = taken.assessment
                as_good = not question.demand.survive and self._is_as_good(problem, choice, taken.study, found)
                found = taken.study if as_good else found
        named = with_branch(question.cell, way.scene) if question.fastest else found.candidate
        figures = replace(found.assessment(""), candidate=way.candidate, best_way=named)
        differs = ranked is not None and any(
            (a is None) != (b is None) or abs((a or 0.0) - (b or 0.0)) > ROUNDED
            for a, b in ((ranked.q_eoi, figures.q_eoi), (ranked.q_avg, figures.q_avg), (ranked.time, figures.time))
        )
        return JudgedCandidate(
            task=way.task, candidate=way.candidate, scene=found, found=figures, ranked=ranked if differs else None
        )

    def _is_as_good(self, problem: Placing, choice: Choice, other: Study, found: Study) -> bool:
        """Whether another way has no worse figures, and the robot touches no chosen camera in it."""
        new, old = other.assessment(""), found.assessment("")
        pairs = [(new.q_eoi, old.q_eoi), (new.q_avg, old.q_avg)]
        worse = any(a is not None and b is not None and a < b - CLOSE for a, b in pairs)
        later = (new.delay_worst or 0.0) > (old.delay_worst or 0.0) + CLOSE
        places = [self.spots[problem.spot[option]] for option in choice.options]
        way = replace(self.ways[choice.ways[0]], scene=other)
        return not (worse or later or (places and blocked(self.question.cell, way, places).any()))

    def _nothing(self) -> Placement:
        """The answer where no candidate can be done."""
        count = len(self.question.mounts.spots)
        why = "no candidate can be done" + (" in that time" if self._too_slow else "")
        return replace(self._empty(np.zeros(count), np.zeros(count, dtype=bool)), met=False, why=why)

    def _empty(self, seen: Array, shut: Mask) -> Placement:
        """The answer without cameras. seen, shut: see `Placement`."""
        return Placement(
            question=self.question,
            infeasible=tuple(self.infeasible),
            ways=len(self.ways),
            samples=self._sample_count,
            options=len(self.options) - len(self.kept),
            seen=seen,
            shut=shut,
            cell=self.cell_with(()),
            too_slow=self._too_slow,
        )

    def _so_far(self, problem: Placing, chosen: Chosen) -> Placement:
        """What is known without the chosen cameras."""
        shut = np.isin(np.arange(len(self.question.mounts.spots)), sorted(unusable(problem)))
        return replace(
            self._empty(self._seen_alone(problem), shut),
            interrupted=chosen.interrupted,
            proven=chosen.proven,
            bound=chosen.bound,
            fewest=chosen.fewest,
            met=not self._too_slow,
            quickest=problem.cover.quickest,
            fastest=len(self.ways) == len(self.candidates),
        )

    def _placement(self, problem: Placing, chosen: Chosen) -> Placement:
        found = self._so_far(problem, chosen)
        if chosen.choice is None:
            why = "" if chosen.interrupted else obstacle(problem, self.question.demand, blind=self._blind)
            return replace(found, met=False, why=why, candidates=self._without_more())
        choice = chosen.choice
        worth = worth_of(problem, choice)
        cameras, studies = self.cameras(problem, choice), self.studies(choice)
        if worth.least < 1.0 - ROUNDED and not chosen.interrupted and not self.question.demand.survive:
            cameras, studies = self._unless_stopped(
                lambda: self._refined(problem, choice, cameras, studies), (cameras, studies)
            )
        cell = self.cell_with([placed.camera for placed in cameras])
        candidates = tuple(
            self._judged(cell, problem, choice, number, study)
            for number, study in zip(choice.ways, studies, strict=True)
        )
        late = _is_late(candidates, self.question.demand.wish)
        return replace(
            found,
            cameras=cameras,
            cell=cell,
            candidates=candidates,
            met=found.met and not late,
            late=late,
            worth=worth,
            bound=max(chosen.bound, worth.of(self.question.demand.objective)),
            fewer=self._unless_stopped(lambda: self._fewer(problem, choice), None),
            without_spare=self._unless_stopped(self._without_spare, None),
            interrupted=self._stopped,
        )


def _is_late(candidates: Sequence[JudgedCandidate], wish: Wish | None) -> bool:
    """Whether a fault is noticed later than wished, by the exact figures: the search has simpler ones, at samples."""
    delays = [fault.delay_worst for one in candidates for fault in one.found.faults.values()]
    return wish is not None and wish.delay is not None and max(delays, default=0.0) > wish.delay + 1e-9


def _least(studies: Sequence[Study]) -> float:
    """The least of all Q_eoi and Q_avg of some studies."""
    figures = [study.assessment("") for study in studies]
    return min((q for one in figures for q in (one.q_eoi, one.q_avg) if q is not None), default=1.0)
