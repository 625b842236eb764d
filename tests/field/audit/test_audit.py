"""A program's motion is found in joint states, whatever else they show; a fit of a camera has the right slopes."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.field.audit.bag_footage import Tracks, found_steps
from sqrp_cli.field.audit.camera_fit import SeenEdges
from sqrp_cli.recording.bags import joint_tracks
from sqrp_cli.trajectory import Trajectory
from tests.run.steps import played

ARM = ["shoulder", "elbow"]


def moved(start: list[float], end: list[float], time: float) -> Any:
    """A step that moves the joints with a smooth start and end."""
    law = [[0.0, 0.0, 3 / time**2, -2 / time**3]]
    coefficients = [[[(a + b) / 2 for a, b in zip(start, end, strict=True)],
                     [(b - a) / 2 for a, b in zip(start, end, strict=True)]]]  # fmt: skip
    numbers = {"path": {"breaks": [0.0, 1.0], "coefficients": coefficients}}
    motion = Trajectory.from_numbers({**numbers, "law": {"breaks": [0.0, time], "coefficients": law}})
    return SimpleNamespace(time=time, primitives=[played(motion)], short_task="pickup g1")


OUT, BACK = moved([0.0, 0.0], [0.6, -0.4], 3.0), moved([0.6, -0.4], [0.0, 0.3], 2.0)
PROGRAM: Any = SimpleNamespace(joints=tuple(ARM), steps=[OUT, BACK])


def position(runs: list[tuple[float, Any, float]], t: np.ndarray) -> np.ndarray:
    """Where the joints are: of each run the start [s], the step, and the share after which it stands still."""
    q = np.zeros((len(t), 2))
    for start, step, share in runs:
        tau = np.clip(t - start, 0.0, share * step.time)
        q = np.where((t >= start)[:, None], step.primitives[0].trajectory.positions(tau), q)
    return q


def recorded(runs: list[tuple[float, Any, float]], rate: float = 50.0, end: float = 20.0) -> Tracks:
    """Joint states, each joint on a topic of its own and a little later than the other."""
    states, rng = [], np.random.default_rng(0)
    for column, name in enumerate(ARM):
        t = np.arange(0.0, end, 1.0 / rate) + 0.003 * column
        q = position(runs, t)[:, column] + rng.normal(0.0, 1e-4, len(t))
        for time, value in zip(t, q, strict=True):
            states.append((f"/{name}", time, [name, "finger"], [value, float("nan")]))
    return {name: track for (_, name), track in joint_tracks(states).items()}


HOME, TWICE = moved([0.6, -0.4], [0.0, 0.0], 2.0), [(2.0, OUT, 1.0), (6.0, BACK, 1.0), (10.0, OUT, 1.0)]


@pytest.mark.parametrize(
    ("steps", "moves", "starts", "runs"),
    [
        ([OUT, BACK], [(4.123, OUT, 1.0), (9.456, BACK, 1.0)], [4.123, 9.456], 1),
        ([OUT, BACK], [*TWICE, (14.0, BACK, 1.0)], [2.0, 6.0], 2),
        ([OUT, BACK], [*TWICE, (14.0, BACK, 0.2)], [2.0, 6.0], 1),
        ([OUT, HOME] * 2, [(1.0, OUT, 1.0), (5.0, HOME, 1.0), (9.0, OUT, 1.0), (13.0, HOME, 1.0)], [1, 5, 9, 13], 1),
        ([OUT], [(5.0, OUT, 0.6)], [5.0], 1),
    ],
    ids=["one run", "two runs", "one that was stopped", "a step that comes again", "a step that was stopped"],
)
def test_each_step_of_the_first_run_is_found_and_how_many_runs_there_are(steps, moves, starts, runs) -> None:
    program: Any = SimpleNamespace(joints=tuple(ARM), steps=steps)
    found, count = found_steps(program, ARM, recorded(moves), Path("run.mcap"))
    assert found == pytest.approx(starts, abs=2e-3 if len(steps) == 1 else 1e-3)
    assert count == runs


@pytest.mark.parametrize("end", [0.7, 1.0])
def test_of_a_recording_that_was_interrupted_it_is_said_that_it_ends_too_early(end: float) -> None:
    says = f"this recording ends at {end - 0.02:.2f} s, too early in the motion of step 1, pickup g1; expected at least"
    with pytest.raises(InputError, match=f"{says} the first 35% of it"):
        found_steps(PROGRAM, ARM, recorded([(0.05, OUT, 1.0)], end=end), Path("run.mcap"))


@pytest.mark.parametrize(("runs", "arm", "says"), [
    ([], ["shoulder", "wrist"], "lack wrist; they have `elbow`, `shoulder`"),
    ([(5.0, OUT, 1.0)], ARM, "the motion of step 2, pickup g1, is not in the joint states"),
    ([(5.0, moved([0.0, 0.0], [0.6, -0.4], 9.0), 1.0)], ARM, "step 1, .* it fits; expected at least the first 35% of"),
])  # fmt: skip
def test_what_is_not_there_is_said(runs: Any, arm: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        found_steps(PROGRAM, arm, recorded(runs), Path("run.mcap"))


ROOT = Path(__file__).parents[3]


def test_slopes_are_the_differences_of_how_far_points_are_away() -> None:
    rng = np.random.default_rng(3)
    camera = load_workspace(ROOT / "workspaces" / "tabletop").cameras["cam1"]
    projection, n = Projection(camera), 50
    points = np.column_stack([rng.uniform(-0.1, 0.1, (n, 2)), rng.uniform(0.8, 1.2, n)])
    owner = rng.integers(-1, 2, n)
    fitted = SeenEdges(
        projection=projection, points=points, speeds=rng.normal(0.0, 0.3, (n, 3)), levers=rng.normal(0.0, 0.05, (n, 3)),
        body=rng.integers(0, 4, n), pixels=projection.pixels(points)[0], normals=rng.normal(size=(n, 2)),
        contrast=np.zeros((n, 21)), R_CW=np.tile(np.linalg.qr(rng.normal(size=(3, 3)))[0], (n, 1, 1)), alike=np.ones(n),
        owned=owner[:, None] == [0, 1], deviations=np.ones(16), reach=5.0,
    )  # fmt: skip
    change = rng.normal(0.0, 0.02, len(fitted.deviations))
    steps = 1e-6 * np.eye(len(change))
    differences = [fitted.away(change + step) - fitted.away(change - step) for step in steps]
    np.testing.assert_allclose(fitted.slopes(change), np.stack(differences, axis=1) / 2e-6, rtol=1e-4, atol=0.05)
