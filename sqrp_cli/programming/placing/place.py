"""The cameras that answer a question: searched for in a survey of mounts and ways, and scored as they were chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count
from typing import TypeVar

import numpy as np

from sqrp_cli.errors import Infeasible
from sqrp_cli.geometry import Array, Mask
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Assessment, Study
from sqrp_cli.programming.placing.choose import ChoiceSearch, Chosen
from sqrp_cli.programming.placing.gain import qualities_alone
from sqrp_cli.programming.placing.placement import (
    ROUNDED,
    JudgedCandidate,
    PlacedCamera,
    Placement,
    PlaceQuestion,
    SpareCost,
    WithFewer,
)
from sqrp_cli.programming.placing.problem import Choice, Demand, Placing, obstacle, unusable, worth_of
from sqrp_cli.programming.placing.refine import CameraSeat, refined
from sqrp_cli.programming.placing.scenes import blocked, price_of
from sqrp_cli.programming.placing.survey import Progress, Survey
from sqrp_cli.programming.ways.find import WantedWay, find_way, with_branch

ROUNDS = 8
"""Most rounds in which samples are added at which the chosen cameras lose sight, between those that were judged."""

CLOSE = 1e-3
"""Figures at the samples that differ from the exact ones by more are sharpened, as a fraction."""

MOST_MISSING = 5
"""Most choices that are given up because their exact delays are longer than wished."""

Told = Callable[[str, float | None, float], None]
"""Told what a search seeks, the best value so far if there is one, and the bound."""

Found = TypeVar("Found")


class Placer:
    """Answers a question by searches in a survey, which grows where it is too coarse for what was found."""

    def __init__(self, question: PlaceQuestion, progress: Progress, watch: Told | None = None) -> None:
        """progress: shows how far it is. watch: told what is sought, the best value so far and the bound."""
        self.question, self._progress, self._watch = question, progress, watch or (lambda _title, _best, _bound: None)
        self.survey = Survey(question, progress)
        self._stopped = False
        """Whether Ctrl-C came."""
        self._blind = False
        """Whether no choice of cameras gives any candidate a quality above 0."""

    def place(self) -> Placement:
        """The best cameras for the tasks, with the fastest way of each candidate where no other can do better."""
        self.survey.plan()
        if not self.survey.ways:
            return self._nothing()
        self.survey.lay_out()
        self.survey.judge(self.survey.ways)
        demand = self.question.demand
        if self._is_ruled_out(demand.wish):
            return self._closest(demand)
        problem, chosen = self._reaching(demand)
        if self.survey.others and not chosen.interrupted and self._may_be_better(problem, chosen):
            self.survey.add_ways()
            self._sharpen_plain(demand)
            self.survey.missing = frozenset()
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
            self.survey.missing |= {chosen.choice.options}
            problem, chosen = self._wanted(demand)
        else:
            return first
        if chosen.choice is None and first[1].choice is not None:
            return first
        # Those left out miss it in the ways that were chosen with them, perhaps not in others.
        return problem, replace(chosen, proven=chosen.proven and not self.survey.missing)

    def _misses(self, choice: Choice, demand: Demand) -> bool:
        """Whether a fault may be noticed later than wished with a choice, by the exact delays."""
        if demand.wish is None or demand.wish.delay is None:
            return False
        return _is_late([study.assessment("") for study in self.survey.studies(choice)], demand.wish)

    def _nearest(self, demand: Demand) -> Placement:
        """The answer where the wish cannot be met: as many cameras more as it takes, or what comes nearest."""
        if demand.most is not None:
            problem, enough = self._wanted(replace(demand, most=None))
            if enough.choice is not None:
                return replace(self._placement(problem, enough), met=False)
        return self._closest(demand)

    def _is_ruled_out(self, wish: Wish | None) -> bool:
        """Whether a wished delay is shorter than the period and latency of every camera."""
        responses = [self.survey.camera_at(option).response for option in range(len(self.survey.options))]
        wished = None if wish is None or not any(way.scene.faults for way in self.survey.ways) else wish.delay
        return wished is not None and wished < min(responses, default=0.0) - 1e-9

    def _closest(self, demand: Demand) -> Placement:
        """What comes nearest to a wish that no choice meets."""
        demand = replace(demand, wish=None)
        problem, nearest = self._at_least_some(*self._sharpened(demand), demand)
        found = self._placement(problem, nearest)
        return replace(found, met=False, late=False, unseen=tuple(self.survey.unseen(problem)))

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
        fewer, samples = len(chosen.choice.options) - 1, self.survey.sample_count
        if fewer >= problem.at_least(demand):
            self._sharpened(replace(demand, wish=None, most=fewer), first_only=True)
        if samples == self.survey.sample_count:
            return problem, chosen
        return self._sharpened(demand, start=chosen.choice)

    def _may_be_better(self, problem: Placing, chosen: Chosen) -> bool:
        """Whether other ways may be better than the fastest ones, in quality, delay, or the number of cameras."""
        if chosen.choice is None:
            return True
        worth = worth_of(problem, chosen.choice)
        imperfect = worth.least < 1.0 - ROUNDED or worth.delay > problem.cover.quickest + CLOSE
        return imperfect or len(chosen.choice.options) > problem.at_least(self.question.demand)

    def _sharpen_plain(self, demand: Demand) -> None:
        """Add samples where cameras that are best without a choice of ways lose sight: with it, none are worse."""
        every = self.survey.candidates
        self.survey.candidates = [(of_one[plain],) for of_one, plain in zip(every, self.survey.plain, strict=True)]
        if any(of_one != (all_ways[0],) for of_one, all_ways in zip(self.survey.candidates, every, strict=True)):
            self._sharpened(demand)
        self.survey.candidates = every

    def _sharpened(
        self, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> tuple[Placing, Chosen]:
        """The best choice at samples at which its own figures are exact; first_only: only the first aim counts."""
        for number in range(ROUNDS):
            problem = self.survey.posed(demand.survive)
            chosen = self._search(problem, demand, first_only=first_only, start=start)
            if chosen.choice is None or chosen.interrupted or number == ROUNDS - 1:
                break
            if self.survey.add_hiding(problem, chosen.choice):
                start = None
            elif not self._sharpen(problem, chosen.choice, demand.survive):
                break
        return problem, chosen

    def _search(
        self, problem: Placing, demand: Demand, *, first_only: bool = False, start: Choice | None = None
    ) -> Chosen:
        count = "as few cameras as possible" if demand.most is None else f"{demand.most} of the cameras"
        with self._progress(f"Choosing {count}", 1):
            search = ChoiceSearch(problem, demand, self._watch, start)
            chosen = search.first() if first_only else search.best()
        self._stopped |= chosen.interrupted
        return chosen

    def cameras(self, problem: Placing, choice: Choice) -> tuple[PlacedCamera, ...]:
        """The chosen cameras, with names that no camera that stays has."""
        names = (name for number in count(1) if (name := f"cam{number}") not in self.question.keep)
        plain = self.survey.never_failing(problem)
        return tuple(
            self._camera(plain, choice, option, name) for option, name in zip(choice.options, names, strict=False)
        )

    def _camera(self, plain: Placing, choice: Choice, option: int, name: str) -> PlacedCamera:
        """A chosen camera; plain: the problem if no camera may fail."""
        seat, objective = self.survey.seat(option), self.question.demand.objective
        alone = worth_of(replace(plain, kept=frozenset()), Choice((option,), choice.ways))
        without = worth_of(plain, Choice(tuple(o for o in choice.options if o != option), choice.ways))
        return PlacedCamera(
            camera=seat.camera(name),
            **vars(seat),
            price=price_of(seat.spot, seat.lens),
            alone=alone.of(objective),
            loss=max(0.0, worth_of(plain, choice).of(objective) - without.of(objective)),
        )

    def _refined(
        self, problem: Placing, choice: Choice, cameras: tuple[PlacedCamera, ...], studies: list[Study]
    ) -> tuple[tuple[PlacedCamera, ...], list[Study]]:
        """The cameras moved and turned between their places, with the exact studies, if they are better then."""
        ways = [self.survey.ways[number] for number in choice.ways]
        stay = [self.survey.sees[number][sorted(problem.kept)].sum(axis=0) for number in choice.ways]
        seats = [CameraSeat(placed.spot, placed.view, placed.lens) for placed in cameras]
        with self._progress("Refining", 1):
            found = refined(seats, ways, stay, lambda some: self.survey.seen_from(some, ways), self.survey.free(ways))
        if any(self.survey.hides(one, other, ways) for one in found for other in found if one is not other):
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
        stay_there = [self.survey.camera_at(option) for option in self.survey.kept]
        better = self.survey.studies_with([*stay_there, *(placed.camera for placed in moved)], choice)
        return (moved, better) if _least(better) > _least(studies) + CLOSE else (cameras, studies)

    def _sharpen(self, problem: Placing, choice: Choice, spare: int) -> bool:
        """Add samples where the chosen cameras lose or gain sight between those of a way; whether any were added.

        Then the figures at the samples are the exact ones; where any one camera may fail, those without each of them.
        """
        together = (*choice.options, *self.survey.kept)
        plain = replace(self.survey.never_failing(problem), kept=frozenset())
        added = False
        for some in [together] if not spare else [tuple(o for o in together if o != lost) for lost in together]:
            worth = worth_of(plain, Choice(some, choice.ways))
            studies = self.survey.studies_with([self.survey.camera_at(option) for option in some], choice)
            for number, study, pair in zip(choice.ways, studies, worth.qualities, strict=True):
                found = study.assessment("")
                known = zip(pair, (found.q_eoi, found.q_avg), strict=True)
                if any(a is not None and b is not None and abs(a - b) > CLOSE for a, b in known):
                    added |= self.survey.add_samples(number, study)
        return added

    def _aside(self, demand: Demand, *, first_only: bool = False) -> tuple[Placing, Chosen]:
        """The best choice for another demand; the samples that the proof of the choice is about stay as they are."""
        proven = list(self.survey.ways), list(self.survey.sees)
        found = self._sharpened(demand, first_only=first_only)
        self.survey.ways, self.survey.sees = proven
        return found

    def _fewer(self, problem: Placing, choice: Choice) -> WithFewer | None:
        """What one camera less could do."""
        cameras = len(choice.options) - 1
        if cameras < max(1, problem.at_least(self.question.demand)):
            return None
        demand = replace(self.question.demand, wish=None, most=cameras)
        sharper, found = self._aside(demand, first_only=True)
        best = 0.0 if found.choice is None else worth_of(sharper, found.choice).of(demand.objective)
        return WithFewer(cameras=cameras, objective=best, bound=max(best, found.bound))

    def _without_spare(self) -> SpareCost | None:
        """What would do if no camera could fail; None where that is not asked."""
        demand = self.question.demand
        if not demand.survive:
            return None
        problem, found = self._aside(replace(demand, survive=0))
        if found.choice is None:
            return None
        worth = worth_of(problem, found.choice)
        return SpareCost(cameras=len(found.choice.options), price=worth.price, objective=worth.of(demand.objective))

    def _seen_alone(self, problem: Placing) -> Array:
        """See `Placement.seen`."""
        found = np.zeros(len(self.question.mounts.spots))
        mean = qualities_alone(self.survey.never_failing(problem))
        chosen_from = slice(len(problem.spot) - len(problem.kept))
        np.maximum.at(found, problem.spot[chosen_from], mean[chosen_from])
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
        choice = Choice((), tuple(of_one[0] for of_one in self.survey.candidates))
        pairs = zip((self.survey.ways[number] for number in choice.ways), self.survey.studies(choice), strict=True)
        return tuple(
            JudgedCandidate(task=way.task, candidate=way.candidate, scene=found, found=found.assessment(""))
            for way, found in pairs
        )

    def _judged(self, cell: Cell, problem: Placing, choice: Choice, number: int, found: Study) -> JudgedCandidate:
        """A candidate with its exact figures: in the way that `rank` and `score` take in the new cell, if as good."""
        question, way, ranked = self.question, self.survey.ways[number], None
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
        later = (new.latest or 0.0) > (old.latest or 0.0) + CLOSE
        places = [self.survey.spots[problem.spot[option]] for option in choice.options]
        way = replace(self.survey.ways[choice.ways[0]], scene=other)
        return not (worse or later or (places and blocked(self.question.cell, way, places).any()))

    def _nothing(self) -> Placement:
        """The answer where no candidate can be done."""
        count = len(self.question.mounts.spots)
        why = "no candidate can be done" + (" in that time" if self.survey.too_slow else "")
        return replace(self._empty(np.zeros(count), np.zeros(count, dtype=bool)), met=False, why=why)

    def _empty(self, seen: Array, shut: Mask) -> Placement:
        """The answer without cameras. seen, shut: see `Placement`."""
        return Placement(
            question=self.question,
            infeasible=tuple(self.survey.infeasible),
            ways=len(self.survey.ways),
            samples=self.survey.sample_count,
            options=len(self.survey.options) - len(self.survey.kept),
            seen=seen,
            shut=shut,
            cell=self.survey.cell_with(()),
            too_slow=self.survey.too_slow,
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
            met=not self.survey.too_slow,
            quickest=problem.cover.quickest,
            fastest=len(self.survey.ways) == len(self.survey.candidates),
        )

    def _placement(self, problem: Placing, chosen: Chosen) -> Placement:
        found, choice = self._so_far(problem, chosen), chosen.choice
        if choice is None:
            why = "" if chosen.interrupted else obstacle(problem, self.question.demand, blind=self._blind)
            return replace(found, met=False, why=why, candidates=self._without_more())
        worth = worth_of(problem, choice)
        cameras, studies = self.cameras(problem, choice), self.survey.studies(choice)
        if worth.least < 1.0 - ROUNDED and not chosen.interrupted and not self.question.demand.survive:
            cameras, studies = self._unless_stopped(
                lambda: self._refined(problem, choice, cameras, studies), (cameras, studies)
            )
        cell = self.survey.cell_with([placed.camera for placed in cameras])
        candidates = tuple(
            self._judged(cell, problem, choice, number, study)
            for number, study in zip(choice.ways, studies, strict=True)
        )
        late = _is_late([one.found for one in candidates], self.question.demand.wish)
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


def _is_late(exact: Sequence[Assessment], wish: Wish | None) -> bool:
    """Whether a fault is noticed later than wished, by the exact figures: the search has simpler ones, at samples."""
    latest = max((one.latest or 0.0 for one in exact), default=0.0)
    return wish is not None and wish.delay is not None and latest > wish.delay + 1e-9


def _least(studies: Sequence[Study]) -> float:
    """The least of all Q_eoi and Q_avg of some studies."""
    figures = [study.assessment("") for study in studies]
    return min((q for one in figures for q in (one.q_eoi, one.q_avg) if q is not None), default=1.0)
