"""The pages of advice and of a placement: candidates before and after, and what a camera at every mount would see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sqrp_cli.platform.processes import Progress
from sqrp_cli.search.advice_result import AdviceDocument
from sqrp_cli.search.goal import Goal
from sqrp_cli.search.placing_result import PlacedCandidate, PlaceDocument
from sqrp_cli.search.question import is_fastest
from sqrp_cli.show.documents.scene import ShowDocument
from sqrp_cli.show.pages.assembly import PageContent, PageRow, write_page
from sqrp_cli.show.pages.candidate_page import cell_scene, computed, origin, packed_playback
from sqrp_cli.show.placement_words import placement_in_words
from sqrp_cli.show.sentences import KIND_WORDS
from sqrp_cli.study.pipeline import RankJob, described
from sqrp_cli.study.result import CandidateResult


def write_advice(
    document: AdviceDocument, path: Path, *, arguments: Sequence[str], jobs: int, progress: Progress
) -> None:
    """Write the page about an advice. arguments: of the command. jobs: processes to use at most."""
    goal, question = document.want, document.question
    original, before = RankJob(question.sampling, cell=question.cell, world=question.world), question.before
    several = any(one.found.way.parameters != before.way.parameters for one in document.advice)

    def row(name: str, mark: str, kind: str, found: CandidateResult, reasons: Sequence[str]) -> PageRow:
        labels = {"change": name, "kind": kind}
        if several:
            labels["way"] = "first" if is_fastest(found) else described(found).choice
        retried = found.candidate.skill.retried_faults
        return PageRow(name, mark, labels, None, reasons, None, None, retried=retried)

    # The candidate as it is, then with each change, each with the cell and the world that it is in.
    rows = [(row("as it is", "", "", before, goal.missed(before)), before, original)]
    for number, one in enumerate(document.advice, 1):
        cell, world = one.proposed.in_cell(original.cell), one.proposed.in_world(original.world)
        shown = row(one.words, f"#{number}", one.kind, one.found, [f"makes worse: {cost}" for cost in one.costs])
        rows.append((shown, one.found, replace(original, cell=cell, world=world)))
    entries, scenes = list[PageRow](), [cell_scene(original.cell)]
    for (_, _, job), entry in zip(rows, computed(lambda one: studied(*one, goal), rows, jobs, progress), strict=True):
        if job.cell is not original.cell:
            scenes.append((ShowDocument.of(job.cell), scenes[0][1]))  # cameras are no solids
        entries.append(replace(entry, scene=0 if job.cell is original.cell else len(scenes) - 1))
    count = len(document.advice)
    met = "one change meets it" if count == 1 else f"{count} changes meet it, each on its own"
    if document.met:
        met = "that is met already"
    elif not count:
        met = "nothing is enough" + ("" if document.nearest is None else f"; {document.nearest}")
    about = origin(arguments, original, document.assumed, [one for _, one, _ in rows if one.feasible])
    about += [(KIND_WORDS[one.kind], one.why) for one in document.kinds if one.why is not None]
    summary = f"{document.candidate} is to have {goal}: {met}. {document.whose_figures}".strip()
    title = f"What would help: {document.task} in {document.workspace}"
    write_page(PageContent(title, summary, "Changes", about, entries, scenes), path)


def studied(row: PageRow, found: CandidateResult, job: RankJob, goal: Goal | None) -> PageRow:
    """A row with the playback of the way of its figures, and the verdict on that; it may be finer than they are."""
    ranked = replace(found, rank=1 if found.feasible else None, pareto=False)
    explained = job.explain(ranked)
    shown = explained.result
    figures = described(replace(ranked, verdict=shown.verdict))
    short = goal.missed(shown) if goal is not None and goal.met(found) else ()
    reasons = [*row.reasons, *(f"{missed}, if sampled as finely as the timeline below" for missed in short)]
    return replace(row, candidate=figures, reasons=reasons, detail=packed_playback(job, explained))


def write_placement(
    document: PlaceDocument, path: Path, *, arguments: Sequence[str], jobs: int, progress: Progress
) -> None:
    """Write the page about a placement. arguments: of the command. jobs: processes to use at most."""
    question, goal = document.question, document.question.requirements.goal
    job = RankJob(question.sampling, cell=document.cell, world=question.world)
    several = len(document.tasks) > 1

    def named(task: str, candidate: str) -> tuple[str, dict[str, str]]:
        """The name of a row, and its labels."""
        labels = {"candidate": candidate, **({"task": task} if several else {})}
        return f"{task}: {candidate}" if several else candidate, labels

    def shown(one: PlacedCandidate) -> PageRow:
        """The row of a candidate: how it fares, and what no choice of mounts would cover."""
        missed = () if goal is None else goal.missed(one.found)
        own = (target for target in document.unseen if (target.task, target.candidate) == (one.task, one.candidate))
        mark = "" if goal is None else "short" if missed else "met"
        name, labels = named(one.task, one.candidate)
        if not question.fastest:
            labels["way"] = described(one.found).choice
        retried = one.found.candidate.skill.retried_faults
        row = PageRow(name, mark, labels, None, [*missed, *map(str, own)], 0, None, retried=retried)
        return studied(row, one.found, job, goal)

    entries = list(computed(shown, document.candidates, jobs, progress))
    for one in document.infeasible:
        figures = described(one.found)
        name, labels = named(one.task, figures.name)
        labels |= {} if question.fastest else {"way": ""}
        entries.append(
            PageRow(name, "" if goal is None else "cannot be done", labels, figures, figures.why, None, None)
        )
    taken = {one.mount: one.name for one in document.cameras}
    # Of each place its position in `frame` [m], the mean quality of all candidates with one camera there and no other,
    # null where none can be, and the camera that was put there.
    mounts = []
    for site, seen, shut in zip(question.mounts.sites, document.seen.tolist(), document.shut.tolist(), strict=True):
        known = {"seen": None if shut else seen, "camera": taken.get(site.name)}
        mounts.append({"name": site.name, "frame": site.frame, "position": [*map(float, site.position)], **known})
    said = placement_in_words(document)
    about = origin(arguments, job, document.assumed, [one.found for one in document.candidates])
    about += [("compared", said.comparison), ("proof", said.scope)]
    about += [("to have it", "add --patch FILE to the command")] if document.patch else []
    title = f"Where cameras go: {', '.join(document.tasks)} in {document.workspace}"
    summary = " ".join(filter(None, (said.put or said.unmet, document.proof, said.moves)))
    placement = {"by": document.by, "cameras": document.cameras, "keep": document.keep, "mounts": mounts}
    scenes = [cell_scene(document.cell)]
    write_page(PageContent(title, summary, "Candidates", about, entries, scenes, placement=placement), path)
