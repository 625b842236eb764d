"""The choice of cameras, checked with brute force over the verdicts of an observer that has all of them at once."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from sqrp_cli import open_cell
from sqrp_cli.api.cell import silent
from sqrp_cli.knowledge.workspace.mounts import read_mounts
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.placing import every
from sqrp_cli.programming.placing.choose import ChoiceSearch
from sqrp_cli.programming.placing.gain import greedy
from sqrp_cli.programming.placing.place import Placer
from sqrp_cli.programming.placing.placement import Placement, PlaceQuestion
from sqrp_cli.programming.placing.problem import Choice, Demand, worth_of
from sqrp_cli.programming.placing.scenes import camera_of
from sqrp_cli.programming.sensing.observer import Observer, sees_all
from sqrp_cli.programming.task import read_task

TABLETOP = Path(__file__).parents[3] / "workspaces" / "tabletop"

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


def placer(cell, folder: Path, text: str, demand: Demand, *, fastest: bool = True) -> Placer:
    file = folder / "place.yaml"
    file.write_text(text)
    mounts = read_mounts(file, cell.workspace, tuple(cell.cell.model.links))
    question = PlaceQuestion(
        cell=cell.cell,
        world=cell.cell.initial_world,
        tasks=(read_task("pickup g3", cell.workspace),),
        mounts=mounts,
        demand=demand,
        sampling=Adaptive(),
        fastest=fastest,
    )
    return Placer(question, silent)


class BruteForce:
    """All choices of so many cameras, with the quality that the definition gives at the samples."""

    def __init__(self, placed: Placer):
        (self.way,) = placed.survey.ways
        options = [(placed.survey.views[o.view], placed.survey.lenses[o.lens]) for o in placed.survey.options]
        cameras = [
            camera_of(f"c{n}", placed.survey.spots[view.spot], view, lens) for n, (view, lens) in enumerate(options)
        ]
        observer = Observer(tuple(cameras), placed.question.cell.observer.solids)
        scene = self.way.scene
        matrix = observer.verdicts(scene.targets, self.way.states, shares=False)
        self.sees = np.stack([sees_all(boxes) for boxes in matrix])  # targets, samples, cameras
        self.needed = [target.cameras for target in scene.targets]

    def qualities(self, chosen, spare: int = 0) -> tuple[float, float]:
        required, scene, samples = self.way.required, self.way.scene, self.way.samples
        enough = [self.sees[n][:, list(chosen)].sum(axis=1) >= k + spare for n, k in enumerate(self.needed)]
        covered = required.any(axis=1) & np.all([e | ~required[:, n] for n, e in enumerate(enough)], axis=0)
        both = covered[1:] & covered[:-1] & (np.diff(samples.piece) == 0)
        steps = np.diff(samples.t) * both
        interesting = np.array([scene.stage.pieces[p].of_interest for p in samples.piece[:-1]])
        return float(steps[interesting].sum() / scene.T_eoi), float(steps.sum() / scene.T)

    def least(self, count: int, spare: int = 0) -> float:
        cameras = range(self.sees.shape[2])
        return max(min(self.qualities(chosen, spare)) for chosen in combinations(cameras, count))


@pytest.fixture(scope="module")
def pair(cell, tmp_path_factory) -> tuple[Placer, Placement, BruteForce]:
    asked = placer(cell, tmp_path_factory.mktemp("forty"), FORTY, Demand(most=2))
    found = asked.place()
    return asked, found, BruteForce(asked)


def test_two_of_forty_mounts_are_as_good_as_the_best_of_all_pairs(pair):
    asked, found, brute = pair
    assert len(asked.survey.spots) == 40
    assert found.proven
    assert found.gap == 0.0
    best = brute.least(2)
    assert 0.0 < best < 1.0, "else every pair would be as good, or none would help"
    assert found.objective == pytest.approx(best, abs=1e-6)
    assert found.bound == pytest.approx(best, abs=1e-6)


def test_one_camera_less_is_as_good_as_the_best_of_all_mounts(pair):
    _, found, brute = pair
    assert found.fewer is not None
    assert found.fewer.bound == pytest.approx(brute.least(1), abs=1e-3)


def test_the_figures_are_those_of_the_exact_timeline(pair):
    _, found, _ = pair
    (candidate,) = found.candidates
    assert found.worth is not None
    if any(camera.moved for camera in found.cameras):
        assert min(candidate.found.q_eoi, candidate.found.q_avg) > found.objective
        return
    for rough, exact in zip(found.worth.qualities[0], (candidate.found.q_eoi, candidate.found.q_avg), strict=True):
        assert rough == pytest.approx(exact, abs=2e-3)


def test_the_best_choice_is_never_worse_than_the_greedy_one(pair):
    asked, found, _ = pair
    problem = asked.survey.posed(0)
    assert found.objective >= worth_of(problem, greedy(problem, asked.question.demand, 2)).least - 1e-9


def test_a_wish_that_no_choice_meets_is_impossible_by_brute_force_too(cell, tmp_path):
    narrow = FORTY.replace("6 deg", "4.5 deg").replace("step: 10 cm", "step: 20 cm")
    asked = placer(cell, tmp_path, narrow, Demand(wish=Wish(q_eoi=1.0, q_avg=1.0), most=2))
    found = asked.place()
    brute = BruteForce(asked)
    everything = brute.qualities(range(30))
    assert min(everything) < 1.0
    assert not found.met
    assert found.objective == pytest.approx(brute.least(2), abs=1e-6)
    assert found.unseen
    for unseen in found.unseen:
        target = [str(t.atom) for t in brute.way.scene.targets].index(unseen.literal)
        sample = int(np.argmin(np.abs(brute.way.samples.t - unseen.time)))
        assert brute.sees[target][sample].sum() < unseen.needed


def test_with_a_spare_camera_everything_is_seen_whichever_is_lost(cell, tmp_path):
    wide = FORTY.replace("6 deg", "60 deg")
    asked = placer(cell, tmp_path, wide, Demand(wish=Wish(q_eoi=1.0), survive=1))
    found = asked.place()
    assert found.met
    brute = BruteForce(asked)
    places = [camera.spot.name for camera in found.cameras]
    names = [asked.survey.spots[asked.survey.views[o.view].spot].name for o in asked.survey.options]
    chosen = [names.index(place) for place in places]
    for lost in chosen:
        assert brute.qualities([c for c in chosen if c != lost])[0] == pytest.approx(1.0)
    assert len(chosen) == 2
    assert found.without_spare is not None
    assert (found.without_spare.cameras, found.without_spare.price) == (1, 100.0)


def test_ways_that_are_chosen_too_are_never_worse(cell, tmp_path, pair):
    found = placer(cell, tmp_path, FORTY, Demand(most=2), fastest=False).place()
    assert found.ways > 1
    assert found.objective >= pair[1].objective - 1e-6
    assert found.gap == 0.0


def test_what_cameras_aim_at_does_not_depend_on_a_choice_of_ways(cell, tmp_path, pair):
    free = placer(cell, tmp_path, FORTY, Demand(most=2), fastest=False)
    free.survey.plan()
    free.survey.lay_out()
    assert [view.at.tolist() for view in free.survey.views] == [view.at.tolist() for view in pair[0].survey.views]


def test_ctrl_c_after_the_choice_does_not_lose_it(cell, tmp_path, pair, monkeypatch):
    def pressed(*_arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(Placer, "_refined", pressed)
    found = placer(cell, tmp_path, FORTY, Demand(most=2)).place()
    assert found.interrupted
    assert found.proven
    assert found.objective == pytest.approx(pair[1].objective)
    assert found.cameras


def test_a_camera_in_the_sight_of_another_one_is_not_chosen(cell, tmp_path):
    """The nearer of two places hides the farther one's view; with both, one would see nothing that counts."""
    text = """
mounts:
  near: {points: [[0.6, 0.6, 0.75]], body: 30 cm}
  far: {points: [[0.9, 1.0, 1.1]]}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz}
"""
    asked = placer(cell, tmp_path, text, Demand(wish=Wish(q_eoi=0.1), survive=1))
    assert not asked.place().met
    alone = placer(cell, tmp_path, text.replace("30 cm", "2 mm"), Demand(wish=Wish(q_eoi=0.1), survive=1))
    assert alone.place().met


def test_nothing_stands_where_the_robot_moves(cell, tmp_path):
    text = FORTY.replace(
        "lenses:", "  swept: {points: [[0.51, -0.06, 0.3]]}\n  table: {points: [[0.5, 0.5, 0.01]]}\nlenses:"
    )
    found = placer(cell, tmp_path, text, Demand(most=2)).place()
    shut = [spot.name for spot, gone in zip(found.question.mounts.spots, found.shut, strict=True) if gone]
    assert shut == ["swept", "table"]


@pytest.mark.parametrize(
    ("most", "says"), [(1, "the cheapest camera costs 120"), (2, "the cheapest 2 cameras cost 240")]
)
def test_a_budget_for_mounts_in_the_way_only_is_said_to_be_too_small(cell, tmp_path, most, says):
    """One on the table is cheap enough, but the robot would touch it; `at_least` two cameras with a spare one."""
    text = FORTY.replace("10 cm}}", "10 cm}, price: 20}\n  table: {points: [[0.5, 0.5, 0.01]]}").replace(
        "6 deg", "60 deg"
    )
    found = placer(cell, tmp_path, text, Demand(most=most, survive=most - 1, budget=120.0 * most - 10)).place()
    assert (found.met, found.cameras) == (False, ())
    assert found.why == f"{says}, the budget is {120 * most - 10}"


def test_of_equally_good_pairs_the_one_with_the_shortest_delay_is_chosen(pair):
    asked, found, _ = pair
    problem = asked.survey.posed(0)
    ways = tuple(of_one[0] for of_one in problem.candidates)
    worths = [worth_of(problem, Choice(chosen, ways)) for chosen in combinations(range(problem.count), 2)]
    best = max(worth.least for worth in worths)
    assert len({round(worth.delay, 3) for worth in worths}) > 3
    shortest = min(worth.delay for worth in worths if worth.least >= best - 1e-6)
    assert found.worth is not None
    assert found.worth.delay == pytest.approx(shortest, abs=1e-4)


def test_a_wished_delay_takes_no_more_cameras_than_needed(cell, tmp_path):
    narrow = FORTY.replace("6 deg", "4.5 deg")
    asked = placer(cell, tmp_path, narrow, Demand(most=2))
    asked.place()
    problem = asked.survey.posed(0)
    ways = tuple(of_one[0] for of_one in problem.candidates)

    def shortest(count: int) -> float:
        choices = combinations(range(problem.count), count)
        return min(worth_of(problem, Choice(options, ways)).delay for options in choices)

    wished = shortest(2) + 0.02
    assert shortest(1) > wished + 0.1
    found = ChoiceSearch(problem, Demand(wish=Wish(delay=wished)), lambda _title, _best, _bound: None).best()
    assert found.choice is not None
    assert found.fewest == len(found.choice.options) == 2
    assert worth_of(problem, found.choice).delay <= wished + 1e-6


@pytest.mark.parametrize(
    "demand",
    [
        Demand(most=1),
        Demand(most=2, objective="mean"),
        Demand(most=2, budget=205.0),
        Demand(wish=Wish(q_avg=0.2)),
        Demand(most=2, wish=Wish(q_eoi=1.0, q_avg=1.0)),
    ],
    ids=["one", "mean", "budget", "wish", "unmet"],
)
def test_all_sets_and_the_integer_program_have_the_same_best(pair, demand, monkeypatch):
    problem = pair[0].survey.posed(0)
    of_all = ChoiceSearch(problem, demand, lambda _title, _best, _bound: None).best()
    monkeypatch.setattr(every, "MOST_WORK", 0.0)
    solved = ChoiceSearch(problem, demand, lambda _title, _best, _bound: None).best()
    assert (of_all.proven, of_all.fewest) == (solved.proven, solved.fewest)
    assert (of_all.choice is None) == (solved.choice is None)
    if of_all.choice is None or solved.choice is None:
        return
    one, other = worth_of(problem, of_all.choice), worth_of(problem, solved.choice)
    assert len(of_all.choice.options) == len(solved.choice.options)
    assert (one.least, one.mean) == pytest.approx((other.least, other.mean), abs=1e-6)
    assert (one.delay, one.price) == pytest.approx((other.delay, other.price), abs=1e-5)


def test_a_wish_that_more_cameras_meet_names_their_number(cell, tmp_path, pair):
    _, best, brute = pair
    wish = Wish(q_eoi=best.objective - 0.01, q_avg=best.objective - 0.01)  # samples are not those of that search
    assert brute.least(1) < best.objective - 0.02
    found = placer(cell, tmp_path, FORTY, Demand(wish=wish, most=1)).place()
    assert not found.met
    assert found.fewest == len(found.cameras) == 2


def test_a_motion_that_takes_longer_than_wished_is_said_to(cell, tmp_path):
    found = placer(cell, tmp_path, FORTY, Demand(wish=Wish(time=5.0))).place()
    assert not found.met
    ((_, slow),) = found.infeasible
    assert "more than allowed" in slow.reasons[0]


TWELVE = """
mounts:
  ceiling: {grid: {from: [-0.9, -1, 1.4], to: [0.6, 1, 1.4], step: 100 cm}, price: 20}
  rail: {rail: {from: [-0.9, 1.1, 0.5], to: [1.0, 1.1, 0.5], step: 40 cm}}
lenses:
  wide: {image: {width: 640, height: 480, horizontal_fov: 60 deg}, near: 20 cm, far: 4 m, rate: 10 Hz, latency: 50 ms}
"""


@pytest.fixture(scope="module")
def delays(cell, tmp_path_factory) -> tuple[Placer, dict[tuple[int, ...], float]]:
    """The exact longest delay of every pair of a dozen mounts, one after the other."""
    asked = placer(cell, tmp_path_factory.mktemp("twelve"), TWELVE, Demand(most=2, wish=Wish(delay=1.0)))
    asked.survey.plan()
    asked.survey.lay_out()
    asked.survey.judge(asked.survey.ways)
    pairs = list(combinations(range(len(asked.survey.options)), 2))
    studies = (asked.survey.studies(Choice(pair, (0,)))[0] for pair in pairs)
    return asked, {pair: study.assessment("").delay_worst for pair, study in zip(pairs, studies, strict=True)}


def test_no_pair_with_a_camera_is_quicker_than_that_camera_may_be(delays):
    asked, exact = delays
    least = asked.survey.posed(0).late[0]
    assert len(np.unique(least.round(3))) > 3
    assert all(delay >= max(least[list(pair)]) - 1e-9 for pair, delay in exact.items())
    assert min(delay - max(least[list(pair)]) for pair, delay in exact.items()) < 1e-3


def test_a_wished_delay_is_met_if_any_pair_meets_it(cell, tmp_path, delays):
    _, exact = delays
    shortest = min(exact.values())
    met = placer(cell, tmp_path, TWELVE, Demand(most=2, wish=Wish(delay=shortest + 0.005))).place()
    assert met.met
    assert max(one.found.delay_worst for one in met.candidates) <= shortest + 0.005
    missed = placer(cell, tmp_path, TWELVE, Demand(most=2, wish=Wish(delay=shortest - 0.005))).place()
    assert (missed.met, missed.late) == (False, False)


def test_a_choice_whose_exact_delay_is_too_long_is_given_up_for_another_one(cell, tmp_path, delays, monkeypatch):
    _, exact = delays
    wish = Wish(delay=sorted(exact.values())[len(exact) // 2])
    first = placer(cell, tmp_path, TWELVE, Demand(most=2, wish=wish))
    chosen = first.place()
    misses = Placer._misses
    given_up = [frozenset(one.camera.X_FC[:3, 3].tobytes() for one in chosen.cameras)]

    def missed(asked, choice, demand):
        places = frozenset(asked.survey.camera_at(option).X_FC[:3, 3].tobytes() for option in choice.options)
        return places in given_up or misses(asked, choice, demand)

    monkeypatch.setattr(Placer, "_misses", missed)
    for every_set in (True, False):
        if not every_set:
            monkeypatch.setattr(every, "MOST_WORK", 0.0)
        other = placer(cell, tmp_path, TWELVE, Demand(most=2, wish=wish)).place()
        assert other.met
        assert not other.proven
        assert frozenset(one.camera.X_FC[:3, 3].tobytes() for one in other.cameras) not in given_up


def test_what_a_frame_and_latency_rule_out_is_not_searched_for(cell, tmp_path, monkeypatch):
    asked = placer(cell, tmp_path, TWELVE, Demand(most=2, wish=Wish(delay=0.14)))
    monkeypatch.setattr(Placer, "_reaching", lambda *_: pytest.fail("a search for what cannot be"))
    found = asked.place()
    assert not found.met
    assert found.quickest == pytest.approx(0.15)
    assert found.cameras
