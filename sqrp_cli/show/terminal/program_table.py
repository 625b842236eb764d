"""The steps of a program as a table."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from sqrp_cli.figures import FaultMetrics
from sqrp_cli.show.documents.programs import ProgramDocument
from sqrp_cli.show.terminal.console import (
    Cell,
    Column,
    Share,
    Styled,
    joined,
    numbers,
    plain,
    print_table,
    say,
    say_command,
)


def print_program(found: ProgramDocument) -> None:
    """A row per step, the totals, the tool's actions with their times, and how to go on."""
    count, total = len(found.steps), found.total
    length = f", {total.time:.2f} s" if count else ""
    say(
        joined(
            [(Path(found.program).name, "bold"), f" for {found.workspace}: {count} step{'s' * (count != 1)}{length}\n"]
        )
    )
    if count:
        titles = ("start\n[s]", "time\n[s]", "Q_eoi [%]", "Q_avg [%]", "slowest\nalarm [s]")
        rows: list[list[Cell]] = []
        for number, step in enumerate(found.steps, 1):
            figures = [Share(step.q_eoi), Share(step.q_avg), _slowest(step.faults.values())]
            rows.append([str(number), step.label, f"{step.start:.2f}", f"{step.time:.2f}", *figures])
        faults = _slowest([fault for step in found.steps for fault in step.faults.values()])
        rows.append(["", "in all", "", f"{total.time:.2f}", Share(total.q_eoi), Share(total.q_avg), faults])
        print_table([Column("#"), Column("step", shrink=True), *numbers(*titles)], rows)
        say()
        for number, step in enumerate(found.steps, 1):
            for name, fault in step.faults.items():
                if fault.unseen:
                    when = "of the times at which it may happen, as no image is sure to show it"
                    at = f"step {number}, {step.label}, at {100 * fault.unseen:.3g} %"
                    say(f"No alarm tells of {name} in {at} {when}.")
        if total.step is not None:
            slowest = (
                f"At worst {total.fault} in step {total.step}, {found.steps[total.step - 1].label}, is noticed after "
            )
            alarm = "" if total.delay_worst is None else f"{slowest}{total.delay_worst:.2f} s. "
            say(f"{alarm}Q in all is weighted with the time of the steps.")
        if found.tool:
            say("\nWhat the tool has to do:\n")
            columns = [Column("step"), Column("tool"), *numbers("from [s]", "to [s]")]
            print_table(columns, [(str(c.step), str(c), f"{c.start:.2f}", f"{c.end:.2f}") for c in found.tool])
            say()
    if found.held is not None:
        say(f"It leaves {found.held} in the tool.")
    if found.add is not None:
        say_command("To add a step:", found.add, "dim")


def _slowest(faults: Collection[FaultMetrics]) -> Styled:
    """The longest time until an alarm; never where no image is sure to show a fault."""
    delays = [fault.delay_worst for fault in faults]
    if not delays:
        return plain("-", "dim")
    known = [delay for delay in delays if delay is not None]
    return plain("never", "red") if len(known) < len(delays) else f"{max(known):.2f}"
