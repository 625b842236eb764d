"""The least changes that meet a goal, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Protocol

from sqrp_cli.errors import Infeasible
from sqrp_cli.figures import AdvisedFigures
from sqrp_cli.files.entries import from_fields
from sqrp_cli.records import dataclass
from sqrp_cli.search.advice_result import (
    AdviceFound,
    ChangeFound,
    KindOutcome,
    NearestChange,
    TaskEffect,
)
from sqrp_cli.search.camera_moves import SeenMotion, changed_camera, further_camera
from sqrp_cli.search.goal import KINDS, MOTION, Kind
from sqrp_cli.search.motion_search import other_way, seen_path
from sqrp_cli.search.moves import ProposedChange
from sqrp_cli.search.object_moves import moved_object
from sqrp_cli.search.question import Found, Question, TaskWays, Tried, seen_by
from sqrp_cli.study.result import CandidateResult
from sqrp_cli.study.whole_study import WholeAnalysis, whole_study
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
        """The candidate without any change, as with `--ways fastest`; in its best way if that misses the goal alone."""
        question = self.question
        fastest = self._of_candidate(_figures(question.fastest, self._studied(question.fastest)))
        alone = question.goal.met(fastest) and not question.goal.met(question.best)
        return question.best if alone else fastest

    @cached_property
    def way(self) -> Candidate:
        """The way that changes of objects and cameras start from: the best, unless that meets the goal by itself."""
        question = self.question
        return question.fastest if question.fixed or question.goal.met(question.best) else question.best.way

    @cached_property
    def study(self) -> WholeAnalysis | Infeasible:
        """Of that way, with the verdicts of every camera."""
        return self._studied(self.way, full=True)

    @cached_property
    def cameras(self) -> SeenMotion:
        """The motion of that way, for changes of cameras; only where it can be done."""
        assert isinstance(self.study, WholeAnalysis)  # noqa: S101 - otherwise no camera can help
        return SeenMotion(self.question, self.study)

    @cached_property
    def tasks(self) -> list[tuple[TaskWays, list[WholeAnalysis | Infeasible]]]:
        """The tasks that a change of the cell may affect, with their ways as they are now."""
        return [(task, [self._studied(way) for way in task.ways]) for task in self.question.listed()]

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
        question, goal = self.question, self.question.goal
        why = self._why_not(kind)
        found = Found(why=why) if why else _SEARCHES[kind](self)
        if found.met:
            ordered = sorted(found.met, key=lambda one: one.change.size)
            return KindOutcome(kind=kind, found=len(ordered), advice=tuple(map(self._advice, ordered)))
        if not found.near:
            return KindOutcome(kind=kind, why=found.why)
        start = self.before if kind in MOTION else _figures(self.way, self.study)
        near = min(found.near, key=lambda one: goal.shortfall(one.study.assessment))
        reached = near.study.assessment
        nearest = from_fields(
            NearestChange,
            _change_found(near.change, reached),
            missing=goal.missed(reached),
            limit=question.limit(near),
            nearer=goal.is_nearer(reached, start),
        )
        return KindOutcome(kind=kind, why=found.why, nearest=nearest)

    def _why_not(self, kind: Kind) -> str:
        """Why a kind of change cannot help, without any search; empty if it may."""
        question, goal = self.question, self.question.goal
        first = (*question.fastest.steps, question.fastest)[0]
        unready = unready_world(question.cell, first, question.world)  # whatever is changed in the cell
        if unready is not None:
            return unready.reasons[0]
        if kind in MOTION or kind == "object":
            return "not tried: the way is fixed" if question.fixed and kind in MOTION else ""
        before = _figures(self.way, self.study)
        if not before.feasible:
            return f"no camera helps: {before.reasons[0]}"
        if goal.time is not None and before.time is not None and before.time > goal.time:
            return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {goal.time:.4g} s"
        response = min((camera.response for camera in question.cell.observer.cameras), default=0.0)
        if goal.delay is not None and before.faults and goal.delay < response:
            return f"a frame and the latency of the fastest camera take {response:.2f} s, not {goal.delay:.4g} s"
        return ""

    def _advice(self, met: Tried) -> AdviceFound:
        """A change with its effect on all tasks; another motion is nothing for other candidates or tasks.

        Cameras are changed in the same motion, else it is planned again.
        """
        question, change, found = self.question, met.change, self._of_candidate(met.study.assessment)
        effects = []
        if change.kind in MOTION:
            pairs = [(self.before, found) if one is question.best else (one, one) for one in question.assessments]
            effects.append(TaskEffect.of(question.task, pairs))
        else:
            cell, world = change.in_cell(question.cell), change.in_world(question.world)
            for task, studied in self.tasks:
                pairs = []
                for way, before in zip(task.ways, studied, strict=True):
                    after = before
                    if change.camera is None:
                        after = whole_study(question.cell, way, world, question.sampling, full=False)
                    elif isinstance(before, WholeAnalysis):
                        after = seen_by(cell, before, question.sampling)
                    pairs.append((_figures(way, before), _figures(way, after)))
                effects.append(TaskEffect.of(task.text, pairs))
        worse = tuple(one.task for one in effects if any(candidate.worse for candidate in one.candidates))
        said = _change_found(change, found)
        return from_fields(
            AdviceFound, said, margin=met.margin, tasks=tuple(effects), worse=worse, patch="", unwritten=None
        )

    def _studied(self, way: Candidate, *, full: bool = False) -> WholeAnalysis | Infeasible:
        question = self.question
        return whole_study(question.cell, way, question.world, question.sampling, full=full)

    def _of_candidate(self, found: CandidateResult) -> CandidateResult:
        """The figures of a way as those of the candidate."""
        return replace(found, candidate=self.question.best.candidate, best_way=found.candidate)


def _figures(way: Candidate, found: WholeAnalysis | Infeasible) -> CandidateResult:
    """The figures of a way, or why it cannot be done."""
    return found.assessment if isinstance(found, WholeAnalysis) else CandidateResult.infeasible(way, found.reasons)


def _change_found(change: ProposedChange, found: CandidateResult) -> ChangeFound:
    values = change.values if change.parameters is None else dict(change.parameters)
    return from_fields(ChangeFound, AdvisedFigures.of(found), change, change=values, proposed=change, found=found)


_SEARCHES: Mapping[Kind, Callable[[Adviser], Found]] = {
    "way": lambda adviser: other_way(adviser.question),
    "path": lambda adviser: seen_path(adviser.question),
    "object": lambda adviser: moved_object(adviser.question, adviser.way, adviser.study),
    "aim": lambda adviser: changed_camera(adviser.cameras, "aim"),
    "position": lambda adviser: changed_camera(adviser.cameras, "position"),
    "lens": lambda adviser: changed_camera(adviser.cameras, "lens"),
    "camera": lambda adviser: further_camera(adviser.cameras),
}
"""How each kind of change is searched for."""
