"""Runs as Python has them: the document with all that happened."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import values
from sqrp_cli.document import live
from sqrp_cli.records import dataclass
from sqrp_cli.run.record.report import RunReport

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import RunRequest
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.run.record.events import Event


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedRun(RunReport):
    """How a run of a program went.

    began: how a log of it begins. drawn: the workspace, if its files are at hand; else why_flat: why pages show no
    shapes. events: what happened, in order. never_happened: faults that did not. inputs: the files that it was read
    from, over which no page is written. asked: what it was kept in, among others.
    """

    began: Event = live()
    drawn: Workspace | None = live()
    why_flat: str = live("")
    events: Sequence[Event] = live()
    never_happened: Sequence[str] = live()
    inputs: Sequence[Path] = live()
    asked: RunRequest = live()

    def write_page(self, path: str | Path, arguments: Sequence[str] = ()) -> None:
        """Write a page that plays the run; arguments: of the command that it names.

        Raises InputError if it cannot be written, or would replace a file that the run read or wrote.
        """
        from sqrp_cli.show.pages.run_page import write_run

        file = values.path.read(path, "path")
        values.texts("the words of a command, in a list").read(arguments, "arguments")
        self.asked.check_outputs(self.inputs, file)
        write_run(self.began, self, self.events, file, arguments, self.drawn, self.why_flat)
