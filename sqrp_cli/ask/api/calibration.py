"""Detectors calibrated with labelled frames."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask.api.cell import OpenCell, open_cell
from sqrp_cli.ask.api.program import PROGRAM, open_program
from sqrp_cli.ask.requests import CalibrateRequest
from sqrp_cli.errors import InputError, Place, bad_input, bad_option

if TYPE_CHECKING:
    from sqrp_cli.field.calibrating.fit import CalibrateDocument
    from sqrp_cli.field.calibrating.labelled import LabelledImages


def learned(ask: CalibrateRequest) -> CalibrateDocument:
    """How likely detectors see, from labelled frames. Raises InputError for frames that teach nothing."""
    from sqrp_cli.platform.simulator import check_packages

    check_packages()
    from sqrp_cli.cell.edits import with_curve
    from sqrp_cli.cell.workspace_file import read_workspace_document
    from sqrp_cli.field.calibrating.fit import LEAST_LOOKS, CalibratedDetector, CalibrateDocument, fit, held_out, judge
    from sqrp_cli.field.calibrating.labelled import look_at_frames
    from sqrp_cli.files.yaml_edit import patch

    cell, labelled = _labelled(ask)
    images = sum(len(together.images) for together in labelled)
    with ask.progress(f"Looking at {ask.frames}", images) as advance:
        looked = look_at_frames(cell.cell, labelled, lambda: advance(1))
    document = read_workspace_document(cell.workspace.whole_file.file)
    detectors, content = {}, document.content
    for name, looks in looked.items():
        detector, reason, curve, count = cell.workspace.detectors[name], None, None, len(looks.seen)
        if count < LEAST_LOOKS:
            reason = f"it looked at {count} boxes in range and in the image, expected {LEAST_LOOKS} or more"
        else:
            curve = fit(looks, detector)
            content = with_curve(read_workspace_document(document.path, content), name, curve)
        detectors[name] = CalibratedDetector(
            looks=count,
            seen=int(looks.seen.sum()) / max(count, 1),
            curve=curve,
            held_out=None if reason else judge(held_out(looks, detector), looks.seen),
            limits=judge(looks.covered.astype(float), looks.seen) if count else None,
            reason=reason,
        )
    if not any(one.curve for one in detectors.values()):
        reasons = "; ".join(f"`{name}`: {one.reason}" for name, one in detectors.items())
        message = f"these frames teach nothing about a detector: {reasons or 'nothing in them is looked for'}"
        raise bad_input("too-few-frames", message, Place(Path(ask.frames)))
    return CalibrateDocument(
        workspace=cell.workspace.name,
        images=images,
        detectors=detectors,
        patch=patch(document, content),
        cell=cell,
        looked=looked,
    )


def calibrate(*given: Any, **named: Any) -> CalibrateDocument:  # noqa: ANN401 - of the fields of a request
    """Learn from labelled frames how likely detectors see; it takes the fields of a `CalibrateRequest`."""
    return learned(CalibrateRequest(*given, **named))


def _labelled(ask: CalibrateRequest) -> tuple[OpenCell, list[LabelledImages]]:
    from sqrp_cli.field.calibrating.labelled import LABELS, of_labels, of_program
    from sqrp_cli.files.input_file import missing_file
    from sqrp_cli.ros.bag import check_kind

    folder, workspace, program = Path(ask.frames), ask.workspace, ask.program
    if not folder.exists():
        raise InputError(missing_file(folder))
    check_kind(folder)
    if (folder / LABELS).is_file() and program is None:
        if workspace is None:
            message = f"{LABELS} does not say which cell it is about"
            raise bad_option(message, Place(folder / LABELS), mend=f"sqrp calibrate {folder} --workspace WORKSPACE")
        cell = open_cell(workspace)
        return cell, list(of_labels(cell.workspace, folder))
    if workspace is not None:
        message = f"{ask.called('workspace')} goes with frames that have a {LABELS}, and there is none"
        raise bad_option(message, Place(folder))
    file = Path(program or folder / PROGRAM)
    if not file.is_file() and program is None:
        none = f"there is neither a {LABELS} in this folder nor a {PROGRAM}, so it is not known what the frames show"
        message = none if folder.is_dir() else "of a file it is not known what its images show"
        mend = f"sqrp calibrate {folder} --program FILE, with the program that was run"
        raise bad_input("no-labels", message, Place(folder), mend=mend)
    opened = open_program(file)
    return opened.cell, list(of_program(opened.program, opened.workspace, opened.footage(folder, {})))
