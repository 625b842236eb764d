"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol

from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import completed
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import (
    AdviceFound,
    ChangeFound,
    KindOutcome,
    NearestChange,
    TaskEffect,
)
from sqrp_cli.search.camera_search import Cameras
from sqrp_cli.search.goal import KINDS, MOTION, Kind
from sqrp_cli.search.motion_search import other_way, seen_path
from sqrp_cli.search.moves import ProposedChange
from sqrp_cli.search.object_search import moved_objects
from sqrp_cli.search.question import Met, Miss, Question, assessed
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_study import WholeStudy, whole_study
from sqrp_cli.task.feasibility import unready_world
from sqrp_cli.task.task import Candidate


class Kept(Protocol):
    """Outcomes of a run before this one."""

    def get(self, kind: Kind) -> KindOutcome | None:
        """The outcome of a kind, if it is known."""

    def keep(self, outcome: KindOutcome) -> None:
        """Keep it for runs after this one."""


@dataclass(frozen=True, eq=False)
class Adviser:
    """Answers a question; what all kinds need is computed once."""

    question: Question

    @cached_property
    def before(self) -> CandidateResult:
        """The candidate without any change, as with `--ways fastest`; in its best way if that misses the wish alone."""
        question = self.question
        found = whole_study(question.cell, question.fastest, question.world, question.sampling, full=False)
        fastest = self._of_candidate(assessed(question.fastest, found))
        alone = question.wish.met(fastest) and not question.wish.met(question.best)
        return question.best if alone else fastest

    @cached_property
    def way(self) -> Candidate:
        """The way that changes of objects and cameras start from: the best, unless that meets the wish by itself."""
        question = self.question
        return question.fastest if question.fixed or question.wish.met(question.best) else question.best.way

    @cached_property
    def study(self) -> WholeStudy | Infeasible:
        """Of that way."""
        question = self.question
        return whole_study(question.cell, self.way, question.world, question.sampling, full=True)

    @cached_property
    def cameras(self) -> Cameras:
        """Searches for changes of cameras; only where that way can be done."""
        assert isinstance(self.study, WholeStudy)  # noqa: S101 - otherwise no camera can help
        return Cameras(self.question, self.study)

    def outcomes(self, kept: Kept | None = None) -> Iterator[KindOutcome]:
        """What comes of each kind, in order; one that is kept is not searched for again."""
        suffices = False
        for kind in KINDS if self.question.kinds is None else self.question.kinds:
            if suffices and self.question.kinds is None:
                yield KindOutcome(kind=kind, why="not tried, because the motion is enough; --kinds names what to try")
                continue
            outcome = None if kept is None else kept.get(kind)
            if outcome is None:
                outcome = self._outcome(kind)
                if kept is not None:
                    kept.keep(outcome)
            suffices |= kind in MOTION and bool(outcome.found)
            yield outcome

    def _outcome(self, kind: Kind) -> KindOutcome:
        question = self.question
        first = (*question.fastest.steps, question.fastest)[0]
        why = ""
        unready = unready_world(question.cell, first, question.world)  # whatever is changed in the cell
        if unready is not None:
            why = unready.reasons[0]
        elif kind in MOTION:
            why = "not tried: the way is fixed" if question.fixed else ""
        elif kind != "object":
            why = self._why_cameras_cannot()
        found: Sequence[Met] | Miss = Miss(why) if why else _SEARCHES[kind](self)
        if not isinstance(found, Miss):
            ordered = sorted(found, key=lambda met: met.change.size)
            return KindOutcome(kind=kind, found=len(found), advice=tuple(map(self._advice, ordered)))
        if not found.near:
            return KindOutcome(kind=kind, why=found.why)
        start = self.before if kind in MOTION else assessed(self.way, self.study)
        near = min(found.near, key=lambda one: question.wish.shortfall(one.study.assessment))
        reached = near.study.assessment
        nearest = completed(
            NearestChange,
            _change_found(near.change, reached),
            missing=question.wish.missed(reached),
            limit=question.limit(near.change.in_cell(question.cell), near.study),
            nearer=question.wish.is_nearer(reached, start),
        )
        return KindOutcome(kind=kind, why=found.why, nearest=nearest)

    def _why_cameras_cannot(self) -> str:
        """Why no camera can help, without any search; empty if one may."""
        before, wish = assessed(self.way, self.study), self.question.wish
        if not before.feasible:
            return f"no camera helps: {before.reasons[0]}"
        if wish.time is not None and before.time is not None and before.time > wish.time:
            return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {wish.time:.4g} s"
        response = min((camera.response for camera in self.question.cell.observer.cameras), default=0.0)
        if wish.delay is not None and before.faults and wish.delay < response:
            return f"a frame and the latency of the fastest camera take {response:.2f} s, not {wish.delay:.4g} s"
        return ""

    def _advice(self, met: Met) -> AdviceFound:
        """A change with its effect on all tasks; another motion is nothing for other candidates or tasks."""
        question, found = self.question, self._of_candidate(met.found)
        if met.change.kind in MOTION:
            pairs = [(self.before, found) if one is question.best else (one, one) for one in question.assessments]
            effects: tuple[TaskEffect, ...] = (TaskEffect.of(question.task, pairs),)
        else:
            effects = question.effects.of(met.change)
        worse = tuple(one.task for one in effects if any(candidate.worse for candidate in one.candidates))
        change = _change_found(met.change, found)
        return completed(AdviceFound, change, margin=met.margin, tasks=effects, worse=worse, patch="", unwritten=None)

    def _of_candidate(self, found: CandidateResult) -> CandidateResult:
        """The figures of a way as those of the candidate."""
        return replace(found, candidate=self.question.best.candidate, best_way=found.candidate)


def _change_found(change: ProposedChange, found: CandidateResult) -> ChangeFound:
    values = change.values if change.parameters is None else dict(change.parameters)
    return completed(ChangeFound, AdvisedFigures.of(found), change, change=values, proposed=change, found=found)


_SEARCHES: Mapping[Kind, Callable[[Adviser], Sequence[Met] | Miss]] = {
    "way": lambda adviser: other_way(adviser.question),
    "path": lambda adviser: seen_path(adviser.question),
    "object": lambda adviser: moved_objects(adviser.question, adviser.way, adviser.study),
    "aim": lambda adviser: adviser.cameras.moved("aim"),
    "position": lambda adviser: adviser.cameras.moved("position"),
    "lens": lambda adviser: adviser.cameras.with_other_lens(),
    "camera": lambda adviser: adviser.cameras.with_further_one(),
}
"""How each kind of change is searched for."""
