"""`sqrp run`: a program in the simulated cell, watched by its cameras."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sqrp_cli.cli.options import Json, Report, Seed
from sqrp_cli.cli.run_once import Kept, run_once
from sqrp_cli.cli.run_replay import run_replay
from sqrp_cli.cli.slip_sweep import sweep_slips
from sqrp_cli.errors import ExitCode, InputError, Place, Problem

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sqrp_cli.knowledge.workspace.workspace import Workspace
    from sqrp_cli.program.record import Program
    from sqrp_cli.runtime.run.simulation import Simulation

NAME = "run"

DEFAULT_RUNS = 20
"""Runs of a sweep."""

_FORMS = (
    "slip@a4+0.4, slip@a4:random, slip@7.2, miss-pick, camera-loss:cam2@5, frozen:cam1@3, latency:cam3=0.5, "
    "perception-crash:cam1@4, 2:slip@a4 in step 2"
)


def command(
    context: typer.Context,
    program: Annotated[Path | None, typer.Argument(metavar="PROGRAM", help="A program that `sqrp rank` wrote.")] = None,
    sim: Annotated[bool, typer.Option("--sim", help="Run it in the simulated cell.")] = False,
    fault: Annotated[list[str] | None, typer.Option("--fault", help=f"Let this happen: {_FORMS}; repeatable.")] = None,
    sweep: Annotated[
        str | None,
        typer.Option("--sweep", metavar="[STEP:]slip@PRIMITIVE", help="Many runs, with a slip at other instants."),
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
    from sqrp_cli.platform.files import check_distinct, check_not_read

    kept = Kept(record, log, frames)
    _check_options(replay, sweep, n, fault, kept, report)
    check_distinct({"--record": record, "--log": log, "--report": report})
    if report is not None:
        from sqrp_cli.report.pages.candidate_page import check_report

        check_report(report)
    if replay is not None:
        return run_replay(replay, program, report, context.obj, as_json=as_json)
    if program is None:
        raise InputError(Problem("no-program", "expected a program to run", mend="sqrp run PROGRAM --sim"))
    simulation = _open(program, sim=sim, seed=seed)
    if sweep is not None:
        return sweep_slips(simulation, sweep, n or DEFAULT_RUNS, as_json=as_json)
    check_not_read([record, log, report], [program, *(file.path for file in simulation.workspace.files.values())])
    return run_once(simulation, fault or [], kept, report, context.obj, as_json=as_json)


def _check_options(
    replay: Path | None, sweep: str | None, n: int | None, fault: list[str] | None, kept: Kept, report: Path | None
) -> None:
    """Raises InputError for options that do not go together, and for a film that is no film."""
    files = {"--record": kept.record, "--log": kept.log, "--frames": kept.frames}
    if replay is not None:
        _refuse_with("--replay", {"--fault": fault, "--sweep": sweep, "--n": n, **files})
    if sweep is not None:
        _refuse_with("--sweep", {"--fault": fault, "--report": report, **files})
    elif n is not None:
        raise InputError(Problem("bad-option", "--n is about --sweep, which is missing"))
    if kept.record is not None and kept.record.suffix.lower() != ".mp4":
        message = f"--record is `{kept.record}`; expected a name that ends in .mp4"
        raise InputError(Problem("bad-option", message))
    if kept.record is not None and not _is_text(kept.record):
        message = f"--record is `{kept.record}`, which is not UTF-8 text; films are written by a library that needs it"
        raise InputError(Problem("bad-option", message))


def _is_text(path: Path) -> bool:
    """Whether the bytes of a path are UTF-8."""
    return str(path) == str(path).encode(errors="ignore").decode()


def _refuse_with(option: str, others: Mapping[str, object]) -> None:
    """Raises InputError where an option is given together with one that it leaves no room for."""
    for name, value in others.items():
        if value:
            raise InputError(Problem("bad-option", f"{option} and {name} exclude each other; give one of them"))


def _open(path: Path, *, sim: bool, seed: int) -> Simulation:
    """The program with its workspace. Raises InputError where it cannot be run."""
    from sqrp_cli.cli.lazy_replanner import LazyReplanner
    from sqrp_cli.cli.program_input import open_program
    from sqrp_cli.runtime.cell.requirements import check_simulator

    program, workspace = open_program(path)
    if not sim:
        message = "there is no driver for a real robot yet"
        raise InputError(Problem("no-driver", message, mend=f"sqrp run {path} --sim"))
    check_simulator()
    from sqrp_cli.runtime.run.simulation import Simulation

    _warn_of_contradictions(program, workspace, path)
    return Simulation(program, workspace, LazyReplanner(workspace), seed)


def _warn_of_contradictions(program: Program, workspace: Workspace, path: Path) -> None:
    """Tell of formulas about which monitors can say nothing, as the motion itself contradicts them."""
    from sqrp_cli.report.sentences import short_times
    from sqrp_cli.runtime.monitor.plan_check import contradictions
    from sqrp_cli.runtime.twin import Twin
    from sqrp_cli.terminal.console import print_problems

    mend = "correct the formula, or the boxes of its literals: one about an object holds while that is in its boxes"
    print_problems(
        [
            Problem("against-the-plan", short_times(text), Place(path), severity="warning", mend=mend)
            for text in contradictions(program, Twin.load(workspace.robot))
        ]
    )
