"""Advice about a task: what is asked, the answer that shows itself, and the workspace file with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.api.results import Answer
from sqrp_cli.api.session import check_choice, choose_candidate
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.geometry import read_only
from sqrp_cli.knowledge.text.source import SourceDocument
from sqrp_cli.knowledge.text.yaml_edit import patch
from sqrp_cli.knowledge.workspace.edits import (
    stated_look_at,
    with_camera,
    with_further_camera,
    with_object,
)
from sqrp_cli.knowledge.workspace.load import read_workspace_document
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.platform.files import write_atomically
from sqrp_cli.programming.advice.advise import Adviser, Question
from sqrp_cli.programming.advice.aiming import Aim
from sqrp_cli.programming.advice.change import KINDS, Advice, Change, Kind, Miss
from sqrp_cli.programming.advice.effects import Effects, TaskWays
from sqrp_cli.programming.advice.wish import Wish, read_wish, wish_of
from sqrp_cli.programming.coverage.assessment import Assessment
from sqrp_cli.programming.ranking import rank
from sqrp_cli.programming.task import read_task
from sqrp_cli.report.documents.advice import (
    AdviceDocument,
    AdviceFound,
    AdvisedFigures,
    KindOutcome,
    WishedFigures,
    nearest_of,
)
from sqrp_cli.scoring.sweep import from_here

if TYPE_CHECKING:
    from sqrp_cli.api.session import Session
    from sqrp_cli.programming.task import Candidate
    from sqrp_cli.scoring.scorecard import Progress


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TaskAdvice(Answer[AdviceDocument]):
    """The least changes that meet a wish."""

    session: Session
    path: Path
    """Of the workspace, as it was given."""
    wish: Wish
    way: Candidate
    """That changes of objects and cameras start from."""
    before: Assessment
    """Without any change."""
    answers: Sequence[tuple[Advice, ...] | Miss]
    """Of each kind that was searched."""
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
        near = [miss for miss in self.misses if miss.found is not None]
        nearest = min(near, key=lambda miss: self.wish.shortfall(_known(miss.found)), default=None)
        return AdviceDocument(
            workspace=self.session.workspace.name,
            task=self.session.task.text,
            want=WishedFigures.of(self.wish),
            candidate=self.before.candidate.name,
            way=self.way.parameters,
            met=self.met,
            before=AdvisedFigures.of(self.before),
            advice=tuple(found),
            kinds=tuple(self._outcome(answer) for answer in self.answers),
            nearest=None if found or nearest is None else nearest_of(nearest, self.wish),
            interrupted=self.interrupted or None,
        )

    def patched(self, number: int) -> bytes:
        """The workspace file with an advice, from 1. Raises InputError for a number that none has, or without patch."""
        if not 1 <= number <= len(self.advice):
            count = len(self.advice)
            expected = f"expected 1 to {count}" if count else "there is none"
            raise InputError(Problem("bad-option", f"there is no advice {number}; {expected}"))
        return changed_file(self._file, self.session.workspace, self.advice[number - 1].change)

    def apply(self, number: int = 1) -> None:
        """Write an advice into the workspace file, by its number from 1; comments stay.

        Raises InputError where it cannot be written, and where the file has changed meanwhile.
        """
        content = self.patched(number)
        if read_workspace_document(self._file.path).content != self._file.content:
            message = "the workspace has changed meanwhile"
            raise InputError(Problem("changed-meanwhile", message, mend="run the same command again"))
        write_atomically(self._file.path, content)

    def show(self) -> None:
        """Print what `sqrp advise` prints."""
        from sqrp_cli.terminal.advice_table import print_advice

        print_advice(self.document, self.wish)

    @cached_property
    def _file(self) -> SourceDocument:
        return read_workspace_document(self.session.workspace.whole_file.file)

    def _patch(self, change: Change) -> tuple[str, str | None]:
        try:
            content = changed_file(self._file, self.session.workspace, change)
        except InputError as error:
            return "", error.problems[0].message
        return patch(self._file, content, from_here(self._file.path)), None

    def _outcome(self, answer: tuple[Advice, ...] | Miss) -> KindOutcome:
        if isinstance(answer, Miss):
            return KindOutcome.of_miss(answer, self.wish)
        return KindOutcome(kind=answer[0].change.kind, found=len(answer), why=None, nearest=None)


def _known(found: Assessment | None) -> Assessment:
    assert found is not None  # noqa: S101 - it was asked for
    return found


def changed_file(document: SourceDocument, workspace: Workspace, change: Change) -> bytes:
    """A workspace file with a change. Raises InputError for one that the file does not state."""
    if change.X_WO is not None:
        return with_object(document, change.target, change.X_WO)
    if change.camera is None or change.aim is None:
        raise InputError(Problem("bad-option", "a way is no part of the workspace: name it in the task"))
    present = workspace.cameras.get(change.camera.name)
    if present is not None:
        return with_camera(document, present, change.camera, change.aim.point)
    return with_further_camera(document, change.camera, next(iter(workspace.cameras)), change.aim.point)


def find_advice(
    session: Session,
    path: Path,
    *,
    want: str | None,
    choose: str,
    kinds: Sequence[Kind] = KINDS,
    fixed: bool,
    jobs: int,
    progress: Progress,
) -> TaskAdvice:
    """The least changes that meet a wish; at Ctrl-C what was found so far.

    fixed: whether the motion stays as it is. Raises InputError for a wish or a choice that cannot be read.
    """
    from sqrp_cli.api.session import assess

    check_choice(session.task, choose)
    workspace = session.workspace
    expected = next((task for task in workspace.tasks if task.task == session.task.text), None)
    wish = wish_of(expected) if want is None else read_wish(want)
    ranking = rank(list(assess(session, jobs, progress)), "q_eoi")
    chosen = choose_candidate(ranking, choose).assessment
    assignment = session.assignment
    tasks = {task.task: read_task(task.task, workspace).candidates for task in workspace.tasks}
    if session.task.text not in tasks:
        tasks[session.task.text] = (chosen.candidate,)
    question = Question(
        cell=session.cell,
        world=assignment.world,
        sampling=assignment.sampling,
        way=chosen.candidate,
        wish=wish,
        aims=_aims(workspace),
        effects=Effects(
            session.cell,
            assignment.world,
            assignment.sampling,
            tuple(TaskWays(text, candidates) for text, candidates in tasks.items()),
        ),
        kinds=kinds,
        fixed=fixed,
        jobs=jobs,
    )
    adviser = Adviser(question)
    found = TaskAdvice(
        session=session, path=path, wish=wish, way=question.way, before=adviser.before, answers=(), interrupted=False
    )
    if found.met:
        return found
    answers: list[tuple[Advice, ...] | Miss] = []
    try:
        with progress(f"Searching for {wish}", len(kinds)) as advance:
            for answer in adviser.answers():
                answers.append(answer)
                advance(1)
    except KeyboardInterrupt:
        return replace(found, answers=answers, interrupted=True)
    return replace(found, answers=answers)


def _aims(workspace: Workspace) -> dict[str, Aim]:
    """What cameras look at, where the workspace says so."""
    stated = {name: stated_look_at(workspace, name) for name in workspace.cameras}
    return {
        name: Aim(read_only(look_at[0]), read_only(look_at[1]), stated=True)
        for name, look_at in stated.items()
        if look_at is not None
    }
