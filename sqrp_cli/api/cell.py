"""A cell, read once, and its methods: rank, explain, check, score."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.api import arguments
from sqrp_cli.api.results import Check, Explanation, Ranking, Scene, Scores
from sqrp_cli.errors import InputError, Problem, bad_option

if TYPE_CHECKING:
    from sqrp_cli.api.advice import TaskAdvice
    from sqrp_cli.api.placing import CellPlacement
    from sqrp_cli.api.session import Session
    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.logic.planner import Planner
    from sqrp_cli.programming.cell import Cell
    from sqrp_cli.programming.coverage.robustness import Calibration
    from sqrp_cli.programming.coverage.sampling import Sampling
    from sqrp_cli.programming.ranking import Criterion
    from sqrp_cli.scoring.scorecard import Progress


@contextmanager
def silent(_title: str, _total: int | None) -> Iterator[Callable[[int], None]]:
    """Progress that is not shown."""
    yield lambda _count: None


def open_cell(path: str | Path, *, seed: int = 0) -> OpenCell:
    """Read a workspace: its folder, or its YAML file.

    seed: of everything that planning draws at random. Raises InputError, with file, line and column, for a workspace
    that cannot be used.
    """
    arguments.check_count(seed, "seed", 0)
    cell = OpenCell.read(arguments.checked_path(path), seed)
    if cell.errors:
        raise InputError(*cell.errors)
    return cell


@dataclass(frozen=True, eq=False)
class OpenCell:
    """A cell, with a method for each question about it.

    path: as it was given. seed: of everything that planning draws at random.

    Every method takes `jobs`, the processes to use at most, and raises InputError for input that cannot be used. What
    cannot be done is a result with reasons, not an exception.
    """

    path: Path
    workspace: Workspace
    seed: int = 0
    content: bytes | None = None
    """The text of the workspace file where it was not read from the disk."""

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
        from sqrp_cli.knowledge.workspace.load import load_workspace

        return cls(path, load_workspace(path, content), seed, content)

    @cached_property
    def findings(self) -> tuple[Problem, ...]:
        """Warnings about the workspace; with errors, only `check` and `scene` work."""
        from sqrp_cli.checks.lint import lint

        return (*self.workspace.warnings, *lint(self.workspace))

    @property
    def errors(self) -> tuple[Problem, ...]:
        """The findings that keep the cell from being used."""
        return tuple(problem for problem in self.findings if problem.severity == "error")

    @cached_property
    def cell(self) -> Cell:
        """Robot model, collision scene and cameras, made once. Raises InputError for a mesh that cannot be used."""
        from sqrp_cli.programming.cell import Cell

        return Cell.load(self.workspace, self.seed)

    def begin(
        self,
        task: str,
        *,
        sampling: Sampling | None = None,
        calibration: Calibration | None = None,
        after: str | Path | None = None,
        by: Criterion = "q_eoi",
        ways: arguments.WaysOption = "best",
        max_time: str | float | None = None,
    ) -> Session:
        """A task in the cell, with nothing computed yet; see `rank`."""
        from sqrp_cli.api.session import Session
        from sqrp_cli.programming.coverage.sampling import Adaptive
        from sqrp_cli.programming.pipeline import Inquiry

        arguments.check_text(task, "task", "a skill and what to do it with, such as `pickup green`")
        arguments.check_sampling(sampling)
        arguments.check_calibration(calibration)
        before = arguments.optional_path(after, "after")
        wanted = arguments.check_wanted(by, ways, max_time)
        return Session.begin(self.cell, task, Inquiry(sampling or Adaptive(), calibration, wanted), before)

    def rank(
        self,
        task: str,
        *,
        by: Criterion = "q_eoi",
        sampling: Sampling | None = None,
        calibration: Calibration | None = None,
        after: str | Path | None = None,
        ways: arguments.WaysOption = "best",
        max_time: str | float | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> Ranking:
        """Rank the candidates of a task, such as `pickup green`, each in its best way.

        by: what counts first. sampling: of the motions, adaptive by default. calibration: accuracy of the camera poses,
        to draw poses and show how the qualities spread. after: a program; the task starts where it ends. ways: `best`
        of all, or `fastest`: each candidate with its fastest branch and the first yaw and side, seen or not. max_time:
        of a way, such as `20 s`, or `1.25x` the time of the fastest of all ways of the candidate.
        """
        from sqrp_cli.api.session import assess
        from sqrp_cli.programming.ranking import rank

        arguments.check_means(jobs, progress)
        session = self.begin(
            task,
            sampling=sampling,
            calibration=calibration,
            after=after,
            by=by,
            ways=ways,
            max_time=max_time,
        )
        return Ranking(session, rank(list(assess(session, jobs, progress)), by), by)

    def explain(
        self,
        task: str,
        choose: str | None = "best",
        *,
        step: int | None = None,
        sampling: Sampling | None = None,
        after: str | Path | None = None,
        ways: arguments.WaysOption = "best",
        max_time: str | float | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> Explanation:
        """Explain when each camera sees each literal, and what is in the way when it does not.

        choose: the candidate's name, `best` for the first in the ranking, or None to compare all of them. step: of a
        task of several, from 1; by default the one that is seen worst. ways, max_time: see `rank`.
        """
        from sqrp_cli.api.session import assess, at_step, check_choice, check_one_step, choose_candidate
        from sqrp_cli.programming.ranking import rank

        arguments.check_means(jobs, progress)
        if choose is not None:
            arguments.check_text(choose, "choose", "the name of a candidate, `best`, or None for all")
        session = self.begin(task, sampling=sampling, after=after, ways=ways, max_time=max_time)
        check_choice(session.task, "best" if choose is None else choose)
        whole = bool(session.task.candidates[0].steps)
        if step is not None and not whole:
            raise bad_option(f"--step is {step}, but `{task}` is a task of one step")
        if choose is None:
            check_one_step(session)
        ranking = rank(list(assess(session, jobs, progress)), "q_eoi")
        place = None
        if whole and choose is not None:
            session, one, place = at_step(session, choose_candidate(ranking, choose), step)
            ranking, task, choose = (one,), session.task.text, "best"
        chosen = list(ranking) if choose is None else [choose_candidate(ranking, choose)]
        explained = []
        with progress("Looking up causes", len(chosen)) as advance:
            for ranked in chosen:
                explained.append(session.assignment.explain(ranked))
                advance(1)
        return Explanation(session, task, ranking, explained, several=choose is None, step=place)

    def advise(
        self,
        task: str,
        *,
        want: str | None = None,
        choose: str = "best",
        kinds: Sequence[str] | None = None,
        ways: arguments.WaysOption = "best",
        sampling: Sampling | None = None,
        after: str | Path | None = None,
        out: str | Path | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> TaskAdvice:
        """Find the least changes that let the cameras see enough: of the motion, of objects, of cameras.

        want: a wish such as `q_eoi 100 %, time 20 s`, by default the thresholds of the task in the workspace, else
        Q_eoi 100 %. choose: the candidate's name, or `best` for the first in the ranking. kinds: what may change; by
        default cells only where no other motion is enough. ways: `fastest` leaves the motion as `rank` has it with
        that. out: folder in which the answer of each kind is kept; those there are used.
        """
        from sqrp_cli.api.advice import find_advice
        from sqrp_cli.programming.advice.change import read_kinds

        arguments.check_means(jobs, progress)
        arguments.check_text(choose, "choose", "the name of a candidate, or `best`")
        if want is not None:
            arguments.check_text(want, "want", "a wish such as `q_eoi 100 %, time 20 s`")
        session = self.begin(task, sampling=sampling, after=after, ways=ways)
        return find_advice(
            session,
            self.path,
            content=self.content,
            want=want,
            choose=choose,
            kinds=read_kinds(kinds),
            out=arguments.optional_path(out, "out"),
            jobs=jobs,
            progress=progress,
        )

    def place(
        self,
        *tasks: str,
        cameras: int | None = None,
        want: str | None = None,
        objective: str = "least",
        survive: int = 0,
        keep: Sequence[str] = (),
        budget: float | None = None,
        ways: arguments.WaysOption = "best",
        mounts: str | Path | None = None,
        out: str | Path | None = None,
        sampling: Sampling | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> CellPlacement:
        """Find where cameras should go for some tasks, by default all that the workspace lists, with a proof.

        cameras: most of them on mounts. want: a wish such as `q_eoi 100 %, delay 0.5 s` that every candidate has to
        reach; then as few cameras as possible. Without both, Q_eoi 100 %. objective: `least` or `mean`, the quality of
        all candidates that counts first. survive: 1 if any one camera may fail. keep: cameras of the workspace that
        stay. budget: most that they may cost. ways: `best` chooses the way of each candidate, too. mounts: the file
        that says where cameras may go and which, by default `place.yaml` beside the workspace. out: folder that keeps
        what mounts see for a later call.
        """
        from sqrp_cli.api.placing import PlaceRequest, find_placement
        from sqrp_cli.programming.coverage.sampling import Adaptive
        from sqrp_cli.scoring.work.compute import Means

        if cameras is not None:
            arguments.check_count(cameras, "cameras", 1)
        arguments.check_count(survive, "survive", 0)
        arguments.check_texts(tasks, "tasks", "texts such as `pickup green`")
        arguments.check_texts(keep, "keep", "names of cameras")
        request = PlaceRequest(
            tasks=tasks,
            cameras=cameras,
            want=want,
            objective=objective,
            survive=survive,
            keep=keep,
            budget=budget,
            ways=arguments.check_ways(ways),
            mounts=arguments.optional_path(mounts, "mounts"),
        )
        arguments.check_sampling(sampling)
        arguments.check_means(jobs, progress)
        means = Means(sampling or Adaptive(), jobs, None, arguments.optional_path(out, "out"), self.seed)
        return find_placement(self.cell, request, means=means, progress=progress, content=self.content)

    def check(
        self,
        task: str | None = None,
        *,
        after: str | Path | None = None,
        plan: bool | None = None,
        planner: Planner | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> Check:
        """Check the workspace, and which candidates of a task can be done, why the others cannot, and what to do first.

        plan: whether to plan the steps to do first, each in its best way; by default if no candidate can be done at
        once. planner: that of this package by default.
        """
        from sqrp_cli.checks.cell_warnings import cell_warnings, swept_cameras
        from sqrp_cli.checks.formulas import intervals_outside
        from sqrp_cli.logic.planner import find_plan
        from sqrp_cli.programming.suggestion import Suggester, best_suggestion, check_candidate
        from sqrp_cli.programming.task import example_task, impossible_tasks
        from sqrp_cli.programming.ways.grips import first_grip

        arguments.check_means(jobs, progress)
        if plan is not None and not isinstance(plan, bool):
            raise arguments.refused("plan", plan, "True, False, or None for where it is needed")
        if planner is not None:
            arguments.check_callable(planner, "planner", "a function such as sqrp_cli.logic.planner.find_plan")
        name, path = self.workspace.name, str(self.path)
        if self.errors:
            return Check(path, name, task, self.findings)
        if task is None:
            doubts = (*self.findings, *impossible_tasks(self.workspace), *self._doubts())
            return Check(path, name, None, doubts, example=example_task(self.workspace))
        session = self.begin(task, after=after)
        candidates = len(session.task.candidates)
        suggester = Suggester(session.cell, session.assignment.world, planner or find_plan, jobs, candidates)
        found = []
        with progress(f"Checking {task}", candidates) as advance:
            for candidate in session.task.candidates:
                found.append(check_candidate(candidate, suggester))
                advance(1)
        wanted = not any(one.feasible for one in found) if plan is None else plan
        suggested = best_suggestion(found, suggester) if wanted else ()
        first = [first_grip(one.candidate) for one in found if one.feasible][:1]
        swept = swept_cameras(
            session.cell, session.assignment.world, (step for one in first for step in one.steps or (one,))
        )
        problems = (*self.findings, *cell_warnings(session.cell), *intervals_outside(found), *swept)
        return Check(path, name, task, problems, tuple(found), suggested)

    def _doubts(self) -> Iterator[Problem]:
        """Warnings that need the geometry of the cell, among them contacts of the robot at home.

        A contact is no error, because a program may have left the robot elsewhere.
        """
        from sqrp_cli.checks.cell_warnings import cell_warnings

        cell = self.cell
        yield from cell_warnings(cell)
        contact = cell.collision.contact_in(cell.initial_world)
        if contact is not None:
            message = f"at home {contact} before anything moves, so no task can begin there"
            mend = "change the home position, or move what is in its way"
            place = self.workspace.places.get("robot.home")
            yield Problem("contact-at-home", message, place, severity="warning", mend=mend)

    def scene(self) -> Scene:
        """The workspace as understood."""
        return Scene(self.cell)

    def score(
        self,
        *,
        sampling: Sampling | None = None,
        out: str | Path | None = None,
        jobs: int = 1,
        progress: Progress = silent,
    ) -> Scores:
        """Score all tasks of the workspace. out: a folder that keeps results for a later call."""
        from sqrp_cli.programming.coverage.sampling import Adaptive
        from sqrp_cli.scoring.score import read_cells
        from sqrp_cli.scoring.scorecard import score_cells
        from sqrp_cli.scoring.work.compute import Means, open_computer

        arguments.check_sampling(sampling)
        arguments.check_means(jobs, progress)
        means = Means(sampling or Adaptive(), jobs, None, arguments.optional_path(out, "out"), self.seed)
        with open_computer(means) as computer:
            return Scores(score_cells(list(read_cells([self.workspace.path])), computer, progress))
