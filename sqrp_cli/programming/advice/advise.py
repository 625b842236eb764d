"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Protocol

from sqrp_cli.errors import Infeasible
from sqrp_cli.programming.advice.cameras import Cameras
from sqrp_cli.programming.advice.change import (
    CAMERAS,
    KINDS,
    MOTION,
    Advice,
    CandidateEffect,
    EffectOnTask,
    Kind,
    Miss,
    ProposedChange,
)
from sqrp_cli.programming.advice.effects import assessed
from sqrp_cli.programming.advice.motion_search import MotionSearch, MotionsOfSteps
from sqrp_cli.programming.advice.object_search import moved_objects
from sqrp_cli.programming.advice.question import Found, Question
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.feasibility import unready_world
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.whole_study import WholeStudy, whole_study

Answer = tuple[Advice, ...] | Miss
"""Of a kind: the changes that meet the wish, the least first, or why there is none."""


class Kept(Protocol):
    """Answers of a run before this one."""

    def get(self, kind: Kind) -> Answer | None:
        """The answer of a kind, if it is known."""

    def keep(self, kind: Kind, answer: Answer) -> None:
        """Keep it for runs after this one."""


class Adviser:
    """Answers a question; what all kinds need is computed once."""

    def __init__(self, question: Question) -> None:
        """Nothing is computed yet."""
        self.question = question

    @cached_property
    def before(self) -> Assessment:
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

    def answers(self, kept: Kept | None = None) -> Iterator[Answer]:
        """For each kind in order its answer; one that is kept is not searched for again."""
        suffices = False
        for kind in KINDS if self.question.kinds is None else self.question.kinds:
            if suffices and self.question.kinds is None:
                why = "not tried, because the motion is enough; --kinds names what to try"
                yield Miss(kind=kind, why=why, tried=False)
                continue
            answer = None if kept is None else kept.get(kind)
            if answer is None:
                answer = self._answer(kind)
                if kept is not None:
                    kept.keep(kind, answer)
            suffices |= kind in MOTION and not isinstance(answer, Miss)
            yield answer

    def _answer(self, kind: Kind) -> Answer:
        why_not = self._why_not(kind)
        if why_not:
            return Miss(kind=kind, why=why_not, tried=False)
        found = self._found(kind)
        if not isinstance(found, Miss):
            return self._advice(found)
        start = self.before if kind in MOTION else assessed(self.way, self._study)
        return replace(found, nearer=self.question.wish.is_nearer(found.found, start))

    def _found(self, kind: Kind) -> Sequence[Found] | Miss:
        match kind:
            case "way" | "path":
                several = bool(self.question.fastest.steps)
                motions = MotionsOfSteps(self.question) if several else MotionSearch(self.question)
                found = motions.other_way() if kind == "way" else motions.seen_path()
                return found if isinstance(found, Miss) else [found]
            case "object":
                return moved_objects(self.question, self.way, self._study)
            case "aim":
                return self._cameras.turned()
            case "position":
                return self._cameras.shifted()
            case "lens":
                return self._cameras.with_other_lens()
            case "camera":
                return self._cameras.with_further_one()

    def _why_not(self, kind: Kind) -> str:
        """Why a kind of change cannot help, without any search; empty if it may."""
        if self._unready is not None:
            return self._unready.reasons[0]
        if kind in MOTION:
            return "not tried: the way is fixed" if self.question.fixed else ""
        return self._why_cameras_cannot if kind in CAMERAS else ""

    @cached_property
    def _unready(self) -> Infeasible | None:
        """What the world lacks, whatever is changed in the cell."""
        first = (*self.question.fastest.steps, self.question.fastest)[0]
        return unready_world(self.question.cell, first, self.question.world)

    @cached_property
    def _why_cameras_cannot(self) -> str:
        before, wish = assessed(self.way, self._study), self.question.wish
        if not before.feasible:
            return f"no camera helps: {before.reasons[0]}"
        if wish.time is not None and before.time is not None and before.time > wish.time:
            return f"no camera makes the motion faster: it takes {before.time:.2f} s, not {wish.time:.4g} s"
        response = min((camera.response for camera in self.question.cell.observer.cameras), default=0.0)
        if wish.delay is not None and before.faults and wish.delay < response:
            return f"a frame and the latency of the fastest camera take {response:.2f} s, not {wish.delay:.4g} s"
        return ""

    @cached_property
    def _study(self) -> WholeStudy | Infeasible:
        """What changes of objects and cameras start from."""
        question = self.question
        return whole_study(question.cell, self.way, question.world, question.sampling, full=True)

    @cached_property
    def _cameras(self) -> Cameras:
        assert isinstance(self._study, WholeStudy)  # noqa: S101 - otherwise no camera can help
        return Cameras(self.question, self._study)

    def _advice(self, answers: Sequence[Found]) -> tuple[Advice, ...]:
        """With effects, the least change first."""
        advice = []
        for met, margin in sorted(answers, key=lambda answer: answer.met.change.size):
            found = self._of_candidate(met.found)
            effects = self._effects(met.change, found)
            advice.append(Advice(change=met.change, found=found, margin=margin, effects=effects))
        return tuple(advice)

    def _effects(self, change: ProposedChange, found: Assessment) -> tuple[EffectOnTask, ...]:
        """On all tasks; another motion of the candidate is nothing for others, nor for other tasks."""
        question = self.question
        if change.kind not in MOTION:
            return question.effects.of(change)
        pairs = ((self.before, found) if one is question.best else (one, one) for one in question.assessments)
        candidates = tuple(CandidateEffect(before=before, after=after) for before, after in pairs)
        return (EffectOnTask(task=question.task, candidates=candidates),)

    def _of_candidate(self, found: Assessment) -> Assessment:
        """The figures of a way as those of the candidate."""
        return replace(found, candidate=self.question.best.candidate, best_way=found.candidate)
