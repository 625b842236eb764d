"""What mounts see, computed by a cluster, and kept in a folder from which the same search can resume."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, fields

from sqrp_cli.errors import Infeasible, InputError
from sqrp_cli.geometry import Mask
from sqrp_cli.knowledge.workspace.mounts import LensChoice, Spot
from sqrp_cli.knowledge.workspace.workspace import Workspace
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import rehearsal
from sqrp_cli.programming.coverage.stage import Samples
from sqrp_cli.programming.feasibility import feasible_motion
from sqrp_cli.programming.placing.scenes import JudgedWay, View
from sqrp_cli.programming.placing.tensor import Verdicts, ViewBatch, seen_by
from sqrp_cli.programming.task import Candidate
from sqrp_cli.scoring.work.cluster import Cluster, DaskWorkers
from sqrp_cli.scoring.work.dispatcher import Dispatcher, Done
from sqrp_cli.scoring.work.identity import digest_of, program_digest
from sqrp_cli.scoring.work.job import Job, PackedWorkspace
from sqrp_cli.scoring.work.results import Results, as_line, from_line


@dataclass(frozen=True, eq=False)
class LookJob(Job):
    """A portion of looks, for a worker that plans the same motion again."""

    task: str = ""
    samples: Samples | None = None
    spots: tuple[Spot, ...] = ()
    views: tuple[View, ...] = ()
    lenses: tuple[LensChoice, ...] = ()

    def goes_with(self, other: Job) -> bool:  # noqa: ARG002 - each is large enough
        """See `Job`."""
        return False

    def done_in(self, cell: Cell) -> tuple[str, ...]:
        """What the portion sees, as text."""
        (way,), world = self.candidates, cell.initial_world
        motion = feasible_motion(cell, way, world)
        if isinstance(motion, Infeasible) or self.samples is None:
            raise ValueError(f"{way.name} was feasible a moment ago")
        scene = rehearsal(cell, way, world, motion)
        judged = JudgedWay(scene, self.samples, task=self.task, candidate=way)
        return (as_line(seen_by(cell, judged, self.spots, self.views, self.lenses)),)


@dataclass(frozen=True, eq=False)
class ClusterVerdicts:
    """The workers of a Dask cluster; see `tensor.Verdicts`."""

    cluster: Cluster
    workspace: Workspace
    seed: int

    def of(self, parts: Sequence[ViewBatch], done: Callable[[int, Mask], None]) -> None:
        """See `Verdicts`. Raises InputError if a portion cannot be computed, or no worker is left."""
        packed = PackedWorkspace.of(self.workspace)
        jobs = [self._job(packed, part) for part in parts]
        number = {id(job): index for index, job in enumerate(jobs)}

        def keep(finished: Done) -> None:
            if finished.problems:
                raise InputError(*finished.problems)
            done(number[id(finished.job)], from_line(finished.outcomes[0]))

        with closing(DaskWorkers(self.cluster)) as workers:
            dispatcher = Dispatcher(workers, keep)
            try:
                dispatcher.add(jobs)
                dispatcher.finish()
            except KeyboardInterrupt:
                dispatcher.give_up()
                raise

    def _job(self, packed: PackedWorkspace, part: ViewBatch) -> LookJob:
        from sqrp_cli.programming.coverage.sampling import Adaptive

        return LookJob(
            workspace=packed,
            content="",
            candidates=(part.way.scene.candidate,),
            sampling=Adaptive(),
            seed=self.seed,
            coverage=False,
            task=part.way.task,
            samples=part.way.samples,
            spots=part.spots,
            views=part.views,
            lenses=part.lenses,
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
            sees = self._known(key)
            if sees is None or sees.shape != (len(part.lenses), len(part.views), len(part.way.items.sample)):
                missing.append(number)
            else:
                done(number, sees)

        def keep(index: int, sees: Mask) -> None:
            self.results.keep(keys[missing[index]], as_line(sees))
            done(missing[index], sees)

        if missing:
            self.others.of([parts[number] for number in missing], keep)

    def _known(self, key: str) -> Mask | None:
        """What is kept under a key; None if nothing is, or its file is damaged."""
        with suppress(ValueError):
            sees: Mask = from_line(self.results.get(key) or "")
            return sees
        return None

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
                [[spot.frame, spot.position.tolist(), [lens.name for lens in spot.lenses]] for spot in part.spots],
                [[view.spot, view.X_FC.tolist()] for view in part.views],
                [_lens(lens) for lens in part.lenses],
            ]
        )


def _way(way: Candidate) -> list[object]:
    vias = {name: via.tolist() for name, via in way.vias.items()}
    return [way.skill.name, dict(way.binding), dict(way.values), dict(way.branch), vias]


def _lens(lens: LensChoice) -> list[object]:
    own = lens.intrinsics
    sensing = [getattr(lens, part.name) for part in fields(lens) if isinstance(getattr(lens, part.name), float)]
    size, distortion = [own.width, own.height], [own.distortion_model, own.distortion.tolist()]
    return [lens.name, *size, own.matrix.tolist(), *distortion, sensing]
