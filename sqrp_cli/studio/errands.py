"""What takes longer than an answer: one job at a time, of which browsers are told what it reports."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from typing import Any

from sqrp_cli.errors import InputError, Problem
from sqrp_cli.studio.jobs import TOO_LATE, Job, Offer, Report, Running
from sqrp_cli.studio.messages import kind_of, message
from sqrp_cli.studio.server import Live

PASSING = ("run-image", "run-state", "run-evidence", "searching")
"""Reports that the next ones replace."""


class Errands:
    """The job under way, and what was found."""

    def __init__(self, live: Live, dropped: Callable[[dict[str, Any]], None]) -> None:
        """dropped: called with the report that a part was dropped."""
        self._live, self._dropped = live, dropped
        self._running: Running | None = None
        self.offers: Sequence[Offer] = ()
        """The changes that can be applied."""

    def begin(self, job: Job) -> None:
        """Start a job instead of the one that is under way."""
        self.stop()
        self._live.forget("run-began", "run-ended", "written", "refused")
        self.forget_offers()
        self._running = Running(job)
        asyncio.get_running_loop().add_reader(self._running.pipe.fileno(), self._reported)

    def stop(self) -> None:
        """End the job under way, in the loop that serves browsers."""
        if self._running is not None:
            asyncio.get_running_loop().remove_reader(self._running.pipe.fileno())
            self.end()
            self._live.tell(message("job-ended"))

    def end(self) -> None:
        """End the job under way, once nobody is told any more."""
        if self._running is not None:
            self._running.end()
            self._running = None

    def drop(self) -> None:
        """Drop what the tool holds in the run under way. Raises InputError where that is over."""
        if self._running is None or not self._running.drop():
            raise InputError(Problem("bad-fault", f"nothing was dropped: {TOO_LATE}"))

    def forget_offers(self) -> None:
        """Offer nothing any more."""
        self.offers = ()
        self._live.forget("offers")

    def _reported(self) -> None:
        assert self._running is not None  # noqa: S101 - its pipe is read
        try:
            report: Report = self._running.pipe.recv()
        except (EOFError, OSError):
            self.stop()
            return
        do = kind_of(report.text)
        if do == "offers":
            self.offers = report.offers
        if do == "run-fault":
            self._dropped(json.loads(report.text))
        if do in ("offers", "run-began", "run-ended"):
            self._live.post(do, report.text)
        else:
            self._live.tell(report.text, passing=do in PASSING)
