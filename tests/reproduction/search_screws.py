from __future__ import annotations

import pickle, sys, time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.programming.assessment import Study, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.sampling import FixedStep
from sqrp_cli.programming.task import read_task
from tests.reproduction.layout_search import Grading, Sight, anneal, beyond, random_camera, sight


class Screws:
    def __init__(self) -> None:
        workspace = load_workspace(Path("workspaces/screws"))
        self.cell = Cell.load(workspace)
        candidates = {c.name: c for c in read_task("pickup_two_finger screw", workspace).candidates}
        world = workspace.initial_world
        self.model = next(iter(workspace.cameras.values()))
        found = [study(self.cell, candidates[n], world, FixedStep(dt), full=False) for n, dt in (("red1", 1.0), ("red2", 1.0), ("red2", 0.2))]
        self.studies = [s for s in found if isinstance(s, Study)]
        assert len(self.studies) == 3, found
        print([s.motion.time for s in self.studies])
        self.grading = Grading(self.studies)
        self.aims = np.array([workspace.objects[name].X_WO[:3, 3] + (0, 0, z) for name in ("red1", "red2") for z in (0.0, 0.15, 0.3)] + [[0.1, -0.4, 0.15], [0.3, -0.1, 0.3]])

    def penalty(self, chosen: Sequence[Sight]) -> float:
        one, two, fine = (self.grading._of_study(index, chosen) for index in range(3))
        cost = 0.0
        s = self.studies[2]
        t = s.timeline.samples.t
        lift_end = s.motion.primitives[3].end
        slip = 0.5 * (s.motion.primitives[3].start + lift_end)
        seen = np.any([x.sees[2] for x in chosen], axis=0).all(axis=-1)
        for v in range(len(one)):
            cost += beyond(one[v, 0], 89.5, 95.0) + 0.1 * abs(one[v, 0] - 92.27) + abs(one[v, 1] - 100)
            cost += beyond(two[v, 0], 7.7, 14.7) + 0.1 * abs(two[v, 0] - 11.19) + abs(two[v, 1])
            later = t[seen[v] & (t > slip)]
            first = later[0] if len(later) else 60.0
            cost += 5 * beyond(first - slip, 5.8, 7.2)
        interest = s.timeline.interesting
        placed = [x.hidden[2][:, interest, 1].mean() for x in chosen]
        cost += 20 * len(one) * (1 - max(placed))
        cost += 40 * len(one) * np.mean(np.any([x.sees[2][:, interest, 1] for x in chosen], axis=0))
        useful = sorted(x.sees[0].all(axis=-1).mean() for x in chosen)
        cost += len(one) * sum(beyond(u, 0.15, 1.0) for u in useful[1:]) * 2
        return cost / len(one)


def main() -> None:
    seed = int(sys.argv[1]); N = int(sys.argv[2])
    random = np.random.default_rng(seed)
    cell = Screws()
    t0 = time.time()
    pool = []
    while len(pool) < N:
        camera = random_camera(random, cell.aims, cell.model, np.radians([30, 36, 42, 48, 54, 60]))
        s = sight(camera, cell.cell.observer, cell.studies, 3)
        it = cell.studies[2].timeline.interesting
        if s.sees[0].all(-1).mean() > 0.15 or s.sees[1].all(-1).mean() > 0.05 or s.hidden[2][:, it, 1].mean() > 0.8:
            pool.append(s)
            if len(pool) % 20 == 0: print(len(pool), time.time() - t0, flush=True); pickle.dump(pool, open(f"/tmp/w/spool{seed}.pkl", "wb"))


if __name__ == "__main__":
    main()
