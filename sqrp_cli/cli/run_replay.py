"""A run shown again from its log, without simulating."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sqrp_cli.errors import InputError, Place, Problem

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqrp_cli.errors import ExitCode
    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.report.pages.run_page import RunCell
    from sqrp_cli.runtime.record.events import Event, RunBegan


def run_replay(
    path: Path, program: Path | None, page: Path | None, arguments: Sequence[str], *, as_json: bool
) -> ExitCode:
    """Show a run again. program: tells where its workspace is, for a page that plays it in three dimensions."""
    from sqrp_cli.cli.run_result import show_run
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.report.pages.run_page import write_run
    from sqrp_cli.runtime.record.events import RunBegan, RunReported
    from sqrp_cli.runtime.record.log import read_log
    from sqrp_cli.terminal.console import note, print_problems
    from sqrp_cli.terminal.run_view import LiveView

    events = read_log(path)
    header = next(events)
    assert isinstance(header, RunBegan)  # noqa: S101 - as `read_log` makes sure
    workspace = None if program is None else _workspace_of(program, path, header)
    read = [] if workspace is None else [file.path for file in workspace.files.values()]
    check_not_read([page], [path, *read, *([] if program is None else [program])])
    report = None
    kept: list[Event] = []
    with LiveView(header.cameras, pace=not as_json) as view:
        for event in events:
            if isinstance(event, RunReported):
                report = event.report
            else:
                view(event)
                kept.append(event)
    if report is None:
        raise InputError(Problem("no-log", "this log has no report at its end: the run was interrupted", Place(path)))
    if page is not None:
        write_run(_cell_then(header, workspace), report, kept, page, arguments)
        note(f"open {page} in a browser")
    rates = _rates_then(header, workspace)
    if not rates and not as_json and any(fault.predicted_delay is not None for fault in report.faults):
        print_problems([_rates_missing(path, program)])
    return show_run(report, header.workspace, 1.0 / min(rates) if rates else None, as_json=as_json)


def _workspace_of(program: Path, path: Path, header: RunBegan) -> Workspace:
    """The workspace of a program. Raises InputError for a program whose steps are not those of the log at `path`."""
    from sqrp_cli.cli.program_input import program_and_workspace

    found, workspace = program_and_workspace(program)
    ran = [(step.skill, step.parameters, step.time) for step in header.steps]
    steps = [(step.skill, dict(step.parameters), step.time) for step in found.steps]
    if ran and ran != steps:
        was, now = (", ".join(f"{skill} of {time:.2f} s" for skill, _, time in one) for one in (ran, steps))
        message = f"this log is not of a run of {program} as it is now: that was {was}; now it is {now or 'empty'}"
        raise InputError(Problem("other-program", message, Place(path, 1), mend=f"sqrp run --replay {path}"))
    return workspace


def _rates_then(header: RunBegan, workspace: Workspace | None) -> list[float]:
    """How often each camera of a run took an image [Hz]; empty where neither the log nor the workspace tells."""
    if header.rates:
        return list(header.rates.values())
    cell = _cell_then(header, workspace).workspace
    return [] if cell is None else [camera.rate for camera in cell.cameras.values()]


def _rates_missing(path: Path, program: Path | None) -> Problem:
    message = (
        "this log does not tell how often its cameras took images, so what was seen later than predicted is not pointed"
        " out"
    )
    mend = f"name the program that was run: sqrp run PROGRAM --replay {path}" if program is None else None
    return Problem("no-rates", message, Place(path, 1), severity="warning", mend=mend)


def _cell_then(header: RunBegan, workspace: Workspace | None) -> RunCell:
    """The cell of a run that its log is about; a workspace that is not as it was then is not used."""
    from sqrp_cli.report.pages.run_page import RunCell

    name, cameras, digest = header.workspace, header.cameras, header.digest
    if workspace is None:
        mend = "sqrp run PROGRAM --replay LOG --report FILE"
        return RunCell(name, cameras, digest, None, f"a log has no shapes; `{mend}` takes them from the workspace")
    if workspace.name != name:
        reason = f"this program is for the workspace {workspace.name}, the run was in {name}"
        return RunCell(name, cameras, digest, None, reason)
    if workspace.digest != digest:
        return RunCell(name, cameras, digest, None, "the workspace of this program is not as it was in the run")
    return RunCell(name, cameras, digest, workspace)
