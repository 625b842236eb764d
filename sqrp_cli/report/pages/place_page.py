"""The page of a placement: the candidates with the chosen cameras, and what a camera at every mount would see."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from sqrp_cli.platform.processes import in_processes
from sqrp_cli.programming.pipeline import Assignment
from sqrp_cli.programming.placing.placement import JudgedCandidate, Placement
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.report.documents import placing
from sqrp_cli.report.documents.candidates import CandidateFigures
from sqrp_cli.report.pages.advice_page import studied
from sqrp_cli.report.pages.candidate_page import cell_scene, origin
from sqrp_cli.report.pages.page import MountShown, PageContent, PageRow, PlacementShown, write_page
from sqrp_cli.report.sentences import accuracy, reasons_by_doing, way_of
from sqrp_cli.scoring.scorecard import Progress


def write_placement(
    found: Placement,
    document: placing.PlaceDocument,
    path: Path,
    *,
    arguments: Sequence[str],
    jobs: int,
    progress: Progress,
) -> None:
    """Write the page about a placement. arguments: of the command. jobs: processes to use at most."""
    question = found.question
    assignment = Assignment(found.cell, question.world, question.sampling)
    entries = []

    def shown(one: JudgedCandidate) -> PageRow:
        return studied(_row(found, document, one), one.found, assignment, question.demand.wish)

    with progress("Writing the report", len(found.candidates)) as advance:
        for row in in_processes(shown, found.candidates, min(jobs, len(found.candidates))):
            entries.append(row)
            advance(1)
    entries += _infeasible(found)
    workspace = found.cell.workspace
    about = [*origin(arguments), ("workspace", str(workspace.path)), ("digest", workspace.digest)]
    about += [("compared", placing.compared_in_words(document)), ("proof", placing.scope_in_words(document))]
    about += [("to have it", "add --patch FILE to the command")] if document.patch else []
    if found.candidates:
        judged = [Ranked(one.found, 1, pareto=False) for one in found.candidates]
        about.append(("accuracy", accuracy(question.sampling, judged)))
    title = f"Where cameras go: {', '.join(document.tasks)} in {document.workspace}"
    said = (placing.unmet_in_words(document, question.demand.wish), document.proof, placing.moved_in_words(document))
    summary = " ".join(filter(None, said))
    scenes = [cell_scene(found.cell)]
    write_page(
        PageContent(title, summary, "Candidates", about, entries, scenes, placement=_placement(found, document)), path
    )


def _placement(found: Placement, document: placing.PlaceDocument) -> PlacementShown:
    placed = {camera.spot.name: camera.camera.name for camera in found.cameras}
    return PlacementShown(
        by=document.by,
        cameras=document.cameras,
        keep=document.keep,
        mounts=[
            MountShown(
                name=spot.name,
                frame=spot.frame,
                position=(float(spot.position[0]), float(spot.position[1]), float(spot.position[2])),
                seen=None if shut else seen,
                camera=placed.get(spot.name),
            )
            for spot, seen, shut in zip(
                found.question.mounts.spots, found.seen.tolist(), found.shut.tolist(), strict=True
            )
        ],
    )


def _row(found: Placement, document: placing.PlaceDocument, one: JudgedCandidate) -> PageRow:
    """The row of a candidate: how it fares, and what no choice of mounts would cover."""
    wish = found.question.demand.wish
    missed = () if wish is None else wish.missed(one.found)
    unseen = [
        str(target) for target in document.unseen if (target.task, target.candidate) == (one.task, one.candidate.name)
    ]
    mark = "" if wish is None else "short" if missed else "met"
    labels = _labels(found, one.task, one.candidate.name)
    if not found.question.fastest:
        labels["way"] = way_of(one.found)
    retried = one.candidate.skill.retried_faults
    return PageRow(
        _name(found, one.task, one.candidate.name), mark, labels, None, [*missed, *unseen], 0, None, retried=retried
    )


def _infeasible(found: Placement) -> Iterator[PageRow]:
    """The rows of candidates that cannot be done."""
    for task, one in found.infeasible:
        name, labels = _name(found, task, one.candidate.name), _labels(found, task, one.candidate.name)
        labels |= {} if found.question.fastest else {"way": ""}
        figures = CandidateFigures.of(Ranked(one, None, pareto=False))
        yield PageRow(
            name,
            "" if found.question.demand.wish is None else "infeasible",
            labels,
            figures,
            reasons_by_doing(one),
            None,
            None,
        )


def _labels(found: Placement, task: str, name: str) -> dict[str, str]:
    several = len(found.question.tasks) > 1
    return {"candidate": name, **({"task": task} if several else {})}


def _name(found: Placement, task: str, name: str) -> str:
    return f"{task}: {name}" if len(found.question.tasks) > 1 else name
