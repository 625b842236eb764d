"""The baseline file: scores to compare later ones with, and what is needed to explain how they changed."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from sqrp_cli.errors import InputError, Place, Problem
from sqrp_cli.files import write_atomically
from sqrp_cli.knowledge.source import Scalar, missing_file
from sqrp_cli.paths_as_text import json_line
from sqrp_cli.programming.coverage import Coverage
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.programming.sampling import DEFAULT_TOLERANCE, Sampling
from sqrp_cli.scoring.cells import ScoredCell
from sqrp_cli.scoring.outcome import coverage_numbers, read_coverage
from sqrp_cli.scoring.score import TaskScore
from sqrp_cli.scoring.source_fields import fields_of


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class WayRecord(_Record):
    """The best candidate for a choice of objects. delay: the longest time that a fault may remain unnoticed [s]."""

    candidate: str
    feasible: bool
    reasons: tuple[str, ...] = ()
    time: float | None = None
    q_avg: float | None = None
    q_eoi: float | None = None
    delay: float | None = None
    coverage: dict[str, Any] | None = None

    @property
    def seen(self) -> Coverage | None:
        """The coverage over time, if it is known."""
        return None if self.coverage is None else read_coverage(self.coverage)

    @staticmethod
    def of(ranked: Ranked, coverage: Coverage | None) -> WayRecord:
        """The record of a candidate."""
        assessment = ranked.assessment
        return WayRecord(
            candidate=assessment.candidate.name,
            feasible=assessment.feasible,
            reasons=assessment.reasons,
            time=assessment.time,
            q_avg=assessment.q_avg,
            q_eoi=assessment.q_eoi,
            delay=assessment.delay_worst,
            coverage=None if coverage is None else coverage_numbers(coverage),
        )


class TaskRecord(_Record):
    """A task: how its best candidate is called (None: none is feasible), and every way of doing it."""

    best: str | None
    ways: dict[str, WayRecord]


class WorkspaceRecord(_Record):
    """A workspace: its digest, the digest of each of its files by role, and its tasks."""

    digest: str
    files: dict[str, str]
    tasks: dict[str, TaskRecord]


class Baseline(_Record):
    """Scores of workspaces by name. sampling: how motions were sampled. fields: what files say, by their digest."""

    format: Literal["sqrp baseline 1"] = "sqrp baseline 1"
    sampling: str
    workspaces: dict[str, WorkspaceRecord]
    fields: dict[str, dict[str, Scalar]] = Field(default={})


def baseline_of(
    cells: Sequence[ScoredCell],
    scores: Sequence[TaskScore],
    coverage: Callable[[TaskScore, Ranked], Coverage | None],
    sampling: Sampling,
) -> Baseline:
    """The baseline that these scores make; workspaces and tasks with errors are left out."""
    workspaces: dict[str, WorkspaceRecord] = {}
    fields: dict[str, dict[str, Scalar]] = {}
    for cell in cells:
        if cell.workspace is None:
            continue
        files = {role: file.digest for role, file in sorted(cell.workspace.files.items())}
        for role, digest in files.items():
            if digest not in fields:
                fields[digest] = fields_of(cell.workspace, role)
        tasks = {
            result.task: TaskRecord(
                best=None if result.best is None else result.best.assessment.candidate.name,
                ways={name: WayRecord.of(way, coverage(result, way)) for name, way in result.ways.items()},
            )
            for result in scores
            if result.workspace == cell.name and result.task is not None and result.status != "error"
        }
        workspaces[cell.name] = WorkspaceRecord(digest=cell.workspace.digest, files=files, tasks=tasks)
    known = {digest: found for digest, found in fields.items() if found}
    return Baseline(sampling=repr(sampling), workspaces=workspaces, fields=known)


def save_baseline(baseline: Baseline, path: Path) -> None:
    """Write a baseline, the same bytes for the same scores. Raises InputError where it cannot be written."""
    text = json_line(baseline.model_dump(mode="json"), indent=1)
    write_atomically(path, text + "\n")


def load_baseline(path: Path, sampling: Sampling) -> Baseline:
    """Read a baseline. Raises InputError for a file that `save_baseline` did not write, or from another sampling."""
    mend = f"make it with: sqrp score ... --save-baseline {path}"
    if not path.is_file():
        raise InputError(replace(missing_file(path), mend=None if path.is_dir() else mend))
    try:
        baseline = _with_known_coverage(Baseline.model_validate_json(path.read_bytes()))
    except OSError as error:
        message = f"the baseline cannot be read: {error.strerror or error}"
        raise InputError(Problem("missing-file", message, Place(path), mend=mend)) from error
    except (ValidationError, ValueError, LookupError, TypeError, AttributeError) as error:
        message = "this is no baseline, or of another version"
        # Whatever it is, it is not for a mend to replace.
        another = path.with_name(f"{path.stem}-new.json")
        mend = f"make one with: sqrp score ... --save-baseline {another}"
        raise InputError(Problem("bad-baseline", message, Place(path), mend=mend)) from error
    if baseline.sampling != repr(sampling):
        made, asked = (_sampling_options(text) for text in (baseline.sampling, repr(sampling)))
        message = f"the baseline was made with {made}, but this run samples with {asked}"
        mend = "give the options --samples, --dt or --tolerance that it was made with, or make it again"
        raise InputError(Problem("other-sampling", message, Place(path), mend=mend))
    return baseline


def _sampling_options(text: str) -> str:
    """The option that stands for the representation of a sampling."""
    found = re.fullmatch(r"(Adaptive|FixedCount|FixedStep)\(\w+=([\d.e+-]+)\)", text)
    if found is None:
        return "an unknown sampling"
    kind, value = found[1], float(found[2])
    if kind == "Adaptive":
        return f"--tolerance {100 * value:g}{' (the default)' if value == DEFAULT_TOLERANCE else ''}"
    return f"--{'samples' if kind == 'FixedCount' else 'dt'} {value:g}"


def _with_known_coverage(baseline: Baseline) -> Baseline:
    """The baseline; raises as `read_coverage` where a coverage in it cannot be read."""
    for workspace in baseline.workspaces.values():
        for task in workspace.tasks.values():
            for way in task.ways.values():
                way.seen  # noqa: B018
    return baseline


def vanished(baseline: Baseline, names: Mapping[str, Sequence[str]]) -> tuple[tuple[str, str], ...]:
    """Workspace and text of every task that a baseline has and that is no longer there; names: tasks by workspace."""
    return tuple(
        (workspace, task)
        for workspace, record in baseline.workspaces.items()
        for task in record.tasks
        if task not in names.get(workspace, ())
    )
