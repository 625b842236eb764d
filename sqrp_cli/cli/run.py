"""`sqrp run`: a program in the simulated cell, watched by its cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import Json, Report, Seed
from sqrp_cli.errors import ExitCode, InputError, Place, Problem

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sqrp_cli.cli.run_page import RunCell
    from sqrp_cli.knowledge.workspace import Workspace, World
    from sqrp_cli.program import Program, Step
    from sqrp_cli.programming.retry import StepReplanner
    from sqrp_cli.runtime.faults import InjectedFault
    from sqrp_cli.runtime.outcome import Event, RunReport
    from sqrp_cli.runtime.recording import Gallery
    from sqrp_cli.runtime.simulated_run import Simulation

NAME = "run"

DEFAULT_RUNS = 20
"""Runs of a sweep."""

_FORMS = (
    "slip@a4+0.4, slip@a4:random, slip@7.2, miss-pick, camera-loss:cam2@5, frozen:cam1@3, latency:cam3=0.5, "
    "perception-crash:cam1@4"
)


def command(
    context: typer.Context,
    program: Annotated[Path | None, typer.Argument(metavar="PROGRAM", help="A program that `sqrp rank` wrote.")] = None,
    sim: Annotated[bool, typer.Option("--sim", help="Run it in the simulated cell.")] = False,
    fault: Annotated[list[str] | None, typer.Option("--fault", help=f"Let this happen: {_FORMS}; repeatable.")] = None,
    sweep: Annotated[
        str | None, typer.Option("--sweep", metavar="slip@PRIMITIVE", help="Many runs, with a slip at other instants.")
    ] = None,
    n: Annotated[int | None, typer.Option("--n", min=1, help="Runs of a sweep; 20 by default.")] = None,
    seed: Seed = 0,
    record: Annotated[
        Path | None, typer.Option("--record", metavar="FILE.mp4", help="Film all cameras, with what is seen drawn in.")
    ] = None,
    log: Annotated[
        Path | None, typer.Option("--log", metavar="FILE", help="Write what happens, one JSON document per line.")
    ] = None,
    frames: Annotated[
        Path | None, typer.Option("--frames", metavar="DIR", help="Keep every image, as `sqrp audit` reads them.")
    ] = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            "--replay",
            metavar="LOG",
            help="Show a run again, from its log, without simulating; with PROGRAM its page has 3D playback, too.",
        ),
    ] = None,
    report: Report = None,
    as_json: Json = False,
) -> ExitCode:
    """Run a program, watched through camera images alone.

    The robot stops, tries again or goes on as the skill says when a fault is seen.
    """
    from sqrp_cli.files import check_distinct, check_not_read

    kept = {"--record": record, "--log": log, "--frames": frames}
    if replay is not None:
        _refuse_with("--replay", {"--fault": fault, "--sweep": sweep, "--n": n, **kept})
    if sweep is not None:
        _refuse_with("--sweep", {"--fault": fault, "--report": report, **kept})
    elif n is not None:
        raise InputError(Problem("bad-option", "--n is about --sweep, which is missing"))
    if record is not None and record.suffix.lower() != ".mp4":
        message = f"--record is `{record}`; expected a name that ends in .mp4"
        raise InputError(Problem("bad-option", message))
    check_distinct({"--record": record, "--log": log, "--report": report})
    if report is not None:
        from sqrp_cli.cli.report_page import check_report

        check_report(report)
    if replay is not None:
        return _replay(replay, program, report, context.obj, as_json=as_json)
    if program is None:
        raise InputError(Problem("no-program", "expected a program to run", mend="sqrp run PROGRAM --sim"))
    simulation = _open(program, sim=sim, seed=seed)
    if sweep is not None:
        return _sweep(simulation, sweep, n or DEFAULT_RUNS, as_json=as_json)
    check_not_read([record, log, report], [program, *(file.path for file in simulation.workspace.files.values())])
    return _run(simulation, fault or [], (record, log, frames), report, context.obj, as_json=as_json)


def _refuse_with(option: str, others: Mapping[str, object]) -> None:
    """Raises InputError where an option is given together with one that it leaves no room for."""
    for name, value in others.items():
        if value:
            raise InputError(Problem("bad-option", f"{option} and {name} exclude each other; give one of them"))


def _open(path: Path, *, sim: bool, seed: int) -> Simulation:
    """The program with its workspace. Raises InputError where it cannot be run."""
    from sqrp_cli.runtime.simulation.requirements import check_simulator

    program, workspace = open_program(path)
    if not sim:
        message = "there is no driver for a real robot yet"
        raise InputError(Problem("no-driver", message, mend=f"sqrp run {path} --sim"))
    check_simulator()
    from sqrp_cli.runtime.simulated_run import Simulation

    return Simulation(program, workspace, LazyReplanner(workspace), seed)


def open_program(path: Path) -> tuple[Program, Workspace]:
    """A program with at least one step, and its workspace. Raises InputError if it does not fit the workspace."""
    from sqrp_cli.program_file import check_program

    program, workspace = _program_and_workspace(path)
    check_program(program, path, workspace)
    if not program.steps:
        raise InputError(Problem("no-steps", "this program has no steps", Place(path)))
    return program, workspace


def _program_and_workspace(path: Path) -> tuple[Program, Workspace]:
    """A program and its workspace as it is now, whether or not they still fit."""
    from sqrp_cli.cli.options import open_workspace
    from sqrp_cli.program_file import load_program, workspace_path

    program = load_program(path)
    return program, open_workspace(workspace_path(program, path))


class LazyReplanner:
    """A replanner that loads what planning needs when a step has to be planned again."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._planner: StepReplanner | None = None

    def replan(self, step: Step, world: World) -> Step | None:
        """As `program.Replanner` says."""
        from sqrp_cli.programming.cell import Cell
        from sqrp_cli.programming.retry import StepReplanner

        if self._planner is None:
            self._planner = StepReplanner(Cell.load(self._workspace))
        return self._planner.replan(step, world)


def _run(
    simulation: Simulation,
    texts: Sequence[str],
    outputs: tuple[Path | None, Path | None, Path | None],
    page: Path | None,
    arguments: Sequence[str],
    *,
    as_json: bool,
) -> ExitCode:
    import numpy as np

    from sqrp_cli.cli.console import note
    from sqrp_cli.cli.run_page import EventRecorder, RunCell, write_run
    from sqrp_cli.cli.run_view import LiveView, wall_time
    from sqrp_cli.files import check_writable
    from sqrp_cli.runtime.faults import parse_fault
    from sqrp_cli.runtime.log import LogWriter
    from sqrp_cli.runtime.simulated_run import header

    program, workspace = simulation.program, simulation.workspace
    rng = np.random.default_rng(simulation.seed)
    faults: list[InjectedFault] = [parse_fault(text, program.steps[0], workspace.cameras, rng) for text in texts]
    record, log, frames = outputs
    for path in (record, log):
        if path is not None:
            check_writable(path)
    gallery = _gallery(workspace, record, frames)
    writer = LogWriter(log, header(program, workspace, simulation.seed, faults)) if log is not None else None
    recorder = EventRecorder()
    try:
        with LiveView(list(workspace.cameras)) as view:
            listeners = [listener for listener in (writer, view, recorder) if listener is not None]
            # Without a page or a log nobody wants to know where everything really is.
            report = simulation.run(faults, listeners, gallery, witnessed=page is not None or writer is not None)
        if writer is not None:
            writer.finish(report)
    finally:
        if writer is not None:
            writer.close()
        if gallery is not None:
            gallery.close()
    if page is not None:
        cell = RunCell(workspace.name, list(workspace.cameras), workspace.digest, workspace)
        write_run(cell, report, recorder.events, page, arguments)
    if not as_json:
        note(wall_time(report))
    return _show(report, workspace.name, as_json=as_json)


def _gallery(workspace: Workspace, record: Path | None, frames: Path | None) -> Gallery | None:
    if record is None and frames is None:
        return None
    from sqrp_cli.runtime.recording import Film, FrameFolder, Gallery

    rate = max(camera.rate for camera in workspace.cameras.values())
    folder = FrameFolder(frames) if frames is not None else None
    return Gallery(folder, Film(record, list(workspace.cameras), rate) if record is not None else None)


def _sweep(simulation: Simulation, text: str, count: int, *, as_json: bool) -> ExitCode:
    from sqrp_cli.cli.console import progress, say_raw
    from sqrp_cli.cli.documents import as_text
    from sqrp_cli.cli.run_document import sweep_document
    from sqrp_cli.cli.run_view import print_sweep
    from sqrp_cli.runtime.simulated_run import SweepSummary, sweep

    with progress(f"Sweeping {text}", count) as advance:
        runs = list(sweep(simulation, text, count, advance))
    summary = SweepSummary.of(runs, max(1.0 / camera.rate for camera in simulation.workspace.cameras.values()))
    if as_json:
        say_raw(as_text(sweep_document(simulation.workspace.name, text, runs, summary)))
    else:
        print_sweep(simulation.program.steps[0], simulation.workspace.name, text, runs, summary)
    return ExitCode.OK if all(run.report.outcome == "done" for run in runs) else ExitCode.STOPPED_ON_FAULT


def _replay(
    path: Path, program: Path | None, page: Path | None, arguments: Sequence[str], *, as_json: bool
) -> ExitCode:
    """Show a run again. program: tells where its workspace is, for a page that plays it in three dimensions."""
    from sqrp_cli.cli.run_page import EventRecorder, write_run
    from sqrp_cli.cli.run_view import LiveView
    from sqrp_cli.files import check_not_read
    from sqrp_cli.runtime.log import read_log, report_of

    events = read_log(path)
    header = next(events)
    workspace = None if program is None else _program_and_workspace(program)[1]
    read = [] if workspace is None else [file.path for file in workspace.files.values()]
    check_not_read([page], [path, *read, *([] if program is None else [program])])
    report = None
    recorder = EventRecorder()
    with LiveView(header.fields["cameras"], pace=not as_json) as view:
        for event in events:
            if event.kind == "report":
                report = report_of(path, dict(event.fields))
            else:
                view(event)
                recorder(event)
    if report is None:
        raise InputError(Problem("no-log", "this log has no report at its end: the run was interrupted", Place(path)))
    if page is not None:
        write_run(_cell_then(header, workspace), report, recorder.events, page, arguments)
    return _show(report, header.fields["workspace"], as_json=as_json)


def _cell_then(header: Event, workspace: Workspace | None) -> RunCell:
    """The cell of a run that its log is about; a workspace that is not as it was then is not used."""
    from sqrp_cli.cli.run_page import RunCell

    fields = header.fields
    name, cameras, digest = fields["workspace"], fields["cameras"], fields["digest"]
    if workspace is None:
        mend = "sqrp run PROGRAM --replay LOG --report FILE"
        return RunCell(name, cameras, digest, None, f"a log has no shapes; `{mend}` takes them from the workspace")
    if workspace.name != name:
        reason = f"this program is for the workspace {workspace.name}, the run was in {name}"
        return RunCell(name, cameras, digest, None, reason)
    if workspace.digest != digest:
        return RunCell(name, cameras, digest, None, "the workspace of this program is not as it was in the run")
    return RunCell(name, cameras, digest, workspace)


def _show(report: RunReport, workspace: str, *, as_json: bool) -> ExitCode:
    from sqrp_cli.cli.console import say_raw
    from sqrp_cli.cli.documents import as_text
    from sqrp_cli.cli.run_document import run_document
    from sqrp_cli.cli.run_view import print_run

    if as_json:
        say_raw(as_text(run_document(workspace, report)))
    else:
        print_run(workspace, report)
    return ExitCode.OK if report.outcome == "done" else ExitCode.STOPPED_ON_FAULT
