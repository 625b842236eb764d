"""Every number of every YAML file of a cell, made extreme: refused where it stands, or used and ranked soundly."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.errors import InputError
from sqrp_cli.files.source import KeyPath, dotted
from sqrp_cli.files.units import read_quantity
from sqrp_cli.files.yaml_file import read_yaml
from tests.damage.cell import described_cell

SKILL = "skills/pickup/skill.yaml"
FILES = ("workspace.yaml", SKILL, "camera.yaml", "opencv.yaml", "hand_eye.yaml")
OUT_OF_ALL_BOUNDS = (math.nan, math.inf, -math.inf, 1e9, -1e9)
EXTREMES = (*OUT_OF_ALL_BOUNDS, 0, -1, 1e-9, -1e-9, 1e-6, 1e-3, 1e3, -1e3, 1e6, 180, 1)


@dataclass(frozen=True)
class Field:
    """A number of a file, by the path of its key."""

    file: str
    path: KeyPath

    def __str__(self) -> str:
        return f"{self.file}:{dotted(self.path)}"


def everything_stated(workspace: dict[str, Any], skill: dict[str, Any]) -> None:
    """Numbers that a cell may state and the starter leaves to their defaults."""
    workspace["padding"] = "1 mm"
    workspace["robot"]["limits"] = {
        "velocity": {f"joint_{number}": 1.0 for number in range(1, 7)},
        "acceleration": 2,
        "jerk": 20,
        "stop_acceleration": 4,
        "stop_jerk": 40,
    }
    workspace["robot"]["markers"] = {"wrist_1": {"id": 3, "side": "2 cm"}}
    workspace["tasks"] = [{"task": "pickup red", "min_q_avg": 0.1, "min_q_eoi": 0.1, "max_time": 60, "max_delay": 10}]
    eye = {"pose": {"position": [0.9, 0.6, 0.6], "look_at": [0.36, -0.08, 0.05], "up": [0, 0, 1]}, "rate": 10}
    lens = {"distortion": {"model": "plumb_bob", "coefficients": [-0.1, 0.01, 0, 0, 0]}}
    eye["image"] = {"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240, **lens}
    workspace["cameras"] |= {
        "eye": eye,
        "wide": {**eye, "near": 0.1, "far": 10, "latency": 0.05, "image": {"width": 640, "height": 480}},
    }
    workspace["cameras"]["wide"]["image"]["horizontal_fov"] = "70 deg"
    parts = [{"cylinder": {"radius": "2 cm", "length": "4 cm"}}, {"box": [0.04, 0.04, 0.04]}, {"sphere": 0.02}]
    workspace["objects"]["r1"] |= {"parts": [*parts, {"capsule": {"radius": "1 cm", "length": "2 cm"}}], "marker": 7}
    skill["waypoints"]["grasp"]["depth"] = 0
    skill["waypoints"]["above"] = {"from": "grasp", "retreat": "2 cm"}
    for primitive in skill["primitives"]:
        if "straight_move" in primitive:
            primitive |= {"acceleration": 0.5, "jerk": 5}
    skill["faults"]["slip"]["settle"] = 0.5
    for target in skill["targets"].values():
        target["boxes"][0] |= {"margin": 0.0, "pose": {"position": [0, 0, 0], "rpy": [0, 0, 0]}}


class Stated:
    """A cell with a file of every kind, which states every number, each on a line of its own."""

    def __init__(self, cell: Path) -> None:
        self.cell = cell
        self.documents = {file: read_yaml(cell / file) for file in FILES}
        self.fields = [
            Field(file, path)
            for file, document in self.documents.items()
            for path in numbers(document.data)
            if file in FILES[:2] or (path[0] in USED_OF_CALIBRATIONS and path[-1] not in ("rows", "cols"))
        ]

    @contextmanager
    def changed(self, field: Field, value: float) -> Iterator[int | None]:
        """The line of a number, which is another one for a while."""
        path = self.cell / field.file
        content = path.read_bytes()
        data = yaml.load(content, Loader=yaml.CSafeLoader)
        owner = data
        for step in field.path[:-1]:
            owner = owner[step]
        owner[field.path[-1]] = value
        write(path, data)
        try:
            yield self.documents[field.file].value_place(field.path).line
        finally:
            path.write_bytes(content)


@pytest.fixture(scope="module")
def stated(tmp_path_factory: pytest.TempPathFactory) -> Stated:
    cell = described_cell(tmp_path_factory.mktemp("extreme") / "cell")
    opencv = frozenset({"!!opencv-matrix"})
    data = {file: read_yaml(cell / file, opencv).data for file in FILES}
    everything_stated(data["workspace.yaml"], data[SKILL])
    for file in FILES:
        write(cell / file, data[file])
    return Stated(cell)


def write(path: Path, data: object) -> None:
    path.write_text(yaml.dump(data, Dumper=yaml.CSafeDumper, sort_keys=False), encoding="utf-8")


def numbers(value: object, path: KeyPath = ()) -> Iterator[KeyPath]:
    """The paths of the numbers in a document."""
    if isinstance(value, dict | list):
        for key, inner in value.items() if isinstance(value, dict) else enumerate(value):
            yield from numbers(inner, (*path, key))
    elif read_quantity(value) is not None:
        yield path


USED_OF_CALIBRATIONS = {
    *("image_width", "image_height", "camera_matrix", "distortion_coefficients", "transform"),
}
"""Keys of calibration files that are read; others are those of the programs that wrote them."""


def test_a_number_out_of_all_bounds_is_refused_on_its_line(stated: Stated) -> None:
    assert len(stated.fields) > 150
    accepted = []
    for number, field in enumerate(stated.fields):
        for value in (OUT_OF_ALL_BOUNDS * 2)[number % 5 :][:2]:  # each field two of the five, in turn
            with stated.changed(field, value) as line:
                try:
                    load_workspace(stated.cell)
                except InputError as error:
                    places = [
                        (problem.place.file.name, problem.place.line) for problem in error.problems if problem.place
                    ]
                    if (Path(field.file).name, line) in places:
                        continue
                    accepted.append((str(field), value, error.problems))
                else:
                    accepted.append((str(field), value, "accepted"))
    assert accepted == []


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_an_extreme_number_is_refused_or_ranked_soundly(
    data: st.DataObject, stated: Stated, sqrp: Callable[..., Any]
) -> None:
    field = data.draw(st.sampled_from(stated.fields))
    value = data.draw(st.sampled_from(EXTREMES) | st.floats())
    assert_sound(stated, field, value, sqrp)


def assert_sound(stated: Stated, field: Field, value: float, sqrp: Callable[..., Any]) -> None:
    """Whether the ranking ends as it must: a refusal that names a place, or shares and times that can be."""
    before = time.process_time()
    with stated.changed(field, value):
        outcome = sqrp("rank", stated.cell, "pickup red", "--samples", "2", "--json")
    assert time.process_time() - before < 10.0
    assert outcome.code in (0, 1, 2), outcome.err
    assert "Warning:" not in outcome.err, outcome.err
    assert "Traceback" not in outcome.err, outcome.err
    if outcome.code == 2:
        assert f"{stated.cell}/" in outcome.err, outcome.err
        return
    for candidate in outcome.document["candidates"]:
        shares = [candidate["q_avg"], candidate["q_eoi"]]
        assert all(share is None or 0.0 <= share <= 1.0 for share in shares), shares
        assert candidate["time"] is None or 0.0 < candidate["time"] < math.inf
