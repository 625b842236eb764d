"""One run of a program in the simulated cell, shown live, with all that may be kept of it."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sqrp_cli.errors import ExitCode
    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.runtime.record.events import Event
    from sqrp_cli.runtime.record.film import Gallery
    from sqrp_cli.runtime.run.injected_fault import InjectedFault
    from sqrp_cli.runtime.run.simulation import Simulation


@dataclass(frozen=True)
class Kept:
    """Where a film, a log and the images of a run go; None for what is not kept."""

    record: Path | None
    log: Path | None
    frames: Path | None


def run_once(
    simulation: Simulation,
    fault_texts: Sequence[str],
    kept: Kept,
    page: Path | None,
    arguments: Sequence[str],
    *,
    as_json: bool,
) -> ExitCode:
    """Run a program with faults that are given as text. page: file of the page about it, if one is wanted.

    Raises InputError for a fault that is not known and for a file that cannot be written.
    """
    import numpy as np

    from sqrp_cli.cli.run_result import show_run
    from sqrp_cli.platform.files import check_writable
    from sqrp_cli.report.pages.run_page import RunCell, write_run
    from sqrp_cli.runtime.record.log import LogWriter
    from sqrp_cli.runtime.run.injected_fault import parse_fault
    from sqrp_cli.runtime.run.simulation import header
    from sqrp_cli.terminal.console import note
    from sqrp_cli.terminal.run_view import LiveView, wall_time

    program, workspace = simulation.program, simulation.workspace
    rng = np.random.default_rng(simulation.seed)
    faults: list[InjectedFault] = [parse_fault(text, program.steps, workspace.cameras, rng) for text in fault_texts]
    for path in (kept.record, kept.log):
        if path is not None:
            check_writable(path)
    gallery = _gallery(workspace, kept)
    events: list[Event] = []

    def keep(event: Event) -> None:
        events.append(event)

    with ExitStack() as closing:  # one that cannot be closed keeps no other from being
        if gallery is not None:
            closing.callback(gallery.close)
        writer = None
        if kept.log is not None:
            writer = LogWriter(kept.log, header(program, workspace, simulation.seed, faults))
            closing.callback(writer.close)
        with LiveView(list(workspace.cameras)) as view:
            listeners = [listener for listener in (writer, view, keep) if listener is not None]
            # Without a page or a log nobody wants to know where everything really is.
            report = simulation.run(faults, listeners, gallery, witnessed=page is not None or writer is not None)
        if writer is not None:
            writer.finish(report)
    if page is not None:
        cell = RunCell(workspace.name, list(workspace.cameras), workspace.digest, workspace)
        write_run(cell, report, events, page, arguments)
        note(f"open {page} in a browser")
    if not as_json:
        note(wall_time(report))
    for fault in _never_happened(faults, events):
        note(f"--fault {fault.text} never happened: the run ended before, at {report.time:.2f} s")
    period = max(1.0 / camera.rate for camera in workspace.cameras.values())
    return show_run(report, workspace.name, period, as_json=as_json)


def _never_happened(faults: Sequence[InjectedFault], events: Sequence[Event]) -> list[InjectedFault]:
    """The faults whose time never came."""
    from sqrp_cli.runtime.record.events import FaultInjected

    injected = [event.fault for event in events if isinstance(event, FaultInjected)]
    late = []
    for fault in faults:
        if fault.text in injected:
            injected.remove(fault.text)
        else:
            late.append(fault)
    return late


def _gallery(workspace: Workspace, kept: Kept) -> Gallery | None:
    """What takes the images of a run, if they are kept as a film or one by one."""
    if kept.record is None and kept.frames is None:
        return None
    from sqrp_cli.runtime.record.film import Film, Gallery
    from sqrp_cli.runtime.record.frames import FrameFolder

    rate = max(camera.rate for camera in workspace.cameras.values())
    folder = FrameFolder(kept.frames) if kept.frames is not None else None
    return Gallery(folder, Film(kept.record, list(workspace.cameras), rate) if kept.record is not None else None)
