"""The first run of a new workspace: its task, ranked, written as a program and run once in the simulated cell."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from sqrp_cli.api.cell import open_cell
from sqrp_cli.api.program import open_program
from sqrp_cli.errors import InputError
from sqrp_cli.report.documents.scene import FirstRun


def first_run(folder: Path, task: str) -> FirstRun | None:
    """Run the best candidate of a task of the workspace in a folder, and keep nothing of it.

    None where there is no simulator, or no candidate is feasible.
    """
    from sqrp_cli.runtime.cell.requirements import check_simulator

    try:
        check_simulator()
    except InputError:
        return None
    ranking = open_cell(folder).rank(task)
    if ranking.best is None:
        return None
    with TemporaryDirectory(dir=folder) as drafts:
        program = Path(drafts) / "first.yaml"
        ranking.write(program)
        report = open_program(program).run(witnessed=False).report
    promised = report.total.tp + report.total.fp
    return FirstRun(
        outcome=report.outcome,
        reason=report.reason,
        time=report.time,
        promised=promised,
        seen=report.total.tp,
    )
