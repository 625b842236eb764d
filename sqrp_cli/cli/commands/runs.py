"""Programs in a cell: `run`, `cell`, `audit` and `calibrate`."""

from __future__ import annotations

import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.calibration import learned
from sqrp_cli.ask.api.program import DEFAULT_RUNS, audited, cameras_patch, interrupted_log, late_replanner, run_of_log
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.options import (
    answer,
    check_excluded,
    check_needed,
    check_outputs,
    open_with_warnings,
    page_is_written,
    read_program,
    write_patch,
)
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_input, bad_option

if TYPE_CHECKING:
    from sqrp_cli.ask.api.cell import OpenCell
    from sqrp_cli.ask.api.program import OpenProgram
    from sqrp_cli.ask.api.run_results import SimulatedRun
    from sqrp_cli.ask.requests import RunRequest
    from sqrp_cli.field.cell_server import CellServer
    from sqrp_cli.run.cell.robot_file import RobotFile
    from sqrp_cli.run.cell.ros_cell import RosCell
    from sqrp_cli.run.record.events import Event, Listener

LOOPBACK = "127.0.0.1"  # the network on which a cell is served if nobody says otherwise: this computer alone
LISTENED = 0.7  # for how long it is listened whether another cell is served [s]: to be heard takes 0.3 s
LEAST_SPEED = 0.01  # below it a program would take a hundred times as long


@command("run", requests.RunRequest)
def _run(
    ask: requests.RunRequest,
    *,
    program: Path | None = argument(
        "PROGRAM", "A program file, as `sqrp rank --program` writes.", values.path, default=None
    ),
    sim: bool = flag("--sim", "Run it in the simulated cell."),
    robot: Path | None = option("--robot CONFIG", "Run it on the robot that this file leads to.", values.path),
    dry_run: bool = flag("--dry-run", "With --robot: check and look, but command nothing."),
    yes: bool = flag("--yes", "With --robot: do not ask before it moves."),
    speed: float | None = option(
        "--speed",
        "With --robot: share of the program's speed, such as 10%.",
        values.quantity("SHARE", LEAST_SPEED, 1.0, f"{LEAST_SPEED:.0%} to 100%", "PERCENT"),
    ),
    slip: str | None = option(
        "--sweep [STEP:]slip@PRIMITIVE",
        "Many runs, with a slip at other instants.",
        values.text("a slip and where, such as `slip@lift`"),
    ),
    count: int | None = option("--n", "Runs of a sweep; 20 by default.", values.count(1)),
    replayed: Path | None = option(
        "--replay LOG",
        "Show a run again, from its log, without simulating; with PROGRAM its page has 3D playback, too.",
        values.path,
    ),
    report: Path | None = requests.REPORT,
    seed: int = requests.SEED,
    json: bool = requests.JSON,
) -> ExitCode:
    about = {"--fault": ask.faults, "--sweep": slip}
    files = {"--record": ask.film, "--log": ask.log, "--frames": ask.frames}
    check_excluded("--replay", replayed, {**about, "--n": count, **files})
    check_excluded("--sweep", slip, {"--fault": ask.faults, **files, "--report": report})
    check_needed("--sweep", slip, {"--n": count})
    check_needed("--robot", robot, {"--dry-run": dry_run, "--yes": yes, "--speed": speed})
    check_excluded("--robot", robot, {"--sim": sim, **about, "--replay": replayed})
    ask.check_outputs((), report)
    check_outputs({"--record": ask.film, "--log": ask.log, "--report": report})
    if replayed is not None:
        return _replay(replayed, program, report, as_json=json)
    if program is None:
        how = "--sim" if robot is None else f"--robot {shlex.quote(str(robot))}"
        raise bad_input("no-program", "expected a program to run", mend=f"sqrp run PROGRAM {how}")
    from sqrp_cli.platform.simulator import check_simulator
    from sqrp_cli.show.terminal.console import print_problems, progress, say

    if robot is not None and json and not dry_run and not yes:
        raise bad_option("--json leaves no room for a question; add --yes, or --dry-run")
    opened = read_program(program, seed)
    ask.check_outputs([*opened.files, robot], report)
    if robot is not None:
        print_problems(opened.warnings)
        found = _run_on_robot(opened, robot, speed or 1.0, ask, agreed=dry_run or yes, moves=not dry_run, as_json=json)
    else:
        if not sim:
            message = "expected where to run it: --sim, or --robot with the file that leads to a robot"
            raise bad_input("no-driver", message, mend=f"sqrp run {program} --sim")
        check_simulator()
        print_problems(opened.warnings)
        if slip is not None:
            swept = opened.sweep(slip, count or DEFAULT_RUNS, progress=progress, option="--sweep")
            answer(swept, as_json=json)
            if swept.interrupted:
                return ExitCode.INTERRUPTED
            return ExitCode.OK if swept.done else ExitCode.STOPPED_ON_FAULT
        opened.read_faults(ask.faults, "--fault")  # before anything is shown
        with _shown_live(opened, as_json=json) as listeners:
            found = opened.run_into(ask.but(listeners=listeners, witnessed=report is not None))
    if dry_run and found.done and not json:
        say("The cell is as the program says, and so are the images where it starts. Nothing was commanded.")
        return ExitCode.OK
    return _show(found, report, as_json=json)


@contextmanager
def _shown_live(opened: OpenProgram, *, as_json: bool, stopped: str = "") -> Iterator[Sequence[Listener]]:
    """What shows a run live; at Ctrl-C its finished steps are printed. stopped: what is then said of the robot."""
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import live_view, print_finished

    events: list[Event] = []
    steps = opened.program.steps
    try:
        with live_view(list(opened.workspace.cameras), planned=sum(step.time for step in steps)) as view:
            yield events.append, view
    except KeyboardInterrupt:
        tasks = [step.short_task for step in steps]
        note(f"interrupted at {print_finished(tasks, events, opened.workspace.name, quiet=as_json)}{stopped}")
        raise typer.Exit(ExitCode.INTERRUPTED) from None


def _replay(log: Path, program: Path | None, report: Path | None, *, as_json: bool) -> ExitCode:
    """Show a run again, or what happened until it was interrupted; with a program its page has 3D playback."""
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.run.record.log import read_log
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.run_view import live_view, print_finished

    header = next(read_log(log))  # a file that is no log is told before what is wrong with the program
    opened = None if program is None else read_program(program, check=False)
    check_not_read([report], [log, *([] if opened is None else opened.files)])
    events: list[Event] = []
    with live_view(header.cameras, pace=not as_json) as view:
        run = run_of_log(log, opened, events.append, view)
    if run is not None:
        return _show(run, report, as_json=as_json)
    if report is not None or as_json:
        raise interrupted_log(log)
    finished = print_finished([step.skill for step in header.steps], events, header.workspace)
    note(f"this log was interrupted at {finished}")
    return ExitCode.INTERRUPTED


def _show(run: SimulatedRun, report: Path | None, *, as_json: bool) -> ExitCode:
    """Write the page, if one is wanted, and print how a run went."""
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.show.terminal.progress_lines import Verbosity, verbosity
    from sqrp_cli.show.terminal.run_view import wall_time

    if not page_is_written(report, run.write_page):
        return ExitCode.INTERRUPTED
    if not as_json and run.wall and verbosity.get() is Verbosity.VERBOSE:
        note(wall_time(run))
    for fault in run.never_happened:
        note(f"--fault {fault} never happened: the run ended before, at {run.time:.2f} s")
    answer(run, as_json=as_json)
    return ExitCode.OK if run.done else ExitCode.STOPPED_ON_FAULT


def _run_on_robot(
    opened: OpenProgram, robot: Path, speed: float, ask: RunRequest, *, agreed: bool, moves: bool, as_json: bool
) -> SimulatedRun:
    """Run a program at a share of its speed on the robot that a file leads to; at Ctrl-C it stops, and stands.

    moves: else only images are looked at. agreed: whether nobody need be asked.
    """
    from sqrp_cli.platform.simulator import check_packages
    from sqrp_cli.run.cell.robot_file import read_robot_file
    from sqrp_cli.show.terminal.console import ask as ask_user
    from sqrp_cli.show.terminal.console import say

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # the robot is told to stop, as at Ctrl-C
    check_packages()
    from sqrp_cli.ros.dds import DdsTransport
    from sqrp_cli.run.cell.ros_cell import RosCell
    from sqrp_cli.run.run import Run
    from sqrp_cli.run.slowed import slowed

    file, program = read_robot_file(robot, opened.workspace, opened.program), opened.program
    joints = file.joints or {name: name for name in program.joints}  # by name in the program, those in messages
    steps = tuple(slowed(step, speed) for step in program.steps)
    opened = replace(opened, program=program.model_copy(update={"steps": steps}))
    with RosCell(file, joints, opened.workspace, DdsTransport(file.domain, file.network)) as cell:
        check_cell(cell, steps[0].before.joints, robot, as_json=as_json)
        if not agreed:
            seconds = sum(step.time for step in opened.program.steps)
            told = f"The robot will move for {seconds:.0f} s."
            say(f"{told} SQRP is no safety function: keep the emergency stop at hand.")
            sys.stdout.flush()
            try:
                said = ask_user("Move the robot? [y/N] ")
            except EOFError:
                said = ""
            if said.lower() not in ("y", "yes"):
                raise bad_input("not-agreed", "nobody agreed that the robot moves", mend="answer y, or give --yes")
        with _shown_live(opened, as_json=as_json, stopped="; the robot is told to stop") as listeners:
            made = partial(Run, opened.program, opened.workspace, cell, late_replanner(opened.workspace, speed))
            kept = ask.but(listeners=listeners, witnessed=moves)
            return opened.run_into(kept, elsewhere=lambda recording: made(recording=recording).run(moves=moves))


def check_cell(cell: RosCell, start: Mapping[str, float], robot: Path, *, as_json: bool) -> None:
    """Compare a cell with where a program begins, and print that. Raises InputError where it differs."""
    from sqrp_cli.run.cell.ros_checks import check_cell as compared
    from sqrp_cli.show.terminal.console import Column, note, print_table, say

    note("watching the cell ...")
    checks = compared(cell, start)
    if not as_json:
        columns = [Column("cell"), Column("what"), Column("found"), Column("expected"), Column("")]
        words = ["" if one.problem is None else "differs" for one in checks]
        rows = [[c.about, c.what, c.found, c.expected, word] for c, word in zip(checks, words, strict=True)]
        print_table(columns, rows)
        say()
    differing = [one for one in checks if one.problem is not None]
    problems = [Problem("other-cell", str(one.problem), Place(robot)) for one in differing]
    if late := [index for index, one in enumerate(differing) if one.what == "age"]:
        mend = cell.file.mend_of_lateness
        problems[late[-1]] = replace(problems[late[-1]], mend=mend or None)  # once for all
    if problems:
        raise InputError(*problems)


@command("cell")
def _cell(
    workspace: Path = requests.WORKSPACE,
    *,
    serving: str | None = option("--serve", "By topics of ROS 2 (DDS).", values.one_of("ros2")),
    config: Path | None = option(
        "--config FILE", "Write how `run --robot` reaches it, once it can be reached.", values.path
    ),
    program: Path | None = option("--program FILE", "Begin where this program begins.", values.path),
    faults: Sequence[str] = option(
        "--fault FAULT",
        "Let this happen, at times from the program's first motion: as in `run --sim`, and joints-loss@5, "
        "joints-frozen@5, joints-latency=0.5; repeatable.",
        values.texts("faults such as `slip@lift+0.4`"),
        default=(),
    ),
    domain: int | None = option("--domain", "Of ROS 2; by default a free one.", values.count(0, 232)),
    network: str | None = option(
        "--network NAME", "Interface or address of ROS 2; loopback by default.", values.text("a name")
    ),
    pace: float = option(
        "--pace FACTOR", "How fast its time may pass; 0.1 on a busy computer.", values.number(1e-3, 100.0), default=1.0
    ),
    seed: int = requests.SEED,
) -> None:
    """Serve the simulated cell to other programs: it follows trajectories and publishes joint states and images.

    Runs until Ctrl-C. Its clock is `/clock`, which passes more slowly where this computer is too slow.
    """
    from sqrp_cli.platform.files import check_not_read, check_writable, write_atomically
    from sqrp_cli.run.cell.robot_file import as_yaml
    from sqrp_cli.show.terminal.console import note

    if not serving:
        raise bad_option("--serve is missing; expected ros2", mend=f"sqrp cell {workspace} --serve ros2")
    if faults and program is None:
        raise bad_option("--fault needs --program: its times are those of a program")
    cell = open_with_warnings(workspace, seed)
    opened = None if program is None else read_program(program, seed)

    def check_new() -> None:
        """Raises InputError for a file that is there: it is removed at the end, and may be that of a real robot."""
        if config is not None and (config.exists() or config.is_symlink()):
            message = "this file is there, and --config removes its file at the end"
            mend = "choose another name, or remove it if an earlier `sqrp cell` was killed and left it"
            raise bad_input("would-overwrite", message, Place(config), mend=mend)

    if config is not None:
        check_not_read([config], cell.files)
        check_writable(config)
        check_new()
    joints = tuple(cell.workspace.robot.home) if opened is None else opened.program.joints
    file = _served_as(joints, cell, network, domain)

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
    try:
        with _served(cell, opened, file, faults, note) as server, ExitStack() as leaving:
            if config is not None:
                check_new()  # it may have come while the simulation was made ready
                write_atomically(config, as_yaml(file))
                leaving.callback(config.unlink, missing_ok=True)
            note(f"serving {cell.workspace.name} (domain {file.domain}, {file.network}) until Ctrl-C")
            server.serve(lambda: False, pace)
    except KeyboardInterrupt:
        note("stopped serving")


def _served_as(joints: Sequence[str], cell: OpenCell, network: str | None, domain: int | None) -> RobotFile:
    """How `run --robot` reaches a cell that is served. network: loopback by default.

    domain: of ROS 2; by default ROS_DOMAIN_ID, or the first that no participant on this computer is in, by the first
    port of each.
    """
    import os
    import socket

    from sqrp_cli.field.cell_server import served_file

    named = os.environ.get("ROS_DOMAIN_ID")
    if domain is None and named is not None:
        if not named.isdigit() or int(named) > 232:
            raise bad_option(f"ROS_DOMAIN_ID is `{named}`, expected 0 to 232")
        domain = int(named)
    for free in range(100 if domain is None else 0):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.bind((LOOPBACK, 7400 + 250 * free + 10))
            domain = free
            break
    return served_file(cell.workspace, joints, domain or 0, network or LOOPBACK)


@contextmanager
def _served(
    cell: OpenCell,
    program: OpenProgram | None,
    file: RobotFile,
    faults: Sequence[str],
    tell: Callable[[str], None],
) -> Iterator[CellServer]:
    """A cell that can be reached, and the server that answers. tell: says what happens.

    program: where it starts and what faults are about; None: the cell's home.
    """
    from sqrp_cli.platform.simulator import check_simulator

    check_simulator()
    from sqrp_cli.field.cell_server import CellServer, Faults
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell

    injected = [] if program is None else program.read_faults(faults, "--fault", served=True)
    steps = () if program is None else program.program.steps
    world = steps[0].before if steps else cell.cell.initial_world
    joints = list(file.joints or {}) if program is None else program.program.joints
    from sqrp_cli.ros.dds import DdsTransport
    from sqrp_cli.run.cell.ros_cell import CLOCK

    with closing(DdsTransport(file.domain, file.network)) as transport:
        # Raises InputError where somebody else sends the time: nobody could tell two clocks, and two arms, apart.
        inbox = transport.subscribe(CLOCK)
        transport.wait(LISTENED)
        if inbox.count:
            message = f"somebody else, such as another cell, sends `/clock` {file.where}"
            raise bad_input("no-network", message, mend="--domain N, with another number")
        with SimulatedCell(cell.workspace, world, cell.seed) as simulated:
            simulated.frames(list(cell.workspace.cameras))  # the processes that draw are ready then
            yield CellServer(simulated, cell.workspace, file, transport, Faults(injected, steps, joints), tell)


@command("audit", requests.AuditRequest)
def _audit(
    ask: requests.AuditRequest,
    *,
    program: Path = requests.PROGRAM,
    patch: Path | None = option("--patch FILE", "Write where cameras that have moved are, as a patch.", values.path),
    json: bool = requests.JSON,
) -> ExitCode:
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.platform.simulator import check_packages
    from sqrp_cli.ros.bag import is_bag
    from sqrp_cli.show.terminal.console import note

    if is_bag(program):
        mend = shlex.join(["sqrp", "audit", str(ask.recording), str(program)])
        raise bad_option("this is a recording; expected a program here", Place(program), mend=mend)
    check_packages()
    opened = read_program(program)
    check_outputs({"--patch": patch})
    check_not_read([patch], opened.files)
    found = audited(opened, ask)
    answer(replace(found, written=patch is not None), as_json=json)
    if patch is not None:
        if content := cameras_patch(opened.workspace, found.cameras):
            write_patch(patch, "Cameras as `sqrp audit` found them", content)
            note(f"to have the poses: {to_apply(patch, opened.workspace.whole_file.file)}")
        else:
            note(f"of no camera is it known that it has moved, so {patch} is not written")
    return ExitCode.OK if found.passed else ExitCode.NONE_FEASIBLE


@command("calibrate", requests.CalibrateRequest)
def _calibrate(
    ask: requests.CalibrateRequest,
    *,
    patch: Path | None = option("--patch FILE", "Write a patch of the workspace with the curves.", values.path),
    json: bool = requests.JSON,
) -> None:
    from sqrp_cli.files.yaml_edit import to_apply
    from sqrp_cli.platform.files import check_not_read
    from sqrp_cli.show.terminal.console import note

    check_outputs({"--patch": patch})
    found = learned(ask)
    if patch is not None:
        check_not_read([patch], found.cell.files)
        write_patch(patch, "Curves that `sqrp calibrate` found", found.patch)
        note(f"to have the curves: {to_apply(patch, found.cell.workspace.whole_file.file)}")
    answer(found, as_json=json)
