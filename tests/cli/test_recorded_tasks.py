"""Recordings are tasks: every command works on their episodes, with the figures of the motions that were recorded."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sqrp_cli.ask.api.cell import OpenCell, open_cell
from sqrp_cli.ask.api.new_cell import new_cell
from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.mounts import PlaceFile
from sqrp_cli.errors import InputError
from sqrp_cli.files.validation import validate
from sqrp_cli.files.yaml_file import read_yaml
from sqrp_cli.motion.plan_motion import Motion
from sqrp_cli.motion.recorded_motion import opened
from sqrp_cli.show.documents.frames import write_frames
from sqrp_cli.study.analysis import planned_motion
from sqrp_cli.study.sampling import FixedStep
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.grips import first_grip
from sqrp_cli.task.task import read_task
from tests.cells import shipped_cell, write_cell

PICKUP, STEP = "pickup g2", 0.01
USUAL = {"file": "data", "detector": "color", "objects": {"g2": {}}}


def written(motion: Motion, path: Path, shift: float = 0.0, holds: float = np.inf) -> None:
    """A motion as a table with a row every 10 ms and at the ends of its primitives; shift: of its first joint [rad].

    holds: until when the table says what the tool holds [s].
    """
    ends = [one.end for one in motion.primitives]
    times = np.unique(np.concatenate([np.arange(0.0, motion.time, STEP), ends]))
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["time", *(f"position_{name}" for name in motion.joint_names), "held"])
        for t in times.tolist():
            index = min(int(np.searchsorted(ends, t, side="right")), len(ends) - 1)
            q = motion.positions(index, np.array([t]))[0] + shift * np.eye(len(motion.joint_names))[0]
            table.writerow([repr(t), *map(repr, q.tolist()), motion.primitives[index].held if t < holds else ""])


@pytest.fixture(scope="module")
def planned() -> tuple[OpenCell, Motion, Any]:
    """The shipped cell with a planned motion."""
    cell = open_cell("workspaces/tabletop")
    way = first_grip(read_task(PICKUP, cell.workspace).candidates[0])
    motion = feasible_motion(cell.cell, way, cell.cell.initial_world)
    assert isinstance(motion, Motion)
    return cell, motion, way


@pytest.fixture(scope="module")
def recorded(planned, tmp_path_factory) -> OpenCell:
    """The cell with three recorded episodes: the motion, one that breaks limits, and one in which nothing is held."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "data").mkdir()
    for name, how in (("3", {}), ("5", {"shift": 2 * np.pi}), ("7", {"holds": 0.0})):
        written(planned[1], folder / "data" / f"{name}.csv", **how)
    ends = {one.name: one.end - one.start for one in planned[1].primitives}
    asked = f"always[approach.start, grasp.end - {ends['a3']!r}] (not hold(g2) and place(g2))"
    slip = f"eventually[carry.start, carry.start + {ends['a4']!r}] (not hold(g2) and place(g2))"
    same = {
        **USUAL,
        "formulas": [asked, "always[carry.start, carry.end] (hold(g2) and not place(g2))"],
        "faults": {"slip": {"formula": slip}},
    }
    tasks = [{"task": "demo", "min_phases": {"carry": 0.1}}, {"task": "demo", "min_phases": {"carry": 1.0}}]
    write_cell({**shipped_cell("tabletop"), "recordings": {"demo": USUAL, "same": same}, "tasks": tasks}, folder)
    return open_cell(folder)


def test_a_recorded_motion_has_the_figures_of_the_motion(planned, recorded):
    cell, _, way = planned
    before = cell.rank(PICKUP, ways="first", sampling=FixedStep(STEP)).candidates[0]
    (found,) = recorded.rank("same episode=3", sampling=FixedStep(STEP)).candidates
    assert way.binding == {"object": "g2"}
    for figure in ("time", "q_avg", "q_eoi", "t_total", "t_eoi"):
        assert getattr(found, figure) == pytest.approx(getattr(before, figure), abs=1e-6)
    assert found.parameters == {"episode": 3.0}
    now, then = found.faults["slip"], before.faults["slip"]
    assert (now.delay_mean, now.delay_worst) == pytest.approx((then.delay_mean, then.delay_worst), abs=1e-3)


def test_episodes_are_ranked_and_one_without_a_grasp_still_has_its_object(recorded):
    ranking = recorded.rank("demo")
    assert len(ranking.feasible) == 3
    by_name = {one.name: one for one in ranking.candidates}
    assert [one.name for one in by_name["episode 3"].phases] == ["approach", "grasp", "carry"]
    assert [one.name for one in by_name["episode 7"].phases] == ["approach"]
    assert by_name["episode 7"].q_eoi is None
    worst = recorded.rank("demo", worst=True)
    assert [one.name for one in worst.candidates] == [one.name for one in ranking.candidates][::-1]
    assert [one.rank for one in worst.candidates] == [3, 2, 1]
    assert worst.best.name == ranking.best.name


def test_an_explanation_has_what_cameras_see_of_each_phase_and_free_views(recorded):
    found = recorded.explain("demo episode=3", windows=0.5)
    samples = found.samples
    for atom, cameras in found.coverage.items():
        for camera, phases in cameras.items():
            for phase in (one for one in found.phases if one.name in phases):
                seen = total = 0.0
                for one, other in pairwise(samples):  # by the trapezium rule, from the document alone
                    said = [s.literals.get(atom) or s.literals.get(f"not {atom}") for s in (one, other)]
                    if phase.start <= one.t and other.t <= phase.end and None not in said:
                        total += other.t - one.t
                        seen += 0.5 * (other.t - one.t) * sum(s.cameras[camera].covered for s in said)
                assert phases[phase.name] == pytest.approx(seen / total, abs=1e-9)
    for window in found.windows:
        inside = [one for one in samples if window.start <= one.t <= window.end]
        assert window.end - window.start >= 0.5
        assert all(one.cameras[window.cameras[0]].covered for each in inside for one in each.literals.values())
    longest = max(found.free_views.longest.values())
    never = recorded.explain("demo episode=3", windows=longest + 1.0).free_views
    assert never.wait.end - never.wait.start == pytest.approx(longest)
    assert "wait 1000 ms" in never.words


def test_a_recorded_motion_is_checked_like_a_planned_one(recorded):
    found = {one.parameters["episode"]: one for one in recorded.check("demo").candidates}
    assert found[3].feasible
    assert not found[5].feasible
    assert "joint `shoulder_pan_joint` goes past its limit, by up to" in found[5].reasons[0]


@pytest.mark.parametrize(
    ("task", "how", "says"),
    [
        ("demo", {"ways": "all"}, "each episode is done in one way only"),
        ("demo", {"max_time": 3.0}, "its episodes take as long as they took"),
        ("demo", {"after": "program.yaml"}, ""),
        ("demo then pickup g1", {}, "a task of its own and no step"),
        ("demo episode=4", {}, "there is no episode 4 in data; "),
    ],
)
def test_what_makes_no_sense_of_a_recording_is_refused(recorded, task, how, says):
    with pytest.raises(InputError) as refused:
        recorded.rank(task, **how)
    assert says in str(refused.value)


def test_phases_have_thresholds_and_programs_know_no_recordings(planned, recorded):
    passed, failed = recorded.score().results
    assert (passed.status, failed.status) == ("passed", "failed")
    assert "time seen of carry" in failed.reasons[0]
    assert recorded.workspace.digest == planned[0].workspace.digest


def test_frames_are_a_table(recorded, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    task, cell = read_task("demo episode=3", recorded.workspace), recorded.cell
    rows = write_frames(cell, cell.initial_world, task.candidates, tmp_path / "frames.parquet")
    table = parquet.read_table(tmp_path / "frames.parquet").to_pylist()
    frames = len(opened(recorded.workspace.recordings["demo"].file).read(0).times)
    assert {one["episode"] for one in table} == {3}
    assert rows == len(table) == frames * 3 * len(recorded.workspace.cameras)
    assert all(one["visible"] is None or one["visible"] >= 0.5 for one in table if one["cause"] is None)
    shares = recorded.explain("demo episode=3").coverage["hold(g2)"]
    for camera, phases in shares.items():
        own = [
            one["cause"] is None
            for one in table
            if (one["camera"], one["target"], one["phase"]) == (camera, "hold(g2)", "carry")
        ]
        assert np.mean(own) == pytest.approx(phases["carry"], abs=0.01)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"watch": ["jaw"]}, "did you mean `jaws`?"),
        ({"objects": {"g2": {"held": ["grasp", "release2"]}}}, "expected [grasp, release]"),
        ({"joints": {"j1": "shoulder_pan_joint"}}, "no numbers called `j1`"),
        ({"gripper": {"joint": "vacum", "closed_above": 1}}, "`vacum` is no joint"),
        ({"formulas": ["always[lift.start, 4] jaws"]}, "no primitive action `lift`"),
        ({"file": "nowhere.csv"}, "nowhere.csv"),
        ({"joints": {"shoulder_pan_joint": {"joint": "shoulder_pan_joint", "scale": "1 mm"}}}, "`scale` is a length"),
        ({"joints": {"shoulder_pan_joint": {"joint": "shoulder_pan_joint", "offset": "1 s"}}}, "`offset` is a time"),
        ({"gripper": {"joint": "held", "closed_above": "5 deg"}}, "`closed_above` is an angle, expected a share"),
        (
            {"joints": dict.fromkeys(("elbow_joint", "held"), "elbow_joint")},
            "second name of joint `elbow_joint`",
        ),
        ({"objects": {"a": {"held": [1, 3]}, "b": {"held": [2, 4]}}}, "`b` is held while `a` is"),
        ({"objects": {"a": {"held": ["grasp", "release"]}, "b": {"held": ["grasp", "release"]}}}, "while `a` is"),
        ({"objects": {"a": {"held": [1, 3]}, "b": {"held": ["grasp", "release"]}}}, "expected either of them for all"),
        ({"objects": {"g2": {"size": ["5 cm", "5 cm", "5 cm"]}}}, "`g2` has the size"),
    ],
)
def test_entries_that_do_not_fit_are_refused_in_one_message(recorded, tmp_path, entry, says):
    data = str(recorded.workspace.recordings["demo"].file)
    write_cell({**shipped_cell("tabletop"), "recordings": {"demo": {**USUAL, "file": data, **entry}}}, tmp_path)
    with pytest.raises(InputError) as refused:
        open_cell(tmp_path).rank("demo")
    assert says in refused.value.problems[0].message or says in str(refused.value)
    assert len(refused.value.problems) == 1


def test_objects_without_a_word_are_held_in_the_grasps_that_are_left(recorded, tmp_path):
    data, again = str(recorded.workspace.recordings["demo"].file), {"held": ["grasp2", "release2"]}
    for objects, expected in (
        ({"a": again, "b": {}, "c": {}}, ["b", "a", "c", None]),
        ({"a": {}}, ["a", "a", "a", "a"]),
        ({"a": again}, [None, "a", None, None]),
        ({"b": {}, "a": {"held": [1.0, 2.0]}}, [None, "a", None, None]),
    ):
        entry = {**USUAL, "file": data, "objects": objects}
        write_cell({**shipped_cell("tabletop"), "recordings": {"demo": entry}}, tmp_path)
        task = load_workspace(tmp_path).recordings["demo"]
        assert [task.held_in(number, float(number)) for number in range(4)] == expected


def test_recordings_share_an_object_of_one_size(recorded, tmp_path):
    entry = {**USUAL, "file": str(recorded.workspace.recordings["demo"].file)}
    sizes = {"small": {"size": ["2 cm", "2 cm", "2 cm"]}, "same": {}, "large": {"size": ["4 cm", "4 cm", "4 cm"]}}
    for names in (("same", "small"), ("small", "large")):
        demos = {name: {**entry, "objects": {"part": sizes[name]}} for name in names}
        write_cell({**shipped_cell("tabletop"), "recordings": demos}, tmp_path)
        if "large" not in names:
            assert load_workspace(tmp_path).objects["part"].size == (0.02, 0.02, 0.02)
    with pytest.raises(InputError, match="`part` has the size"):
        load_workspace(tmp_path)


def test_a_second_grasp_elsewhere_has_its_own_box_and_one_of_nothing_is_told(planned, tmp_path):
    """What is released stays, whatever the tool does until it takes it again."""
    cell, data = {**shipped_cell("tabletop"), "recordings": {"demo": USUAL}}, tmp_path / "data"
    data.mkdir()
    written(planned[1], data / "3.csv")
    write_cell(cell, tmp_path)
    assert [p.name for p in recorded_motion(tmp_path)[1].primitives][-1] == "carry"
    head, *rows = (data / "3.csv").read_text().splitlines()
    end = np.array([float(cell or 0) for cell in rows[-1].replace("g2", "1").split(",")])
    turned = [("", 0.0, 0.0), ("", 0.01, 0.3), ("g2", 0.01, 0.3), ("g2", 0.3, 0.3), ("", 0.3, 0.3), ("", 1.0, 0.0)]
    for held, first, last in (*turned, ("g2", 1.0, 0.0)):  # of the first and the last joint, a second for each
        end[0] += 1.0
        q = [end[1] + first, *end[2:6], end[6] + last]
        rows.append(",".join([*map(repr, map(float, (end[0], *q))), held]))
    (data / "3.csv").write_text("\n".join([head, *rows]))  # its folder is as it was
    opened, motion = recorded_motion(tmp_path)
    one, other = (p for p in motion.primitives if p.held)
    model = opened.cell.model
    ends = ((one, one.end), (other, other.start))
    q = [motion.positions(motion.primitives.index(p), np.array([t]))[0] for p, t in ends]
    rests = [model.tool_pose(at) @ p.X_TO for at, p in zip(q, (one, other), strict=True)]
    np.testing.assert_allclose(*rests, atol=1e-9)
    assert np.linalg.norm(one.X_TO - other.X_TO) > 0.1
    (candidate,) = read_task("demo", opened.workspace).candidates
    targets = planned_motion(opened.cell, candidate, opened.cell.initial_world, motion).targets
    boxes = {str(one.atom): one.boxes[0] for one in targets if one.atom.predicate.startswith("hold")}
    assert [*boxes] == ["hold(g2)", "hold2(g2)"]
    for box, held in zip(boxes.values(), (one, other), strict=True):
        X_WB = model.link_poses(model.home[None])[box.frame][0] @ box.X_FB
        np.testing.assert_allclose(X_WB, model.tool_pose(model.home) @ held.X_TO, atol=1e-9)
    ranked = opened.rank("demo").candidates[0]
    assert "the gripper closes" in " ".join(ranked.remarks)
    assert ". At" in ranked.verdict
    assert ranked.faults.keys() == {"dropped", "dropped2"}  # each by where its grasp holds it
    assert all(one.delay_mean is not None for one in ranked.faults.values())
    assert ranked.happens["dropped2"] == "g2 is dropped while it is carried (grasp 2)"
    assert "the gripper closes" in " ".join(opened.check("demo").candidates[0].reasons)


def recorded_motion(folder: Path) -> tuple[OpenCell, Motion]:
    """The motion of the only episode of a cell."""
    opened = open_cell(folder)
    (candidate,) = read_task("demo", opened.workspace).candidates
    motion = feasible_motion(opened.cell, candidate, opened.cell.initial_world)
    assert isinstance(motion, Motion)
    return opened, motion


def test_a_first_workspace_comes_from_a_recording(planned, tmp_path):
    written(planned[1], tmp_path / "taught.csv")
    made = new_cell(tmp_path / "cell", robot="ur5", recording=tmp_path / "taught.csv")
    assert "`elbow_joint` is joint `elbow_joint`" in " ".join(made.told)
    assert load_workspace(tmp_path / "cell").recordings["demo"].objects.keys() == {"part"}
    assert open_cell(tmp_path / "cell").rank(made.task).best.time == pytest.approx(planned[1].time)
    assert validate(read_yaml(tmp_path / "cell" / "place.yaml"), PlaceFile).mounts.keys() == {"left", "right", "above"}
    written(planned[1], tmp_path / "taught.csv", holds=0.0)  # a recording that changes is read again
    assert "nothing is grasped" in open_cell(tmp_path / "cell").rank(made.task).candidates[0].reasons[0]


def test_a_recording_may_begin_past_the_limits_of_joints(tmp_path, sqrp):
    joints = "shoulder_pan,shoulder_lift,elbow_flex,wrist_flex,wrist_roll,gripper"
    (tmp_path / "rest.csv").write_text(f"time,{joints}\n0,119,-109,99,99,169,50\n1,0,0,0,0,0,50\n")
    made = new_cell(tmp_path / "cell", robot="so101", recording=tmp_path / "rest.csv")
    assert "joint `elbow_flex` then goes 2 deg past its limit" in " ".join(made.told)
    assert 'TASK is missing, such as "demo"' in sqrp("rank", tmp_path / "cell").err


def test_an_episode_of_one_state_is_no_motion(recorded, tmp_path):
    lines = (recorded.workspace.recordings["demo"].file / "3.csv").read_text().splitlines()
    (tmp_path / "data").write_text("\n".join(lines[:2]))
    write_cell({**shipped_cell("tabletop"), "recordings": {"demo": USUAL}}, tmp_path)
    assert open_cell(tmp_path).rank("demo").candidates[0].reasons == ("it has one state, so there is no motion",)
