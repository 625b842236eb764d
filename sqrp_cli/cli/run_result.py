"""What a run ended with, for people or as JSON."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.runtime.record.report import RunReport


def show_run(report: RunReport, workspace: str, period: float | None, *, as_json: bool) -> ExitCode:
    """Print a report; the exit code says whether the program is done.

    period: between images of the slowest camera [s], None if that is not known.
    """
    from sqrp_cli.report.documents.document import as_text
    from sqrp_cli.report.documents.runs import RunDocument
    from sqrp_cli.terminal.console import say_raw
    from sqrp_cli.terminal.run_view import print_run

    if as_json:
        say_raw(as_text(RunDocument.of(workspace, report)))
    else:
        print_run(workspace, report, period)
    return ExitCode.OK if report.outcome == "done" else ExitCode.STOPPED_ON_FAULT
