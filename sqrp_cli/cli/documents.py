"""Records as JSON documents; the fields are a contract with other programs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sqrp_cli.cli.json_text import SCHEMA as SCHEMA
from sqrp_cli.cli.json_text import Document as Document
from sqrp_cli.cli.json_text import as_text as as_text
from sqrp_cli.errors import Problem
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.assessment import Assessment
from sqrp_cli.programming.ranking import Criterion, Ranked, winners
from sqrp_cli.programming.robustness import DRAWS, Calibration
from sqrp_cli.programming.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling

if TYPE_CHECKING:
    from sqrp_cli.programming.dependency_check import Feasibility
    from sqrp_cli.programming.suggestion import Suggestion


def header(workspace: Workspace, task: str | None = None) -> Document:
    """The fields that begin every document."""
    fields: Document = {"schema": SCHEMA, "workspace": workspace.name}
    return fields if task is None else {**fields, "task": task}


def sampling_document(sampling: Sampling, assessments: Sequence[Assessment]) -> Document:
    """How the motion was sampled, with the largest remaining error of Q and the largest gap among the candidates."""
    reached: Document = {
        "error": max((a.error for a in assessments if a.error is not None), default=None),
        "max_gap": max((a.largest_gap for a in assessments if a.largest_gap is not None), default=None),
    }
    match sampling:
        case FixedCount(samples):
            return {"mode": "samples", "samples": samples, **reached}
        case FixedStep(dt):
            return {"mode": "dt", "dt": dt, **reached}
        case Adaptive(tolerance):
            return {"mode": "adaptive", "tolerance": tolerance, "max_motion": MAX_MOTION, **reached}


def candidate_document(ranked: Ranked) -> Document:
    """The figures of a candidate."""
    assessment = ranked.assessment
    return {
        "parameters": assessment.candidate.parameters,
        "feasible": assessment.feasible,
        "rank": ranked.rank,
        "reasons": list(assessment.reasons),
        "time": assessment.time,
        "q_avg": assessment.q_avg,
        "q_eoi": assessment.q_eoi,
        "t_total": assessment.t_total,
        "t_eoi": assessment.t_eoi,
        "faults": {
            name: {
                "delay_mean": fault.delay_mean,
                "delay_worst": fault.delay_worst,
                "blind_longest": fault.blind_longest,
                "unseen": fault.unseen,
                "expected_time": fault.expected_time,
            }
            for name, fault in assessment.faults.items()
        },
        "states": assessment.states,
        "pareto": ranked.pareto,
        "verdict": assessment.verdict,
    }


def calibration_fields(calibration: Calibration | None, assessments: Sequence[Assessment], by: Criterion) -> Document:
    """What inexact camera poses do: how often each candidate is first, and the spread of its qualities."""
    if calibration is None:
        return {}
    feasible = [assessment for assessment in assessments if assessment.feasible]
    first = winners(assessments, by)
    return {
        "calibration": {
            "position": calibration.position,
            "rotation": calibration.rotation,
            "seed": calibration.seed,
            "draws": DRAWS,
            "candidates": [
                {
                    "parameters": assessment.candidate.parameters,
                    "first": first[assessment.candidate.name],
                    "q_avg": percentiles([q.q_avg for q in assessment.recalibrated]),
                    "q_eoi": percentiles([q.q_eoi for q in assessment.recalibrated]),
                }
                for assessment in feasible
            ],
        }
    }


def percentiles(values: Sequence[float | None]) -> list[float] | None:
    """The 5th and 95th percentile, None where a value is undefined."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return None
    return [float(value) for value in np.percentile(known, [5, 95])]


def _plan(suggestion: Suggestion) -> list[Document] | None:
    if suggestion.steps is None:
        return None
    return [
        {
            "action": step.action,
            "feasible": step.feasible,
            "q_avg": None if step.assessment is None else step.assessment.q_avg,
            "q_eoi": None if step.assessment is None else step.assessment.q_eoi,
            "reasons": list(step.reasons),
        }
        for step in suggestion.steps
    ]


def check_document(
    workspace: str, task: str | None, found: Sequence[Feasibility], problems: Sequence[Problem]
) -> Document:
    """Candidates with their verdicts, and the findings about the workspace."""
    return {
        "schema": SCHEMA,
        "workspace": workspace,
        "task": task,
        "candidates": [
            {
                "parameters": feasibility.candidate.parameters,
                "feasible": feasibility.feasible,
                "reasons": list(feasibility.reasons),
                "plan": _plan(feasibility.suggestion),
                "planning": feasibility.suggestion.outcome,
            }
            for feasibility in found
        ],
        "problems": [
            {
                "code": problem.code,
                "severity": problem.severity,
                "file": None if problem.place is None else str(problem.place.file),
                "line": None if problem.place is None else problem.place.line,
                "column": None if problem.place is None else problem.place.column,
                "message": problem.message,
            }
            for problem in problems
        ],
    }
