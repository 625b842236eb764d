"""What recorded images say: of cameras and predictions in an audit, and of detectors that are calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, hypot

from sqrp_cli.errors import first_names
from sqrp_cli.field.audit.report import AuditDocument, AuditedCamera
from sqrp_cli.field.calibrating.fit import CalibrateDocument
from sqrp_cli.run.record.events import listed
from sqrp_cli.show.terminal.console import Cell, Column, numbers, plain, print_table, say
from sqrp_cli.show.terminal.run_view import print_disagreements, print_prediction

TAIL = 0.3
"""A step whose last image that is compared is earlier than this before its end [s] is not seen to its end."""


def print_audit(found: AuditDocument) -> None:
    """What a recording says about a program's predictions, and what of it is not compared or counts as blind."""
    what = "; ".join(found.steps)
    say(f"{what} in {found.workspace}: {found.images} images compared, {found.skipped} skipped (not as planned)")
    if found.runs > 1:
        say(f"The motion is there {found.runs} times (runs, or a retry): the first is compared.", "yellow")
    if found.damaged:
        count = "1 image is" if found.damaged == 1 else f"{found.damaged} images are"
        say(f"{count} damaged and left out: {found.damage}.", "yellow")
    for name, after in found.apart.items():
        when = f"{abs(after):,.0f} s {'after' if after > 0 else 'before'} the robot's motion"
        say(f"All images of {name} are, by their stamps, {when} or more: its clock is not the robot's.", "red")
    if found.missing:
        them = "them" if found.missing[1:] else "it"
        said = f"There are no images of {listed(found.missing)}: what was predicted of {them} is left out."
        if topics := found.other_topics:  # whose images may be theirs
            said += f" Images of no camera are on {first_names(topics)}: --topic {found.missing[0]}={topics[0]}"
        say(said, "yellow")
    if found.repeated:
        say(f"{found.repeated} images are bit by bit the same as the one before them; they count as blind.", "yellow")
    for number, (time, t) in enumerate(zip(found.times, found.until, strict=True), 1):
        motion = "the motion" if len(found.steps) == 1 else f"step {number}"
        if t is None:
            say(f"No image of {motion} is compared.", "yellow")
        elif t < time - TAIL:
            upto = f"Images are compared up to {t:.2f} s of {time:.2f} s of {motion}"
            say(f"{upto}: then the recording ends, or the robot does not do as planned.", "yellow")
    say()
    if found.unsurveyed is not None:
        say(f"Whether cameras have moved is not known: {found.unsurveyed}.", "yellow")
    else:
        _print_cameras(found.cameras, written=bool(found.written))
    say()
    print_prediction(found.prediction, found.usual)
    print_disagreements(found.disagreements, len(found.prediction))
    for one in found.lost:
        since = f"From {one.t:.2f} s of step {one.step} on, `{one.atom}` is false in each of the {one.images} images"
        say(f"{since} that show it: perhaps the part was lost there, and its detector is right.", "yellow")
    say()
    wrong = f" Not passed: {listed(found.not_as_stated)}." if found.not_as_stated else ""
    if found.precision is None:
        say(f"No image was predicted to show anything, so there is nothing to confirm.{wrong}")
    else:
        verdict = "at least" if found.precision >= found.threshold else "less than"
        seen = f"{100 * found.precision:.1f} % of what was predicted to be seen was seen"
        say(f"{seen}, {verdict} {100 * found.threshold:g} %.{wrong}")


def _print_cameras(cameras: Mapping[str, AuditedCamera], *, written: bool) -> None:
    """A row for each camera, and what is wrong with some. written: whether a patch is, for those that have moved."""
    titles = ("images", "clock [ms]", "turned [deg]", "shifted [mm]", "off by [px]")
    rows: list[list[Cell]] = []
    for name, one in cameras.items():
        cells: list[Cell] = ["-"] * 4
        if one.pose is not None:
            offset, error = one.clock.offset, one.clock.error
            clock = "-" if offset is None or error is None else f"{1e3 * offset:+z.1f} ±{1e3 * error:.1f}"
            turn, turn_error = (degrees(hypot(*v)) for v in (one.pose.turn, one.pose.turn_error))
            shift, shift_error = (1e3 * hypot(*v) for v in (one.pose.shift, one.pose.shift_error))
            style = "red" if one.moved else ""
            cells = [
                plain(clock, "red" if one.clock.wrong else ""),
                plain(f"{turn:.2f} ±{turn_error:.2f}", style),
                plain(f"{shift:.1f} ±{shift_error:.1f}", style),
                plain(f"{one.pose.pixels:.1f}", style),
            ]
        rows.append([name, str(one.images), *cells])
    print_table([Column("camera"), *numbers(*titles)], rows)
    for name, one in cameras.items():
        if one.clock.wrong and one.clock.offset is not None:
            ahead = "ahead of" if one.clock.offset > 0 else "behind"
            text = f"The clock of {name} is {1e3 * abs(one.clock.offset):.0f} ms {ahead} the robot's"
            say(f"{text}: its images are compared at the robot's times.", "red")
    moved = [name for name, one in cameras.items() if one.moved]
    if moved:
        verb, them = ("has", "it is") if len(moved) == 1 else ("have", "they are")
        how = "" if written else f" --patch FILE writes where {them} into the workspace."
        say(f"{listed(moved)} {verb} moved.{how}", "red")
    blind = [name for name, one in cameras.items() if one.pose is None]
    if blind:
        it, has = ("it is", "it has") if len(blind) == 1 else ("they are", "they have")
        little = f"Images of {listed(blind)} show too little of the cell to tell where {it}"
        say(f"{little}, or {has} moved by more than can be found out.", "yellow")


def print_calibration(document: CalibrateDocument) -> None:
    """For each detector how well limits and curve agree with what was seen, and the curve."""
    say(f"Detectors of {document.workspace} in {document.images} images")
    for name, found in document.detectors.items():
        say()
        say(f"{name}: {found.looks} looks at boxes, in {100 * found.seen:.1f} % it said what was true")
        if found.curve is None or found.held_out is None or found.limits is None:
            say(f"No curve: {found.reason}.")
            continue
        judged = {"limits": found.limits, "curve, poses held out": found.held_out}
        rows = [(what, f"{100 * one.calibration_error:.1f}", f"{one.brier:.3f}") for what, one in judged.items()]
        print_table([Column(""), *numbers("calibration error [points]", "Brier score")], rows)
        say()
        bins = [(f"{100 * one.told:.1f}", f"{100 * one.seen:.1f}", str(one.looks)) for one in found.held_out.bins]
        print_table(numbers("predicted [%]", "seen [%]", "looks"), bins)
        terms = {"bias": found.curve.bias, **found.curve.terms, "most": found.curve.most}
        said = ", ".join(f"{term}: {value:g}" for term, value in terms.items())
        say(f"detectors: {name}: curve: {{{said}}}")
