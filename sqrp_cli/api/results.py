"""Results of questions about a cell: typed documents that show themselves as the terminal's tables."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence, Sized
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Generic, TypeVar

from sqrp_cli.api.arguments import RunOutputs, check_text, check_texts, checked_path
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.report.documents.document import as_text

if TYPE_CHECKING:
    from pathlib import Path

    from sqrp_cli.api.session import Session
    from sqrp_cli.checks.dependency_check import Feasibility
    from sqrp_cli.program.record import Program
    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.coverage.assessment import Assessment
    from sqrp_cli.programming.pipeline import Explained
    from sqrp_cli.programming.ranking import Criterion, Ranked
    from sqrp_cli.programming.suggestion import SuggestedStep
    from sqrp_cli.report.documents.candidates import CandidateFigures, RankDocument
    from sqrp_cli.report.documents.checks import CheckDocument, CheckedCandidate
    from sqrp_cli.report.documents.document import Document
    from sqrp_cli.report.documents.explanation import CandidateStudy, ExplainAllDocument, ExplainDocument
    from sqrp_cli.report.documents.runs import AuditDocument, RunDocument, SweepDocument
    from sqrp_cli.report.documents.scene import InitDocument, ShowDocument
    from sqrp_cli.report.documents.scores import ScoreDocument, TaskResult
    from sqrp_cli.report.pages.run_page import RunCell
    from sqrp_cli.runtime.monitor.frame_audit import AuditReport
    from sqrp_cli.runtime.record.events import Event
    from sqrp_cli.runtime.record.report import RunReport
    from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary
    from sqrp_cli.scoring.scorecard import Scorecard
    from sqrp_cli.starter.make import Starter

AnyDocument = TypeVar("AnyDocument", bound="Document", covariant=True)


class Answer(ABC, Generic[AnyDocument]):
    """A result. `print` and a notebook show it like the command of the same name."""

    @property
    @abstractmethod
    def document(self) -> AnyDocument:
        """The whole result, with the fields of `--json`."""

    @property
    @abstractmethod
    def brief(self) -> str:
        """Its main figures, in a line."""

    @abstractmethod
    def show(self) -> None:
        """Print it to the terminal."""

    def to_json(self) -> str:
        """The document as one line of JSON, as `--json` prints it."""
        return as_text(self.document)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.brief})"

    def __str__(self) -> str:
        from sqrp_cli.terminal.console import as_plain_text

        return as_plain_text(self.show)

    def _repr_html_(self) -> str:
        from sqrp_cli.terminal.console import as_html

        return as_html(self.show)


@dataclass(frozen=True, eq=False, repr=False)
class Ranking(Answer["RankDocument"]):
    """The candidates of a task, best first.

    ranked: the candidates, infeasible ones last. interrupted: whether some are missing because of Ctrl-C. all_ways:
    whether it is shown with all Pareto-optimal ways of each candidate.
    """

    session: Session
    ranked: Sequence[Ranked]
    by: Criterion
    interrupted: bool = False
    all_ways: bool = False

    @property
    def candidates(self) -> tuple[CandidateFigures, ...]:
        """The candidates with their figures, best first, infeasible ones last."""
        return self.document.candidates

    @property
    def best(self) -> CandidateFigures | None:
        """The first candidate, None if none is feasible."""
        return next((one for one in self.candidates if one.feasible), None)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        best = next((one.assessment for one in self.ranked if one.rank is not None), None)
        first = "none feasible" if best is None else f"best {_figures(best)}"
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.session.named}: {_count(self.ranked, 'candidate')}, {first}{cut}"

    @cached_property
    def document(self) -> RankDocument:
        """The document of `sqrp rank`."""
        from sqrp_cli.report.documents.candidates import CandidateFigures, RankDocument, Recalibrated, SamplingDone

        assignment = self.session.assignment
        # In the order of the task: of equal candidates the first one wins a draw.
        order = {id(candidate): place for place, candidate in enumerate(self.session.task.candidates)}
        assessments = sorted((one.assessment for one in self.ranked), key=lambda one: order[id(one.candidate)])
        return RankDocument(
            workspace=self.session.workspace.name,
            task=self.session.task.text,
            by=self.by,
            sampling=SamplingDone.of(assignment.sampling, assessments),
            calibration=Recalibrated.of(assignment, assessments, self.by),
            interrupted=self.interrupted or None,
            candidates=tuple(CandidateFigures.of(one) for one in self.ranked),
        )

    def write(self, path: str | Path, choose: str = "best") -> None:
        """Append a candidate to a program file, which is created if it does not exist.

        choose: the candidate's name, or `best` for the first. Raises InputError where it is infeasible, or does not
        begin where the program ends.
        """
        from sqrp_cli.api.session import ChosenStep, add_steps, check_choice, choose_candidate

        file, session = checked_path(path), self.session
        check_text(choose, "choose", "the name of a candidate, or `best`")
        check_choice(session.task, choose)
        chosen = choose_candidate(self.ranked, choose).assessment
        if not chosen.feasible:
            message = f"{chosen.candidate.name} is infeasible ({chosen.reasons[0]}), so {file} was not written"
            raise InputError(Problem("bad-option", message))
        step = ChosenStep(session.task.text, chosen, session.assignment.world)
        add_steps(session.cell, [step], session.assignment.sampling, file)

    def show(self) -> None:
        """Print the table of `sqrp rank`."""
        from sqrp_cli.terminal.rank_table import print_ranking

        title, assignment = self.session.task.text, self.session.assignment
        print_ranking(title, assignment, self.ranked, self.by, all_ways=self.all_ways)


@dataclass(frozen=True, eq=False, repr=False)
class Explanation(Answer["ExplainDocument | ExplainAllDocument"]):
    """Some candidates over time."""

    session: Session
    task: str
    """Its text."""
    ranking: Sequence[Ranked]
    """Of all candidates."""
    explained: Sequence[Explained]
    """The requested ones."""
    several: bool
    """Whether they are compared, not explained one by one."""

    @property
    def candidates(self) -> list[CandidateStudy]:
        """The candidates with all data from which their figures can be recomputed."""
        from sqrp_cli.report.documents.explanation import ExplainAllDocument

        document = self.document
        return document.candidates if isinstance(document, ExplainAllDocument) else [document]

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        if self.several:
            return f"{self.session.named}: {_count(self.explained, 'candidate')}"
        return f"{self.session.named}: {_figures(self.explained[0].ranked.assessment)}"

    @cached_property
    def document(self) -> ExplainDocument | ExplainAllDocument:
        """The document of `sqrp explain`."""
        from sqrp_cli.report.documents.explanation import CandidateStudy, ExplainAllDocument, ExplainDocument

        cell, sampling, name = self.session.cell, self.session.assignment.sampling, self.session.workspace.name
        studies = [
            CandidateStudy.infeasible(one) if found is None else CandidateStudy.of_study(cell, found, one, sampling)
            for one, found in self.explained
        ]
        if self.several:
            return ExplainAllDocument(workspace=name, task=self.task, candidates=studies)
        return ExplainDocument(workspace=name, task=self.task, **vars(studies[0]))

    def show(self) -> None:
        """Print the timeline of `sqrp explain`, or the comparison of `--all`."""
        from sqrp_cli.terminal.timeline_chart import print_comparison, print_study

        sampling = self.session.assignment.sampling
        if self.several:
            print_comparison(self.explained, sampling)
        else:
            print_study(self.session.cell, *self.explained[0], sampling)


@dataclass(frozen=True, eq=False, repr=False)
class Check(Answer["CheckDocument"]):
    """The findings about a workspace, and which candidates of a task can be done.

    path: of the workspace, as it was given. found: empty without a task. suggested: what has to be done first.
    """

    path: str
    workspace: str
    task: str | None
    problems: tuple[Problem, ...]
    found: tuple[Feasibility, ...] = ()
    suggested: tuple[SuggestedStep, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether nothing is wrong; warnings are not errors."""
        return all(problem.severity != "error" for problem in self.problems)

    @property
    def candidates(self) -> list[CheckedCandidate]:
        """The candidates, in the order of the task."""
        return self.document.candidates

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        about = self.workspace if self.task is None else f"{self.task} in {self.workspace}"
        able = sum(one.feasible for one in self.found)
        found = "" if self.task is None or not self.valid else f"{able} of {_count(self.found, 'candidate')} feasible, "
        return f"{about}: {found}{'valid' if self.valid else 'not valid'}, {_count(self.problems, 'problem')}"

    @cached_property
    def document(self) -> CheckDocument:
        """The document of `sqrp check`."""
        from sqrp_cli.report.documents.checks import CheckDocument

        return CheckDocument.of(self.workspace, self.task, self.found, self.problems)

    def show(self) -> None:
        """Print what `sqrp check` prints on stdout; `problems` are warnings and errors."""
        from sqrp_cli.terminal.check_table import print_candidates, print_valid

        if not self.valid:
            return
        if self.task is None:
            print_valid(self.path, self.workspace, self.problems)
        else:
            print_candidates(self.task, self.workspace, self.found, self.suggested)


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Answer["ShowDocument"]):
    """A workspace as understood."""

    cell: Cell

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        scene = self.cell.workspace
        return f"{scene.name}: {_count(scene.cameras, 'camera')}, {_count(scene.objects, 'object')}"

    @cached_property
    def document(self) -> ShowDocument:
        """The document of `sqrp show`."""
        from sqrp_cli.report.documents.scene import ShowDocument

        return ShowDocument.of(self.cell)

    def show(self) -> None:
        """Print what `sqrp show` prints."""
        from sqrp_cli.terminal.scene_table import print_scene

        print_scene(self.cell)


@dataclass(frozen=True, eq=False, repr=False)
class Scores(Answer["ScoreDocument"]):
    """Every task of some workspaces."""

    findings: Scorecard

    @property
    def passed(self) -> bool:
        """Whether nothing failed and nothing is wrong."""
        return self.findings.passed

    @property
    def results(self) -> list[TaskResult]:
        """A result per task."""
        return self.document.results

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        passed = self.findings.count("passed")
        cut = ", interrupted" if self.findings.interrupted else ""
        return f"{passed} of {_count(self.findings.results, 'task')} passed{cut}"

    @cached_property
    def document(self) -> ScoreDocument:
        """The document of `sqrp score`."""
        from sqrp_cli.report.documents.scores import ScoreDocument

        return ScoreDocument.of(self.findings)

    def show(self) -> None:
        """Print the table of `sqrp score`."""
        from sqrp_cli.terminal.score_table import print_report

        print_report(self.findings)


@dataclass(frozen=True, eq=False, repr=False)
class Difference(Scores):
    """What differs between two versions of a workspace, and the effect on its tasks."""

    def show(self) -> None:
        """Print what `sqrp diff` prints."""
        from sqrp_cli.terminal.score_table import print_difference

        print_difference(self.findings)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedRun(Answer["RunDocument"]):
    """How a run of a program went."""

    cell: RunCell
    report: RunReport
    events: Sequence[Event]
    """What happened, in order."""
    period: float | None
    """Between images of the slowest camera [s]; None if the log does not say."""
    never_happened: tuple[str, ...] = ()
    """Faults that never happened."""
    problems: tuple[Problem, ...] = ()
    """Warnings about data that the log lacks."""
    inputs: Sequence[Path] = ()
    """The files that it was read from, over which no page is written."""
    outputs: RunOutputs = field(default_factory=RunOutputs)
    """What it was kept in; neither."""

    @property
    def done(self) -> bool:
        """Whether the program was completed."""
        return self.report.outcome == "done"

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        report = self.report
        steps, faults = _count(report.steps, "step"), _count(report.faults, "fault")
        return f"{self.cell.name}: {report.outcome} at {report.time:.2f} s, {steps}, {faults}, {report.images} images"

    @cached_property
    def document(self) -> RunDocument:
        """The document of `sqrp run`."""
        from sqrp_cli.report.documents.runs import RunDocument

        return RunDocument.of(self.cell.name, self.report)

    def show(self) -> None:
        """Print what `sqrp run` prints."""
        from sqrp_cli.terminal.run_view import print_run

        print_run(self.cell.name, self.report, self.period)

    def write_page(self, path: str | Path, arguments: Sequence[str] = ()) -> None:
        """Write a page that plays the run; arguments: of the command that it names.

        Raises InputError if it cannot be written, or would replace a file that the run read or wrote.
        """
        from sqrp_cli.report.pages.run_page import write_run

        file = checked_path(path)
        check_texts(arguments, "arguments", "the words of a command, in a list")
        outputs = replace(self.outputs, page=file)
        outputs.check_names()
        outputs.check_not_read(self.inputs)
        write_run(self.cell, self.report, self.events, file, arguments)


@dataclass(frozen=True, eq=False, repr=False)
class SlipSweep(Answer["SweepDocument"]):
    """Runs of a program with a slip at different instants, and how well the delays were predicted."""

    program: Program
    workspace: str
    text: str
    """The swept slip, such as `slip@a4`."""
    step: int
    """Number of the step that was swept, from 1."""
    runs: Sequence[SweepRun]
    summary: SweepSummary

    @property
    def done(self) -> bool:
        """Whether all runs were completed."""
        return all(run.report.outcome == "done" for run in self.runs)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        done = sum(run.report.outcome == "done" for run in self.runs)
        return f"{self.text} in step {self.step}, {self.workspace}: {done} of {_count(self.runs, 'run')} done"

    @cached_property
    def document(self) -> SweepDocument:
        """The document of `sqrp run --sweep`."""
        from sqrp_cli.report.documents.runs import SweepDocument

        return SweepDocument.of(self.workspace, self.text, self.step, self.runs, self.summary)

    def show(self) -> None:
        """Print what `sqrp run --sweep` prints."""
        from sqrp_cli.terminal.run_view import print_sweep

        print_sweep(self.program, self.step, self.workspace, self.text, self.runs, self.summary)


@dataclass(frozen=True, eq=False, repr=False)
class Audit(Answer["AuditDocument"]):
    """What recorded frames say about the predictions of a program."""

    program: Program
    workspace: str
    report: AuditReport
    threshold: float
    """Least share of predicted detections that must have come true."""

    @property
    def passed(self) -> bool:
        """Whether so many came true."""
        precision = self.report.total.precision
        return precision is not None and precision >= self.threshold

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        precision = self.report.total.precision
        share = "nothing was predicted" if precision is None else f"{100 * precision:.1f} % of predictions came true"
        return f"{self.workspace}: {share}, {'passed' if self.passed else 'not passed'}"

    @cached_property
    def document(self) -> AuditDocument:
        """The document of `sqrp audit`."""
        from sqrp_cli.report.documents.runs import AuditDocument

        return AuditDocument.of(self.workspace, self.report, self.threshold)

    def show(self) -> None:
        """Print what `sqrp audit` prints."""
        from sqrp_cli.terminal.run_view import print_audit

        print_audit(self.program, self.workspace, self.report, self.threshold)


@dataclass(frozen=True, eq=False, repr=False)
class NewCell(Answer["InitDocument"]):
    """A new workspace."""

    starter: Starter
    path: Path
    """Of its folder, as it was given."""
    own_arm: bool
    """Whether the arm is the user's, so that some values were guessed."""

    @property
    def problems(self) -> Sequence[Problem]:
        """Warnings about the arm."""
        return self.starter.warnings

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        return f"{self.path}: {self.starter.task or 'nothing within reach'}"

    @cached_property
    def document(self) -> InitDocument:
        """The document of `sqrp init`."""
        from sqrp_cli.report.documents.scene import InitDocument

        made = self.starter
        return InitDocument(workspace=str(made.folder), tool_link=made.tip, objects=list(made.cubes), task=made.task)

    def show(self) -> None:
        """Print what `sqrp init` prints."""
        from sqrp_cli.terminal.scene_table import print_new_cell

        print_new_cell(self.path, self.starter, own_arm=self.own_arm)


def _count(several: Sized, noun: str) -> str:
    """How many there are, such as `1 candidate` or `6 candidates`."""
    return f"{len(several)} {noun}{'' if len(several) == 1 else 's'}"


def _figures(assessment: Assessment) -> str:
    """A candidate and its quality."""
    name, quality = assessment.candidate.name, assessment.q_eoi
    if not assessment.feasible:
        return f"{name}, infeasible"
    return name if quality is None else f"{name}, Q_eoi {100 * quality:.1f} %"
