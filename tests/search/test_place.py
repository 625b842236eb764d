"""The choice of cameras, checked with brute force over the verdicts of an observer that has all of them at once.

What mounts see is checked with a renderer, and by hand where lenses have gains of their own.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sqrp_cli import open_cell
from sqrp_cli.ask.values import silent
from sqrp_cli.camera.camera import ImageEntry
from sqrp_cli.camera.light import Light
from sqrp_cli.cell.mounts import LensEntry, Site, read_mounts
from sqrp_cli.geometry import inverse, look_at, pose
from sqrp_cli.search import place
from sqrp_cli.search.goal import Goal
from sqrp_cli.search.place import CameraPlacer
from sqrp_cli.search.placing_problem import Requirements
from sqrp_cli.search.placing_program import PlacementProgram
from sqrp_cli.search.placing_result import PlaceDocument
from sqrp_cli.search.sites import Installation, hidden_by, verdicts_of
from sqrp_cli.search.visibility_table import PlaceQuestion
from sqrp_cli.sight.observer import Observer, sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.study.analysis import analysed
from sqrp_cli.study.sampling import Adaptive, FixedStep, first_samples
from sqrp_cli.task.task import read_task
from tests.sight.renderer import MujocoScene
from tests.sight.test_truth import picture_of
from tests.sight.visibility.test_lighting import CUBE, GREEN

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"

FORTY = """
mounts:
  ceiling: {grid: {from: [-0.9, -1, 1.4], to: [0.6, 1, 1.4], step: 50 cm}, price: 20}
  rail: {rail: {from: [-0.9, 1.1, 0.5], to: [1.0, 1.1, 0.5], step: 10 cm}}
lenses:
  tele: {image: {width: 640, height: 480, horizontal_fov: 6 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, price: 100}
"""


@pytest.fixture(scope="module")
def cell():
    return open_cell(TABLETOP)


def placer(cell, folder: Path, text: str, demand: Requirements, *, fastest=True, tasks=("pickup g3",)) -> CameraPlacer:
    file = folder / "place.yaml"
    file.write_text(text)
    question = PlaceQuestion(
        cell=cell.cell,
        world=cell.cell.initial_world,
        tasks=tuple(read_task(task, cell.workspace) for task in tasks),
        mounts=read_mounts(file, cell.workspace, tuple(cell.cell.model.links)),
        requirements=demand,
        sampling=Adaptive(),
        fastest=fastest,
    )
    return CameraPlacer(question, silent)


class BruteForce:
    """All choices of cameras for one of the ways, with the quality that the definition gives at instants 4 ms apart."""

    def __init__(self, placed: CameraPlacer, number: int = 0):
        self.way = placed.table.ways[number]
        planned = self.way.planned
        cameras = [placed.table.camera_at(option) for option in range(len(placed.table.options))]
        observer = Observer(tuple(cameras), placed.question.cell.observer.solids)
        self.samples = first_samples(FixedStep(0.004), planned.stage, observer, planned.targets)
        matrix = observer.verdicts(planned.targets, planned.stage.states(self.samples), shares=False)
        self.sees = np.stack([sees_all(boxes) for boxes in matrix])  # targets, samples, cameras
        self.required = planned.stage.requires(planned.targets, self.samples)

    def qualities(self, chosen, spare: int = 0) -> tuple[float, ...]:
        """Q_eoi, if it is defined, and Q_avg."""
        planned, samples, covered = self.way.planned, self.samples, self.required.any(axis=1)
        for target, sees, required in zip(planned.targets, self.sees, self.required.T, strict=True):
            covered = covered & ((sees[:, list(chosen)].sum(axis=1) >= target.cameras + spare) | ~required)
        steps = np.diff(samples.t) * (covered[1:] & covered[:-1] & (np.diff(samples.piece) == 0))
        interesting = np.array([planned.stage.pieces[p].of_interest for p in samples.piece[:-1]])
        parts = ((steps[interesting], planned.T_eoi), (steps, planned.T))
        return tuple(float(part.sum() / total) for part, total in parts if total > 0)

    def least(self, count: int) -> float:
        return max(min(self.qualities(chosen)) for chosen in combinations(range(self.sees.shape[2]), count))


@pytest.fixture(scope="module")
def pair(cell, tmp_path_factory) -> tuple[CameraPlacer, PlaceDocument, BruteForce]:
    asked = placer(cell, tmp_path_factory.mktemp("forty"), FORTY, Requirements(most=2))
    found = asked.place()
    return asked, found, BruteForce(asked)


def test_two_of_forty_mounts_and_one_less_are_as_good_as_the_best_of_all(pair):
    asked, found, brute = pair
    assert (len(asked.table.sites), found.proven, found.gap) == (40, True, 0.0)
    best = brute.least(2)
    assert 0.0 < best < 1.0, "else every pair would be as good, or none would help"
    assert (found.objective, found.bound) == pytest.approx((best, best), abs=1e-3)
    assert found.fewer.bound == pytest.approx(brute.least(1), abs=1e-3)


def test_the_objective_is_the_exact_figure_of_the_chosen_cameras_at_their_mounts(pair):
    asked, found, _ = pair
    cameras = [option.camera(f"c{n}") for n, option in enumerate(asked.table.options)]
    names = [option.site.name for option in asked.table.options]
    chosen = [cameras[names.index(placed.place.site.name.removesuffix(", moved"))] for placed in found.cameras]
    (way,) = asked.table.ways
    seen = analysed(asked.table.cell_with(chosen), way.planned, Adaptive(), full=False).result
    assert found.objective == pytest.approx(min(seen.q_eoi, seen.q_avg), abs=1e-12)
    (candidate,) = found.candidates
    assert min(candidate.found.q_eoi, candidate.found.q_avg) >= found.objective


def test_a_goal_that_no_choice_meets_is_impossible_by_brute_force_too(cell, tmp_path):
    narrow = FORTY.replace("6 deg", "4.5 deg").replace("step: 10 cm", "step: 20 cm")
    asked = placer(cell, tmp_path, narrow, Requirements(goal=Goal(q_eoi=1.0, q_avg=1.0), most=2))
    found = asked.place()
    brute = BruteForce(asked)
    everything = brute.qualities(range(30))
    assert min(everything) < 1.0
    assert not found.met
    assert found.objective == pytest.approx(brute.least(2), abs=1e-3)
    assert found.unseen
    for unseen in found.unseen:
        target = [str(t.atom) for t in brute.way.planned.targets].index(unseen.literal)
        sample = int(np.argmin(np.abs(brute.samples.t - unseen.time)))
        assert brute.sees[target][sample - 1 : sample + 2].sum(axis=1).min() < unseen.needed


@pytest.mark.slow
def test_with_a_spare_camera_everything_is_seen_whichever_is_lost(cell, tmp_path):
    wide = FORTY.replace("6 deg", "60 deg").replace("step: 50 cm", "step: 1 m").replace("step: 10 cm", "step: 40 cm")
    asked = placer(cell, tmp_path, wide, Requirements(goal=Goal(q_eoi=1.0), failure_tolerance=1))
    found, brute = asked.place(), BruteForce(asked)
    names = [option.site.name for option in asked.table.options]
    chosen = [names.index(camera.place.site.name) for camera in found.cameras]
    assert (found.met, len(chosen)) == (True, 2)
    for lost in chosen:
        assert brute.qualities([c for c in chosen if c != lost])[0] == pytest.approx(1.0, abs=1e-3)
    assert (found.without_spare.cameras, found.without_spare.price) == (1, 100.0)


def test_ways_that_are_chosen_too_are_never_worse_and_cameras_aim_at_the_same(cell, tmp_path, pair):
    free = placer(cell, tmp_path, FORTY, Requirements(most=2), fastest=False)
    found = free.place()
    assert found.compared.ways > 1
    assert found.objective >= pair[1].objective - 1e-6
    assert found.gap == 0.0
    assert [one.at.tolist() for one in free.table.options] == [one.at.tolist() for one in pair[0].table.options]


def test_ctrl_c_after_the_choice_does_not_lose_it(cell, tmp_path, pair, monkeypatch):
    def pressed(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(CameraPlacer, "_refined", pressed)
    found = placer(cell, tmp_path, FORTY, Requirements(most=2)).place()
    assert found.interrupted
    assert found.proven
    assert found.objective == pytest.approx(pair[1].objective)
    assert found.cameras


def test_cameras_are_not_moved_to_where_the_mean_that_was_asked_for_is_less(cell, tmp_path, monkeypatch):
    """What has the best least, as if the cameras had been moved there."""
    narrow = FORTY.replace("6 deg", "5 deg")
    least = placer(cell, tmp_path, narrow, Requirements(most=1)).place()
    there = tuple(one.place for one in least.cameras)
    monkeypatch.setattr(place, "refined", lambda *_arguments: there)
    mean = placer(cell, tmp_path, narrow, Requirements(most=1, objective="mean")).place()
    (of_least,), (of_mean,) = least.candidates, mean.candidates
    assert min(of_least.found.q_eoi, of_least.found.q_avg) > min(of_mean.found.q_eoi, of_mean.found.q_avg) + 0.01
    assert of_mean.found.q_eoi + of_mean.found.q_avg > of_least.found.q_eoi + of_least.found.q_avg + 0.01


def test_a_camera_in_the_sight_of_another_one_is_not_chosen(cell, tmp_path):
    """The nearer of two places hides the farther one's view; with both, one would see nothing that counts."""
    text = """
mounts:
  near: {points: [[0.6, 0.6, 0.75]], body: 30 cm}
  far: {points: [[0.9, 1.0, 1.1]]}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}
"""
    wanted = Requirements(goal=Goal(q_eoi=0.1), failure_tolerance=1)
    met = [placer(cell, tmp_path, text.replace("30 cm", body), wanted).place().met for body in ("30 cm", "2 mm")]
    assert met == [False, True]


def test_a_camera_on_the_base_hides_what_one_hides_at_the_same_place_of_the_world(pair):
    asked, _, _ = pair
    (way,), far = asked.table.ways, asked.table.options[-1]
    half_way = replace(far.site, position=0.5 * (far.site.position + far.at), entry=SimpleNamespace(body=0.3))
    X_LW = inverse(way.states.X_WF["base_link"][0])
    on_base = [
        replace(one, frame="base_link", position=(X_LW @ [*one.position, 1.0])[:3]) for one in (half_way, far.site)
    ]
    hidden = hidden_by(way, half_way, far.site)
    assert hidden.any()
    np.testing.assert_array_equal(hidden_by(way, *on_base), hidden)


def test_nothing_stands_where_the_robot_moves(cell, tmp_path):
    text = FORTY.replace(
        "lenses:", "  swept: {points: [[0.51, -0.06, 0.3]]}\n  table: {points: [[0.5, 0.5, 0.01]]}\nlenses:"
    )
    found = placer(cell, tmp_path, text, Requirements(most=2)).place()
    shut = [site.name for site, gone in zip(found.question.mounts.sites, found.shut, strict=True) if gone]
    assert shut == ["swept", "table"]


@pytest.mark.parametrize(
    ("most", "says"), [(1, "the cheapest camera costs 120"), (2, "the cheapest 2 cameras cost 240")]
)
def test_a_budget_for_mounts_in_the_way_only_is_said_to_be_too_small(cell, tmp_path, most, says):
    """One on the table is cheap enough, but the robot would touch it; `at_least` two cameras with a spare one."""
    text = FORTY.replace("10 cm}}", "10 cm}, price: 20}\n  table: {points: [[0.5, 0.5, 0.01]]}")
    wanted = Requirements(most=most, failure_tolerance=most - 1, budget=120.0 * most - 10)
    found = placer(cell, tmp_path, text.replace("6 deg", "60 deg"), wanted).place()
    assert (found.met, found.cameras) == (False, ())
    assert found.reason == f"{says}, the budget is {120 * most - 10}"


def test_a_goal_that_more_cameras_meet_names_their_number(cell, tmp_path, pair):
    _, best, brute = pair
    goal = Goal(q_eoi=best.objective - 0.01, q_avg=best.objective - 0.01)  # samples are not those of that search
    assert brute.least(1) < best.objective - 0.02
    found = placer(cell, tmp_path, FORTY, Requirements(goal=goal, most=1)).place()
    assert not found.met
    assert found.fewest == len(found.cameras) == 2


def test_a_motion_that_takes_longer_than_the_goal_says_is_said_to(cell, tmp_path):
    found = placer(cell, tmp_path, FORTY, Requirements(goal=Goal(time=5.0))).place()
    assert not found.met
    (slow,) = found.infeasible
    assert "more than allowed" in slow.reason


TWELVE = """
mounts:
  ceiling: {grid: {from: [-0.9, -1, 1.4], to: [0.6, 1, 1.4], step: 100 cm}, price: 20}
  rail: {rail: {from: [-0.9, 1.1, 0.5], to: [1.0, 1.1, 0.5], step: 40 cm}}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, latency: 50 ms}
"""


@pytest.fixture(scope="module")
def delays(cell, tmp_path_factory) -> tuple[CameraPlacer, dict[tuple[int, ...], float]]:
    """The exact longest delay of every pair of a dozen mounts, one after the other."""
    asked = placer(cell, tmp_path_factory.mktemp("twelve"), TWELVE, Requirements(most=2, goal=Goal(delay=1.0)))
    asked.table.plan()
    asked.table.judge()
    pairs = list(combinations(range(len(asked.table.options)), 2))
    exact = {}
    for pair in pairs:
        cell = asked.table.cell_with(map(asked.table.camera_at, pair))
        exact[pair] = analysed(cell, asked.table.ways[0].planned, Adaptive(), full=False).result.latest
    return asked, exact


def test_no_pair_with_a_camera_is_quicker_than_that_camera_may_be(delays):
    asked, exact = delays
    least = asked.table.problem(0).least_delays[0]
    assert len(np.unique(least.round(3))) > 3
    assert all(delay >= max(least[list(pair)]) - 1e-9 for pair, delay in exact.items())
    assert min(delay - max(least[list(pair)]) for pair, delay in exact.items()) < 1e-3


def test_a_delay_of_a_goal_is_met_if_any_pair_meets_it(cell, tmp_path, delays):
    _, exact = delays
    shortest = min(exact.values())
    met = placer(cell, tmp_path, TWELVE, Requirements(most=2, goal=Goal(delay=shortest + 0.005))).place()
    assert met.met
    assert max(one.found.latest for one in met.candidates) <= shortest + 0.005
    missed = placer(cell, tmp_path, TWELVE, Requirements(most=2, goal=Goal(delay=shortest - 0.005))).place()
    assert not missed.met


def test_what_a_frame_and_latency_rule_out_is_not_searched_for(cell, tmp_path, monkeypatch):
    asked = placer(cell, tmp_path, TWELVE, Requirements(most=2, goal=Goal(delay=0.14)))
    searched = []
    monkeypatch.setattr(PlacementProgram, "_demand_goal", searched.append)
    found = asked.place()
    assert not searched
    assert not found.met
    assert found.quickest == pytest.approx(0.15)
    assert found.cameras


def test_a_search_that_ends_early_says_that_nothing_is_proven(cell, tmp_path, pair):
    asked = placer(cell, tmp_path, FORTY, Requirements(most=2))
    hurried = CameraPlacer(asked.question, silent, seconds=1e-9).place()
    assert not hurried.proven
    assert hurried.gap > 0.0 or not hurried.cameras
    loose = CameraPlacer(asked.question, silent, gap=1.0).place()
    assert loose.cameras
    assert loose.bound >= pair[1].objective - 1e-9
    assert loose.objective >= loose.bound - 1.0
    assert not loose.proven or loose.gap == 0.0


RESOLUTION = 120

SIX = """
mounts:
  ceiling: {points: [[-0.5, -1.1, 1.6], [0.3, 0.3, 1.6], [1.1, 0.1, 1.4]]}
  low: {points: [[0.0, 1.15, 0.5], [0.9, -1.15, 0.3], [-0.9, 0.6, 0.25]]}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}
"""


@pytest.mark.slow
def test_six_cameras_see_what_a_renderer_shows(cell, tmp_path: Path) -> None:
    """MuJoCo's depth images during the motion."""
    asked = placer(cell, tmp_path, SIX, Requirements(most=2))
    asked.place()
    (way,), (sees,) = asked.table.ways, asked.table.sees
    planned, states = way.planned, way.states
    objects = cell.workspace.objects
    carried = planned.candidate.binding["object"]
    others = ((obj, part) for name, obj in objects.items() if name != carried for part in obj.parts)
    fixed = [replace(part, parent="world", X_PG=obj.X_WO @ part.X_PG) for obj, part in others]
    (held,) = objects[carried].parts
    stage = MujocoScene(cell.workspace.robot, fixed, held, RESOLUTION)
    q = planned.stage.positions(way.samples)
    boxes = [box for target in planned.targets for box in target.boxes]
    assert len(boxes) == len(planned.targets)
    agree: list[bool] = []
    shown = 0
    for option, there in enumerate(asked.table.options):
        camera = there.camera("here")
        sample, target = way.items
        (within,) = cell.cell.observer.seen_from(
            [camera], there.X_FC[None], planned.targets, states, sample, target, limits_only=True
        )[0]
        assert not sees[option][~within].any()
        for item in np.flatnonzero(within).tolist():
            state, box = int(sample[item]), boxes[int(target[item])]
            stage.move(dict(zip(planned.motion.joint_names, q[state], strict=True)))
            stage.place(held.parent, _at(states.X_WF[carried], state))
            stage.show([i for i, name in enumerate(stage.names) if name in box.encloses])
            share = _share(stage, there.X_FC, _at(states.box_poses(box), state), box)
            agree.append((share >= box.limits.min_visible) == bool(sees[option][item]))
            shown += share >= box.limits.min_visible
    stage.close()
    assert len(agree) > 200
    assert 0.1 < shown / len(agree) < 0.99, "else a wrong verdict would hardly show"
    assert np.mean(agree) >= 0.999


def _at(poses, state):
    return poses[state if len(poses) > 1 else 0]


def _share(stage, X_WC, X_WB, box) -> float:
    """The share of the silhouette of a box without its skin along which nothing lies before its far side."""
    picture, leaves, _ = picture_of(stage, inverse(X_WC) @ X_WB, X_WC, box)
    inside = leaves > 0
    return 1.0 - float((inside & (picture.depth < leaves)).sum() / inside.sum())


ABOVE = look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""A camera that sees the top of the cube alone."""
STATES = SceneStates(1, {"world": pose()[None], "cube": pose()[None]})

IMAGE = ImageEntry(width=640, height=480, horizontal_fov=1.0)
LENSES = {
    f"gain {gain}": LensEntry(image=IMAGE, price=1.0, rate=10.0, latency=0.05, near=0.01, far=10.0, gain=gain)
    for gain in (1.0, 0.4, 2.0, 60.0, None)
}
WAY = SimpleNamespace(
    planned=SimpleNamespace(targets=[SimpleNamespace(boxes=(CUBE,))]),
    states=STATES,
    items=(np.array([0]), np.array([0])),
    needed=np.array([1]),
)


def seen_by_lenses(lights: dict[str, Light], lenses: dict[str, LensEntry] = LENSES) -> list[bool]:
    """Whether each lens sees the top of a green cube from above."""
    site = Site(mount="m", name="m", frame="world", position=ABOVE[:3, 3], entry=SimpleNamespace(), lenses=lenses)
    cell = SimpleNamespace(observer=Observer((), (), lights))
    places = [Installation(site, ABOVE, None, np.zeros(3), name, lens) for name, lens in lenses.items()]
    return verdicts_of(cell, WAY, places)[:, 0].tolist()


def test_light_is_judged_with_the_gain_of_each_lens_in_any_order() -> None:
    dim = {"sun": Light(intensity=0.7 * GREEN, direction=(0.0, 0.0, -1.0))}
    assert seen_by_lenses(dim) == [
        False,
        False,
        True,
        False,
        False,
    ]  # too dark, too dark, enough, too bright, as with gain 1
    assert seen_by_lenses(dim, dict(reversed(LENSES.items()))) == [False, False, True, False, False]


def test_without_lights_no_gain_matters() -> None:
    assert seen_by_lenses({}) == [True] * len(LENSES)
