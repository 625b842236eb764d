"""The least changes that meet a wish, kind after kind: the motion first, then what it handles, cameras last."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

from sqrp_cli.errors import Infeasible
from sqrp_cli.knowledge.skill.settings import SEEN, MotionValue, Reference
from sqrp_cli.knowledge.skill.skill import JointMove
from sqrp_cli.knowledge.workspace.workspace import World
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
from sqrp_cli.programming.advice.motion_search import MotionSearch, meets, with_way
from sqrp_cli.programming.advice.object_search import moved_objects
from sqrp_cli.programming.advice.question import Found, Met, Near, Question
from sqrp_cli.programming.coverage.assessment import Assessment, Study, study
from sqrp_cli.programming.feasibility import unready_world
from sqrp_cli.programming.program_update import world_after
from sqrp_cli.programming.task import Candidate
from sqrp_cli.programming.ways.find import WantedWay, find_way
from sqrp_cli.programming.ways.words import choice_in_words
from sqrp_cli.programming.whole_study import WholeStudy, whole_study, worst_seen
from sqrp_cli.programming.whole_task import whole_candidate

MOST_TOGETHER = 12
"""Ways of the first steps that are followed further: a third of them the fastest, the others those seen best."""


class _FirstSteps(NamedTuple):
    """The first steps, each in a way."""

    steps: tuple[Study, ...]
    after: World

    @property
    def time(self) -> float:
        """Of these steps [s]."""
        return sum(step.motion.time for step in self.steps)


@dataclass(frozen=True, eq=False)
class MotionsOfSteps:
    """Looks for other motions of a candidate of several steps."""

    question: Question

    def other_way(self) -> Found | Miss:
        """The fastest whole that meets the wish, of the Pareto-optimal ways of each step after those before it."""
        question = self.question
        if not question.best.feasible:
            return Miss(kind="way", why=f"none can be done: {'; '.join(question.best.reasons[:1])}")
        near = []
        for found in sorted(self._wholes(), key=lambda whole: whole.assessment.time or 0.0):
            change = self._way_change(found.candidate)
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        return question.nearest("way", f"none of {len(near)} combinations of the steps' ways meets the wish", near)

    def seen_path(self) -> Found | Miss:
        """Paths that cameras can follow, in as few steps as that takes, those first that are seen worst."""
        question, near = self.question, []
        for candidate in self._with_seen_paths():
            found = self._in_best_ways(candidate)
            if found is None:
                continue
            chosen = {name: value for name, value in candidate.values.items() if value == SEEN}
            parameters = {**question.best.candidate.parameters, **chosen}
            steps = " and ".join(dict.fromkeys(name.partition(".")[0] for name in chosen))
            said = f"with paths that keep sight in step {steps}"
            change = ProposedChange(
                kind="path", target=candidate.name, size=0.0, unit="", parameters=parameters, said=said
            )
            if meets(question, found):
                return Found(Met(change, found.assessment))
            near.append(Near(change, found))
        if not near:
            return Miss(kind="path", why="not tried: the skills or the task say which paths", tried=False)
        return question.nearest("path", "no path that was found meets the wish", near)

    def _wholes(self) -> Iterator[WholeStudy]:
        """Combinations of the steps' ways, each in the world that those before it leave."""
        candidate = self.question.best.candidate
        begun = [_FirstSteps((), self.question.world)]
        for step in candidate.steps:
            begun = _promising([longer for one in begun for longer in self._longer(one, step)])
        for one in begun:
            yield WholeStudy(whole_candidate(candidate.skill, [step.candidate for step in one.steps]), one.steps)

    def _longer(self, begun: _FirstSteps, step: Candidate) -> Iterator[_FirstSteps]:
        """With one more step in each of its Pareto-optimal ways."""
        cell, sampling = self.question.cell, self.question.sampling
        found = find_way(cell, step, begun.after, sampling, WantedWay())
        if isinstance(found, Infeasible):
            return
        others = [with_way(step, figures) for figures in found.ways.pareto[1:]]
        for way in (found.study.candidate, *others):
            done = study(cell, way, begun.after, sampling, full=False)
            if isinstance(done, Study):
                yield _FirstSteps((*begun.steps, done), world_after(way, done.motion, begun.after))

    def _with_seen_paths(self) -> Iterator[Candidate]:
        """The candidate with seen paths in one step, in one more, and so on; the steps that are seen worst first."""
        candidate = self.question.best.candidate
        steps, left = list(candidate.steps), list(range(len(candidate.steps)))
        while left and self.question.best.feasible:
            index = left.pop(worst_seen([self.question.best.steps[number] for number in left]))
            names = _open_paths(steps[index])
            if names:
                values: dict[str, MotionValue] = {**steps[index].values, **dict.fromkeys(names, SEEN)}
                steps[index] = replace(steps[index], values=values)
                yield replace(whole_candidate(candidate.skill, steps), name=candidate.name)

    def _in_best_ways(self, candidate: Candidate) -> WholeStudy | None:
        """Each step in its best way, after those before it; None if one cannot be done."""
        world, done = self.question.world, []
        for step in candidate.steps:
            found = find_way(self.question.cell, step, world, self.question.sampling, WantedWay())
            if isinstance(found, Infeasible):
                return None
            done.append(found.study)
            world = world_after(found.study.candidate, found.study.motion, world)
        return WholeStudy(whole_candidate(candidate.skill, [one.candidate for one in done]), tuple(done))

    def _way_change(self, way: Candidate) -> ProposedChange:
        asked = self.question.best.candidate
        said = choice_in_words(asked, way)
        return ProposedChange(kind="way", target=asked.name, size=0.0, unit="", parameters=way.parameters, said=said)


def _open_paths(step: Candidate) -> list[str]:
    """The parameters of a step that choose the paths of joint moves and leave them direct."""
    moves = [move for move in step.skill.primitives if isinstance(move, JointMove)]
    names = [move.path.parameter for move in moves if isinstance(move.path, Reference)]
    return [] if step.open_paths else names


def _promising(begun: Sequence[_FirstSteps]) -> list[_FirstSteps]:
    """At most `MOST_TOGETHER` of several beginnings, in their order: the best seen ones, and the fastest."""
    if len(begun) <= MOST_TOGETHER:
        return list(begun)
    seen = sorted(range(len(begun)), key=lambda index: -_covered(begun[index]))
    fast = sorted(range(len(begun)), key=lambda index: begun[index].time)
    third = MOST_TOGETHER // 3
    chosen = dict.fromkeys([*fast[:third], *seen[:MOST_TOGETHER]])
    return [begun[index] for index in sorted(list(chosen)[:MOST_TOGETHER])]


def _covered(begun: _FirstSteps) -> float:
    """How well the first steps are seen: their covered time, that of events of interest twice [s]."""
    figures = [step.assessment("") for step in begun.steps]
    return sum((one.q_avg or 0.0) * (one.t_total or 0.0) + (one.q_eoi or 0.0) * (one.t_eoi or 0.0) for one in figures)


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
