"""What `--report` writes: the same documents as `--json` prints, with everything that a page shows beside them."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from sqrp_cli import __version__
from sqrp_cli.cli.console import note, progress
from sqrp_cli.cli.documents import Document
from sqrp_cli.cli.scene_document import scene_document
from sqrp_cli.cli.session import Session, explain
from sqrp_cli.cli.study_document import study_document
from sqrp_cli.files import check_writable
from sqrp_cli.programming.pipeline import in_processes
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.report.libraries import check_libraries
from sqrp_cli.report.model import model_document
from sqrp_cli.report.packing import packed, without_repetition
from sqrp_cli.report.page import PageContent, write_page


def check_report(path: Path) -> None:
    """Raises InputError, before anything is computed, where a page cannot be written or a library is missing."""
    check_writable(path)
    check_libraries()


def write_report(
    session: Session, ranking: Sequence[Ranked], document: Document, path: Path, arguments: Sequence[str], jobs: int
) -> None:
    """Write the page about a ranking.

    document: of the ranking. arguments: of the command. jobs: processes to use at most.
    """
    workspace = session.workspace
    with progress("Writing the report", len(ranking)) as advance:
        details = []
        for detail in in_processes(lambda ranked: _detail(session, ranked), ranking, min(jobs, len(ranking) // 2)):
            details.append(detail)
            advance()
    about = (
        ("command", shlex.join(["sqrp", *arguments])),
        ("workspace", str(workspace.path)),
        ("digest of its files", workspace.digest),
        ("SQRP", __version__),
    )
    title = f"{session.task.text} in {workspace.name}"
    scene, model = scene_document(session.cell), model_document(session.cell)
    write_page(PageContent(title, about, document, scene, model, details), path)
    note(f"open {path} in a browser")


def _detail(session: Session, ranked: Ranked) -> str | None:
    explained, found = explain(session, ranked)
    if found is None:
        return None
    return packed(without_repetition(study_document(session.cell, found, explained, session.assignment.sampling)))
