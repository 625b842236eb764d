"""The steps of a program as a table."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

from sqrp_cli.knowledge.workspace.load import shortest_path, workspace_name
from sqrp_cli.program.file import workspace_path
from sqrp_cli.program.joint_trajectory import tool_commands
from sqrp_cli.program.record import Program, Step, Totals
from sqrp_cli.terminal.console import Cell, Column, Share, Styled, joined, plain, print_table, say, say_command


def print_program(program: Program, file: Path) -> None:
    """A row per step, the totals, the tool's actions with their times, and how to go on."""
    count = len(program.steps)
    totals = Totals.of(program)
    workspace = workspace_path(program, file)
    steps = f"{count} step{'s' * (count != 1)}"
    length = f", {totals.time:.2f} s" if count else ""
    say(joined([(file.name, "bold"), f" for {workspace_name(workspace)}: {steps}{length}\n"]))
    if count:
        _print_steps(program, totals)
        _print_tool(program)
    held = program.steps[-1].after.held if count else None
    if held is not None:
        say(f"It leaves {held} in the tool.")
    asked = shlex.quote(os.path.relpath(shortest_path(workspace)))
    command = f"sqrp rank {asked} TASK --program {shlex.quote(str(file))}"
    say_command("To add a step:", command, "dim")


def _print_steps(program: Program, totals: Totals) -> None:
    columns = [Column("#"), Column("step", shrink=True)]
    columns += [Column(title, right=True) for title in ("start\n[s]", "time\n[s]")]
    columns += [Column("Q_eoi [%]", right=True), Column("Q_avg [%]", right=True)]
    columns += [Column("slowest\nalarm [s]", right=True)]
    rows: list[list[Cell]] = []
    start = 0.0
    for number, step in enumerate(program.steps, 1):
        figures = [Share(step.q_eoi), Share(step.q_avg), _worst(step)]
        rows.append([str(number), step.short_task, f"{start:.2f}", f"{step.time:.2f}", *figures])
        start += step.time
    worst = "-" if totals.worst is None else f"{totals.worst.seconds:.2f}"
    rows.append(["", "in all", "", f"{totals.time:.2f}", Share(totals.q_eoi), Share(totals.q_avg), worst])
    print_table(columns, rows)
    say()
    if totals.worst is not None:
        worst_step = program.steps[totals.worst.step - 1]
        say(
            f"At worst {totals.worst.fault} in step {totals.worst.step}, {worst_step.short_task}, is noticed after "
            f"{totals.worst.seconds:.2f} s. Q in all is weighted with the time of the steps."
        )


def _worst(step: Step) -> Styled:
    if not step.faults:
        return plain("-", "dim")
    unseen = any(fault.unseen > 0 for fault in step.faults.values())
    return plain(f"{max(fault.delay_worst for fault in step.faults.values()):.2f}", "red" if unseen else "")


def _print_tool(program: Program) -> None:
    commands = tool_commands(program)
    if commands:
        say("\nWhat the tool has to do:\n")
        columns = [Column("step"), Column("tool"), *(Column(title, right=True) for title in ("from [s]", "to [s]"))]
        print_table(columns, [(str(c.step), str(c), f"{c.start:.2f}", f"{c.end:.2f}") for c in commands])
        say()
