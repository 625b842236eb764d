"""What recorded images say: of cameras and predictions in an audit, and of detectors that are calibrated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sqrp_cli.calibrating.fit import Judged
from sqrp_cli.errors import first_names
from sqrp_cli.program.record import Program
from sqrp_cli.report.documents.runs import CalibrateDocument
from sqrp_cli.runtime.record.events import listed
from sqrp_cli.terminal.console import Column, numbers, plain, print_table, say
from sqrp_cli.terminal.run_view import print_disagreements, print_prediction

if TYPE_CHECKING:
    from sqrp_cli.runtime.audit.frame_audit import AuditReport
    from sqrp_cli.runtime.audit.survey import CameraSurvey

TAIL = 0.3
"""A step whose last image that is compared is earlier than this before its end [s] is not seen to its end."""


def print_audit(
    program: Program,
    workspace: str,
    report: AuditReport,
    threshold: float,
    cameras: Mapping[str, CameraSurvey],
    *,
    unsurveyed: str,
    not_as_stated: Sequence[str],
    written: bool,
) -> None:
    """What a recording says about a program's predictions.

    unsurveyed: why nothing is known of the cameras. not_as_stated: what is wrong with them, in words. written: whether
    a patch is written for those that have moved.
    """
    what = "; ".join(step.short_task for step in program.steps)
    say(f"{what} in {workspace}: {report.images} images compared, {report.skipped} skipped (not as planned)")
    # What of a recording is not compared, or counts as blind.
    if report.runs > 1:
        say(f"The motion is there {report.runs} times (runs, or a retry): the first is compared.", "yellow")
    if report.damaged:
        count = "1 image is" if len(report.damaged) == 1 else f"{len(report.damaged)} images are"
        say(f"{count} damaged and left out: {report.damaged[0]}.", "yellow")
    for name, after in report.apart.items():
        when = f"{abs(after):,.0f} s {'after' if after > 0 else 'before'} the robot's motion"
        say(f"All images of {name} are, by their stamps, {when} or more: its clock is not the robot's.", "red")
    if report.missing:
        say(_without(report.missing, report.other_topics), "yellow")
    if report.repeated:
        say(f"{report.repeated} images are bit by bit the same as the one before them; they count as blind.", "yellow")
    _print_ends(program, report.until)
    say()
    if unsurveyed:
        say(f"Whether cameras have moved is not known: {unsurveyed}.", "yellow")
    else:
        _print_cameras(cameras, written=written)
    say()
    print_prediction(report.prediction, report.usual)
    print_disagreements(report.disagreements, len(report.prediction))
    for one in report.lost:
        since = f"From {one.t:.2f} s of step {one.step} on, `{one.atom}` is false in each of the {one.images} images"
        say(f"{since} that show it: perhaps the part was lost there, and its detector is right.", "yellow")
    say()
    say(_total(report.total.precision, threshold, not_as_stated))


def _print_ends(program: Program, until: Sequence[float | None]) -> None:
    """How far images are compared of steps that they do not show to the end."""
    for number, (step, t) in enumerate(zip(program.steps, until, strict=True), 1):
        motion = "the motion" if len(program.steps) == 1 else f"step {number}"
        if t is None:
            say(f"No image of {motion} is compared.", "yellow")
        elif t < step.time - TAIL:
            upto = f"Images are compared up to {t:.2f} s of {step.time:.2f} s of {motion}"
            say(f"{upto}: then the recording ends, or the robot does not do as planned.", "yellow")


def _total(precision: float | None, threshold: float, not_as_stated: Sequence[str]) -> str:
    """How much of what was predicted to be seen was seen, and what else is wrong."""
    wrong = f" Not passed: {listed(not_as_stated)}." if not_as_stated else ""
    if precision is None:
        return f"No image was predicted to show anything, so there is nothing to confirm.{wrong}"
    verdict = "at least" if precision >= threshold else "less than"
    seen = f"{100 * precision:.1f} % of what was predicted to be seen was seen"
    return f"{seen}, {verdict} {100 * threshold:g} %.{wrong}"


def _without(cameras: Sequence[str], topics: Sequence[str]) -> str:
    """What is said of cameras without images; topics: whose images may be theirs."""
    them = "them" if cameras[1:] else "it"
    said = f"There are no images of {listed(cameras)}: what was predicted of {them} is left out."
    if not topics:
        return said
    return f"{said} Images of no camera are on {first_names(topics)}: --topic {cameras[0]}={topics[0]}"


def _print_cameras(cameras: Mapping[str, CameraSurvey], *, written: bool) -> None:
    titles = ("images", "clock [ms]", "turned [deg]", "shifted [mm]", "off by [px]")
    columns = [Column("camera"), *numbers(*titles)]
    print_table(columns, [[name, str(one.images), *_cells(one)] for name, one in cameras.items()])
    for name, one in cameras.items():
        if one.has_wrong_clock and one.offset is not None:
            ahead = "ahead of" if one.offset > 0 else "behind"
            text = f"The clock of {name} is {1e3 * abs(one.offset):.0f} ms {ahead} the robot's"
            say(f"{text}: its images are compared at the robot's times.", "red")
    moved = [name for name, one in cameras.items() if one.has_moved]
    if moved:
        verb, them = ("has", "it is") if len(moved) == 1 else ("have", "they are")
        how = "" if written else f" --patch FILE writes where {them} into the workspace."
        say(f"{listed(moved)} {verb} moved.{how}", "red")
    blind = [name for name, one in cameras.items() if one.fit is None]
    if blind:
        it, has = ("it is", "it has") if len(blind) == 1 else ("they are", "they have")
        little = f"Images of {listed(blind)} show too little of the cell to tell where {it}"
        say(f"{little}, or {has} moved by more than can be found out.", "yellow")


def _cells(survey: CameraSurvey) -> list[Any]:
    fit = survey.fit
    if fit is None:
        return ["-"] * 4
    clock = "-" if survey.offset is None else f"{1e3 * survey.offset:+z.1f} ±{1e3 * survey.offset_error:.1f}"
    style = "red" if survey.has_moved else ""
    turn, shift = np.degrees(fit.change[:3]), 1e3 * fit.change[3:6]
    errors = np.degrees(fit.deviations[:3]), 1e3 * fit.deviations[3:6]
    return [
        plain(clock, "red" if survey.has_wrong_clock else ""),
        plain(f"{_length(turn):.2f} ±{_length(errors[0]):.2f}", style),
        plain(f"{_length(shift):.1f} ±{_length(errors[1]):.1f}", style),
        plain(f"{fit.pixels:.1f}", style),
    ]


def _length(vector: Any) -> float:  # noqa: ANN401 # of numbers
    return float(np.linalg.norm(vector))


def print_calibration(document: CalibrateDocument) -> None:
    """For each detector how well limits and curve agree with what was seen, and the curve."""
    say(f"Detectors of {document.workspace} in {document.images} images")
    for name, found in document.detectors.items():
        say()
        say(f"{name}: {found.looks} looks at boxes, in {100 * found.seen:.1f} % it said what was true")
        if found.curve is None or found.held_out is None or found.limits is None:
            say(f"No curve: {found.reason}.")
        else:
            rows = [("limits", *_figures(found.limits)), ("curve, poses held out", *_figures(found.held_out))]
            titles = ("calibration error [points]", "Brier score")
            print_table([Column(""), *numbers(*titles)], rows)
            say()
            bins = [(f"{100 * one.told:.1f}", f"{100 * one.seen:.1f}", str(one.looks)) for one in found.held_out.bins]
            print_table(numbers("predicted [%]", "seen [%]", "looks"), bins)
            terms = {"bias": found.curve.bias, **found.curve.terms, "most": found.curve.most}
            said = ", ".join(f"{term}: {value:g}" for term, value in terms.items())
            say(f"detectors: {name}: curve: {{{said}}}")


def _figures(judged: Judged) -> tuple[str, str]:
    return f"{100 * judged.calibration_error:.1f}", f"{judged.brier:.3f}"
