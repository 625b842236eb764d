"""A cell, read once, and its methods: rank, explain, check, score."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import values
from sqrp_cli.ask.request import question
from sqrp_cli.ask.requests import (
    AdviseRequest,
    CheckRequest,
    ExplainRequest,
    PlaceRequest,
    RankRequest,
    ScoreRequest,
    TaskRequest,
)
from sqrp_cli.errors import InputError, Problem
from sqrp_cli.records import dataclass

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.score.compute import Workers
    from sqrp_cli.score.result import Scorecard
    from sqrp_cli.search.advice_result import AdviceDocument
    from sqrp_cli.search.placing_program import Watch
    from sqrp_cli.search.placing_result import PlaceDocument
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.show.documents.explanation import ExplainedAll, Explanation
    from sqrp_cli.show.documents.scene import ShowDocument
    from sqrp_cli.study.result import Ranking


def open_cell(path: str | Path, *, seed: int = 0) -> OpenCell:
    """Read a workspace: its folder, or its YAML file.

    seed: of everything that planning draws at random. Raises InputError, with file, line and column, for a workspace
    that cannot be used.
    """
    cell = OpenCell.read(values.path.read(path, "path"), values.count(0).read(seed, "seed"))
    if cell.errors:
        raise InputError(*cell.errors)
    return cell


def ranked(cell: OpenCell, ask: RankRequest, written: Path | None = None) -> Ranking:
    """The candidates of a task in order. written: the program that one of them is to continue."""
    from sqrp_cli.ask.api.session import Session, assess

    session = Session.begin(cell.cell, ask, written)
    return session.ranking(list(assess(session, ask)), ask)


def explained(cell: OpenCell, ask: ExplainRequest) -> Explanation | ExplainedAll:
    """When each camera sees each literal, and what is in the way; `choose` None compares all candidates."""
    from sqrp_cli.ask.api import session

    return session.explained(session.Session.begin(cell.cell, ask), ask)


def advised(cell: OpenCell, ask: AdviseRequest) -> AdviceDocument:
    """The least changes that let the cameras see enough: of the motion, of objects, of cameras."""
    from sqrp_cli.ask.api.advice import find_advice

    return find_advice(cell.cell, ask, cell.content)


def checked(cell: OpenCell, ask: CheckRequest) -> Check:
    """Whether the workspace is sound, and which candidates can be done, why the others cannot, and what to do first."""
    from sqrp_cli.ask.api.session import Session
    from sqrp_cli.cell.workspace_file import WORKSPACE_FILE
    from sqrp_cli.checks.cell_warnings import cell_warnings, idle_cameras, outside_detectors, scenes_of, swept_cameras
    from sqrp_cli.checks.formulas import intervals_outside
    from sqrp_cli.logic.planner import find_plan
    from sqrp_cli.search.suggestion import Suggester, best_suggestion, check_candidate
    from sqrp_cli.show.documents.checks import Check
    from sqrp_cli.task.grips import first_grip
    from sqrp_cli.task.task import example_task, impossible_tasks

    name, path = cell.workspace.name, str(cell.path.parent if cell.path.name == WORKSPACE_FILE else cell.path)
    if cell.errors:
        return Check.of(path, name, ask.task, cell.findings)
    if ask.task is None:
        doubts = [*cell.findings, *impossible_tasks(cell.workspace), *cell_warnings(cell.cell)]
        # A contact at home is no error, because a program may have left the robot elsewhere.
        if contact := cell.cell.collision.contact_in(cell.cell.initial_world):
            message = f"at home {contact} before anything moves, so no task can begin there"
            mend = "change the home position, or move what is in its way"
            place = cell.workspace.places.get("robot.home")
            doubts.append(Problem("contact-at-home", message, place, severity="warning", mend=mend))
        return Check.of(path, name, None, doubts, example=example_task(cell.workspace) or "TASK")
    session = Session.begin(cell.cell, TaskRequest(ask.task, after=ask.after))
    candidates = session.task.candidates
    suggester = Suggester(session.cell, session.job.world, ask.planner or find_plan, ask.jobs, len(candidates))
    found = []
    with ask.progress(f"Checking {ask.task}", len(candidates)) as advance:
        for candidate in candidates:
            found.append(check_candidate(candidate, suggester))
            advance(1)
    wanted = not any(one.feasible for one in found) if ask.plan is None else ask.plan
    suggested = best_suggestion(found, suggester) if wanted else ()
    able = [first_grip(one.candidate) for one in found if one.feasible]
    scenes = scenes_of(session.cell, session.job.world, [one.steps or (one,) for one in able])
    problems = [*cell.findings, *cell_warnings(session.cell), *intervals_outside(found)]
    problems += (*swept_cameras(session.cell, scenes), *outside_detectors(session.cell, scenes))
    problems += idle_cameras(session.cell, ask.task, scenes, problems)
    return Check.of(path, name, ask.task, problems, found, suggested)


def scored(cell: OpenCell, ask: ScoreRequest) -> Scorecard:
    """All tasks of the workspace."""
    from sqrp_cli.score.compute import open_computer
    from sqrp_cli.score.score import read_cell, score_cells, short_names

    path = cell.workspace.path
    with open_computer(ask.means(cell.seed)) as computer:
        return score_cells([read_cell(path, short_names([path])[path])], computer, ask.progress)


def placed(
    cell: OpenCell, ask: PlaceRequest, workers: Workers | None = None, watch: Watch | None = None
) -> PlaceDocument:
    """Where cameras should go. workers: of a cluster. watch: told what is sought, the best so far and the bound."""
    from sqrp_cli.ask.api.placing import find_placement

    return find_placement(cell.cell, ask, ask.means(cell.seed, workers), watch, cell.content)


@dataclass(frozen=True, eq=False)
class OpenCell:
    """A cell, with a method for each question about it.

    path: as it was given. seed: of everything that planning draws at random.

    A question takes the fields of its request (see `sqrp_cli.ask.requests`) and raises InputError for input that cannot
    be used. What cannot be done is a result with reasons, not an exception.
    """

    path: Path
    workspace: Workspace
    seed: int = 0
    content: bytes | None = None  # the text of the workspace file where it was not read from the disk

    def __repr__(self) -> str:
        cell = self.workspace
        return (
            f"OpenCell({cell.name}: {len(cell.cameras)} cameras, {len(cell.objects)} objects, {', '.join(cell.skills)})"
        )

    @classmethod
    def read(cls, path: Path, seed: int = 0, content: bytes | None = None) -> OpenCell:
        """A workspace, even one with problems. Raises InputError if it cannot be read at all.

        content: instead of that of its file.
        """
        from sqrp_cli.cell.load import load_workspace

        return cls(path, load_workspace(path, content), seed, content)

    @cached_property
    def findings(self) -> tuple[Problem, ...]:
        """Warnings about the workspace; with errors, only `check` and `scene` work."""
        from sqrp_cli.checks.lint import lint

        return (*self.workspace.warnings, *lint(self.workspace))

    @property
    def files(self) -> list[Path]:
        """The files that it was read from."""
        return [file.path for file in self.workspace.files.values()]

    @property
    def errors(self) -> tuple[Problem, ...]:
        """The findings that keep the cell from being used."""
        return tuple(problem for problem in self.findings if problem.severity == "error")

    @cached_property
    def cell(self) -> Cell:
        """Robot model, collision scene and cameras, made once. Raises InputError for a mesh that cannot be used."""
        from sqrp_cli.motion.cell import Cell

        return Cell.load(self.workspace, self.seed)

    rank = question(RankRequest, ranked)
    explain = question(ExplainRequest, explained)
    advise = question(AdviseRequest, advised)
    check = question(CheckRequest, checked)
    score = question(ScoreRequest, scored)

    def place(self, *tasks: str, **how: Any) -> PlaceDocument:  # noqa: ANN401 - of the fields of a request
        """Find where cameras should go for some tasks, by default all that the workspace lists, with a proof.

        how: the other fields of a `PlaceRequest`.
        """
        return placed(self, PlaceRequest(tasks=tasks, **how))

    def scene(self) -> ShowDocument:
        """The workspace as understood."""
        from sqrp_cli.show.documents.scene import ShowDocument

        return ShowDocument.of(self.cell)
