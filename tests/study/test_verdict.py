from __future__ import annotations

import re
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import axis_rotation, displacement
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.study.analysis import Analysis, analyse, analysed
from sqrp_cli.study.blind_spans import cause_totals, sample_weights
from sqrp_cli.study.sampling import Adaptive
from sqrp_cli.study.verdict import (
    BlindSpot,
    CameraCause,
    CameraChange,
    explain_blind_spot,
    longest_blind_spot,
    stretches,
    with_verdict,
)
from sqrp_cli.task.task import read_task

CANDIDATES = ("g1", "g2", "g3", "g4", "g5")
CAMERAS = ("cam1", "cam2", "cam3", "cam4", "cam5", "cam6")


@pytest.fixture(scope="module")
def cell(tabletop: Workspace) -> Cell:
    return Cell.load(tabletop)


@pytest.fixture(scope="module")
def analyses(cell: Cell) -> dict[str, Analysis]:
    found = {}
    for name in CANDIDATES:
        candidate = read_task(f"pickup {name}", cell.workspace).candidates[0]
        result = analyse(cell, candidate, cell.initial_world, Adaptive(), full=True)
        assert isinstance(result, Analysis)
        found[name] = result
    return found


@pytest.mark.parametrize("name", CANDIDATES)
def test_what_the_verdict_says_is_true(name: str, cell: Cell, analyses: dict[str, Analysis]) -> None:
    found = analyses[name]
    timeline = found.timeline
    text, blind = with_verdict(cell, found.timeline, found.result).verdict, timeline.observation.blind
    if not blind.any():
        assert text == "Everything that must be seen is seen."
        return
    times = re.search(r"From (\d+\.\d) s to (\d+\.\d) s", text)
    assert times is not None
    start, end = (float(time) for time in times.groups())
    t = timeline.samples.t
    inside = (t > start + 0.06) & (t < end - 0.06)
    assert blind[inside].all(), "every sample of the stretch is blind"
    if (blind & timeline.of_interest).any():
        assert timeline.of_interest[inside].all(), "events of interest come first"
    assert re.search(r"\(camera `(\w+)`", text)[1] in cell.workspace.cameras


@pytest.mark.parametrize("name", CANDIDATES)
def test_the_totals_of_a_camera_and_the_time_it_sees_add_up_to_what_was_asked(
    name: str, cell: Cell, analyses: dict[str, Analysis]
) -> None:
    found = analyses[name]
    weights, observation = sample_weights(found), found.timeline.observation
    assert weights.sum() == pytest.approx(found.planned.motion.time, abs=1e-9)
    totals = cause_totals(cell, found)
    for column, target in enumerate(found.planned.targets):
        required, seen = observation.required[:, column], sees_all(observation.full_matrix[column])
        for index, camera in enumerate(cell.observer.cameras):
            lost = sum(t.seconds for t in totals if (t.literal, t.camera) == (str(target.atom), camera.name))
            together = lost + weights[required & seen[:, index]].sum()
            assert together == pytest.approx(weights[required].sum(), abs=1e-9)


def test_a_cell_whose_only_camera_is_hidden_names_the_occluder(cell: Cell, analyses: dict[str, Analysis]) -> None:
    found = analyses["g1"]
    timeline = found.timeline
    hidden = [
        (row, index)
        for boxes in timeline.observation.full_matrix
        for row, index in np.argwhere(boxes[0].cause == Cause.HIDDEN)
        if timeline.observation.blind[row]
    ]
    row, index = hidden[0]
    alone = replace(cell, observer=Observer((cell.observer.cameras[index],), cell.observer.solids))
    stretch = explain_blind_spot(alone, found.timeline, np.array([row]))
    assert stretch.causes[0].limit is Cause.HIDDEN
    assert stretch.causes[0].by in {*cell.model.links, *cell.workspace.objects}
    assert f"behind `{stretch.causes[0].by}`" in str(stretch)


@pytest.mark.parametrize("name", ["g1", "g4"])
def test_where_two_cameras_are_needed_each_is_reported_with_whether_it_sees_for_a_while(
    name: str, cell: Cell, analyses: dict[str, Analysis]
) -> None:
    found = analyses[name]
    observation = found.timeline.observation
    sees = np.all([box.cause == Cause.NONE for box in observation.full_matrix[0]], axis=0)
    runs = list(stretches(observation.required[:, 0] & (sees.sum(axis=1) < 2)))
    longest = max(runs, key=len)
    rows = longest[:: 1 + len(longest) // 25]  # so few that all of them are looked at
    required, covered = observation.required[:, :1], sees.sum(axis=1)[:, None] >= 2
    part = SimpleNamespace(required=required, covered=covered, uncovered=required & ~covered)
    asked = SimpleNamespace(
        samples=found.timeline.samples,
        observation=part,
        planned=SimpleNamespace(stage=found.planned.stage, targets=[replace(found.planned.targets[0], cameras=2)]),
    )
    stretch = explain_blind_spot(cell, asked, rows)
    share = dict(zip(cell.workspace.cameras, sees[rows].mean(axis=0), strict=True))
    partly = {camera for camera, seen in share.items() if 0.0 < seen < 1.0}
    assert partly
    assert {cause.camera: cause.partly for cause in stretch.causes} == {
        camera: camera in partly for camera, seen in share.items() if seen < 1.0
    }
    assert not stretch.causes[0].partly
    assert f" fewer than 2 cameras see whether the tool holds {name} (" in str(stretch)
    assert set(re.findall(r"camera `(\w+)`: [^;)]* for a part of it", str(stretch))) == partly


def test_a_literal_is_named_for_times_at_which_it_is_lost_itself(cell: Cell, analyses: dict[str, Analysis]) -> None:
    found = analyses["g4"]
    timeline = found.timeline
    matrix = timeline.observation.full_matrix
    seen = np.array([sees_all(boxes).any(axis=1) for boxes in matrix]).T
    lost = timeline.observation.required & ~seen
    every = np.flatnonzero(timeline.observation.blind)
    stretch = explain_blind_spot(cell, found.timeline, every)
    column = next(place for place, target in enumerate(found.planned.targets) if target.atom == stretch.atom)
    t = timeline.samples.t
    inside = timeline.monitored & (stretch.start <= t) & (t <= stretch.end)
    assert inside.any()
    assert lost[inside, column].all()
    assert not lost[every, column].all(), "else nothing was narrowed"


def test_a_camera_is_to_be_turned_only_where_that_was_tried() -> None:
    cause = CameraCause(camera="eye", cause="out_of_image", by="left", figure=0.0, partly=False)
    for turn, remedy in ((None, ""), (CameraChange(-3.0), "turning camera `eye` 3 deg down would help")):
        blind = BlindSpot(0.0, 1.0, Atom("open"), "`open` holds", (replace(cause, change=turn),), 1)
        assert str(blind) == "From 0.0 s to 1.0 s no camera sees whether `open` holds (camera `eye`: left of its image)"
        assert blind.remedy == remedy


RANGES = [(0.2, 4.0), (0.5, 4.0), (0.8, 4.0), (1.2, 4.0), (0.2, 0.7), (0.2, 0.9), (0.2, 1.15)]


@pytest.mark.parametrize("names", [("g3",), pytest.param(("g2", "g3", "g4"), marks=pytest.mark.trial)])
def test_what_would_help_does_help_in_the_changed_cell_and_all_else_is_said_to_be_untried(
    names: tuple[str, ...], cell: Cell, analyses: dict[str, Analysis]
) -> None:
    """Each camera alone, with other ranges: the change that the sentence names is made, and all is looked at again."""
    said = set[str]()
    for name, (camera, near, far) in product(names, ((c, *r) for c in CAMERAS for r in RANGES)):
        alone = replace(cell.workspace.cameras[camera], near=near, far=far)
        before = cell.with_cameras_of(replace(cell.workspace, cameras={camera: alone}))
        found = analysed(before, analyses[name].planned, Adaptive(), full=False)
        if (stretch := longest_blind_spot(before, found.timeline)) is None:
            continue
        sentence = with_verdict(before, found.timeline, found.result).verdict
        change = stretch.causes[0].change if stretch.causes else None
        assert (f"; {stretch.remedy}." in sentence and "would help" in sentence) == (change is not None)
        if change is None:
            assert "would help" not in sentence
            continue
        words = re.fullmatch(r"(turn|mov)ing camera `(\w+)` (\d+) (deg|cm) (.+) would help", stretch.remedy)
        assert words is not None
        assert words[2] == camera
        X_CD = np.eye(4)
        if words[1] == "mov":
            X_CD[2, 3] = 0.01 * int(words[3]) * {"back": -1, "closer": 1}[words[5]]
        else:
            X_CD[:3, :3] = axis_rotation(1, np.radians(change.right)) @ axis_rotation(0, np.radians(change.up))
        said.add(words[1] if words[1] == "turn" else words[5])
        changed = replace(alone, X_FC=alone.X_FC @ X_CD)
        after = cell.with_cameras_of(replace(cell.workspace, cameras={camera: changed}))
        again = analysed(after, analyses[name].planned, Adaptive(), full=False).timeline
        column = [target.atom for target in again.planned.targets].index(stretch.atom)
        inside = (stretch.start <= again.samples.t) & (again.samples.t <= stretch.end)
        lost = again.observation.required[:, column] & ~again.observation.covered[:, column] & inside
        others = np.delete(again.observation.required & ~again.observation.covered, column, axis=1).any(axis=1)
        assert not (lost & ~others).any()
    assert said == {"turn", "back", "closer"}


@pytest.mark.parametrize("name", ["g2", "g3", "g5"])
def test_the_camera_to_turn_closes_the_gap_and_none_does_with_less(
    name: str, cell: Cell, analyses: dict[str, Analysis]
) -> None:
    found = analyses[name]
    timeline, cameras = found.timeline, np.array(list(cell.workspace.cameras))
    stretch = longest_blind_spot(cell, timeline)
    assert stretch is not None
    t = timeline.samples.t
    rows = np.flatnonzero((stretch.start <= t) & (t <= stretch.end) & timeline.observation.blind)
    column = [target.atom for target in found.planned.targets].index(stretch.atom)
    states = found.planned.stage.states(timeline.samples)

    def closing(angle: float) -> list[str]:
        """The cameras that see it all, turned about their lenses by an angle [deg] in one of 16 directions."""
        turns = [np.radians(angle) * np.array([np.cos(d), np.sin(d), 0.0]) for d in np.pi / 8 * np.arange(16)]
        there = [(one, one.X_FC @ displacement(np.zeros(3), t)) for one in cell.observer.cameras for t in turns]
        observer = Observer(tuple(replace(one, X_FC=X_FC) for one, X_FC in there), cell.observer.solids)
        (boxes,) = observer.verdicts([found.planned.targets[column]], states, rows=[rows], shares=False)
        return cameras[sees_all(boxes).all(axis=0).reshape(len(cameras), -1).any(axis=1)].tolist()

    nearest = stretch.causes[0]
    assert nearest.change is not None
    assert nearest.camera in closing(nearest.change.angle)
    assert not closing(nearest.change.angle - 1.5)
    assert stretch.remedy.startswith(f"turning camera `{nearest.camera}` {nearest.change.angle:.0f} deg ")
