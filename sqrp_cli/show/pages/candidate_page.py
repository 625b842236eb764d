"""The pages of a ranking and of scores: the documents of `--json` with everything that is shown beside them."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from sqrp_cli.document import Pose
from sqrp_cli.figures import Qualities, falls_short
from sqrp_cli.files.entries import from_fields
from sqrp_cli.logic.literal import NOT
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.processes import in_processes
from sqrp_cli.records import dataclass
from sqrp_cli.shapes import Triangles
from sqrp_cli.show import sentences
from sqrp_cli.show.documents.analysis_shown import analysis_shown
from sqrp_cli.show.documents.explanation import ExplainedCandidate, Span
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
from sqrp_cli.study.pipeline import Explained, RankJob, sampling_done
from sqrp_cli.study.result import CandidateResult, Ranking
from sqrp_cli.study.whole_analysis import mean_qualities, worst_seen
from sqrp_cli.version import __version__

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.platform.processes import Progress
    from sqrp_cli.score.compute import Means
    from sqrp_cli.score.result import Scorecard, TaskScore
    from sqrp_cli.score.score import ScoredCell


Item = TypeVar("Item")
Result = TypeVar("Result")


def write_ranking(found: Ranking, path: Path, *, arguments: Sequence[str], jobs: int, progress: Progress) -> None:
    """Write the page about a ranking. arguments: of the command. jobs: processes to use at most."""
    job, candidates = found.session.job, found.candidates
    cell = job.cell
    details = computed(
        lambda one: packed_playback(job, job.explain(one)), candidates, min(jobs, len(candidates) // 2), progress
    )
    said = f"{sentences.summary(candidates, found.by)}."
    if found.feasible:
        said = f"{sentences.first_answer(found.feasible[0])} {said}"
    title, about = f"{found.task} in {cell.workspace.name}", origin(arguments, job, found.assumed, found.feasible)
    entries = candidate_rows(candidates, list(details))
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
    """Write the page about scores. means: how they were computed. arguments: of the command."""
    usable = [(one.name, one.workspace) for one in cells if one.workspace is not None and one.tasks]

    def scored(one: tuple[str, Workspace]) -> tuple[list[CellScene], list[PageRow]]:
        """The rows of a workspace's tasks, and its scene if any of them can be done."""
        own = [score for score in findings.results if score.workspace == one[0]]
        if all(score.best is None for score in own):
            return [], [_score_row(score) for score in own]
        cell = Cell.load(one[1], means.seed)
        job = RankJob(means.sampling, cell=cell, world=cell.initial_world)
        return [cell_scene(cell)], [_score_row(score, job) for score in own]

    scenes = list[CellScene]()
    entries = [_score_row(score) for score in findings.results if score.task is None]
    for scene, rows in computed(scored, usable, means.jobs, progress):
        entries += [replace(one, scene=len(scenes)) for one in rows] if scene else rows
        scenes += scene
    about = [*origin(arguments), *((f"digest of {name}", workspace.digest) for name, workspace in usable)]
    passed = f"{findings.count('passed')} of {len(findings.results)} tasks passed"
    summary = f"{passed}; of each, the best candidate is shown."
    write_page(PageContent("Scores", summary, "Tasks", about, entries, scenes, compared=False), path)


def _score_row(score: TaskScore, job: RankJob | None = None) -> PageRow:
    """The row of a task. job: in whose cell its best candidate is drawn, if there is one."""
    best = score.best
    labels = {"workspace": score.workspace, "task": score.task or "", "best": "" if best is None else best.name}
    return PageRow(
        ", ".join(filter(None, labels.values())),
        score.status,
        labels,
        # The other rows are about other tasks, so a comparison within this one says nothing about them.
        None if best is None else replace(best, pareto=False),
        score.reasons,
        None,
        None if job is None or best is None else packed_playback(job, job.explain(best)),
        retried=() if best is None else best.retried,
    )


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


def cell_scene(cell: Cell) -> CellScene:
    """What a page needs to draw a cell; it may come from another process."""
    return ShowDocument.of(cell), packed(scene_model(cell))


def origin(
    arguments: Sequence[str], job: RankJob | None = None, assumed: str = "", judged: Sequence[CandidateResult] = ()
) -> list[tuple[str, str]]:
    """The command and the version; of a job its workspace, what delays assume, and the accuracy of what is judged."""
    about = [("command", shlex.join(["sqrp", *arguments])), ("SQRP", __version__)]
    if job is not None:
        about += [("workspace", str(job.cell.workspace.path)), ("digest", job.cell.workspace.digest)]
        about += [("delays", f"{assumed}.")] if assumed else []
        about += [("accuracy", sentences.accuracy(sampling_done(job.sampling, judged), judged))] if judged else []
    return about


def computed(work: Callable[[Item], Result], items: Sequence[Item], jobs: int, progress: Progress) -> Iterator[Result]:
    """What `work` finds of each item of a page, in order, with the progress shown. jobs: processes to use at most."""
    with progress("Writing the report", len(items)) as advance:
        for found in in_processes(work, items, jobs):
            yield found
            advance(1)


# What a page plays of a candidate: its motion as predicted, nothing said twice


@dataclass(frozen=True, kw_only=True)
class PlayedStep(Span, Qualities):
    """A step of a task of several, by its number and task, and when it is done [s]."""

    verdict: str
    """Where it is blind, why, and what would help."""
    seen_worst: bool
    """Whether it is the one that is seen worst; false where all are seen all the time."""


@dataclass(frozen=True, kw_only=True)
class PlayedCandidate(ExplainedCandidate):
    """A candidate without redundant data: corners of boxes, and poses of objects that never move.

    Of several steps, names of primitives, literals and faults begin with the number of the step, such as
    `2.hold(peg1)`, and times count from the start of the first.
    """

    still: Mapping[str, Pose]
    """Objects that never move, in the world."""
    played: tuple[PlayedStep, ...]
    """Of a task of several steps: each; else empty."""

    @classmethod
    def of_candidate(cls, analysis: ExplainedCandidate, played: tuple[PlayedStep, ...] = ()) -> PlayedCandidate:
        """What a page needs of a candidate."""
        first = analysis.samples[0].objects if analysis.samples else {}
        still = {name: X for name, X in first.items() if all(s.objects.get(name) == X for s in analysis.samples)}
        samples = []
        for sample in analysis.samples:
            literals = {
                name: replace(literal, boxes=[replace(box, corners=None) for box in literal.boxes])
                for name, literal in sample.literals.items()
            }
            objects = {name: X for name, X in sample.objects.items() if name not in still}
            samples.append(replace(sample, objects=objects, literals=literals))
        return cls(**{**vars(analysis), "samples": samples}, still=still, played=played)

    @classmethod
    def of_steps(cls, figures: CandidateResult, steps: Sequence[ExplainedCandidate]) -> PlayedCandidate:
        """What a page needs of a candidate of several steps, which follow each other without a pause."""
        starts = [*accumulate((step.time or 0.0 for step in steps), initial=0.0)]
        parts = [_later(step, f"{number}.", starts[number - 1]) for number, step in enumerate(steps, 1)]
        joined = ExplainedCandidate(
            **vars(figures),
            sampling=steps[0].sampling,
            primitives=[one for part in parts for one in part.primitives],
            formulas=[one for part in parts for one in part.formulas],
            cameras=steps[0].cameras,
            without_camera={
                name: mean_qualities((step.without_camera[name], step.t_total, step.t_eoi) for step in steps)
                for name in steps[0].without_camera
            },
            targets={name: one for part in parts for name, one in part.targets.items()},
            samples=[one for part in parts for one in part.samples],
            hidden=[one for part in parts for one in part.hidden],
        )
        worst, played = worst_seen(steps), []
        loses = any(q is not None and falls_short(q, 1.0) for q in (steps[worst].q_eoi, steps[worst].q_avg))
        for index, (step, known) in enumerate(zip(steps, figures.steps or (), strict=True)):
            span = {"name": f"{index + 1}: {known.task}", "start": starts[index], "end": starts[index + 1]}
            played.append(from_fields(PlayedStep, step, **span, seen_worst=index == worst and loses))
        return cls.of_candidate(joined, tuple(played))


def _later(step: ExplainedCandidate, prefix: str, start: float) -> ExplainedCandidate:
    """A step that begins later [s], with a prefix to its names: what pages show of it beside its figures."""

    def named(literal: str) -> str:
        return f"{NOT * literal.startswith(NOT)}{prefix}{literal.removeprefix(NOT)}"

    formulas, samples = [], []
    for one in step.formulas:
        fault, literals = None if one.fault is None else prefix + one.fault, list(map(named, one.literals))
        formulas.append(replace(one, start=start + one.start, end=start + one.end, literals=literals, fault=fault))
    for sample in step.samples:
        seen = {named(name): shown for name, shown in sample.literals.items()}
        samples.append(replace(sample, t=start + sample.t, literals=seen))
    return replace(
        step,
        primitives=[
            replace(one, name=prefix + one.name, start=start + one.start, end=start + one.end)
            for one in step.primitives
        ],
        formulas=formulas,
        targets={named(name): replace(one, says=f"{prefix} {one.says}") for name, one in step.targets.items()},
        samples=samples,
        hidden=[replace(one, literal=named(one.literal)) for one in step.hidden],
    )


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


# Shapes

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
