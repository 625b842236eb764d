"""What mounts see, computed by a cluster, and kept in a folder from which the same search can resume."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, replace

import numpy as np

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible, InputError, bad_input
from sqrp_cli.geometry import Mask
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.interrupts import interrupts_later
from sqrp_cli.records import dataclass
from sqrp_cli.score.compute import Job, PackedWorkspace, Workers
from sqrp_cli.score.kept import Results, as_line, from_line, key_of
from sqrp_cli.search.sites import Installation, Verdicts, ViewBatch, judged, verdicts_of
from sqrp_cli.study.assessment import planned_motion
from sqrp_cli.study.stage import Samples
from sqrp_cli.task.feasibility import feasible_motion


@dataclass(frozen=True, eq=False, kw_only=True)
class LookJob(Job):
    """A batch of installations, for a worker that plans the same motion again."""

    task: str
    samples: Samples
    places: Sequence[Installation]

    def done_in(self, cell: Cell) -> str:
        """What the installations see, as text."""
        motion = feasible_motion(cell, self.candidate, cell.initial_world)
        if isinstance(motion, Infeasible):
            raise ValueError(f"{self.candidate.name} was feasible a moment ago")
        scene = planned_motion(cell, self.candidate, cell.initial_world, motion)
        way = replace(judged(cell, self.task, self.candidate, scene), samples=self.samples)
        return as_line(verdicts_of(cell, way, self.places))


def cluster_verdicts(
    cluster: Workers, workspace: Workspace, seed: int, batches: Sequence[ViewBatch]
) -> Iterator[tuple[int, Mask]]:
    """See `sites.Verdicts`. Raises InputError if a batch cannot be computed, or no worker is left."""
    packed = PackedWorkspace.of(workspace)
    jobs = [
        LookJob(
            workspace=packed,
            seed=seed,
            candidate=way.scene.candidate,
            task=way.task,
            samples=way.samples,
            places=places,
        )
        for way, places in batches
    ]
    with interrupts_later(second_raises=True) as interrupted:
        for index, answer in cluster.answers(jobs, interrupted):
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
    for number, batch in enumerate(batches):
        judged_way, places = batch[0], list[object]()
        way = judged_way.scene.candidate
        for one in batch[1]:
            lens, own = one.lens, one.lens.intrinsics
            sensing = [value for entry in fields(lens) if isinstance(value := getattr(lens, entry.name), float)]
            size, distortion = [own.width, own.height], [own.distortion_model, own.distortion.tolist()]
            said = [lens.name, *size, own.matrix.tolist(), *distortion, sensing]
            places.append([one.spot.frame, one.X_FC.tolist(), said])
        vias = {name: via.tolist() for name, via in way.vias.items()}
        motion = [way.skill.name, dict(way.binding), dict(way.values), dict(way.branch), vias]
        samples = (judged_way.samples.piece.tolist(), judged_way.samples.t.tolist())
        key = key_of("place", workspace.digest, seed, motion, *samples, places)
        try:
            yield number, _mask_in(results.get(key) or "", batch)
        except ValueError:  # nothing is kept, or its file is damaged
            missing.append((number, key))
    for index, sees in others([batches[number] for number, _ in missing]) if missing else ():
        number, key = missing[index]
        results.keep(key, as_line(sees))
        yield number, sees


def _mask_in(text: str, batch: ViewBatch) -> Mask:
    """What a batch shows, of a text. Raises ValueError for any other text."""
    sees = from_line(text)
    expected = (len(batch[1]), len(batch[0].needed))
    if not isinstance(sees, np.ndarray) or sees.dtype != bool or sees.shape != expected:
        raise ValueError("no verdicts of these views")
    return sees
