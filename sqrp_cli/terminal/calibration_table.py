"""What `sqrp calibrate` prints."""

from __future__ import annotations

from sqrp_cli.calibrating.fit import Judged
from sqrp_cli.report.documents.calibration import CalibrateDocument
from sqrp_cli.terminal.console import Column, numbers, print_table, say


def print_calibration(document: CalibrateDocument) -> None:
    """For each detector how well limits and curve agree with what was seen, and the curve."""
    say(f"Detectors of {document.workspace} in {document.images} images")
    for name, found in document.detectors.items():
        say()
        say(f"{name}: {found.looks} looks at boxes, in {100 * found.seen:.1f} % it said what was true")
        if found.curve is None or found.held_out is None or found.limits is None:
            say(f"No curve: {found.reason}.")
        else:
            _print_detector(found.limits, found.held_out)
            terms = {"bias": found.curve.bias, **found.curve.terms, "most": found.curve.most}
            said = ", ".join(f"{term}: {value:g}" for term, value in terms.items())
            say(f"detectors: {name}: curve: {{{said}}}")


def _print_detector(limits: Judged, held_out: Judged) -> None:
    rows = [("limits", *_figures(limits)), ("curve, poses held out", *_figures(held_out))]
    titles = ("calibration error [points]", "Brier score")
    print_table([Column(""), *numbers(*titles)], rows)
    say()
    bins = [(f"{100 * one.told:.1f}", f"{100 * one.seen:.1f}", str(one.looks)) for one in held_out.bins]
    print_table(numbers("predicted [%]", "seen [%]", "looks"), bins)


def _figures(judged: Judged) -> tuple[str, str]:
    return f"{100 * judged.calibration_error:.1f}", f"{judged.brier:.3f}"
