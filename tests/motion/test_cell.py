"""What would take minutes because of its size is refused, at its line, before anything is checked for contacts."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sqrp_cli.errors import Problem
from sqrp_cli.starter.make import make_starter
from tests.cells import FILES, refused
from tests.task.robots import joint, written_urdf

LIMIT = '<limit lower="{0}" upper="{1}" velocity="1" effort="100"/>'


def six_axes(far: str = "0 0 0.4", limit: str = LIMIT.format(-3, 3)) -> tuple[str, ...]:
    places = ("0 0 0.3", "0.1 0 0.1", far, "0.3 0 0", "0.1 0 0", "0.08 0 0")
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    return tuple(
        joint(f"j{k}", f"link{k}", f"link{k + 1}", "revolute", place, axis, limit)
        for k, (place, axis) in enumerate(zip(places, axes, strict=True))
    )


def with_shape(urdf: Path, link: str, shape: str) -> Path:
    solid = f'<link name="{link}">\n<collision><geometry>{shape}</geometry></collision></link>'
    urdf.write_text(urdf.read_text().replace(f'<link name="{link}"/>', solid))
    return urdf


def refusal(folder: Path, urdf: Path) -> Problem:
    return refused(make_starter, folder / "cell", str(urdf))


@pytest.mark.parametrize("shape", ['<box size="900 900 900"/>', '<mesh filename="cube.stl" scale="9000 9000 9000"/>',
                                   '<sphere radius="25"/>'], ids=["box", "mesh", "sphere"])  # fmt: skip
def test_a_link_that_moves_and_is_a_hill_is_refused(tmp_path, shape):
    shutil.copy(FILES / "cube.stl", tmp_path)
    urdf = with_shape(written_urdf(tmp_path / "arm.urdf", *six_axes()), "link3", shape)
    problem = refusal(tmp_path, urdf)
    assert problem.code == "link-too-large"
    assert problem.message.startswith("link `link3` moves, and part `link3` of it reaches ")
    assert problem.message.endswith(" m from its origin, expected at most 20 m")
    assert (problem.place.file, problem.place.line) == (urdf, 1)


def test_a_joint_far_from_the_one_that_carries_it_is_refused(tmp_path):
    problem = refusal(tmp_path, written_urdf(tmp_path / "arm.urdf", *six_axes(far="0 0 900")))
    assert problem.message == "joint `j2` is 900 m from the one that carries it, expected at most 20 m"


def test_an_arm_of_dozens_of_joints_is_refused(tmp_path):
    chain = [
        joint(f"j{k}", f"link{k}", f"link{k + 1}", "continuous", "0 0 0.05", ("0 0 1", "0 1 0")[k % 2])
        for k in range(40)
    ]
    problem = refusal(tmp_path, written_urdf(tmp_path / "snake.urdf", *chain))
    assert problem.code == "too-many-joints"
    assert problem.message == "40 joints move `link40`, expected at most 20 in an arm"


@pytest.mark.parametrize("limit", [1e18, 600.0])
def test_limits_that_mean_none_are_none(tmp_path, limit):
    """Whole turns within such limits were all tried, in all combinations of the joints; a hall may stand around it."""
    urdf = written_urdf(tmp_path / "arm.urdf", *six_axes(limit=LIMIT.format(-limit, limit)))
    made = make_starter(tmp_path / "cell", str(with_shape(urdf, "link0", '<box size="90 90 0.01"/>')))
    assert made.tip == "link6"
    assert ("no-limit" in [warning.code for warning in made.warnings]) == (limit > 629)
