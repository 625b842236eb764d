"""What is not a number is never within a limit, never free of what is in the way, and never gets into a record."""

from __future__ import annotations

from dataclasses import replace
from typing import get_type_hints

import numpy as np
import pytest

from sqrp_cli.camera.projection import Projection
from sqrp_cli.figures import NO_FIGURES, FaultMetrics, Figures, Qualities
from sqrp_cli.geometry import Array, pose
from sqrp_cli.kernel import kernel
from sqrp_cli.sight.limits import Cause
from sqrp_cli.study.result import CandidateResult
from tests.sight.views import box_part, look, make_box, make_camera, make_detector, solid_of

NAN = float("nan")
LENSES = {"none": (), "plumb_bob": (-0.1, 0, 0, 0, 0), "equidistant": (0.01, 0, 0, 0)}


@pytest.mark.parametrize("model", LENSES)
def test_a_lens_shows_no_point_that_is_not_a_number(model: str) -> None:
    projection = Projection(make_camera(model=model, distortion=LENSES[model]))
    _, inside = projection.pixels(np.array([[0.0, 0.0, 1.0], [NAN, 0.0, 1.0], [0.0, NAN, 1.0], [0.0, 0.0, NAN]]))
    assert inside.tolist() == [True, False, False, False]


@pytest.mark.parametrize("broken", ["matrix", "max_incidence", "min_pixels"])
def test_the_kernel_takes_no_camera_and_no_detector_with_a_figure_that_is_none(broken: str) -> None:
    camera, box = make_camera(pose(position=(0.0, 0.0, -1.0))), make_box()
    if broken == "matrix":
        object.__setattr__(camera, "matrix", np.full((3, 3), NAN))  # past the check of the record
    else:
        box = make_box(detector=replace(make_detector(), **{broken: NAN}))
    with pytest.raises(ValueError, match="has a figure that is none"):
        look(camera, box)


@pytest.mark.parametrize(
    ("vertices", "triangles", "said"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "needs triangles"),
        (np.zeros((3, 3)), np.array([[0, 1, 3]]), "none of 3"),
        (np.full((3, 3), NAN), np.array([[0, 1, 2]]), "not finite"),
    ],
)
def test_the_kernel_takes_no_solid_without_triangles_or_with_vertices_that_are_nowhere(
    vertices: Array, triangles: Array, said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        kernel.Solid(vertices, triangles, kernel.Form.MESH, pose(), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def test_a_flat_solid_and_a_needle_hide_nothing_beside_them_and_break_nothing() -> None:
    """Triangles without area, and a box that is seen edge-on."""
    flat = solid_of(np.array([[0.0, 0.0, 0.5], [0.0, 0.0, 0.5], [0.0, 0.001, 0.5]]), np.array([[0, 1, 2], [0, 0, 0]]))
    for size in ((0.04, 0.04, 0.04), (0.04, 0.04, 1e-6)):
        for share in (1.0, 0.5):
            box = make_box(size, pose(position=(0.3, 0.0, 1.0)), detector=make_detector(share))
            assert look(make_camera(), box, [flat]).cause.tolist() == [[Cause.NONE]]


FIGURES = [name for name, kind in get_type_hints(Figures).items() if kind == float | None]


def _spoilt(X: Array) -> Array:
    X[1, 0] = NAN
    return X


@pytest.mark.parametrize(
    "make",
    [
        lambda: make_camera(_spoilt(pose())),
        lambda: make_camera(2.0 * pose()),
        lambda: make_camera(np.diag([1.0, 1.0, -1.0, 1.0])),
        lambda: make_camera(focal=(NAN, 500.0)),
        lambda: make_camera(model="plumb_bob", distortion=(NAN, 0, 0, 0, 0)),
        lambda: make_box(X_FB=_spoilt(pose())),
        lambda: make_box((NAN, 0.1, 0.1)),
        lambda: make_box(normal=(0.0, NAN, 1.0)),
        lambda: box_part("part", (0.1, 0.1, 0.1), _spoilt(pose())),
        lambda: look(make_camera(), make_box(), frames={"world": _spoilt(pose())[None]}),
        lambda: look(make_camera(), make_box(), frames={"world": np.array([pose(), _spoilt(pose())])}),
        lambda: Qualities(NAN, None),
        lambda: FaultMetrics(0.1, NAN, 0.0, 0.0, 1.0),
        *(lambda name=name: replace(NO_FIGURES, **{name: NAN}) for name in FIGURES),
        *(lambda name=name: replace(CandidateResult.infeasible(None, ()), **{name: NAN}) for name in FIGURES),
        lambda: replace(CandidateResult.infeasible(None, ()), error=NAN),
        lambda: replace(CandidateResult.infeasible(None, ()), largest_gap=NAN),
    ],
)
def test_no_record_takes_a_pose_or_figure_that_is_not_finite(make: object) -> None:
    with pytest.raises(ValueError, match=r"is none|not finite"):
        make()
