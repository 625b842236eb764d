"""What mounts see, computed by a cluster, and kept in a folder from which the same search can resume."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

import numpy as np

from sqrp_cli.cell.mounts import LensChoice
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.errors import Infeasible, InputError, bad_input
from sqrp_cli.geometry import Mask
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.interrupts import first_interrupt_noted
from sqrp_cli.records import dataclass
from sqrp_cli.score.work.cluster import Cluster
from sqrp_cli.score.work.identity import digest_of, program_digest
from sqrp_cli.score.work.job import Job, PackedWorkspace
from sqrp_cli.score.work.results import Results, as_line, from_line
from sqrp_cli.search.sites import Verdicts, View, ViewBatch, installations, judged
from sqrp_cli.study.assessment import rehearsal
from sqrp_cli.study.stage import Samples
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import Candidate


@dataclass(frozen=True, eq=False)
class LookJob(Job):
    """A portion of looks, for a worker that plans the same motion again."""

    task: str = ""
    samples: Samples | None = None
    views: tuple[View, ...] = ()

    def done_for(self, cell: Cell, candidate: Candidate) -> str:
        """What the portion sees, as text."""
        motion = feasible_motion(cell, candidate, cell.initial_world)
        if isinstance(motion, Infeasible) or self.samples is None:
            raise ValueError(f"{candidate.name} was feasible a moment ago")
        scene = rehearsal(cell, candidate, cell.initial_world, motion)
        way = replace(judged(cell, self.task, candidate, scene), samples=self.samples)
        return as_line(ViewBatch(way, self.views).seen(cell))


@dataclass(frozen=True, eq=False)
class ClusterVerdicts:
    """The workers of a Dask cluster; see `sites.Verdicts`."""

    cluster: Cluster
    workspace: Workspace
    seed: int

    def of(self, parts: Sequence[ViewBatch], done: Callable[[int, Mask], None]) -> None:
        """See `Verdicts`. Raises InputError if a portion cannot be computed, or no worker is left."""
        packed = PackedWorkspace.of(self.workspace)
        jobs = [self._job(packed, part) for part in parts]
        with first_interrupt_noted() as interrupted:
            for index, (answer,) in self.cluster.answers(jobs, interrupted):
                if not isinstance(answer, str):
                    raise InputError(*answer)
                try:
                    sees = _mask_in(answer, parts[index])
                except ValueError as error:
                    raise bad_input("worker-died", "a worker of the cluster answered with what is no result") from error
                done(index, sees)

    def _job(self, packed: PackedWorkspace, part: ViewBatch) -> LookJob:
        from sqrp_cli.study.sampling import Adaptive

        return LookJob(
            workspace=packed,
            content="",
            candidates=(part.way.scene.candidate,),
            sampling=Adaptive(),
            seed=self.seed,
            coverage=False,
            task=part.way.task,
            samples=part.way.samples,
            views=part.views,
        )


@dataclass(frozen=True, eq=False)
class KeptVerdicts:
    """Verdicts that a folder keeps; only those that it does not have are computed."""

    results: Results
    workspace: Workspace
    seed: int
    others: Verdicts

    def of(self, parts: Sequence[ViewBatch], done: Callable[[int, Mask], None]) -> None:
        """See `Verdicts`. Raises InputError where one cannot be written."""
        keys = [self._key(part) for part in parts]
        missing = []
        for number, (key, part) in enumerate(zip(keys, parts, strict=True)):
            try:
                done(number, _mask_in(self.results.get(key) or "", part))
            except ValueError:  # nothing is kept, or its file is damaged
                missing.append(number)

        def keep(index: int, sees: Mask) -> None:
            self.results.keep(keys[missing[index]], as_line(sees))
            done(missing[index], sees)

        if missing:
            self.others.of([parts[number] for number in missing], keep)

    def _key(self, part: ViewBatch) -> str:
        """Digest of all that the verdicts depend on."""
        way = part.way.scene.candidate
        return digest_of(
            [
                program_digest(),
                "place",
                self.workspace.digest,
                self.seed,
                _way(way),
                part.way.samples.piece.tolist(),
                part.way.samples.t.tolist(),
                [[one.view.spot.frame, one.view.X_FC.tolist(), _lens(one.lens)] for one in installations(part.views)],
            ]
        )


def _mask_in(text: str, part: ViewBatch) -> Mask:
    """What a portion sees, of a text. Raises ValueError for any other text."""
    sees = from_line(text)
    expected = (len(installations(part.views)), len(part.way.items.sample))
    if not isinstance(sees, np.ndarray) or sees.dtype != bool or sees.shape != expected:
        raise ValueError("no verdicts of these views")
    return sees


def _way(way: Candidate) -> list[object]:
    vias = {name: via.tolist() for name, via in way.vias.items()}
    return [way.skill.name, dict(way.binding), dict(way.values), dict(way.branch), vias]


def _lens(lens: LensChoice) -> list[object]:
    own = lens.intrinsics
    sensing = [getattr(lens, part.name) for part in fields(lens) if isinstance(getattr(lens, part.name), float)]
    size, distortion = [own.width, own.height], [own.distortion_model, own.distortion.tolist()]
    return [lens.name, *size, own.matrix.tolist(), *distortion, sensing]
