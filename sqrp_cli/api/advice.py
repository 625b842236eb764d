"""Advice about a task: what is asked, the answer that shows itself, and the workspace file with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.api.results import Answer
from sqrp_cli.api.session import Session, assess, check_choice, choose_candidate
from sqrp_cli.errors import InputError, bad_option
from sqrp_cli.geometry import inverse, read_only
from sqrp_cli.knowledge.camera.camera import assumed_latency
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.knowledge.text.yaml_edit import patch
from sqrp_cli.knowledge.workspace.edits import stated_look_at, with_camera, with_further_camera, with_object, with_task
from sqrp_cli.knowledge.workspace.workspace import ExpectedTask, Workspace
from sqrp_cli.knowledge.workspace.workspace_file import read_again, replace_workspace
from sqrp_cli.programming.advice.advise import Adviser, Kept
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.change import KINDS, Advice, Kind, Miss, ProposedChange
from sqrp_cli.programming.advice.question import Effects, Question, TaskWays, is_fastest
from sqrp_cli.programming.advice.wish import Wish, read_wish, wish_of
from sqrp_cli.programming.candidate import THEN
from sqrp_cli.programming.pipeline import assess_all
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.suggestion import Suggester, with_first_steps
from sqrp_cli.programming.task import Candidate, in_words, read_task
from sqrp_cli.programming.ways.grips import first_grip
from sqrp_cli.report.documents.advice import (
    AdviceDocument,
    AdviceFound,
    AdvisedFigures,
    KindOutcome,
    WishedFigures,
    nearest_of,
)
from sqrp_cli.scoring.work.results import KeptSearches, Results

if TYPE_CHECKING:
    from sqrp_cli.knowledge.skill.settings import MotionValue
    from sqrp_cli.report.pages.search_pages import AdviceShown
    from sqrp_cli.scoring.scorecard import Progress


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TaskAdvice(Answer[AdviceDocument]):
    """The least changes that meet a wish."""

    session: Session
    path: Path
    """Of the workspace, as it was given."""
    content: bytes | None = None
    """The text of the workspace file where it was not read from the disk."""
    wish: Wish
    way: Candidate
    """That changes of objects and cameras start from."""
    before: CandidateResult
    """Without any change, as `--ways fastest` has it; in its best way if that misses the wish alone."""
    best: CandidateResult
    """Without any change, in the way that `rank` and `score` take."""
    answers: Sequence[tuple[Advice, ...] | Miss]
    """Of each kind that was searched."""
    first: str = ""
    """What has to be done before, where the precondition does not hold."""
    interrupted: bool = False
    """Whether some are missing because of Ctrl-C."""

    @property
    def advice(self) -> tuple[Advice, ...]:
        """What meets the wish, in order."""
        return tuple(one for answer in self.answers if not isinstance(answer, Miss) for one in answer)

    @property
    def misses(self) -> tuple[Miss, ...]:
        """The kinds that do not."""
        return tuple(answer for answer in self.answers if isinstance(answer, Miss))

    @property
    def met(self) -> bool:
        """Whether nothing has to change."""
        return self.wish.met(self.before)

    @property
    def found(self) -> bool:
        """Whether anything meets the wish."""
        return self.met or bool(self.advice)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        count = len(self.advice)
        found = "met as it is" if self.met else f"{count} change{'' if count == 1 else 's'} meet{'s' * (count == 1)} it"
        return f"{self.session.named}: {self.wish}, {found}"

    @cached_property
    def document(self) -> AdviceDocument:
        """The document of `sqrp advise`."""
        found = []
        for advice in self.advice:
            text, unwritten = self._patch(advice.change)
            found.append(AdviceFound.of_advice(advice, text, unwritten))
        nearest = min(self.misses, key=lambda miss: self.wish.shortfall(miss.found), default=None)
        return AdviceDocument(
            workspace=self.session.workspace.name,
            task=self.session.task.text,
            want=completed(WishedFigures, self.wish),
            candidate=self.before.candidate.name,
            way=self.way.parameters,
            met=self.met,
            before=AdvisedFigures.of(self.before),
            best=AdvisedFigures.of(self.best) if self.wish.met(self.best) else None,
            advice=tuple(found),
            kinds=tuple(self._outcome(answer) for answer in self.answers),
            nearest=None if found or nearest is None else nearest_of(nearest, self.wish),
            first=self.first or None,
            interrupted=self.interrupted or None,
        )

    @property
    def shown(self) -> AdviceShown:
        """What its page shows."""
        from sqrp_cli.report.pages.search_pages import AdviceShown

        return AdviceShown(
            document=self.document,
            wish=self.wish,
            assignment=self.session.assignment,
            before=self.before,
            advice=self.advice,
        )

    def patched(self, number: int) -> bytes:
        """The workspace file with an advice, from 1. Raises InputError for a number that none has, or without patch."""
        if not 1 <= number <= len(self.advice):
            count = len(self.advice)
            expected = f"expected 1 to {count}" if count else "there is none"
            raise bad_option(f"there is no advice {number}; {expected}")
        return self._changed(self.advice[number - 1].change)

    @property
    def first_with_patch(self) -> int:
        """The number of the first advice that the workspace file can say, from 1; 1 if it can say none."""
        return next((number for number, one in enumerate(self.document.advice, 1) if one.patch), 1)

    def is_there(self, number: int = 1) -> bool:
        """Whether the workspace file says already what an advice says, by its number from 1."""
        return self.patched(number) == self._file.content

    def apply(self, number: int = 1) -> None:
        """Write an advice into the workspace file, by its number from 1; comments stay.

        Nothing is written where the file says it already. Raises InputError where it cannot be written, and where the
        file has changed meanwhile.
        """
        content = self.patched(number)
        if content != self._file.content:
            replace_workspace(self._file, content)

    def show(self, *, written: bool = False) -> None:
        """Print what `sqrp advise` prints; written: whether a change was written to a file."""
        from sqrp_cli.terminal.console import say
        from sqrp_cli.terminal.search_tables import print_advice

        fixed = self.session.assignment.wanted.fastest
        fastest = is_fastest(self.before)
        print_advice(self.document, self.wish, fastest=fastest, fixed=fixed, written=written)
        if assumed := assumed_latency(self.session.workspace.cameras.values()):
            say(f"Delays: {assumed}.")

    @cached_property
    def _file(self) -> SourceDocument:
        workspace = self.session.workspace
        return read_again(workspace.whole_file.file, workspace.files["workspace"].digest, self.content)

    def _patch(self, change: ProposedChange) -> tuple[str, str | None]:
        try:
            content = self._changed(change)
        except InputError as error:
            return "", error.problems[0].message
        if content == self._file.content:
            return "", "the workspace says it already"
        return patch(self._file, content), None

    def _changed(self, change: ProposedChange) -> bytes:
        """The workspace file with a change. Raises InputError for what it does not say itself."""
        if change.unwritten:
            raise bad_option(change.unwritten)
        if change.X_WO is not None and not self._is_as_stated(change.target):
            message = f"the program before has moved `{change.target}`, so its place is no line of the workspace"
            raise bad_option(message, mend="change the program that puts it there")
        if change.parameters is None:
            return changed_file(self._file, self.session.workspace, change)
        task = self._task(change.parameters)
        return with_task(self._file, task, self.wish.thresholds, instead_of=self._listed_alone)

    @property
    def _listed_alone(self) -> str | None:
        """The text of the listed task that has only the candidate; None if each has others as well."""
        workspace, own = self.session.workspace, _key(self.before.candidate)
        listed = ((one.task, read_task(one.task, workspace).candidates) for one in workspace.tasks)
        return next((text for text, candidates in listed if list(map(_key, candidates)) == [own]), None)

    def _is_as_stated(self, name: str) -> bool:
        """Whether an object is where the workspace says that it is, or was moved by the program before."""
        stated, now = self.session.workspace.objects[name].X_WO, self.session.assignment.world.X_WO.get(name)
        return stated is not None and now is not None and np.array_equal(stated, now)

    def _task(self, parameters: Mapping[str, MotionValue]) -> str:
        """The text of a task that says a way, and has this candidate alone."""
        candidate, workspace = self.before.candidate, self.session.workspace
        if not candidate.steps:
            return _text_of(candidate, parameters, workspace)
        own = [
            {name.removeprefix(f"{n}."): value for name, value in parameters.items() if name.startswith(f"{n}.")}
            for n in range(1, len(candidate.steps) + 1)
        ]
        return THEN.join(_text_of(step, said, workspace) for step, said in zip(candidate.steps, own, strict=True))

    def _outcome(self, answer: tuple[Advice, ...] | Miss) -> KindOutcome:
        if isinstance(answer, Miss):
            return completed(KindOutcome, answer, found=0, nearest=nearest_of(answer, self.wish))
        return KindOutcome(kind=answer[0].change.kind, found=len(answer), why=None, nearest=None)


def _text_of(candidate: Candidate, parameters: Mapping[str, MotionValue], workspace: Workspace) -> str:
    """The text of a task of one step that says a way of a candidate, and has that alone."""
    text = candidate.task
    if any(one.binding != candidate.binding for one in read_task(text, workspace).candidates):
        text = " ".join([candidate.skill.name, *(f"{name}={one}" for name, one in candidate.binding.items())])
    unsaid = [one.all_parameters for one in read_task(text, workspace).candidates]
    stated = {name: value for name, value in parameters.items() if any(one.get(name) != value for one in unsaid)}
    said = in_words(candidate.skill, stated)
    return " ".join([text, *(f"{name}={value.replace(' ', '')}" for name, value in said.items())])


def changed_file(document: SourceDocument, workspace: Workspace, change: ProposedChange) -> bytes:
    """A workspace file with a change. Raises InputError for one that the file does not state."""
    if change.X_WO is not None:
        X_FO = workspace.objects[change.target].X_FO
        return with_object(document, change.target, change.X_WO @ inverse(X_FO))
    assert change.camera is not None  # noqa: S101 - else it is about an object
    assert change.aim is not None  # noqa: S101 - it goes with the camera
    present = workspace.cameras.get(change.camera.name)
    if present is not None:
        return with_camera(document, present, change.camera, change.aim.point)
    return with_further_camera(document, change.camera, change.like, change.aim.point)


def find_advice(
    session: Session,
    path: Path,
    *,
    content: bytes | None = None,
    want: str | None,
    choose: str,
    kinds: Sequence[Kind] | None,
    jobs: int,
    progress: Progress,
    out: Path | None = None,
) -> TaskAdvice:
    """The least changes that meet a wish; at Ctrl-C what was found so far.

    content: of the workspace file, where it is not that on the disk. out: folder that keeps the answer of each kind.
    Raises InputError for a wish or a choice that cannot be read, and for a folder that cannot be used.
    """
    with closing(Results(out)) as results:
        check_choice(session.task, choose)
        wish = wish_of(_expected(session)) if want is None else read_wish(want)
        question = _question(session, wish, choose, kinds, jobs, progress)
        adviser, best = Adviser(question), question.best
        found = TaskAdvice(
            session=session,
            path=path,
            content=content,
            wish=wish,
            way=adviser.way,
            before=adviser.before,
            best=best,
            answers=(),
        )
        if found.met:
            return found
        if not best.feasible and not best.candidate.steps:
            suggester = Suggester(session.cell, question.world, jobs=jobs)
            found = replace(found, first=suggester.suggest(best.candidate).words)
        kept = None if results.folder is None else _kept(session, results, wish, best)
        return _answered(found, adviser, kept, progress)


def _answered(found: TaskAdvice, adviser: Adviser, kept: Kept | None, progress: Progress) -> TaskAdvice:
    """With the answers of all kinds, or at Ctrl-C of the finished ones."""
    answers: list[tuple[Advice, ...] | Miss] = []
    kinds = adviser.question.kinds
    try:
        with progress(f"Searching for {found.wish}", len(KINDS if kinds is None else kinds)) as advance:
            for answer in adviser.answers(kept):
                answers.append(answer)
                advance(1)
    except KeyboardInterrupt:
        return replace(found, answers=answers, interrupted=True)
    return replace(found, answers=answers)


def _question(
    session: Session, wish: Wish, choose: str, kinds: Sequence[Kind] | None, jobs: int, progress: Progress
) -> Question:
    """What is asked, once all candidates are assessed."""
    cell, assignment = session.cell, session.assignment
    world, sampling = assignment.world, assignment.sampling
    assessments = list(assess(session, jobs, progress))
    best = choose_candidate(rank(assessments, "q_eoi"), choose)
    return Question(
        task=session.task.text,
        cell=cell,
        world=world,
        sampling=sampling,
        fastest=first_grip(best.candidate),
        best=best,
        assessments=assessments,
        wish=wish,
        aims=_aims(session.workspace),
        effects=Effects(cell, world, sampling, lambda: _listed(session, assessments, best, jobs)),
        kinds=kinds,
        fixed=assignment.wanted.fastest,
        jobs=jobs,
    )


def _expected(session: Session) -> ExpectedTask | None:
    """The task as the workspace lists it, if it does."""
    return next((task for task in session.workspace.tasks if task.task == session.task.text), None)


def _kept(session: Session, results: Results, wish: Wish, best: CandidateResult) -> KeptSearches:
    """The searches that a folder keeps, by all that they depend on."""
    workspace, assignment = session.workspace, session.assignment
    world, sampling = assignment.world, assignment.sampling
    about = (
        workspace.digest,
        session.task.text,
        best.candidate.name,
        vars(wish),
        {"sampling": type(sampling).__name__, **asdict(sampling)},
        session.cell.seed,
        assignment.wanted.fastest,
        dict(world.X_WO),
        dict(world.joints),
        world.held,
        world.X_TO,
        sorted(map(str, world.facts)),
    )
    return KeptSearches(results, about, workspace.skills)


def _listed(
    session: Session, assessments: Sequence[CandidateResult], chosen: CandidateResult, jobs: int
) -> tuple[TaskWays, ...]:
    """Every task of the workspace, and the one that was asked for, with the ways in which candidates are done.

    Tasks that need others first are done with these, as `score` does.

    assessments: of the task that was asked for. chosen: the one that advice is about, which alone counts of a task that
    the workspace does not list.
    """
    workspace, assignment = session.workspace, session.assignment
    facts = assignment.world.facts
    known = {_key(one.candidate): one.way for one in assessments}
    found = []
    for listed in workspace.tasks:
        task = read_task(listed.task, workspace, facts)
        if listed.feasible is not False:
            task = with_first_steps(task, workspace, facts)
        candidates = task.candidates
        if assignment.wanted.fastest:
            ways = tuple(map(first_grip, candidates))
        else:
            missing = [one for one in candidates if _key(one) not in known]
            known |= {_key(one.candidate): one.way for one in assess_all(assignment, missing, jobs)}
            ways = tuple(replace(known[_key(one)], name=one.name) for one in candidates)
        found.append(TaskWays(listed.task, ways))
    if all(task.text != session.task.text for task in found):
        found.append(TaskWays(session.task.text, (chosen.way,)))
    return tuple(found)


def _key(candidate: Candidate) -> str:
    """What tells candidates apart."""
    return repr((candidate.skill.name, sorted(candidate.binding.items()), sorted(candidate.values.items())))


def _aims(workspace: Workspace) -> dict[str, Aim]:
    """What cameras look at, where the workspace says so."""
    stated = {name: stated_look_at(workspace, name) for name in workspace.cameras}
    return {
        name: Aim(read_only(look_at.point), read_only(look_at.up), stated=True)
        for name, look_at in stated.items()
        if look_at is not None
    }
