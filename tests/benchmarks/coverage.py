"""View hulls against rays: time and truth on the same scene in the same run."""

from __future__ import annotations

from textwrap import fill

import numpy as np

from sqrp_cli.geometry import Array
from sqrp_cli.programming.sensing.limits import Cause
from tests.benchmarks import oracle
from tests.benchmarks.peers import EmbreePeer, MujocoPeer, Peer
from tests.benchmarks.scene import BenchmarkScene, lattice, make_scene
from tests.benchmarks.table import cpu_milliseconds, print_table

SIDES = (3, 4, 5, 6, 8, 10, 12)
"""Lattices that are tried, in this order, until the rays are as often right as the view hulls."""

TIMED = (2, 3, 5)
"""Lattices that are timed in any case."""


def compare(runs: int) -> None:
    """View hulls, and each peer at 8 rays and at as many as it needs: the robot alone, and with fixtures in the way."""
    _compare("robot alone", make_scene(), runs)
    _compare("with crate, post and thin rail", make_scene(fixtures=True), runs)
    print("  agree: with exact clipping of all triangles. x ours: above 1 is slower than sqrp.")


def _compare(name: str, scene: BenchmarkScene, runs: int) -> None:
    within = _within(scene)
    truth = oracle.hidden(scene, within)
    ours = _ours_hidden(scene)
    agreement = _agreement(ours, truth, within)
    full, alone = (
        cpu_milliseconds(lambda: _ours_full(scene), runs),
        cpu_milliseconds(lambda: _ours_covered(scene), runs),
    )
    rows = [["sqrp, view hulls with causes", "", f"{full:.1f}", "1.0", f"{alone:.1f}", "1.0", f"{agreement:.2%}"]]
    notes = []
    for peer in (MujocoPeer(scene), EmbreePeer(scene)):
        reached, shares = False, []
        for side in (2, *SIDES):
            points = lattice(side)
            share = _agreement(peer.hidden(within, points), truth, within)
            reached = share >= agreement
            shares.append(f"{len(points)}: {share:.2%}")
            if side in TIMED or reached or side == SIDES[-1]:
                times = _peer_times(scene, peer, points, runs)
                note = " (never equal)" if side == SIDES[-1] and not reached else ""
                rows.append(
                    [f"{peer.name}{note}", f"{len(points)}", f"{times[0]:.1f}", f"{times[0] / full:.1f}",
                     f"{times[1]:.1f}", f"{times[1] / alone:.1f}", f"{share:.2%}"]
                )  # fmt: skip
            if reached:
                break
        notes.append(f"{peer.name}, rays and agreement: " + ", ".join(shares))
    print_table(
        f"Coverage, CPU, {name}: {scene.states.count} states, {len(scene.observer.cameras)} cameras, "
        f"{len(scene.boxes)} boxes,\n  {scene.triangles:,} triangles, {within.sum():,} lines of sight, "
        f"{(truth & within).sum() / within.sum():.0%} hidden",
        ["", "rays", "full ms", "x ours", "cover ms", "x ours", "agree"],
        rows,
    )
    for note in notes:
        print(fill(note, 78, initial_indent="  ", subsequent_indent="    "))


def grow(runs: int) -> None:
    """How the time grows with each measure of the scene, doubled from the benchmark's."""
    variants: list[tuple[str, dict[str, int]]] = [
        ("benchmark scene", {}),
        ("320 states", {"states": 320}),
        ("640 states", {"states": 640}),
        ("12 cameras", {"cameras": 12}),
        ("24 cameras", {"cameras": 24}),
        ("6 boxes", {"boxes": 6}),
        ("12 boxes", {"boxes": 12}),
        ("triangles x 4", {"splits": 1}),
        ("triangles x 16", {"splits": 2}),
    ]
    rows, first = [], None
    for name, change in variants:
        scene = make_scene(**change)
        times = [
            cpu_milliseconds(lambda s=scene: _ours_full(s), runs),
            cpu_milliseconds(lambda s=scene: _ours_covered(s), runs),
        ]
        first = first or times
        rows.append([name, f"{scene.triangles:,}", f"{times[0]:.1f}", f"{times[0] / first[0]:.2f}",
                     f"{times[1]:.1f}", f"{times[1] / first[1]:.2f}"])  # fmt: skip
    print_table("Growth, CPU", ["", "triangles", "full ms", "x", "cover ms", "x"], rows)


def _within(scene: BenchmarkScene) -> Array:
    """Which views pass every limit but occlusion, shape (boxes, cameras, states)."""
    within = scene.observer.limits(scene.boxes, scene.states, np.arange(scene.states.count)).cause == Cause.NONE
    return within.reshape(len(scene.observer.cameras), len(scene.boxes), -1).swapaxes(0, 1)


def _ours_full(scene: BenchmarkScene) -> list[object]:
    return scene.observer.verdicts(scene.targets, scene.states, shares=False)


def _ours_hidden(scene: BenchmarkScene) -> Array:
    verdicts = [boxes[0] for boxes in scene.observer.verdicts(scene.targets, scene.states, shares=False)]
    return np.stack([box.cause.T == Cause.HIDDEN for box in verdicts])


def _ours_covered(scene: BenchmarkScene) -> list[object]:
    rows = np.arange(scene.states.count)
    return list(scene.observer.coverage(scene.targets, scene.states, [rows] * len(scene.targets)))


def _peer_times(scene: BenchmarkScene, peer: Peer, points: Array, runs: int) -> tuple[float, float]:
    """Full matrix and coverage alone [ms]; both include the limits, which are computed for the peer as for us."""
    full = cpu_milliseconds(lambda: peer.hidden(_within(scene), points), runs)
    return full, cpu_milliseconds(lambda: peer.covered(_within(scene), points), runs)


def _agreement(found: Array, truth: Array, within: Array) -> float:
    return float((found == truth)[within].mean())
