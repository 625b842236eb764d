"""Two versions of a workspace: the one as the baseline of the other."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from sqrp_cli.errors import InputError
from sqrp_cli.knowledge.workspace.load import workspace_file
from sqrp_cli.scoring.baselines.baseline import baseline_of
from sqrp_cli.scoring.baselines.findings import CoverageLookup, Findings, Progress, compare_with, score_cells
from sqrp_cli.scoring.cells import ScoredCell, read_cell
from sqrp_cli.scoring.score import TaskScore
from sqrp_cli.scoring.work.compute import Computer


def read_versions(before: Path, after: Path) -> tuple[ScoredCell, ScoredCell]:
    """Two versions of a workspace, both under the name of the later one.

    Raises InputError where one of them, or a task of it, cannot be used.
    """
    old, new = _read_version(before), _read_version(after)
    name = "workspace" if new.workspace is None else new.workspace.name
    return replace(old, name=name), replace(new, name=name)


def _read_version(path: Path) -> ScoredCell:
    cell = read_cell(workspace_file(path), "workspace")
    problems = [problem for problem in cell.problems if problem.severity == "error"]
    problems += [problem for task in cell.tasks for problem in task.problems]
    if problems:
        raise InputError(*problems)
    return cell


def difference(
    before: ScoredCell,
    after: ScoredCell,
    computer: Computer,
    allowance: float,
    progress: Progress,
) -> Findings:
    """How the tasks of `after` compare with those of `before`; allowance: see `compare`.

    Raises InputError where results cannot be kept, or candidates cannot be computed.
    """
    first = score_cells([before], computer, progress)
    if first.interrupted:
        return replace(first, results=())
    lookup = CoverageLookup([before], computer)
    scores = [result.score for result in first.results]
    lookup.prepare([(score, way) for score in scores for way in score.ways.values()], progress)
    baseline = baseline_of([before], scores, lookup, computer.sampling)
    second = score_cells([after], computer, progress)
    if second.interrupted:
        return second
    # Only what is worse than before counts as failed, not what is below a threshold in both.
    results_now = (replace(result, score=_expecting_nothing(result.score)) for result in second.results)
    second = replace(second, results=tuple(results_now))
    return compare_with(second, [after], baseline, allowance, CoverageLookup([after], computer), progress)


def _expecting_nothing(score: TaskScore) -> TaskScore:
    return replace(score, status="passed", reasons=()) if score.status == "failed" else score
