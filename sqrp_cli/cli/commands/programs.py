"""The steps of a program, its export for a real arm, and its making at a terminal: `program`."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.options import answer, check_excluded, check_needed, check_outputs
from sqrp_cli.errors import ExitCode, InputError, Place, Problem, bad_input, bad_option, nearest

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.program.record import Program

NEW = "new"  # given instead of a file, it makes a new program in questions and answers
DEFAULT_RATE = 100.0  # points per second of an export [Hz]


@command("program")
def _program(
    file: Path = argument("PROGRAM|new", "A program file, or `new` to make one.", values.path),
    workspace: Path | None = argument(
        "WORKSPACE", "With `new`: the workspace to make it for.", values.path, default=None
    ),
    *,
    drop_last: bool = flag("--drop-last", "Take the last step back."),
    export: Path | None = option(
        "--export OUT",
        "Write the joint trajectory (*.csv, *.yaml for ROS JointTrajectory) or all that is planned (*.mcap, *.bag for "
        "ROS 1).",
        values.path,
    ),
    rate: float | None = option("--rate HZ", "Points per second of the export; 100 by default.", values.rate),
    json: bool = requests.JSON,
) -> ExitCode:
    """List the steps of a program and what they add up to.

    `sqrp program new WORKSPACE` makes a program in questions and answers: what can be done now, how well each way is
    seen, which one to take.
    """
    if str(file) == NEW:
        from sqrp_cli.cli.commands.program_new import make_program

        if workspace is None or drop_last or export is not None or rate is not None or json:
            raise bad_option("`sqrp program new` takes a workspace and nothing else", mend="sqrp program new WORKSPACE")
        return make_program(workspace)
    if workspace is not None:
        mend = f"sqrp program {file}"
        if not file.exists() and nearest(str(file), [NEW]):
            mend = f"sqrp program {NEW} {shlex.quote(str(workspace))}"
        raise bad_option(f"one program at a time: found {file} and {workspace}", mend=mend)
    check_excluded("--drop-last", drop_last, {"--export": export})
    check_needed("--export", export, {"--rate": rate})
    from sqrp_cli.program.file import load_program, made_for, save_program
    from sqrp_cli.show.documents.programs import ProgramDocument
    from sqrp_cli.show.terminal.console import note, print_problems

    notes = []
    found = load_program(file)
    cell, doubts = _judged(found, file)
    if (drop_last or export is not None) and doubts:
        raise InputError(*(replace(doubt, severity="error") for doubt in doubts))
    if drop_last and cell is not None:
        if not found.steps:
            raise bad_input("no-steps", "this program has no step that could be dropped", Place(file))
        notes.append(f"dropped step {len(found.steps)}, {found.steps[-1].short_task}, from {file}")
        found = made_for(found.model_copy(update={"steps": found.steps[:-1]}), file, cell)
        save_program(found, file)
    if export is not None and cell is not None:
        notes.append(_export(found, cell, file, export, rate or DEFAULT_RATE))
    print_problems(doubts)
    answer(ProgramDocument.of(found, file, stale=bool(doubts)), as_json=json)
    for text in notes:
        note(text)
    return ExitCode.OK


def _judged(program: Program, file: Path) -> tuple[Workspace | None, list[Problem]]:
    """The program's workspace, and why the program is not reliable: the workspace has changed, or is missing."""
    from sqrp_cli.cell.load import load_workspace
    from sqrp_cli.program.file import check_program, check_unedited, find_workspace, stale

    try:
        workspace = load_workspace(find_workspace(program, file))
    except InputError as error:
        check_unedited(program, file)
        message = f"its workspace cannot be read, so whether it still holds is not known: {error.problems[0]}"
        return None, [Problem("no-workspace", message, Place(file), severity="warning", mend=error.problems[0].mend)]
    doubt = stale(program, file, workspace)
    if doubt is not None:
        check_unedited(program, file)
        return workspace, [replace(doubt, severity="warning")]
    check_program(program, file, workspace)
    return workspace, []


def _export(program: Program, workspace: Workspace, file: Path, target: Path, rate: float) -> str:
    """Write the joint trajectory, for ROS without the fingers, which have their own controller; says so."""
    from sqrp_cli.platform.files import check_not_read, write_atomically
    from sqrp_cli.program.joint_trajectory import FORMATS
    from sqrp_cli.ros.bag import SUFFIXES

    suffix = target.suffix.lower()
    if suffix not in (*FORMATS, *SUFFIXES):
        message = f"--export is `{target}`; expected a name that ends in .csv, or in .yaml, .mcap or .bag for ROS"
        raise bad_option(message)
    if not program.steps:
        raise bad_input("no-steps", "this program has no steps, so there is nothing to export", Place(file))
    check_outputs({"--export": target})
    check_not_read([target], [file, *(one.path for one in workspace.files.values())])
    if suffix in SUFFIXES:
        from sqrp_cli.platform.simulator import check_packages

        check_packages()
        from sqrp_cli.run.ground_truth import write_planned_run

        write_planned_run(target, program, workspace)
        return f"{target} has the planned motion, frames, boxes and what is promised to be seen; open it in Foxglove"
    joints = program.joints
    if suffix != ".csv":
        joints = tuple(joint for joint in program.joints if joint in workspace.robot.home)
    write_atomically(target, FORMATS[suffix](program, joints, rate))
    return f"{target} has a point every {1 / rate:g} s and at both ends of each primitive action"
