"""A new workspace, and its first run: its task ranked, written as a program and run once in the simulated cell."""

from __future__ import annotations

import json
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from sqrp_cli.ask.api.cell import open_cell
from sqrp_cli.ask.api.program import open_program
from sqrp_cli.ask.requests import InitRequest
from sqrp_cli.ask.values import silent
from sqrp_cli.errors import InputError

if TYPE_CHECKING:
    from sqrp_cli.platform.processes import Progress
    from sqrp_cli.run.record.events import Event
    from sqrp_cli.show.documents.programs import FirstRun, NewCell


def made(ask: InitRequest) -> NewCell:
    """A new workspace with its skill, ready to rank. Raises InputError for an arm or a folder that cannot be used."""
    from sqrp_cli.show.documents.programs import NewCell
    from sqrp_cli.show.documents.schemas import schema_of
    from sqrp_cli.starter.by_name import find_named
    from sqrp_cli.starter.description import OwnRobot
    from sqrp_cli.starter.make import make_starter
    from sqrp_cli.starter.search import MOST_STANDS

    folder, is_own = Path(ask.folder), any(one is not None for one in (ask.robot, ask.urdf, ask.mjcf, ask.moveit))
    roots = tuple(map(Path, ask.package_roots))
    stated, given = ask.urdf if ask.mjcf is None else ask.mjcf, dict(ask.arguments or {})
    urdf = None if stated is None else str(stated)
    if ask.robot is not None:
        urdf, usual = find_named(ask.robot, "robot")
        given = {**usual, **given}
    gripper = ask.gripper
    if gripper is not None and "/" not in gripper and not Path(gripper).is_file():
        gripper, _ = find_named(gripper, "gripper")
    own = OwnRobot(urdf, given, roots, None if ask.moveit is None else Path(ask.moveit), gripper)
    with ask.progress("Looking for what the arm can reach", MOST_STANDS) as advance:
        schema = json.dumps(schema_of("workspace"))
        recording = None if ask.recording is None else Path(ask.recording).absolute()
        found = make_starter(folder, own if is_own else None, ask.tip, advance, schema, recording)
    runs = ask.run and found.task is not None and recording is None
    tried = first_run(found.folder, found.task or "", ask.progress) if runs else None
    return NewCell(
        workspace=str(found.folder),
        tool_link=found.tip,
        fingers=[*found.grip.open] if found.grip else [],
        width=found.grip.width if found.grip else None,
        objects=[cube.name for cube in found.cubes],
        task=found.task,
        run=tried,
        path=str(folder),
        own_arm=is_own,
        told=found.told,
        problems=found.warnings,
    )


def new_cell(*given: Any, **named: Any) -> NewCell:  # noqa: ANN401 - of the fields of a request
    """Make a new workspace; it takes the fields of an `InitRequest`."""
    return made(InitRequest(*given, **named))


def first_run(folder: Path, task: str, progress: Progress = silent) -> FirstRun | None:
    """Run the best candidate of a task, and keep nothing of it; None without a simulator or what can be done."""
    from sqrp_cli.platform.simulator import check_simulator
    from sqrp_cli.show.documents.programs import FirstRun

    try:
        check_simulator()
    except InputError:
        return None
    ranking = open_cell(folder).rank(task, progress=progress)
    if ranking.best is None:
        return None
    seconds = max(1, int(ranking.best.time or 0.0))
    title = "Running the task in simulation, in seconds (not with --no-run)"
    with progress(title, seconds) as advance, TemporaryDirectory(dir=folder) as drafts:
        program, passed = Path(drafts) / "first.yaml", 0

        def count(event: Event) -> None:
            nonlocal passed
            now = min(int(event.t), seconds)
            advance(now - passed)
            passed = now

        ranking.write(program)
        report = open_program(program).run(witnessed=False, listeners=[count])
    promised = report.total.tp + report.total.fp
    return FirstRun(
        outcome=report.outcome, reason=report.reason, time=report.time, promised=promised, seen=report.total.tp
    )
