"""A candidate as a JSON document from which all of its figures can be computed again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sqrp_cli.cli.documents import Document, candidate_document, sampling_document
from sqrp_cli.geometry import Array, box_corners, transform
from sqrp_cli.programming.assessment import Study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.explanation import by_name
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.programming.robustness import without_each_camera
from sqrp_cli.programming.sampling import Sampling
from sqrp_cli.programming.sensing.cause import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts
from sqrp_cli.programming.targets import Target, TargetBox


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
