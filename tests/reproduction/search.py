"""How the cameras of the two cells were found: `python -m tests.reproduction.search tabletop|screws [SEED]`.

Starts from nothing but the robot, the objects and what the paper reports, and prints cameras for the workspace. Takes
the better part of an hour; another seed finds other cameras.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from sqrp_cli.knowledge.camera import Camera
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.sampling import FixedCount, FixedStep, Sampling
from sqrp_cli.programming.task import read_task
from tests.reproduction import screws, simulation
from tests.reproduction.layout_search import Sight, anneal, beyond, qualities, random_camera, refine, sight
from tests.reproduction.paper import REAL_WORLD, SIMULATION, Reported
from tests.reproduction.summary import feasible_study

POOL, ROUNDS, RESTARTS, STEPS, VARIANTS = 700, 40_000, 10, 1500, 9


class Search(ABC):
    """A cell whose cameras are sought; the penalty is 0 where all figures are well within what is asked."""

    cameras: int
    fovs: tuple[float, ...]
    aims: np.ndarray

    def __init__(self, cell: Cell, task: str, wanted: Sequence[tuple[str, Sampling]]) -> None:
        """wanted: the candidates to study, by their objects, and how they are sampled."""
        candidates = {candidate.name: candidate for candidate in read_task(task, cell.workspace).candidates}
        self.cell = cell
        self.studies = [feasible_study(cell, candidates[name], sampling) for name, sampling in wanted]

    @abstractmethod
    def penalty(self, chosen: Sequence[Sight]) -> float:
        """How far the figures are from the paper's, averaged over the variants."""

    def above(self, *names: str) -> np.ndarray:
        """Points on and above objects, to look at, shape (n, 3) [m]."""
        stands = [X_WO[:3, 3] for name in names if (X_WO := self.cell.workspace.objects[name].X_WO) is not None]
        return np.array([np.add(position, (0.0, 0.0, height)) for position in stands for height in (0.0, 0.15, 0.3)])

    def of(self, index: int, chosen: Sequence[Sight]) -> np.ndarray:
        """Q_avg and Q_eoi [%] of a study for every variant, shape (v, 2)."""
        return qualities(self.studies[index], index, chosen)

    def interest(self, index: int) -> np.ndarray:
        """Whether each sample of a study lies in an event of interest."""
        return self.studies[index].timeline.interesting

    def look(self, camera: Camera, variants: int = VARIANTS) -> Sight:
        """What a camera sees."""
        return sight(camera, self.cell.observer, self.studies, variants)

    def run(self, random: np.random.Generator) -> list[Camera]:
        """Cameras that are as good as this search finds them."""
        model = self.cell.observer.cameras[0]
        pool: list[Sight] = []
        while len(pool) < POOL:
            found = self.look(random_camera(random, self.aims, model, np.radians(self.fovs)), variants=1)
            if any(
                sees.all(axis=-1).mean() > 0.05 or hidden.mean() > 0.3
                for sees, hidden in zip(found.sees, found.hidden, strict=True)
            ):
                pool.append(found)
                print(f"\r{len(pool)} of {POOL} cameras to choose from", end="", file=sys.stderr)
        tries = [anneal(pool, self.cameras, self.penalty, random, ROUNDS) for _ in range(RESTARTS)]
        chosen = refine(min(tries, key=self.penalty), lambda camera: self.look(camera, 1), self.penalty, random, STEPS)
        sure = refine([self.look(one.camera) for one in chosen], self.look, self.penalty, random, STEPS)
        print(f"\npenalty {self.penalty(sure):.2f}", file=sys.stderr)
        return [one.camera for one in sure]


class Tabletop(Search):
    """Six cameras; studies: g1 to g5 with 10 samples per primitive, then g1 with 5, 20, 40 and 100."""

    cameras = 6
    fovs = (22, 26, 30, 34, 40, 46)

    def __init__(self) -> None:
        more = [("g1", FixedCount(count)) for count in (5, 20, 40, 100)]
        super().__init__(simulation.tabletop(), simulation.TASK, [*((n, FixedCount(10)) for n in SIMULATION), *more])
        self.aims = self.above(*SIMULATION, "g6")

    def penalty(self, chosen: Sequence[Sight]) -> float:
        """The qualities of the paper, how they converge, what hides g1 and what sees the lift of g5."""
        cost = sum(_far_from(paper, self.of(i, chosen)) for i, paper in enumerate(SIMULATION.values()))
        ten, few, twenty, forty, dense = (self.of(index, chosen)[:, 0] for index in (0, 5, 6, 7, 8))
        cost += 2 * _outside(ten - few, 6.5, 13.5)
        cost += 3 * _outside(forty - twenty, -1.0, 1.0) + 3 * _outside(dense - forty, -0.5, 0.6)
        lift = self.interest(0)
        hides = [
            (one.hidden[0] | one.sees[0])[:, lift].all(axis=-1) & one.hidden[0][:, lift].any(axis=-1) for one in chosen
        ]
        cost += 100 * (1 - max(h.mean() for h in hides))
        return cost + 300 * (1 - max(one.sees[4][:, self.interest(4)].mean() for one in chosen))


class Screws(Search):
    """Four cameras; studies: red1 and red2 with a sample every second, then red2 with five a second."""

    cameras = 4
    fovs = (30, 36, 42, 48, 54, 60)

    def __init__(self) -> None:
        wanted = [("red1", screws.EVERY_SECOND), ("red2", screws.EVERY_SECOND), ("red2", FixedStep(0.2))]
        super().__init__(screws.screws_cell(), screws.TASK, wanted)
        self.aims = self.above("red1", "red2")

    def penalty(self, chosen: Sequence[Sight]) -> float:
        """The qualities of the paper, what hides red2, and when a slip of red2 is seen.

        What the slip costs is about twice the time until it is seen: the arm has to go all the way back.
        """
        cost = sum(_far_from(paper, self.of(i, chosen)) for i, paper in enumerate(REAL_WORLD.values()))
        found, lift = self.studies[2], self.interest(2)
        t, lifting = found.timeline.samples.t, found.motion.primitives[3]
        slip = 0.5 * (lifting.start + lifting.end)
        for seen in np.any([one.sees[2] for one in chosen], axis=0).all(axis=-1):
            later = t[seen & (t > slip)]
            cost += 5 / VARIANTS * beyond((later[0] if len(later) else 2 * t[-1]) - slip, 5.8, 7.2)
        placed = next(i for i, target in enumerate(found.targets) if target.atom.predicate == "obj_on_table")
        cost += 20 * (1 - max(one.hidden[2][:, lift, placed].mean() for one in chosen))
        cost += 40 * np.any([one.sees[2][:, lift, placed] for one in chosen], axis=0).mean()
        return cost


def _far_from(paper: Reported, found: np.ndarray) -> float:
    """How far qualities, shape (v, 2), are from reported ones; they are to be well within the 5 points asked for."""
    q_avg, q_eoi = found.T
    cost = _outside(q_avg, paper.q_avg - 3.5, paper.q_avg + 3.5) + 0.1 * np.abs(q_avg - paper.q_avg).mean()
    if paper.q_eoi in (0.0, 100.0):
        return cost + np.abs(q_eoi - paper.q_eoi).mean()
    return cost + _outside(q_eoi, max(51.5, paper.q_eoi - 3.5), min(68.5, paper.q_eoi + 3.5))


def _outside(values: np.ndarray, lower: float, upper: float) -> float:
    return float(np.mean([beyond(value, lower, upper) for value in values]))


def _print(cameras: Sequence[Camera]) -> None:
    """Entries of a workspace file."""
    for number, camera in enumerate(cameras, 1):
        eye, aim = camera.X_FC[:3, 3], camera.X_FC[:3, 3] + 1.2 * camera.X_FC[:3, 2]
        fov = np.degrees(2 * np.arctan(0.5 * camera.width / camera.matrix[0, 0]))
        print(f"  cam{number}:")
        print(f"    pose: {{position: {np.round(eye, 3).tolist()}, look_at: {np.round(aim, 3).tolist()}}}")
        print(f"    image: {{width: {camera.width}, height: {camera.height}, horizontal_fov: {fov:.0f} deg}}")


if __name__ == "__main__":
    search = {"tabletop": Tabletop, "screws": Screws}[sys.argv[1]]()
    _print(search.run(np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 0)))
