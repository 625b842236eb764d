"""The fit of a camera to edges: its derivatives are those of what it minimises."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sqrp_cli.camera.projection import Projection
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.field.audit.camera_fit import SeenEdges

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
