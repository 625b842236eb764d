"""From tasks and mounts to cameras: ways are planned, mounts judged, cameras chosen, and what was chosen is scored."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera, image_of
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import LensChoice, MountEntry, Mounts, Spot
from sqrp_cli.knowledge.workspace.workspace import World
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Rehearsal, Study, observed
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.placing.choose import Chosen, Search
from sqrp_cli.programming.placing.cover import Cover
from sqrp_cli.programming.placing.problem import Choice, Demand, Hiding, Placing, Worth, qualities_alone, worth_of
from sqrp_cli.programming.placing.refine import Seat, refined
from sqrp_cli.programming.placing.room import blocked, hidden_by, pairs_apart
from sqrp_cli.programming.placing.scenes import JudgedWay, judged, middle_of, varied
from sqrp_cli.programming.placing.tensor import LocalVerdicts, Verdicts, joined_items, portions, seen_by
from sqrp_cli.programming.placing.views import Option, View, camera_of, options_of, price_of, views_of
from sqrp_cli.programming.sensing.observer import Observer
from sqrp_cli.programming.task import Candidate, Task
from sqrp_cli.programming.ways.find import WantedWay, find_way, planned_ways
from sqrp_cli.programming.ways.time_limit import TimeLimit

ROUNDS = 8
"""Most rounds in which samples are added at which the chosen cameras lose sight, between those that were judged."""

ROUNDED = 1e-6
"""Qualities that differ by less are the same: figures of the solver are rounded."""

CLOSE = 1e-3
"""Figures at the samples that differ from the exact ones by more are sharpened, as a fraction."""

MOST_ADDED = 24
"""Most samples that a round adds to a way."""

Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""A title and the number of parts; yields what counts the finished ones."""


Told = Callable[[str, float | None, float], None]
"""Told what a search seeks, the best value so far if there is one, and the bound."""


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
    """Whether candidates keep their fastest ways, or ways are chosen, too."""
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
    """The quality that counts first with no other camera, not even one that stays, in 0..1."""
    loss: float
    """By how much that quality falls if this camera is lost."""
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


@dataclass(frozen=True, eq=False, kw_only=True)
class FewerCameras:
    """What one camera less could do."""

    cameras: int
    """How many."""
    objective: float
    """The best quality, least or mean, that was found, in 0..1."""
    bound: float
    """No choice of so many cameras has more."""


@dataclass(frozen=True, eq=False, kw_only=True)
class WithoutSpare:
    """What would do if no camera could fail."""

    cameras: int
    """How many."""
    price: float
    """Of all of them."""
    objective: float
    """The quality that counts first, in 0..1."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Unseen:
    """Something that too few places see, so that no choice of them covers it."""

    task: str
    candidate: str
    literal: str
    time: float
    """The instant of the candidate's motion [s]."""
    seen_by: int
    """How many places see it."""
    needed: int
    """How many cameras would have to."""


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
    """Whether the wish is met, if there is one."""
    fewest: int | None = None
    """The fewest cameras that meet the wish; None without one, and if none do."""
    fewer: FewerCameras | None = None
    """With one camera less, if there are several."""
    without_spare: WithoutSpare | None = None
    """If cameras may fail: what would do otherwise."""
    unseen: tuple[Unseen, ...] = ()
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


class Placer:
    """Answers a question; what several of its steps need is computed once."""

    def __init__(self, question: PlaceQuestion, progress: Progress, watch: Told | None = None) -> None:
        """progress: shows how far it is. watch: told what is sought, the best value so far and the bound."""
        self.question, self._progress, self._watch = question, progress, watch or (lambda _title, _best, _bound: None)
        self.spots = list(question.mounts.spots)
        self.lenses = list(question.mounts.lenses)
        self.ways: list[JudgedWay] = []
        self.candidates: list[tuple[int, ...]] = []
        self.infeasible: list[tuple[str, Assessment]] = []
        self._others: list[list[JudgedWay]] = []
        """Of each candidate, ways that are looked at only where they may be better."""
        self._shut: list[Mask] = []
        """Of each way, at which places a camera would touch something."""
        self._apart: frozenset[tuple[int, int]] = frozenset(pairs_apart(self.spots))
        self._too_slow = False
        """Whether no camera helps, because a candidate takes longer than is wished for."""
        self._known_hiding: frozenset[Hiding] = frozenset()
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
        problem, chosen = self._sharpened(demand)
        if self._others and not chosen.interrupted and self._may_be_better(problem, chosen):
            self._add_ways()
            problem, chosen = self._sharpened(demand, start=chosen.choice)
        if chosen.choice is not None or chosen.interrupted:
            return self._placement(problem, chosen)
        # The wish cannot be met: so many cameras more as it takes, or what comes nearest.
        if demand.most is not None:
            problem, enough = self._sharpened(replace(demand, most=None))
            if enough.choice is not None:
                return replace(self._placement(problem, enough), met=False)
        problem, nearest = self._sharpened(replace(demand, wish=None))
        return replace(self._placement(problem, nearest), met=False, unseen=tuple(self._unseen(problem)))

    def _may_be_better(self, problem: Placing, chosen: Chosen) -> bool:
        """Whether other ways may be better than the fastest ones, in quality, delay, or the number of cameras."""
        if chosen.choice is None:
            return True
        worth = worth_of(problem, chosen.choice)
        quickest = min(problem.cover.responses, default=0.0)
        imperfect = worth.least < 1.0 - ROUNDED or worth.delay > quickest + CLOSE
        return imperfect or (self.question.demand.wish is not None and len(chosen.choice.options) > 1)

    def _add_ways(self) -> None:
        """Let other ways be chosen, too."""
        first = len(self.ways)
        for number, others in enumerate(self._others):
            self.candidates[number] += tuple(range(len(self.ways), len(self.ways) + len(others)))
            self.ways += others
        self._others = []
        self._judge(self.ways[first:])

    def _judge(self, ways: Sequence[JudgedWay]) -> None:
        """Find out what is seen of some ways, and which places are in their way."""
        self.sees += self._verdicts(ways)
        self._shut += [blocked(self.question.cell, way, self.question.mounts.spots) for way in ways]

    def _sharpened(
        self, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> tuple[Placing, Chosen]:
        """The best choice at samples at which its own figures are exact; first_only: only the first aim counts."""
        for number in range(ROUNDS):
            problem = self.problem(demand.survive)
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
                first, *others = [judged(question.cell, task.text, candidate, scene) for scene in varied(scenes)]
                self.candidates.append((len(self.ways),))
                self.ways.append(first)
                self._others.append(others)

    def _choose_from(self) -> None:
        """The poses, and the options."""
        question, workspace = self.question, self.question.cell.workspace
        middles = [middle_of([self.ways[number] for number in of_one]) for of_one in self.candidates]
        self.views = views_of(self.spots, middle_of(self.ways), middles)
        self.options = options_of(self.spots, self.views, self.lenses)
        self.kept = []
        for name in question.keep:
            camera = workspace.cameras[name]
            lens = completed(LensChoice, camera, image=image_of(camera), price=0.0)
            entry = MountEntry(points=[tuple(camera.X_FC[:3, 3].tolist())], body=1e-3)
            spot = Spot(
                mount=name,
                name=name,
                frame=camera.frame,
                position=camera.X_FC[:3, 3],
                entry=entry,
                lenses=(lens,),
            )
            self.kept.append(len(self.options))
            self.options.append(Option(len(self.views), len(self.lenses)))
            self.views.append(View(len(self.spots), camera.X_FC, None, np.array([0.0, 0.0, 1.0])))
            self.spots.append(spot)
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

    def problem(self, survive: int) -> Placing:
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
            blocked=frozenset(
                (place, way) for way, shut in enumerate(self._shut) for place in np.flatnonzero(shut).tolist()
            ),
        )

    def _search(
        self, problem: Placing, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> Chosen:
        count = "as few cameras as possible" if demand.most is None else f"{demand.most} of the cameras"
        with self._progress(f"Choosing {count}", 1):
            search = Search(problem, demand, self._watch, start)
            return search.first() if first_only else search.best()

    def cameras(self, problem: Placing, choice: Choice) -> tuple[PlacedCamera, ...]:
        """The chosen cameras, with names that no camera that stays has."""
        names = (name for number in count(1) if (name := f"cam{number}") not in self.question.keep)
        return tuple(
            self._camera(problem, choice, option, name) for option, name in zip(choice.options, names, strict=False)
        )

    def _camera(self, problem: Placing, choice: Choice, option: int, name: str) -> PlacedCamera:
        view, lens = self.views[self.options[option].view], self.lenses[self.options[option].lens]
        spot, objective = self.spots[view.spot], self.question.demand.objective
        alone = worth_of(replace(problem, kept=frozenset()), Choice((option,), choice.ways))
        without = worth_of(problem, Choice(tuple(o for o in choice.options if o != option), choice.ways))
        return PlacedCamera(
            camera=camera_of(name, spot, view, lens),
            spot=spot,
            lens=lens,
            view=view,
            price=price_of(spot, lens),
            alone=alone.of(objective),
            loss=max(0.0, worth_of(problem, choice).of(objective) - without.of(objective)),
        )

    def cell_with(self, cameras: Sequence[Camera]) -> Cell:
        """The cell with the cameras that stay, and these."""
        cell = self.question.cell
        stay = [cell.workspace.cameras[name] for name in self.question.keep]
        together = {camera.name: camera for camera in (*stay, *cameras)}
        workspace = replace(cell.workspace, cameras=together)
        return replace(cell, workspace=workspace, observer=Observer(tuple(together.values()), cell.observer.solids))

    def studies(self, choice: Choice) -> list[Study]:
        """The exact studies of the chosen ways with the chosen cameras."""
        cameras = []
        for option in choice.options:
            view, lens = self.views[self.options[option].view], self.lenses[self.options[option].lens]
            cameras.append(camera_of(f"placed {option}", self.spots[view.spot], view, lens))
        return self._studies_with(cameras, choice)

    def _studies_with(self, cameras: Sequence[Camera], choice: Choice) -> list[Study]:
        cell = self.cell_with(cameras)
        scenes = [self.ways[number].scene for number in choice.ways]
        return [observed(cell, scene, self.question.sampling, full=False) for scene in scenes]

    def _refined(
        self, problem: Placing, choice: Choice, cameras: tuple[PlacedCamera, ...], studies: list[Study]
    ) -> tuple[tuple[PlacedCamera, ...], list[Study]]:
        """The cameras moved and turned between their places, with the exact studies, if they are better then."""
        ways = [self.ways[number] for number in choice.ways]
        stay = [self.sees[number][sorted(problem.kept)].sum(axis=0) for number in choice.ways]
        seats = [Seat(placed.spot, placed.view, placed.lens) for placed in cameras]
        with self._progress("Refining", 1):
            found = refined(seats, ways, stay, lambda some: self._seen_from(some, ways), self._free(ways))
        if any(self._hides(one, other, ways) for one in found for other in found if one is not other):
            return cameras, studies
        moved = tuple(
            replace(
                placed,
                camera=camera_of(placed.camera.name, seat.spot, seat.view, seat.lens),
                view=seat.view,
                moved=float(np.linalg.norm(seat.spot.position - placed.spot.position)),
            )
            for placed, seat in zip(cameras, found, strict=True)
        )
        better = self._studies_with([placed.camera for placed in moved], choice)
        return (moved, better) if _least(better) > _least(studies) + CLOSE else (cameras, studies)

    def _seen_from(self, seats: Sequence[Seat], ways: Sequence[JudgedWay]) -> list[Mask]:
        """What seats see of each way, shape (seats, items) each."""
        spots = [replace(seat.spot, lenses=(seat.lens,)) for seat in seats]
        views = [replace(seat.view, spot=number) for number, seat in enumerate(seats)]
        return [seen_by(self.question.cell, way, spots, views, (seats[0].lens,))[0] for way in ways]

    def _free(self, ways: Sequence[JudgedWay]) -> Callable[[Sequence[Seat], Sequence[Seat]], Mask]:
        def free(tried: Sequence[Seat], rest: Sequence[Seat]) -> Mask:
            """Whether nothing touches a camera there, and it touches no other one."""
            spots = [seat.spot for seat in tried]
            good = np.ones(len(spots), dtype=bool)
            for way in ways if spots else ():
                good &= ~blocked(self.question.cell, way, spots)
            for number, spot in enumerate(spots):
                good[number] &= not any(True for seat in rest for _ in pairs_apart([spot, seat.spot]))
            return good

        return free

    def _hides(self, one: Seat, other: Seat, ways: Sequence[JudgedWay]) -> bool:
        """Whether a camera hides something that another one sees."""
        seen = self._seen_from([other], ways)
        return any(
            bool((hidden_by(way, one.spot, other.spot) & of_way[0]).any())
            for way, of_way in zip(ways, seen, strict=True)
        )

    def _sharpen(self, problem: Placing, choice: Choice, spare: int) -> bool:
        """Add samples where the chosen cameras lose or gain sight between those of a way; whether any were added.

        Then the figures at the samples are the exact ones. Where cameras may fail, states are not what the studies see.
        """
        if spare:
            return False
        worth, added = worth_of(problem, choice), False
        for number, study, pair in zip(choice.ways, self.studies(choice), worth.qualities, strict=True):
            found = study.assessment("")
            known = zip(pair, (found.q_eoi, found.q_avg), strict=True)
            if any(rough is not None and exact is not None and abs(exact - rough) > CLOSE for rough, exact in known):
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
        usable = ~np.isin(problem.spot, np.flatnonzero(np.all(self._shut, axis=0)))
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

    def _fewer(self, choice: Choice) -> FewerCameras | None:
        """What one camera less could do."""
        cameras = len(choice.options) - 1
        if cameras < 1:
            return None
        demand = replace(self.question.demand, wish=None, most=cameras)
        proven = list(self.ways), list(self.sees)
        problem, found = self._sharpened(demand, first_only=True)
        self.ways, self.sees = proven  # the samples that the proof of the choice is about
        best = 0.0 if found.choice is None else worth_of(problem, found.choice).of(demand.objective)
        return FewerCameras(cameras=cameras, objective=best, bound=max(best, found.bound))

    def _without_spare(self) -> WithoutSpare | None:
        """What would do if no camera could fail; None where that is not asked."""
        demand = self.question.demand
        if not demand.survive:
            return None
        proven = list(self.ways), list(self.sees)
        problem, found = self._sharpened(replace(demand, survive=0))
        self.ways, self.sees = proven
        if found.choice is None:
            return None
        worth = worth_of(problem, found.choice)
        return WithoutSpare(cameras=len(found.choice.options), price=worth.price, objective=worth.of(demand.objective))

    def _seen_alone(self, problem: Placing) -> Array:
        """See `Placement.seen`."""
        found = np.zeros(len(self.question.mounts.spots))
        mean = np.maximum(qualities_alone(replace(problem, kept=frozenset())), 0.0)
        np.maximum.at(found, problem.spot[: len(problem.spot) - len(self.kept)], mean[: len(mean) - len(self.kept)])
        return found

    def _judged(self, cell: Cell, problem: Placing, choice: Choice, number: int, found: Study) -> JudgedCandidate:
        """A candidate with its exact figures: in the way that `rank` and `score` take in the new cell, if as good."""
        question, way = self.question, self.ways[number]
        if not (question.fastest or question.demand.survive):
            ranked = find_way(cell, way.candidate, question.world, question.sampling, WantedWay())
            if not isinstance(ranked, Infeasible) and self._is_as_good(problem, choice, ranked.study, found):
                found = ranked.study
        figures = replace(found.assessment(""), candidate=way.candidate, best_way=found.candidate)
        return JudgedCandidate(task=way.task, candidate=way.candidate, scene=found, found=figures)

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
        return Placement(
            question=self.question,
            infeasible=tuple(self.infeasible),
            ways=0,
            samples=0,
            options=0,
            seen=np.zeros(count),
            shut=np.zeros(count, dtype=bool),
            cell=self.cell_with(()),
            met=False,
        )

    def _placement(self, problem: Placing, chosen: Chosen) -> Placement:
        count = len(self.question.mounts.spots)
        found = Placement(
            question=self.question,
            infeasible=tuple(self.infeasible),
            ways=len(self.ways),
            samples=sum(len(way.samples) for way in self.ways),
            options=len(self.options) - len(self.kept),
            seen=self._seen_alone(problem),
            shut=np.all([*self._shut, np.ones(count, dtype=bool)], axis=0) & bool(self._shut),
            cell=self.cell_with(()),
            interrupted=chosen.interrupted,
            proven=chosen.proven,
            bound=chosen.bound,
            fewest=chosen.fewest,
            met=not self._too_slow,
        )
        if chosen.choice is None:
            return replace(found, met=False)
        worth = worth_of(problem, chosen.choice)
        cameras, studies = self.cameras(problem, chosen.choice), self.studies(chosen.choice)
        if worth.least < 1.0 - ROUNDED and not chosen.interrupted and not self.question.demand.survive:
            cameras, studies = self._refined(problem, chosen.choice, cameras, studies)
        cell = self.cell_with([placed.camera for placed in cameras])
        return replace(
            found,
            cameras=cameras,
            cell=cell,
            candidates=tuple(
                self._judged(cell, problem, chosen.choice, number, found)
                for number, found in zip(chosen.choice.ways, studies, strict=True)
            ),
            worth=worth,
            bound=max(chosen.bound, worth.of(self.question.demand.objective)),
            fewer=None if chosen.interrupted else self._fewer(chosen.choice),
            without_spare=None if chosen.interrupted else self._without_spare(),
        )


def _least(studies: Sequence[Study]) -> float:
    """The least of all Q_eoi and Q_avg of some studies."""
    figures = [study.assessment("") for study in studies]
    return min((q for one in figures for q in (one.q_eoi, one.q_avg) if q is not None), default=1.0)
