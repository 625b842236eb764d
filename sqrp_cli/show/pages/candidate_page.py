"""The pages of a ranking and of scores: the documents of `--json` with everything that is shown beside them."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.shapes import Triangles
from sqrp_cli.show import sentences
from sqrp_cli.show.documents.analysis_shown import analysis_shown
from sqrp_cli.show.documents.playback import PlayedCandidate
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.assembly import (
    CellScene,
    PageContent,
    PageRow,
    packed,
    simplified,
    solid_colors,
    write_page,
)
from sqrp_cli.study.pipeline import Explained, RankJob
from sqrp_cli.study.result import CandidateResult, Ranking
from sqrp_cli.version import __version__

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.platform.processes import Progress
    from sqrp_cli.score.compute import Means
    from sqrp_cli.score.result import Scorecard, TaskScore
    from sqrp_cli.score.score import ScoredCell


Item = TypeVar("Item")
Result = TypeVar("Result")


def write_ranking(
    found: Ranking, job: RankJob, path: Path, *, arguments: Sequence[str], jobs: int, progress: Progress
) -> None:
    """Write the page about a ranking. arguments: of the command. jobs: processes to use at most."""
    cell, candidates = job.cell, found.candidates
    details = computed(
        lambda one: packed_playback(job, job.explain(one)), candidates, min(jobs, len(candidates) // 2), progress
    )
    entries = candidate_rows(candidates, list(details))
    about = origin(arguments, cell.workspace, found.assumed)
    said = f"{sentences.summary(candidates, found.by)}."
    if found.feasible:
        about.append(("accuracy", sentences.accuracy(found.sampling, found.feasible)))
        said = f"{sentences.first_answer(found.feasible[0])} {said}"
    title = f"{found.task} in {cell.workspace.name}"
    write_page(PageContent(title, said, "Candidates", about, entries, [cell_scene(cell)]), path)


def write_scores(
    cells: Sequence[ScoredCell],
    findings: Scorecard,
    means: Means,
    path: Path,
    *,
    arguments: Sequence[str],
    progress: Progress,
) -> None:
    """Write the page about scores, with the best candidate of each task.

    means: how they were computed. arguments: of the command.
    """
    usable = [cell for cell in cells if cell.workspace is not None and cell.tasks]
    scores = findings.results
    scenes: list[CellScene] = []
    entries: list[PageRow] = [_score(score, None, None) for score in scores if score.task is None]
    for scene, found in computed(lambda cell: _scored(cell, scores, means), usable, means.jobs, progress):
        entries += found if scene is None else [replace(entry, scene=len(scenes)) for entry in found]
        scenes += [] if scene is None else [scene]
    digests = [(f"digest of {cell.name}", cell.workspace.digest) for cell in usable if cell.workspace is not None]
    about = [*origin(arguments), *digests]
    passed = (
        f"{findings.count('passed')} of {len(findings.results)} tasks passed; of each, the best candidate is shown."
    )
    write_page(PageContent("Scores", passed, "Tasks", about, entries, scenes, compared=False), path)


def _scored(scored: ScoredCell, scores: Sequence[TaskScore], means: Means) -> tuple[CellScene | None, list[PageRow]]:
    """The rows of a workspace's tasks, and its scene if any of them can be done."""
    scores = [score for score in scores if score.workspace == scored.name]
    if scored.workspace is None or all(score.best is None for score in scores):
        return None, [_score(score, None, None) for score in scores]
    cell = Cell.load(scored.workspace, means.seed)
    job = RankJob(means.sampling, cell=cell, world=cell.initial_world)
    details = [None if score.best is None else packed_playback(job, job.explain(score.best)) for score in scores]
    return cell_scene(cell), [_score(score, 0, detail) for score, detail in zip(scores, details, strict=True)]


def candidate_rows(ranking: Sequence[CandidateResult], details: Sequence[str | None]) -> list[PageRow]:
    """The rows of the candidates of a task. details: of each, see `PageRow`."""
    differing = sentences.differing_parameters(ranking)
    choice = any(one.has_choice for one in ranking)
    rows = []
    for one, detail in zip(ranking, details, strict=True):
        labels = {name: {**one.objects, **one.settings}[name] for name in differing}
        mark = "cannot be done" if one.rank is None else f"{one.rank}"
        labels |= {"way": one.choice} if choice else {}
        rows.append(PageRow(one.name, mark, labels, one, one.why, 0, detail, retried=one.retried))
    return rows


def _score(score: TaskScore, scene: int | None, detail: str | None) -> PageRow:
    best = score.best
    labels = {"workspace": score.workspace, "task": score.task or "", "best": "" if best is None else best.name}
    return PageRow(
        ", ".join(filter(None, labels.values())),
        score.status,
        labels,
        # The other rows are about other tasks, so a comparison within this one says nothing about them.
        None if best is None else replace(best, pareto=False),
        score.reasons,
        scene,
        detail,
        retried=() if best is None else best.retried,
    )


def cell_scene(cell: Cell) -> CellScene:
    """What a page needs to draw a cell; it may come from another process."""
    return ShowDocument.of(cell), packed(scene_model(cell))


def origin(arguments: Sequence[str], workspace: Workspace | None = None, assumed: str = "") -> list[tuple[str, str]]:
    """The command and the version that made the page, and the workspace that it is about, if it is about one.

    assumed: what delays assume of its cameras.
    """
    about = [("command", shlex.join(["sqrp", *arguments])), ("SQRP", __version__)]
    about += [] if workspace is None else [("workspace", str(workspace.path)), ("digest", workspace.digest)]
    return [*about, ("delays", f"{assumed}.")] if assumed else about


def computed(work: Callable[[Item], Result], items: Sequence[Item], jobs: int, progress: Progress) -> Iterator[Result]:
    """What `work` finds of each item of a page, in order, with the progress shown. jobs: processes to use at most."""
    with progress("Writing the report", len(items)) as advance:
        for found in in_processes(work, items, jobs):
            yield found
            advance(1)


def packed_playback(job: RankJob, explained: Explained) -> str | None:
    """What is shown of a candidate beside its figures, packed; None for an infeasible one."""
    return packed(playback(job, explained)) if explained.result.feasible else None


def playback(job: RankJob, explained: Explained, *, brief: bool = False) -> PlayedCandidate:
    """What is shown of a feasible candidate beside its figures; brief: see `analysis_shown`."""
    cell, sampling = job.cell, job.sampling
    parts = explained.steps or (explained,)
    analyses = [analysis_shown(cell, one.analysis, one.result, sampling, brief=brief) for one in parts]
    if explained.steps:
        return PlayedCandidate.of_steps(explained.result, analyses)
    return PlayedCandidate.of_candidate(analyses[0])


STEP = 1e-4  # coordinates of meshes are given in multiples of this [m]


def scene_model(cell: Cell) -> Mapping[str, object]:
    """What moves with what, and the shape of every part, as pages draw it.

    `joints`, parents first: `parent` and `links[].joint` are indices of joints, -1 for the world; `pose` is in the
    parent, at position 0, or in the joint. `solids`: `vertices` are x, y, z, x, ... in the parent's frame, in multiples
    of `step`, `triangles` indices of three vertices each. Raises InputError where a library is missing.
    """
    tree = cell.model.tree
    joints = [
        {"name": joint.name, "parent": parent, "slides": not turns, "axis": list(joint.axis), "pose": X.tolist()}
        for joint, parent, turns, X in zip(
            tree.joints, tree.parents, tree.turns.tolist(), tree.terms[:, 0], strict=True
        )
    ]
    links = {name: {"joint": joint, "pose": X_JL.tolist()} for name, (joint, X_JL) in tree.mounts.items()}
    solids = []
    for solid, color in zip(cell.observer.solids, solid_colors(cell), strict=True):
        surface = simplified(Triangles(solid.vertices, solid.triangles))
        solids.append(
            {
                "name": solid.name,
                "parent": solid.part.parent,
                "color": "#{:02x}{:02x}{:02x}".format(*color),
                "vertices": np.round(surface.vertices / STEP).astype(int).reshape(-1).tolist(),
                "triangles": surface.faces.reshape(-1).tolist(),
            }
        )
    return {"step": STEP, "joints": joints, "links": links, "solids": solids}
