"""The steps of a program as a table."""

from __future__ import annotations

import os
import shlex
from collections.abc import Collection
from pathlib import Path

from sqrp_cli.figures import FaultMetrics
from sqrp_cli.knowledge.workspace.workspace_file import shortest_path, workspace_name
from sqrp_cli.program.file import workspace_path
from sqrp_cli.program.joint_trajectory import tool_commands
from sqrp_cli.program.record import Program, Totals
from sqrp_cli.terminal.console import Cell, Column, Share, Styled, joined, numbers, plain, print_table, say, say_command

"""Shares of times up to this are rounded from none."""


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
        commands = tool_commands(program)
        if commands:
            say("\nWhat the tool has to do:\n")
            columns = [Column("step"), Column("tool"), *numbers("from [s]", "to [s]")]
            print_table(columns, [(str(c.step), str(c), f"{c.start:.2f}", f"{c.end:.2f}") for c in commands])
            say()
    held = program.steps[-1].after.held if count else None
    if held is not None:
        say(f"It leaves {held} in the tool.")
    if workspace.exists():
        asked = shlex.quote(os.path.relpath(shortest_path(workspace)))
        command = f"sqrp rank {asked} TASK --program {shlex.quote(str(file))}"
        say_command("To add a step:", command, "dim")


def _print_steps(program: Program, totals: Totals) -> None:
    titles = ("start\n[s]", "time\n[s]", "Q_eoi [%]", "Q_avg [%]", "slowest\nalarm [s]")
    columns = [Column("#"), Column("step", shrink=True), *numbers(*titles)]
    rows: list[list[Cell]] = []
    start = 0.0
    for number, step in enumerate(program.steps, 1):
        figures = [Share(step.q_eoi), Share(step.q_avg), _slowest(step.faults.values())]
        rows.append([str(number), step.short_task, f"{start:.2f}", f"{step.time:.2f}", *figures])
        start += step.time
    faults = [fault for step in program.steps for fault in step.faults.values()]
    rows.append(["", "in all", "", f"{totals.time:.2f}", Share(totals.q_eoi), Share(totals.q_avg), _slowest(faults)])
    print_table(columns, rows)
    say()
    for number, step in enumerate(program.steps, 1):
        for fault, found in step.faults.items():
            if found.unseen:
                share = (
                    f"{100 * found.unseen:.3g} % of the times at which it may happen, as no image is sure to show it"
                )
                say(f"No alarm tells of {fault} in step {number}, {step.short_task}, at {share}.")
    if totals.worst is not None:
        worst, worst_step = totals.worst, program.steps[totals.worst.step - 1]
        slowest = f"At worst {worst.fault} in step {worst.step}, {worst_step.short_task}, is noticed after "
        alarm = "" if worst.seconds is None else f"{slowest}{worst.seconds:.2f} s. "
        say(f"{alarm}Q in all is weighted with the time of the steps.")


def _slowest(faults: Collection[FaultMetrics]) -> Styled:
    """The longest time until an alarm; never where no image is sure to show a fault."""
    delays = [fault.delay_worst for fault in faults]
    if not delays:
        return plain("-", "dim")
    known = [delay for delay in delays if delay is not None]
    return plain("never", "red") if len(known) < len(delays) else f"{max(known):.2f}"
