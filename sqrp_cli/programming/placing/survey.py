"""What every option of the mounts sees in every way of the candidates: the ground on which cameras are chosen."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.knowledge.camera.camera import Camera, image_of
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.workspace.mounts import LensChoice, MountEntry, Spot
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study, observed
from sqrp_cli.programming.coverage.fault_sights import least_fault_delays
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.placing.cover import Cover
from sqrp_cli.programming.placing.placement import PlaceQuestion, UnseenTarget
from sqrp_cli.programming.placing.problem import Choice, Hiding, Placing, unusable
from sqrp_cli.programming.placing.refine import CameraSeat
from sqrp_cli.programming.placing.scenes import (
    JudgedWay,
    Option,
    View,
    blocked,
    hidden_by,
    judged,
    middle_of,
    of_first_grip,
    options_of,
    pairs_apart,
    price_of,
    varied,
    views_of,
)
from sqrp_cli.programming.placing.tensor import LocalVerdicts, joined_items, seen_by, view_batches
from sqrp_cli.programming.ways.find import TimeLimit, planned_ways

MOST_ADDED = 24
"""Most samples that a round adds to a way."""

_TOGETHER = 200
"""Options whose delays are looked at together, to bound the memory."""

Progress = Callable[[str, int], AbstractContextManager[Callable[[int], None]]]
"""A title and the number of parts; yields what counts the finished ones."""


class Survey:
    """The ways of all candidates, the options of all mounts, and what each option sees of each way at its samples."""

    def __init__(self, question: PlaceQuestion, progress: Progress) -> None:
        """Nothing is planned or seen yet. progress: shows how far it is."""
        self.question, self._progress = question, progress
        self.spots, self.lenses = list(question.mounts.spots), list(question.mounts.lenses)
        self.views, self.options, self.kept = list[View](), list[Option](), list[int]()
        self.ways: list[JudgedWay] = []
        self.candidates: list[tuple[int, ...]] = []
        """Of each candidate, which of the ways are its own."""
        self.infeasible: list[tuple[str, Assessment]] = []
        self.others: list[list[JudgedWay]] = []
        """Of each candidate, ways that are looked at only where they may be better."""
        self.plain: list[int] = []
        """Which of the ways of each candidate is the only one without a choice of ways."""
        self.too_slow = False
        """Whether no camera helps, because a candidate takes longer than is wished for."""
        self.sees: list[Mask] = []
        """Of each way, which options see which items, shape (options, items)."""
        self._aimed_at: list[JudgedWay] = []
        """Of each candidate, its plain way: what cameras aim at does not depend on whether ways are chosen, too."""
        self._shut: list[Mask] = []
        """Of each way, at which places a camera would touch something."""
        self._late: list[Array] = []
        """Of each way, how long the longest delay of a fault is at least with each option [s]."""
        self._apart: frozenset[tuple[int, int]] = frozenset(pairs_apart(self.spots))
        self._hiding: frozenset[Hiding] = frozenset()
        """Which cameras of choices that were found hide something that another one sees."""
        self.missing: frozenset[tuple[int, ...]] = frozenset()
        """Sets of options whose exact delays are longer than wished."""

    def plan(self) -> None:
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
                    self.too_slow |= isinstance(scenes, Infeasible)
                if isinstance(scenes, Infeasible):
                    self.infeasible.append((task.text, Assessment.infeasible(candidate, scenes.reasons)))
                    continue
                some = varied(scenes)
                first, *others = all_ways = [judged(question.cell, task.text, candidate, scene) for scene in some]
                self.candidates.append((len(self.ways),))
                self.ways.append(first)
                self.others.append(others)
                self.plain.append(some.index(of_first_grip(scenes)))
                self._aimed_at.append(all_ways[self.plain[-1]])

    def lay_out(self) -> None:
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

    def judge(self, ways: Sequence[JudgedWay]) -> None:
        """Find out what is seen of some ways, and which places are in their way."""
        self.sees += self._verdicts(ways)
        self._shut += [blocked(self.question.cell, way, self.question.mounts.spots) for way in ways]
        self._late += map(self._least_delays, ways)

    def _least_delays(self, way: JudgedWay) -> Array:
        """How long the longest delay of a way is at least with each option, (options,) [s]; 0 if none is wished."""
        wish = self.question.demand.wish
        if wish is None or wish.delay is None:
            return np.zeros(len(self.options))
        cameras = [self.camera_at(option) for option in range(len(self.options))]
        response = min((camera.response for camera in cameras), default=0.0)
        some = [cameras[first : first + _TOGETHER] for first in range(0, len(cameras), _TOGETHER)]
        observer = self.question.cell.observer
        found = [least_fault_delays(way.scene, replace(observer, cameras=tuple(of_some)), response) for of_some in some]
        return np.concatenate([np.empty(0), *found])

    def _verdicts(self, ways: Sequence[JudgedWay]) -> list[Mask]:
        """Which options see which items of some ways."""
        question = self.question
        verdicts = question.verdicts or LocalVerdicts(question.cell)
        parts = [part for way in ways for part in view_batches(way, self.spots, self.views, self.lenses)]
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

    @property
    def sample_count(self) -> int:
        """In how many samples of all ways options were judged."""
        return sum(len(way.samples) for way in self.ways)

    def add_ways(self) -> None:
        """Let other ways be chosen, too."""
        first = len(self.ways)
        for number, others in enumerate(self.others):
            self.candidates[number] += tuple(range(len(self.ways), len(self.ways) + len(others)))
            self.ways += others
        self.others = []
        self.judge(self.ways[first:])

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
            hiding=self._hiding,
            missing=self.missing,
            late=np.array(self._late).reshape(len(self.ways), len(self.options)),
            blocked=frozenset(
                (place, way) for way, shut in enumerate(self._shut) for place in np.flatnonzero(shut).tolist()
            ),
        )

    def never_failing(self, problem: Placing) -> Placing:
        """The same problem if no camera may fail."""
        return self.posed(0) if self.question.demand.survive else problem

    def add_hiding(self, problem: Placing, choice: Choice) -> bool:
        """Keep in mind which of the chosen cameras hide something from another one; whether there are any."""
        found = frozenset(self._found_hiding(problem, choice))
        self._hiding |= found
        return bool(found)

    def _found_hiding(self, problem: Placing, choice: Choice) -> Iterator[Hiding]:
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

    def seat(self, option: int) -> CameraSeat:
        """Where the camera of an option is."""
        view = self.views[self.options[option].view]
        return CameraSeat(self.spots[view.spot], view, self.lenses[self.options[option].lens])

    def camera_at(self, option: int) -> Camera:
        """The camera of an option; one that stays has its name."""
        seat = self.seat(option)
        if option in self.kept:
            return self.question.cell.workspace.cameras[seat.spot.name]
        return seat.camera(f"at {option}")

    def cell_with(self, cameras: Sequence[Camera]) -> Cell:
        """The cell with the cameras that stay, and these."""
        return self._cell_of([*(self.question.cell.workspace.cameras[name] for name in self.question.keep), *cameras])

    def _cell_of(self, cameras: Sequence[Camera]) -> Cell:
        cell, together = self.question.cell, {camera.name: camera for camera in cameras}
        workspace = replace(cell.workspace, cameras=together)
        return replace(cell, workspace=workspace, observer=replace(cell.observer, cameras=tuple(together.values())))

    def studies(self, choice: Choice) -> list[Study]:
        """The exact studies of the chosen ways with the chosen cameras, and those that stay."""
        return self.studies_with([self.camera_at(option) for option in (*choice.options, *self.kept)], choice)

    def studies_with(self, cameras: Sequence[Camera], choice: Choice) -> list[Study]:
        """The exact studies of the chosen ways with these cameras and no others."""
        cell = self._cell_of(cameras)
        scenes = [self.ways[number].scene for number in choice.ways]
        return [observed(cell, scene, self.question.sampling, full=False) for scene in scenes]

    def seen_from(self, seats: Sequence[CameraSeat], ways: Sequence[JudgedWay]) -> list[Mask]:
        """What seats see of each way, shape (seats, items) each."""
        spots = [replace(seat.spot, lenses=(seat.lens,)) for seat in seats]
        views = [replace(seat.view, spot=number) for number, seat in enumerate(seats)]
        return [seen_by(self.question.cell, way, spots, views, (seats[0].lens,))[0] for way in ways]

    def free(self, ways: Sequence[JudgedWay]) -> Callable[[Sequence[CameraSeat], Sequence[CameraSeat]], Mask]:
        """Tells which of some seats may be taken besides others in some ways."""

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

    def hides(self, one: CameraSeat, other: CameraSeat, ways: Sequence[JudgedWay]) -> bool:
        """Whether a camera hides something that another one sees."""
        seen = self.seen_from([other], ways)
        return any(
            bool((hidden_by(way, one.spot, other.spot) & of_way[0]).any())
            for way, of_way in zip(ways, seen, strict=True)
        )

    def add_samples(self, number: int, study: Study) -> bool:
        """Add samples to a way where a study of it gains or loses sight between those it has; whether there are any."""
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

    def unseen(self, problem: Placing) -> Iterator[UnseenTarget]:
        """What no choice covers: of each candidate, the first instant of each literal in the first way."""
        usable = ~np.isin(problem.spot, sorted(unusable(problem)))
        for of_one in self.candidates:
            way, sees = self.ways[of_one[0]], self.sees[of_one[0]][usable]
            spots = problem.spot[usable]
            needed = way.needed + self.question.demand.survive
            few = np.flatnonzero(sees.sum(axis=0) < needed)
            known: set[int] = set()
            for item in few.tolist():
                sample, target = int(way.items.sample[item]), int(way.items.target[item])
                if target not in known:
                    known.add(target)
                    yield UnseenTarget(
                        task=way.task,
                        candidate=way.candidate.name,
                        literal=str(way.scene.targets[target].atom),
                        time=float(way.samples.t[sample]),
                        seen_by=len(set(spots[sees[:, item]].tolist())),
                        needed=int(needed[item]),
                    )
