"""Many runs of a program with a slip at other instants, and how well the delays were predicted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqrp_cli.errors import ExitCode

if TYPE_CHECKING:
    from sqrp_cli.runtime.run.simulation import Simulation


def sweep_slips(simulation: Simulation, text: str, count: int, *, as_json: bool) -> ExitCode:
    """Run a program `count` times with a slip as `text` asks; the exit code says whether all runs got done.

    Raises InputError for a fault that cannot be swept.
    """
    from sqrp_cli.report.documents.document import as_text
    from sqrp_cli.report.documents.runs import SweepDocument
    from sqrp_cli.runtime.run.injected_fault import parse_sweep
    from sqrp_cli.runtime.run.simulation import SweepSummary, sweep
    from sqrp_cli.terminal.console import progress, say_raw
    from sqrp_cli.terminal.run_view import print_sweep

    program, workspace = simulation.program, simulation.workspace
    place, primitive = parse_sweep(text, program.steps)

    with progress(f"Sweeping {text}", count) as advance:
        runs = list(sweep(simulation, place.number, primitive, count, advance))
    summary = SweepSummary.of(runs, max(1.0 / camera.rate for camera in workspace.cameras.values()))
    if as_json:
        say_raw(as_text(SweepDocument.of(workspace.name, text, place.number, runs, summary)))
    else:
        print_sweep(program, place.number, workspace.name, text, runs, summary)
    return ExitCode.OK if all(run.report.outcome == "done" for run in runs) else ExitCode.STOPPED_ON_FAULT
