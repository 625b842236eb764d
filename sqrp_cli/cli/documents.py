"""Records as JSON documents; the fields are a contract with other programs."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sqrp_cli.errors import Problem
from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.knowledge.detector import Detector
from sqrp_cli.knowledge.scene import Box, Capsule, Cylinder, Mesh, Part, Shape, Sphere
from sqrp_cli.knowledge.workspace import Workspace
from sqrp_cli.programming.assessment import Assessment, Study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.dependency_check import Feasibility
from sqrp_cli.programming.explanation import by_name
from sqrp_cli.programming.grounding import on_robot
from sqrp_cli.programming.ranking import Criterion, Ranked, winners
from sqrp_cli.programming.robustness import DRAWS, Calibration, without_each_camera
from sqrp_cli.programming.sampling import MAX_MOTION, Adaptive, FixedCount, FixedStep, Sampling
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts
from sqrp_cli.programming.suggestion import Suggestion
from sqrp_cli.programming.targets import Target, TargetBox

Document = dict[str, Any]

SCHEMA = 1
"""Version of the documents' fields."""


def as_text(document: Document) -> str:
    """A document as one line of JSON. Raises ValueError if a figure is not finite."""
    return json.dumps(document, ensure_ascii=False, allow_nan=False)


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


def study_document(cell: Cell, study: Study, ranked: Ranked, sampling: Sampling) -> Document:
    """Everything from which the figures of a candidate can be computed again."""
    recovery = study.recovery
    return {
        **candidate_document(ranked),
        "sampling": sampling_document(sampling, [ranked.assessment]),
        "primitives": [{"name": p.name, "start": p.start, "end": p.end} for p in study.motion.primitives],
        "formulas": [
            {
                "text": formula.operator.text,
                "operator": formula.operator.operator,
                "start": formula.operator.start,
                "end": formula.operator.end,
                "literals": [str(literal) for literal in formula.operator.literals],
                "fault": formula.fault,
            }
            for formula in study.formulas
        ],
        "cameras": {camera.name: {"rate": camera.rate, "latency": camera.latency} for camera in cell.observer.cameras},
        "without_camera": {
            name: {"q_avg": qualities.q_avg, "q_eoi": qualities.q_eoi}
            for name, qualities in without_each_camera(cell, study).items()
        },
        "recovery": {"t": recovery.t.tolist(), "duration": recovery.duration.tolist()},
        "targets": _targets(study),
        "samples": _samples(cell, study),
    }


def infeasible_document(ranked: Ranked) -> Document:
    """An infeasible candidate, with the same fields as a feasible one."""
    empty: Document = {"sampling": None, "primitives": [], "formulas": [], "cameras": {}, "without_camera": {}}
    return {**candidate_document(ranked), **empty, "recovery": None, "targets": {}, "samples": []}


def _targets(study: Study) -> Document:
    literals = dict.fromkeys(literal for formula in study.formulas for literal in formula.operator.literals)
    by_atom = {target.atom: target for target in study.targets}
    return {
        str(literal): {
            "k": by_atom[literal.atom].cameras,
            "boxes": [_box(box) for box in by_atom[literal.atom].boxes],
        }
        for literal in literals
    }


def _box(box: TargetBox) -> Document:
    return {
        "name": box.name,
        "detector": box.detector.name,
        "normal": None if box.normal is None else list(box.normal),
        "encloses": sorted(box.encloses),
        "min_visible": box.detector.min_visible,
        "frame": box.frame,
        "size": list(box.size),
        "pose": box.X_FB.tolist(),
    }


def _samples(cell: Cell, study: Study) -> list[Document]:
    timeline, samples = study.timeline, study.timeline.samples
    states, q, held = study.stage.states(samples), study.stage.positions(samples), study.stage.held(samples)
    objects = [name for name in cell.workspace.objects if name in states.X_WF]
    observation = timeline.observation
    pages = [
        _target_pages(cell, target, boxes, states.X_WF)
        for target, boxes in zip(study.targets, observation.full_matrix, strict=True)
    ]
    column = {target.atom: index for index, target in enumerate(study.targets)}
    monitored, covered = timeline.monitored, timeline.covered
    documents = []
    for row in range(len(samples)):
        literals = timeline.pieces[int(samples.piece[row])].literals
        documents.append(
            {
                "t": float(samples.t[row]),
                "q": cell.model.joint_values(q[row]),
                "objects": {name: _at(states.X_WF[name], row).tolist() for name in objects},
                "held": held[row],
                "covered": bool(covered[row]) if monitored[row] else None,
                "literals": {
                    str(literal): {
                        "covered": bool(observation.covered[row, column[literal.atom]]),
                        **pages[column[literal.atom]][row],
                    }
                    for literal in literals
                },
            }
        )
    return documents


def _target_pages(
    cell: Cell, target: Target, matrix: Sequence[BoxVerdicts], X_WF: Mapping[str, Array]
) -> list[Document]:
    """The verdicts on a target's boxes and cameras, per sample."""
    count = len(matrix[0].cause)
    names = [camera.name for camera in cell.observer.cameras]
    corners = [transform(X_WF[box.frame] @ box.X_FB, box_corners(box.size)) for box in target.boxes]
    pages = []
    for row in range(count):
        verdicts = [{name: _verdict(cell, boxes, row, index) for index, name in enumerate(names)} for boxes in matrix]
        pages.append(
            {
                "boxes": [
                    {"corners": _at(points, row).tolist(), "cameras": cameras}
                    for points, cameras in zip(corners, verdicts, strict=True)
                ],
                "cameras": {name: _first_failure([cameras[name] for cameras in verdicts]) for name in names},
            }
        )
    return pages


def _verdict(cell: Cell, boxes: BoxVerdicts, row: int, camera: int) -> Document:
    cause, by, visible = (
        Cause(int(boxes.cause[row, camera])),
        int(boxes.by[row, camera]),
        float(boxes.visible[row, camera]),
    )
    return {
        "covered": cause is Cause.NONE,
        "cause": cause.label,
        "by": by_name(cell, cause, by),
        "visible": None if np.isnan(visible) else visible,
    }


def _first_failure(verdicts: Sequence[Document]) -> Document:
    failed = next((verdict for verdict in verdicts if not verdict["covered"]), None)
    if failed is None:
        return {"covered": True, "cause": None, "by": None}
    return {"covered": False, "cause": failed["cause"], "by": failed["by"]}


def _at(X: Array, row: int) -> Array:
    """Entry of an array with leading dimension m or 1."""
    entry: Array = X[row if len(X) > 1 else 0]
    return entry


def _plan(suggestion: Suggestion) -> list[Document] | None:
    if suggestion.steps is None:
        return None
    return [
        {
            "action": step.action,
            "feasible": step.feasible,
            "q_avg": None if step.qualities is None else step.qualities.q_avg,
            "q_eoi": None if step.qualities is None else step.qualities.q_eoi,
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


def scene_document(cell: Cell) -> Document:
    """The resolved scene: what was understood of a workspace."""
    workspace, robot, model = cell.workspace, cell.workspace.robot, cell.model
    return {
        **header(workspace),
        "digest": workspace.digest,
        "robot": {
            "urdf": str(robot.urdf),
            "srdf": None if robot.srdf is None else str(robot.srdf),
            "package_roots": [str(root) for root in robot.package_roots],
            "base": robot.X_WB.tolist(),
            "tool": None
            if robot.tool is None
            else {"urdf": str(robot.tool.urdf), "link": robot.tool.link, "pose": robot.tool.X_LT.tolist()},
            "tool_frame": robot.tool_frame,
            "joints": {
                name: {
                    "lower": _finite(limits.lower),
                    "upper": _finite(limits.upper),
                    "velocity": limits.velocity,
                    "acceleration": limits.acceleration,
                    "jerk": limits.jerk,
                }
                for name, limits in robot.limits.items()
            },
            "home": model.joint_values(model.home),
            "geometry": robot.geometry,
        },
        "cameras": {name: _camera(cell, camera) for name, camera in workspace.cameras.items()},
        "detectors": {name: _detector(detector) for name, detector in workspace.detectors.items()},
        "objects": {
            name: {
                "type": thing.type,
                "color": thing.color,
                "size": list(thing.size),
                "pose": None if thing.X_WO is None else thing.X_WO.tolist(),
                "fixed": thing.fixed,
            }
            for name, thing in workspace.objects.items()
        },
        "opaque": [_part(cell, part) for part in _opaque_parts(cell)],
        "state": sorted(map(str, workspace.state)),
        "skills": list(workspace.skills),
        "tasks": [expected.task for expected in workspace.tasks],
    }


def _opaque_parts(cell: Cell) -> list[Part]:
    """The solid parts that neither the robot's URDF nor a plain box of an object's size tells."""
    tool = [part for part in cell.model.parts if part.parent in cell.model.tool_links]
    shaped = [thing for thing in cell.workspace.objects.values() if not _is_plain_box(thing.parts, thing.size)]
    return [*tool, *(part for thing in shaped for part in thing.parts)]


def _is_plain_box(parts: Sequence[Part], size: tuple[float, float, float]) -> bool:
    return len(parts) == 1 and parts[0].shape == Box(size) and np.array_equal(parts[0].X_PG, np.eye(4))


def _part(cell: Cell, part: Part) -> Document:
    parent, X_PG = on_robot(cell.workspace.robot, cell.model, part.parent, part.X_PG)
    return {"name": part.name, "parent": parent, **_shape(part.shape), "pose": X_PG.tolist()}


def _shape(shape: Shape) -> Document:
    match shape:
        case Box(size):
            return {"shape": "box", "size": list(size)}
        case Sphere(radius):
            return {"shape": "sphere", "size": radius}
        case Cylinder(radius, length):
            return {"shape": "cylinder", "size": [radius, length]}
        case Capsule(radius, length):
            return {"shape": "capsule", "size": [radius, length]}
        case Mesh(path, scale):
            return {"mesh": str(path), "scale": list(scale)}


def _camera(cell: Cell, camera: Camera) -> Document:
    frame, X_FC = on_robot(cell.workspace.robot, cell.model, camera.frame, camera.X_FC)
    return {
        "width": camera.width,
        "height": camera.height,
        "K": camera.matrix.tolist(),
        # ROS has no name for the absence of distortion; it writes five zeros.
        "distortion_model": "plumb_bob" if camera.distortion_model == "none" else camera.distortion_model,
        "D": [0.0] * 5 if camera.distortion_model == "none" else camera.distortion.tolist(),
        "frame": frame,
        "pose": X_FC.tolist(),
        "near": camera.near,
        "far": _finite(camera.far),
        "rate": camera.rate,
        "latency": camera.latency,
    }


def _detector(detector: Detector) -> Document:
    return {
        "kind": detector.kind,
        "distance": list(detector.distance),
        "max_incidence": detector.max_incidence,
        "min_pixels": detector.min_pixels,
        "min_visible": detector.min_visible,
    }


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
