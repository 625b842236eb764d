"""`sqrp place --report`: what the command writes and refuses; what the page shows is tested with the pages."""

from __future__ import annotations

import pytest

MOUNTS = """
mounts: {above: {points: [[0.4, 0, 1.5], [0.9, 0.4, 1.2]]}}
lenses: {wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}}
"""


@pytest.fixture
def command(watch, tmp_path):
    (tmp_path / "place.yaml").write_text(MOUNTS)
    return ("place", watch, "watch cube", "--cameras", 1, "--mounts", tmp_path / "place.yaml")


def test_the_output_is_the_same_with_a_report_and_the_page_with_every_number_of_processes(sqrp, command, tmp_path):
    page = tmp_path / "page.html"
    first = sqrp(*command, "--report", page, "--jobs", 1)
    assert (first.code, first.out) == (0, sqrp(*command).out), first.err
    assert f"open {page} in a browser" in first.err
    details = [line for line in page.read_text().splitlines() if 'id="overview"' not in line]  # has the command in it
    sqrp(*command, "--report", page, "--jobs", 2)
    assert details == [line for line in page.read_text().splitlines() if 'id="overview"' not in line]
