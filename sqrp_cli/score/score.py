"""What to score: every task of the workspaces of folders, files and patterns; its best candidate, and if it passes."""

from __future__ import annotations

import glob
from collections.abc import Mapping, Sequence
from math import inf
from pathlib import Path
from string import digits

from sqrp_cli.cell.canonical_values import digest_of_values, with_skills
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace import ExpectedTask, Workspace
from sqrp_cli.cell.workspace_file import WORKSPACE_FILE, workspace_file
from sqrp_cli.checks.lint import assumptions, lint
from sqrp_cli.errors import InputError, Place, Problem, bad_input
from sqrp_cli.figures import FIGURE_NAMES, falls_short
from sqrp_cli.platform.processes import Progress
from sqrp_cli.records import dataclass
from sqrp_cli.score.compute import Computer, ScoreRequest
from sqrp_cli.score.result import Scorecard, TaskScore
from sqrp_cli.search.suggestion import with_first_steps
from sqrp_cli.shown import shown_name
from sqrp_cli.study.pipeline import described
from sqrp_cli.study.ranking import rank
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.task.candidate import THEN
from sqrp_cli.task.task import Candidate, read_task


@dataclass(frozen=True, eq=False)
class ScoredTask:
    """A task that a workspace lists."""

    expected: ExpectedTask
    requests: tuple[ScoreRequest, ...] = ()  # its candidates, to be computed; none if the text cannot be read
    problems: tuple[Problem, ...] = ()  # why the text cannot be read


@dataclass(frozen=True, eq=False)
class ScoredCell:
    """A workspace to be scored."""

    name: str  # its name in the output
    workspace: Workspace | None  # None if `problems` has an error
    tasks: tuple[ScoredTask, ...] = ()
    problems: tuple[Problem, ...] = ()

    @property
    def requests(self) -> tuple[ScoreRequest, ...]:
        """The candidates of all its tasks, to be computed."""
        return tuple(request for task in self.tasks for request in task.requests)


def read_cell(file: Path, name: str, content: bytes | None = None) -> ScoredCell:
    """A workspace, read as `load_workspace` does."""
    try:
        workspace = load_workspace(file, content)
    except InputError as error:
        return ScoredCell(name, None, problems=error.problems)
    problems = (*workspace.warnings, *lint(workspace))
    errors = tuple(problem for problem in problems if problem.severity == "error")
    if errors:
        return ScoredCell(name, None, problems=errors)
    tasks = []
    # Digests of all in the workspace that the figures of candidates of some skills depend on: what was understood of
    # it, see `cell.canonical_values`, except for other skills.
    contents: dict[tuple[str, ...], str] = {}
    for expected in workspace.tasks:
        try:
            task = read_task(expected.task, workspace)
        except InputError as error:
            tasks.append(ScoredTask(expected, problems=error.problems))
            continue
        if expected.feasible is not False:
            task = with_first_steps(task, workspace)
        steps = task.candidates[0].steps or task.candidates[:1]
        skills = tuple(dict.fromkeys(step.skill.name for step in steps))
        if skills not in contents:
            contents[skills] = digest_of_values(with_skills(workspace.canonical_values, skills))
        said, recorded = contents[skills], workspace.recordings.get(task.skill.name)
        if recorded is not None:
            said = digest_of_values({"cell": {"rest": said, "recording": recorded.state}})
        requests = (ScoreRequest(workspace, said, one) for one in task.candidates)
        tasks.append(ScoredTask(expected, tuple(requests)))
    return ScoredCell(name, workspace, tuple(tasks), problems)


def find_workspaces(patterns: Sequence[str]) -> tuple[Path, ...]:
    """The workspace files that match patterns, each once: in the order of the patterns, each pattern's by name.

    They begin with what the pattern says, so messages name them as the user did.

    A pattern is a workspace file, the folder of one, a folder with workspaces at any depth below it (hidden folders
    left out), or a glob of those (`cells/*`, `**` for any depth). Raises InputError for one without a match.
    """
    found: dict[Path, Path] = {}
    for pattern in patterns:
        if not pattern:
            message = f"PATH is empty; expected a workspace, which is a folder with a {WORKSPACE_FILE}"
            raise bad_input("no-workspace", message)
        magic = glob.has_magic(pattern)
        named = Path(pattern).exists() or not magic
        matches = [Path(pattern)] if named else map(Path, sorted(glob.glob(pattern, recursive=True)))  # noqa: PTH207
        files: list[Path] = []
        for match in matches:
            if match.is_file():
                files += [match] if match.suffix in (".yaml", ".yml") else []
            elif (match / WORKSPACE_FILE).is_file():
                files.append(match / WORKSPACE_FILE)
            else:
                below = ((file, file.relative_to(match).parts) for file in match.rglob(WORKSPACE_FILE))
                files += sorted(file for file, parts in below if not any(part.startswith(".") for part in parts))
        if not files and not magic:  # a single path that does not exist is explained by whoever reads workspaces
            files = [workspace_file(Path(pattern))]
        if not files:
            message = f"no workspace fits `{pattern}`; a workspace is a folder with a {WORKSPACE_FILE}"
            raise bad_input("no-workspace", message, Place(Path(pattern)))
        for file in files:
            found.setdefault(file.absolute(), file)
    return tuple(found.values())


def short_names(files: Sequence[Path]) -> Mapping[Path, str]:
    """The name of each workspace in the output: its folder's, with as much of its path as makes it unique."""
    names: dict[Path, str] = {}
    whole = {file: file.absolute() for file in files}
    paths = {file: at.parent if at.name == WORKSPACE_FILE else at.with_suffix("") for file, at in whole.items()}
    for file, path in paths.items():
        others, count = [other.parts for at, other in paths.items() if at != file], 1
        while count < len(path.parts) and any(other[-count:] == path.parts[-count:] for other in others):
            count += 1
        names[file] = shown_name("/".join(path.parts[-count:]))
    return names


def score_cells(cells: Sequence[ScoredCell], computer: Computer, progress: Progress) -> Scorecard:
    """Score every task; at Ctrl-C those that are finished. An unusable workspace has one score, without a task.

    Raises InputError where results cannot be kept.
    """
    requests, interrupted = [request for cell in cells for request in cell.requests], False
    try:
        with progress("Scoring", len(requests)) as advance:
            computer.compute(requests, advance)
    except KeyboardInterrupt:
        interrupted = True
    results: list[TaskScore] = []
    for cell in cells:
        if cell.workspace is None:
            results.append(TaskScore(cell.name, None, "error", _sentences(cell.problems)))
        found = (_task_score(cell.name, task, computer) for task in cell.tasks)
        results += (one for one in found if one is not None)
    if not interrupted:
        return Scorecard(results=tuple(results))
    total = sum(1 if cell.workspace is None else len(cell.tasks) for cell in cells)
    return Scorecard(results=tuple(results), interrupted=True, unfinished=total - len(results))


def _task_score(workspace: str, task: ScoredTask, computer: Computer) -> TaskScore | None:
    """The score of a task, if each of its candidates is computed, or cannot be."""
    text, results, problems = task.expected.task, [], list(task.problems)
    for request in task.requests:
        outcome = computer.outcome(request)
        if outcome is None:
            return None
        if isinstance(outcome, list):
            problems = outcome
            break
        results.append(outcome.result)
    if problems:
        return TaskScore(workspace, text, "error", _sentences(problems))
    ranking = rank(results, "q_eoi")
    ways: dict[str, CandidateResult] = {}
    for ranked in ranking:
        ways.setdefault(way_name(ranked.candidate), ranked)
    first, named = ranking[0], {name for one in results for name in one.candidate.binding.values()}
    best = described(first) if first.feasible else None
    reasons = shortcomings(
        best,
        task.expected,
        "" if best else f"{first.candidate.name}: {first.candidate.skill.in_pieces(first.reasons[0])}",
    )
    for phase, least in (task.expected.min_phases or {}).items():
        of_phase = [(one, seen) for one in ranking for seen in one.phases if seen.name.rstrip(digits) == phase]
        short = [(one, seen) for one, seen in of_phase if seen.seen is not None and falls_short(seen.seen, least)]
        if short:
            worst, seen = min(short, key=lambda pair: pair[1].seen or 0.0)
            more = f" and of {len(short) - 1} more" * (len(short) > 1)
            reasons += (f"time seen of {seen} in {worst.candidate.name}{more}, expected at least {100 * least:g} %",)
    return TaskScore(
        workspace=workspace,
        task=text,
        status="failed" if reasons else "passed",
        reasons=reasons,
        best=best,
        ways=ways,
        request=task.requests[0],
        assumed=assumptions(task.requests[0].workspace, named),
    )


def _sentences(problems: Sequence[Problem]) -> tuple[str, ...]:
    return tuple(f"{problem}" + (f"; to mend it: {problem.mend}" if problem.mend else "") for problem in problems)


def way_name(candidate: Candidate) -> str:
    """The name of a choice of objects of a task, such as `g1`, `g1 tray` or `peg1 then peg1 socket`; of an episode."""
    if candidate.skill.recorded is not None:
        return candidate.name
    if candidate.steps:
        return THEN.join(map(way_name, candidate.steps))
    return " ".join(candidate.binding.values()) or candidate.skill.name


def shortcomings(best: CandidateResult | None, expected: ExpectedTask, why_none: str) -> tuple[str, ...]:
    """One sentence for each expectation that is not met; none if all are.

    best: the first in the ranking; None if no candidate is feasible, and then `why_none` says why. A task is expected
    to be feasible unless `expected` says otherwise.
    """
    if best is None:
        return () if expected.feasible is False else (f"no candidate can be done: {why_none}",)
    name, lost, said = best.candidate.name, f"{best.blind_spot[:1].lower()}{best.blind_spot[1:]}", list[str]()
    if expected.feasible is False:
        said.append(f"{name} can be done, but no candidate was expected to be")
    for figure, quality, least in (
        ("q_eoi", best.q_eoi, expected.min_q_eoi),
        ("q_avg", best.q_avg, expected.min_q_avg),
    ):
        label = FIGURE_NAMES[figure]
        if least is not None and quality is None:
            said.append(f"{label} of {name} is undefined, expected at least {100 * least:g} %")
        elif least is not None and quality is not None and falls_short(quality, least):
            said.append(f"{label} of {name} is {100 * quality:.1f} %, expected at least {100 * least:g} %: {lost}")
    if expected.max_time is not None and best.time is not None and best.time > expected.max_time:
        said.append(f"{name} takes {best.time:.2f} s, expected at most {expected.max_time:g} s")
    delay = best.latest
    if expected.max_delay is not None and delay is not None and delay > expected.max_delay:
        fault = max(best.faults, key=lambda fault: (best.faults[fault].unseen, best.faults[fault].delay_worst or 0.0))
        hidden = best.faults[fault].blind_longest and best.blind_spot != NOTHING_MISSING
        noticed = "never be noticed" if delay == inf else f"be noticed only after {delay:.2f} s"
        most, why = f"expected at most {expected.max_delay:g} s", lost if hidden else best.why_late
        said.append(f"the fault {fault} of {name} may {noticed}, {most}: {why}")
    if expected.winner is not None and expected.winner not in best.candidate.binding.values():
        said.append(f"{name} is best, expected one with {expected.winner}")
    return tuple(said)
