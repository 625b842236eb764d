"""`sqrp studio`: a live page of a cell."""

from __future__ import annotations

import sys
from typing import Any

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.request import argument, option
from sqrp_cli.ask.values import FLAG
from sqrp_cli.cli.command import command_of
from sqrp_cli.cli.options import open_with_warnings
from sqrp_cli.errors import ExitCode, bad_option

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
    """Show the page until Ctrl-C. Raises InputError where the workspace has no skill, or no such task."""
    import asyncio
    import threading
    import webbrowser

    from sqrp_cli.show.pages.assembly import check_libraries
    from sqrp_cli.show.terminal.console import note, say_raw
    from sqrp_cli.studio.rankings import WorkerProcess
    from sqrp_cli.studio.server import check_server

    def ready(address: str) -> None:
        say_raw(address)
        sys.stdout.flush()
        note("the studio is at this address; Ctrl-C closes it")
        if not ask.no_browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()  # w3m would stay

    check_server()
    check_libraries()
    worker = WorkerProcess(ask.workspace, ask.seed, ask.jobs)  # loads libraries while this one reads the workspace
    try:
        opened = open_with_warnings(ask.workspace, ask.seed)
        from sqrp_cli.studio.session import Studio
        from sqrp_cli.task.task import read_task

        known = opened.workspace
        if ask.task is None and not known.tasks and not known.skills:
            message = "the workspace has no skills, so there is nothing to rank"
            raise bad_option(message, known.whole_file, mend="list some under `skills`")
        task = ask.task or next((one.task for one in known.tasks), next(iter(known.skills), ""))
        read_task(task, known)
        studio = Studio(opened, task, ask.jobs, worker)
        try:
            asyncio.run(studio.run(ask.port, ready))
        except KeyboardInterrupt:
            note("closed")
        finally:
            studio.close()
    finally:
        worker.close()
    return ExitCode.OK


command = command_of(StudioCommand, studio)
