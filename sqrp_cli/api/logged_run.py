"""A run from its log: to show again, and to write its page."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.ask import values
from sqrp_cli.errors import InputError, Place, bad_input

if TYPE_CHECKING:
    from sqrp_cli.api.program import OpenProgram
    from sqrp_cli.api.run_results import SimulatedRun
    from sqrp_cli.report.pages.run_page import RunCell
    from sqrp_cli.runtime.record.events import Event, RunBegan


def read_run(log: str | Path) -> SimulatedRun:
    """A run read from its log. Raises InputError for anything but the log of a complete run."""
    logged = LoggedRun.read(values.PATH.read(log, "log"))
    if (run := logged.replay()) is None:
        raise logged.no_report
    return run


@dataclass(frozen=True, eq=False)
class LoggedRun:
    """The log of a run; its header is read."""

    log: Path
    header: RunBegan
    events: Iterator[Event]
    """The rest of it, which can be read once."""
    program: OpenProgram | None = None
    """The program that was run; it knows where everything stands."""

    @classmethod
    def read(cls, log: Path) -> LoggedRun:
        """Raises InputError for anything but a log."""
        from sqrp_cli.runtime.record.events import RunBegan
        from sqrp_cli.runtime.record.log import read_log

        events = read_log(log)
        header = next(events)
        assert isinstance(header, RunBegan)  # noqa: S101 - as `read_log` makes sure
        return cls(log, header, events)

    def of(self, opened: OpenProgram) -> LoggedRun:
        """The same with its program. Raises InputError for one whose steps are not those of the log."""
        if self.header.steps:
            opened.check_ran(self.header.steps, "this log is", Place(self.log, 1), self._replay)
        return replace(self, program=opened)

    def replay(self, *listeners: Callable[[Event], None]) -> SimulatedRun | None:
        """The run, None if it was interrupted; listeners: called with each event."""
        from sqrp_cli.api.run_results import SimulatedRun
        from sqrp_cli.runtime.record.events import RunReported

        report, kept = None, []
        for event in self.events:
            if isinstance(event, RunReported):
                report = event.report
                continue
            kept.append(event)
            for listener in listeners:
                listener(event)
        if report is None:
            return None
        inputs = [self.log, *([] if self.program is None else self.program.files)]
        return SimulatedRun(cell=self.cell, report=report, events=kept, inputs=inputs)

    @property
    def no_report(self) -> InputError:
        """The error where a run that was interrupted is not enough."""
        message = "this log ends without a report, as the run was interrupted; expected one of a run that ended"
        return bad_input("no-log", message, Place(self.log), mend=self._replay)

    @property
    def _replay(self) -> str:
        """The command that shows the run without its program."""
        return shlex.join(["sqrp", "run", "--replay", str(self.log)])

    @property
    def cell(self) -> RunCell:
        """The cell of the log; without its workspace if that has changed since."""
        from sqrp_cli.report.pages.run_page import RunCell

        header, workspace = self.header, None if self.program is None else self.program.workspace
        why_flat = ""
        if workspace is None:
            mend = "sqrp run PROGRAM --replay LOG --report FILE"
            why_flat = f"a log has no shapes; `{mend}` takes them from the workspace"
        elif workspace.name != header.workspace:
            why_flat = f"this program is for the workspace {workspace.name}, the run was in {header.workspace}"
        elif header.digest not in (workspace.digest, workspace.file_digest):
            why_flat = "the workspace of this program is not as it was in the run"
        return RunCell(header.workspace, header.cameras, header.digest, None if why_flat else workspace, why_flat)
