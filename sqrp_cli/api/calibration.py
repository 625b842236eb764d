"""Detectors calibrated with labelled frames."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqrp_cli.api.cell import OpenCell, open_cell
from sqrp_cli.api.program import PROGRAM, open_program
from sqrp_cli.api.results import Answer
from sqrp_cli.ask.requests import CalibrateRequest
from sqrp_cli.document import how_many
from sqrp_cli.errors import InputError, Place, bad_input, bad_option

if TYPE_CHECKING:
    from sqrp_cli.calibrating.fit import DetectorLooks
    from sqrp_cli.calibrating.labelled import LabelledImages
    from sqrp_cli.report.documents.runs import CalibratedDetector, CalibrateDocument


def learned(ask: CalibrateRequest) -> LearnedCurves:
    """How likely detectors see, from labelled frames.

    Frames lie in a folder with `frames.csv` and the program that was run (as `run(frames=...)` keeps them), or with
    `labels.csv`; or in a recording that `audit` reads. Raises InputError for frames that cannot be used, or from which
    nothing can be learned.
    """
    from sqrp_cli.runtime.cell.requirements import check_packages

    check_packages()
    from sqrp_cli.calibrating.look import look_at_frames

    folder = Path(ask.frames)
    cell, labelled = _labelled(ask)
    images = sum(len(together.images) for together in labelled)
    with ask.progress(f"Looking at {folder}", images) as advance:
        looks = look_at_frames(cell.cell, labelled, lambda: advance(1))
    found = LearnedCurves(cell, images, looks)
    if not any(one.curve for one in found.detectors.values()):
        reasons = "; ".join(f"`{name}`: {one.reason}" for name, one in found.detectors.items())
        message = f"these frames teach nothing about a detector: {reasons or 'nothing in them is looked for'}"
        raise bad_input("too-few-frames", message, Place(folder))
    return found


def calibrate(*given: Any, **named: Any) -> LearnedCurves:  # noqa: ANN401 - of the fields of a request
    """Learn from labelled frames how likely detectors see; it takes the fields of a `CalibrateRequest`."""
    return learned(CalibrateRequest(*given, **named))


def _labelled(ask: CalibrateRequest) -> tuple[OpenCell, list[LabelledImages]]:
    from sqrp_cli.calibrating.labelled import LABELS, of_labels, of_program
    from sqrp_cli.knowledge.text.input_file import missing_file
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


@dataclass(frozen=True, eq=False, repr=False)
class LearnedCurves(Answer["CalibrateDocument"]):
    """What labelled frames say about the detectors of a cell."""

    cell: OpenCell
    images: int
    """How many were looked at."""
    looks: Mapping[str, DetectorLooks]
    """Of each detector, by name."""

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        curves = [name for name, one in self.detectors.items() if one.curve is not None]
        return f"{self.cell.workspace.name}: {how_many(curves, 'curve')} from {self.images} images"

    @cached_property
    def detectors(self) -> Mapping[str, CalibratedDetector]:
        """What was learned about each detector, by name."""
        return {name: _calibrated(self.cell, name, looks) for name, looks in self.looks.items()}

    @cached_property
    def document(self) -> CalibrateDocument:
        """The document of `sqrp calibrate`."""
        from sqrp_cli.report.documents.runs import CalibrateDocument

        return CalibrateDocument(
            workspace=self.cell.workspace.name, images=self.images, detectors=self.detectors, patch=self.patch
        )

    @cached_property
    def patch(self) -> str:
        """A unified diff from the workspace file to the one with these curves."""
        from sqrp_cli.knowledge.text.yaml_edit import patch
        from sqrp_cli.knowledge.workspace.edits import with_curve
        from sqrp_cli.knowledge.workspace.workspace_file import read_workspace_document

        document = read_workspace_document(self.cell.workspace.whole_file.file)
        content = document.content
        for name, one in self.detectors.items():
            if one.curve is not None:
                content = with_curve(read_workspace_document(document.path, content), name, one.curve)
        return patch(document, content)

    def show(self) -> None:
        """Print what `sqrp calibrate` prints."""
        from sqrp_cli.terminal.audit_view import print_calibration

        print_calibration(self.document)


def _calibrated(cell: OpenCell, name: str, looks: DetectorLooks) -> CalibratedDetector:
    from sqrp_cli.calibrating.fit import LEAST_LOOKS, fit, held_out, judge
    from sqrp_cli.report.documents.runs import CalibratedDetector

    detector, seen = cell.workspace.detectors[name], int(looks.seen.sum())
    reason = None
    if len(looks) < LEAST_LOOKS:
        reason = f"it looked at {len(looks)} boxes in range and in the image, expected {LEAST_LOOKS} or more"
    return CalibratedDetector(
        looks=len(looks),
        seen=seen / max(len(looks), 1),
        curve=None if reason else fit(looks, detector),
        held_out=None if reason else judge(held_out(looks, detector), looks.seen),
        limits=judge(looks.covered.astype(float), looks.seen) if len(looks) else None,
        reason=reason,
    )
