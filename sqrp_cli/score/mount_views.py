"""What mounts see, computed by a cluster, and kept in a folder from which the same search can resume."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible, InputError, bad_input
from sqrp_cli.geometry import Mask
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.score.compute import Job, Workers, packed
from sqrp_cli.score.kept import Results, as_line, from_line, key_of, plain_of
from sqrp_cli.search.sites import Installation, Verdicts, ViewBatch, judged_way, verdicts_of
from sqrp_cli.study.analysis import planned_motion
from sqrp_cli.study.stage import Samples
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import Candidate


def verdicts_as_text(
    cell: Cell, candidate: Candidate, task: str, samples: Samples, places: Sequence[Installation]
) -> str:
    """What installations see of a way, for a worker that plans the same motion again."""
    motion = feasible_motion(cell, candidate, cell.initial_world)
    if isinstance(motion, Infeasible):
        raise ValueError(f"{candidate.name} was feasible a moment ago")
    planned = planned_motion(cell, candidate, cell.initial_world, motion)
    way = replace(judged_way(cell, task, candidate, planned), samples=samples)
    return as_line(verdicts_of(cell, way, places))


def cluster_verdicts(
    cluster: Workers, workspace: Workspace, seed: int, batches: Sequence[ViewBatch]
) -> Iterator[tuple[int, Mask]]:
    """See `sites.Verdicts`. Raises InputError if a batch cannot be computed, or no worker is left."""
    bytes_of, jobs = packed(workspace), list[Job]()
    for way, places in batches:
        work = partial(verdicts_as_text, task=way.task, samples=way.samples, places=places)
        jobs.append(Job(*bytes_of, seed, way.planned.candidate, work))
    with interrupts_later(second_raises=True) as interrupted:
        for index, answer in cluster(jobs, interrupted):
            if not isinstance(answer, str):
                raise InputError(*answer)
            try:
                yield index, _mask_in(answer, batches[index])
            except ValueError as error:
                raise bad_input("worker-died", "a worker of the cluster answered with what is no result") from error


def kept_verdicts(
    results: Results, workspace: Workspace, seed: int, others: Verdicts, batches: Sequence[ViewBatch]
) -> Iterator[tuple[int, Mask]]:
    """See `sites.Verdicts`: what a folder keeps, and what is computed for it. Raises InputError as `Results`."""
    missing: list[tuple[int, str]] = []
    for number, (way, installations) in enumerate(batches):
        cameras = [one.camera(one.lens_name) for one in installations]
        seen_in = plain_of((way.planned.candidate, way.samples, cameras))
        key = key_of("place", workspace.digest, seed, seen_in)
        try:
            yield number, _mask_in(results.get(key) or "", batches[number])
        except ValueError:  # nothing is kept, or its file is damaged
            missing.append((number, key))
    for index, sees in others([batches[number] for number, _ in missing]) if missing else ():
        number, key = missing[index]
        results.keep(key, as_line(sees))
        yield number, sees


def _mask_in(text: str, batch: ViewBatch) -> Mask:
    """What a batch shows, of a text. Raises ValueError for any other text."""
    sees, (way, places) = from_line(text), batch
    if not isinstance(sees, np.ndarray) or sees.dtype != bool or sees.shape != (len(places), len(way.needed)):
        raise ValueError("no verdicts of these views")
    return sees
