"""Search the six cameras of `workspaces/tabletop`: `python -m tests.reproduction.search_tabletop [SEED]`."""

from __future__ import annotations

import pickle, sys, time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sqrp_cli.knowledge.load import load_workspace
from sqrp_cli.programming.assessment import Study, study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.sampling import FixedCount
from sqrp_cli.programming.task import read_task
from tests.reproduction.layout_search import Grading, Sight, anneal, beyond, random_camera, sight

PAPER = {"g1": (67.80, 0.0), "g2": (80.25, 100.0), "g3": (83.87, 66.12), "g4": (79.88, 55.41), "g5": (36.67, 100.0)}
MORE = (5, 20, 40, 100)


class Tabletop:
    def __init__(self) -> None:
        workspace = load_workspace(Path("workspaces/tabletop"))
        self.cell = Cell.load(workspace)
        candidates = {c.name: c for c in read_task("pickup green", workspace).candidates}
        world = workspace.initial_world
        self.model = next(iter(workspace.cameras.values()))
        asked = [(name, 10) for name in PAPER] + [("g1", count) for count in MORE]
        found = [study(self.cell, candidates[name], world, FixedCount(count), full=False) for name, count in asked]
        self.studies = [s for s in found if isinstance(s, Study)]
        self.grading = Grading(self.studies)
        self.aims = np.array([workspace.objects[name].X_WO[:3, 3] + (0, 0, z) for name in [*PAPER, "g6"] for z in (0.0, 0.15, 0.3)])
        # g6 at its place, seen by a camera: its box in the first study's static scene
        self.g6 = workspace.objects["g6"].X_WO[:3, 3]

    def sees_g6(self, s: Sight) -> bool:
        X = np.linalg.inv(s.camera.X_FC)
        c = np.array([self.g6 + 0.025 * np.array(d) for d in np.ndindex(2, 2, 2)]) @ X[:3, :3].T + X[:3, 3]
        if (c[:, 2] < 0.3).any():
            return False
        p = c @ s.camera.matrix.T
        p = p[:, :2] / p[:, 2:]
        return bool((p > 5).all() and (p[:, 0] < s.camera.width - 6).all() and (p[:, 1] < s.camera.height - 6).all())

    def penalty(self, chosen: Sequence[Sight]) -> float:
        grades = [self.grading._of_study(index, chosen) for index in range(len(self.studies))]
        cost = 0.0
        for (q_avg, q_eoi), grade in zip(PAPER.values(), grades):
            for g in grade:
                cost += beyond(g[0], q_avg - 3.5, q_avg + 3.5) + 0.1 * abs(g[0] - q_avg)
                if q_eoi in (0.0, 100.0):
                    cost += abs(g[1] - q_eoi)
                else:
                    cost += beyond(g[1], max(51.5, q_eoi - 3.5), min(68.5, q_eoi + 3.5)) + 0.1 * abs(g[1] - q_eoi)
        few, twenty, forty, dense = grades[len(PAPER) :]
        ten = grades[0]
        for v in range(len(ten)):
            cost += 2 * beyond(ten[v, 0] - few[v, 0], 6.5, 13.5)
            cost += 3 * beyond(dense[v, 0] - forty[v, 0], -0.5, 0.6)
            cost += 3 * beyond(abs(forty[v, 0] - twenty[v, 0]), 0, 1.0)
        interest = self.studies[0].timeline.interesting
        hides = [s.hidden[0][:, interest].any(axis=-1) & (s.hidden[0] | s.sees[0])[:, interest].all(axis=-1) for s in chosen]
        cost += 100 * (1 - max(h.mean() for h in hides))
        interest = self.studies[4].timeline.interesting
        helps = [100 * s.sees[4][:, interest].mean() * self.sees_g6(s) for s in chosen]
        cost += 3 * (100 - max(helps))
        return cost / len(ten)


def main() -> None:
    seed = int(sys.argv[1]); N = int(sys.argv[2])
    random = np.random.default_rng(seed)
    cell = Tabletop()
    t0 = time.time()
    pool = []
    while len(pool) < N:
        camera = random_camera(random, cell.aims, cell.model, np.radians([22, 26, 30, 34, 40, 46]))
        s = sight(camera, cell.cell.observer, cell.studies, 1)
        if sum(x.mean() for x in s.sees[:5]) > 0.15 or cell.sees_g6(s):
            pool.append(s)
        if len(pool) % 50 == 0: print(len(pool), time.time() - t0, flush=True)
    pickle.dump(pool, open(f"/tmp/w/pool{seed}.pkl", "wb"))


if __name__ == "__main__":
    main()
