"""A workspace as it stands, and what its files may say: `show`, `set`, `studio`, `rules`, `schema` and `init`."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from sqrp_cli.ask import requests, values
from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.new_cell import made
from sqrp_cli.ask.api.results import is_result, read_result
from sqrp_cli.ask.request import argument, flag, option
from sqrp_cli.cli.command import command
from sqrp_cli.cli.options import answer, check_excluded, check_needed, open_with_warnings, print_warnings
from sqrp_cli.errors import ExitCode, bad_input, bad_option, expected_names


@command("show")
def _show(
    workspace: Path = argument(
        "WORKSPACE", "Folder of a workspace, its YAML file, or what a command wrote with --json.", values.path
    ),
    *,
    json: bool = requests.JSON,
) -> None:
    """Show how a workspace is understood, or the table of a saved result.

    Of a workspace: robot, cameras, objects, skills and state, with every path and pose resolved.
    """
    if is_result(workspace):
        answer(read_result(workspace), as_json=json)
        return
    from sqrp_cli.checks.cell_warnings import cell_warnings
    from sqrp_cli.show.terminal.console import print_problems

    cell = OpenCell.read(workspace)
    print_problems((*(one for one in cell.findings if one.severity == "warning"), *cell_warnings(cell.cell)))
    answer(cell.scene(), as_json=json)


@command("set")
def _set(
    workspace: Path = requests.WORKSPACE,
    stated: Sequence[str] = argument(
        "PATH=VALUE...", "Values by dotted path, such as cameras.cam1.rate=20.", values.texts("values by their paths")
    ),
) -> None:
    """Set values of a workspace file by their paths, as the studio does. Comments and layout stay.

    Nothing is written where the result would be no workspace.
    """
    from sqrp_cli.cell.workspace_file import read_workspace_document, replace_workspace, workspace_file
    from sqrp_cli.files.yaml_edit import with_values
    from sqrp_cli.show.terminal.console import note
    from sqrp_cli.task.task import impossible_tasks

    file = workspace_file(workspace)
    document = read_workspace_document(file)
    said: dict[str, str] = {}
    for text in stated:
        path, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not path:
            raise bad_option(f"found `{text}`, expected PATH=VALUE, such as cameras.cam1.rate=20")
        if path in said:
            raise bad_option(f"`{path}` is set twice; give one value")
        said[path] = value
    content = with_values(document, said)
    if content == document.content:
        note(f"{file} says so already; nothing was written")
        return
    opened = OpenCell.read(workspace, 0, content)
    print_warnings((*opened.findings, *impossible_tasks(opened.workspace)))
    replace_workspace(document, content)
    note(f"{file} is written")


@command("studio")
def _studio(
    workspace: Path = requests.WORKSPACE,
    task: str | None = argument(
        "TASK", "The first that the workspace lists by default.", requests.TASK, default=None, complete="tasks"
    ),
    *,
    port: int = option("--port", "By default one that is free.", values.count(0, 65535), default=0),
    no_browser: bool = flag("--no-browser", "Open no browser, only print the address."),
    jobs: int = requests.JOBS,
    seed: int = requests.SEED,
) -> None:
    """Open a live page of a cell: move cameras, parts and the robot, and see what that changes.

    The page is for this machine only. Ctrl-C closes it; what was not saved is lost.
    """
    import asyncio
    import threading
    import webbrowser

    from sqrp_cli.platform.interrupts import interrupts_later
    from sqrp_cli.show.pages.assembly import check_libraries
    from sqrp_cli.show.terminal.console import note, say_raw
    from sqrp_cli.studio.rankings import WorkerProcess
    from sqrp_cli.studio.server import check_server

    def ready(address: str) -> None:
        say_raw(address)
        sys.stdout.flush()
        note("the studio is at this address; Ctrl-C closes it")
        if not no_browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()  # w3m would stay

    check_server()
    check_libraries()
    with closing(WorkerProcess(workspace, seed, jobs)) as worker:  # loads libraries while this one reads the workspace
        opened = open_with_warnings(workspace, seed)
        from sqrp_cli.studio.session import Studio
        from sqrp_cli.task.task import read_task

        known = opened.workspace
        tasks = [*(one.task for one in known.tasks), *known.skills, *known.recordings]
        if task is None and not tasks:
            message = "the workspace has no skills, so there is nothing to rank"
            raise bad_option(message, known.whole_file, mend="list some under `skills`")
        task = task or tasks[0]
        read_task(task, known)
        studio = Studio(opened, task, jobs, worker)
        try:
            # An exception inside a callback of a library might be lost, and the studio would go on.
            with interrupts_later(second_raises=True) as closed:
                asyncio.run(studio.run(port, ready, closed))
        except KeyboardInterrupt:
            note("closed")
        finally:
            studio.under_way.end()


@command("rules")
def _rules(
    code: str | None = argument(
        "CODE",
        "A finding, such as wrong-unit; all of them unless given.",
        values.text("a code"),
        default=None,
        complete="codes",
    ),
    *,
    json: bool = requests.JSON,
) -> None:
    """List all findings: their codes, what each looks for, and why.

    With CODE, show one finding in full, with an example that passes and one that fails.
    """
    from sqrp_cli.checks.registry import rules
    from sqrp_cli.show.documents.checks import RulesDocument

    if code is not None and code not in rules():
        raise bad_input("unknown-rule", f"there is no finding `{code}`; {expected_names(code, rules())}")
    answer(RulesDocument(rules=list(rules().values()) if code is None else [rules()[code]]), as_json=json)


@command("schema")
def _schema(
    name: str = argument(
        "NAME",
        "workspace, skill, mounts (place.yaml), robot (run --robot), for files; log, for a line of the file of run "
        "--log; or a command, such as rank, for its --json.",
        values.text("a name"),
        default="workspace",
        complete="schemas",
    ),
    *,
    _as_always: bool = flag("--json", "Print one JSON document and nothing else, as always."),
) -> None:
    """Print the JSON Schema of a file, or of what a command prints with --json.

    Editors complete and check files with it, programs read documents with it.
    """
    import json

    from sqrp_cli.show.documents.schemas import schema_of
    from sqrp_cli.show.terminal.console import say_raw

    say_raw(json.dumps(schema_of(name), indent=2))


@command("init", requests.InitRequest)
def _init(ask: requests.InitRequest, *, json: bool = requests.JSON) -> ExitCode:
    from sqrp_cli.cell.workspace_file import WORKSPACE_FILE
    from sqrp_cli.show.terminal.console import note, print_problems

    # The folder and the arguments of a xacro come in any order.
    words = [str(ask.folder), *(ask.arguments or ())]
    given = dict(word.split(":=", 1) for word in words if ":=" in word)
    folders = [word for word in words if ":=" not in word]
    if len(folders) != 1:
        named = ", ".join(f"`{word}`" for word in folders) or "none"
        raise bad_option(f"expected one folder, and arguments such as `ur_type:=ur5e`; found the folders {named}")
    folder = Path(folders[0])
    check_excluded("--robot", ask.robot, {"--urdf": ask.urdf, "--mjcf": ask.mjcf})
    check_excluded("--mjcf", ask.mjcf, {"--urdf": ask.urdf})
    of_arm = {"--tip": ask.tip, "--package-root": ask.package_roots, "--gripper": ask.gripper, "an argument": given}
    check_needed("the arm of --robot or --urdf", ask.robot or ask.urdf or ask.mjcf or ask.moveit, of_arm)
    for root in ask.package_roots:
        if not Path(root).is_dir():
            raise bad_input("missing-folder", f"--package-root: there is no folder {root}")
    try:
        found = made(ask.but(folder=folder, arguments=given))
    except KeyboardInterrupt:
        if (folder / WORKSPACE_FILE).exists():
            note(f"{folder} is made, but its task was not run: sqrp check {shlex.quote(str(folder))}")
        raise
    print_problems(found.problems)
    answer(found, as_json=json)
    return ExitCode.OK if found.works else ExitCode.NONE_FEASIBLE
