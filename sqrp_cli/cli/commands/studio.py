"""`sqrp studio`: a live page of a cell."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import argument, option
from sqrp_cli.ask.values import FLAG
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import open_with_warnings
from sqrp_cli.errors import ExitCode, bad_option

if TYPE_CHECKING:
    from sqrp_cli.api.cell import OpenCell
    from sqrp_cli.studio.rankings import WorkerProcess

NAME = "studio"


class StudioCommand(requests.Worked, requests.Seeded, requests.CellCommand):
    """Open a live page of a cell: move cameras, parts and the robot, and see what that changes.

    The page is for this machine only. Ctrl-C closes it; what was not saved is lost.
    """

    task: str | None = argument(
        "TASK", "The first that the workspace lists by default.", requests.TASK, default=None, complete="tasks"
    )
    port: int = option("--port", "By default one that is free.", values.count(0, 65535), default=0, metavar="N")
    no_browser: bool = option("--no-browser", "Open no browser, only print the address.", FLAG, default=False)


def studio(_context: Any, ask: StudioCommand) -> ExitCode:  # noqa: ANN401 - Typer's context
    """Show the page until Ctrl-C."""
    from sqrp_cli.report.pages.assembly import check_libraries
    from sqrp_cli.studio.rankings import WorkerProcess
    from sqrp_cli.studio.server import check_server

    check_server()
    check_libraries()
    worker = WorkerProcess(ask.workspace, ask.seed, ask.jobs)  # loads libraries while this one reads the workspace
    try:
        opened = open_with_warnings(ask.workspace, ask.seed)
        # The task to begin with. Raises InputError for one that cannot be read.
        task = ask.task
        from sqrp_cli.programming.task import read_task

        task = task or _first_task(opened)
        read_task(task, opened.workspace)
        return _serve(opened, task, worker, ask.port, ask.jobs, show=not ask.no_browser)
    finally:
        worker.close()


def _first_task(opened: OpenCell) -> str:
    """A task to begin with. Raises InputError where the workspace has no skill."""
    known = opened.workspace
    if known.tasks:
        return known.tasks[0].task
    if not known.skills:
        message = "the workspace has no skills, so there is nothing to rank"
        raise bad_option(message, known.whole_file, mend="list some under `skills`")
    return next(iter(known.skills))


def _serve(opened: OpenCell, task: str, worker: WorkerProcess, port: int, jobs: int, *, show: bool) -> ExitCode:
    """Show the page until Ctrl-C."""
    import asyncio
    import threading
    import webbrowser

    from sqrp_cli.studio.session import Studio
    from sqrp_cli.terminal.console import note, say_raw

    def ready(address: str) -> None:
        say_raw(address)
        sys.stdout.flush()
        note("the studio is at this address; Ctrl-C closes it")
        if show:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()  # w3m would stay

    studio = Studio(opened, task, jobs, worker)
    try:
        asyncio.run(studio.run(port, ready))
    except KeyboardInterrupt:
        note("closed")
    finally:
        studio.close()
    return ExitCode.OK


command = command_of(StudioCommand, studio)
