"""View hulls against rays: time and truth on the same scenes in the same run, and how time grows with triangles."""

from __future__ import annotations

from functools import partial

import numpy as np

from sqrp_cli.geometry import BOX_SIGNS, Array, transform
from sqrp_cli.sight.limits import Cause
from tests.benchmarks.peers import EmbreePeer
from tests.benchmarks.scene import BenchmarkScene, lattice, make_scene
from tests.benchmarks.table import cpu_milliseconds, print_table
from tests.sight.plain_geometry import cut, half_spaces, near

SIDES = (2, 5)
"""Points along the edges of the boxes' lattices: 8 and 98 rays."""

SCENES: dict[str, dict[str, int]] = {
    "robot alone": {},
    "with crate, post and rail": {"fixtures": True},
    "4 times the triangles": {"splits": 1},
    "16 times the triangles": {"splits": 2},
}


def compare(runs: int) -> None:
    """A row for each scene and lattice."""
    rows = []
    for name, changes in SCENES.items():
        scene = make_scene(**changes)
        times, causes = _own_times(scene, runs), _causes(scene)
        ours, within = causes == Cause.HIDDEN, (causes == Cause.HIDDEN) | (causes == Cause.NONE)
        truth = None if scene.triangles > 10_000 else _hidden(scene, within)
        rows.append([name, f"{scene.triangles:,}", "hull", *_row(times, times), _right(ours, truth, within)])
        peer = EmbreePeer(scene)
        for side in SIDES:
            points = lattice(side)
            of_peer = tuple(cpu_milliseconds(partial(ask, within, points), runs) for ask in (peer.hidden, peer.covered))
            right = _right(peer.hidden(within, points), ours if truth is None else truth, within)
            rows.append(["Embree", "", f"{len(points)}", *_row(of_peer, times), right])
    title = "Coverage of 160 states by 6 cameras of 3 boxes; CPU [ms], and the time of view hulls over that of rays"
    head = ["", "triangles", "rays", "all, with causes", "ours over", "coverage", "ours over", "right"]
    print_table(title, head, rows, "coverage")


def _hidden(scene: BenchmarkScene, asked: Array) -> Array:
    """Whether any triangle reaches into the hull of camera centre and box, for `asked` (boxes, cameras, states)."""
    found = np.zeros(asked.shape, dtype=bool)
    points = [scene.points(box, BOX_SIGNS) for box in scene.boxes]
    solids = [(scene.states.X_WF[one.part.parent], one) for one in scene.observer.solids]
    for box, camera, state in np.argwhere(asked):
        spaces = half_spaces(np.vstack([points[box][state], scene.eye(camera)]))
        placed = (transform(X_WP[state % len(X_WP)], one.vertices)[one.triangles] for X_WP, one in solids)
        found[box, camera, state] = any(cut(list(t), spaces) for triangles in placed for t in near(triangles, spaces))
    return found


def _row(times: tuple[float, float], ours: tuple[float, float]) -> list[str]:
    return [text for spent, own in zip(times, ours, strict=True) for text in (f"{spent:.1f}", f"{own / spent:.3f}")]


def _own_times(scene: BenchmarkScene, runs: int) -> tuple[float, float]:
    """Full matrix and coverage alone [ms], limits included."""
    rows = [np.arange(scene.states.count)] * len(scene.targets)
    full = cpu_milliseconds(lambda: scene.observer.verdicts(scene.targets, scene.states, shares=False), runs)
    return full, cpu_milliseconds(lambda: scene.observer.coverage(scene.targets, scene.states, rows), runs)


def _causes(scene: BenchmarkScene) -> Array:
    """The first limit that each view fails, shape (boxes, cameras, states)."""
    verdicts = scene.observer.verdicts(scene.targets, scene.states, shares=False)
    return np.stack([boxes[0].cause.T for boxes in verdicts])


def _right(found: Array, truth: Array | None, within: Array) -> str:
    """The share of verdicts within the limits that agree with exact clipping of all triangles, or with `truth`."""
    return "" if truth is None else f"{(found == truth)[within].mean():.2%}"
