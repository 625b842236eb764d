"""What must hold of coverage whatever the scene."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cache, cached_property
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import Array, pose
from sqrp_cli.kernel.kernel import BoxVerdicts, Loss
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Capsule, Cylinder, Part, Sphere
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import Solid, load_solids
from sqrp_cli.sight.targets import Target
from sqrp_cli.study import pipeline
from sqrp_cli.study.pipeline import RankJob, assess_all
from sqrp_cli.study.sampling import FixedCount
from sqrp_cli.task.task import read_task
from tests.sight.views import (
    box_part,
    camera_pose_around,
    make_box,
    make_camera,
    make_detector,
    random_pose,
)
from tests.task.studies import watched_motion

STATES = 6
SEEDS = st.integers(0, 199)
"""Of random watches. Few enough that laws share them, and much of what one compares with is known from another."""

few = settings(max_examples=40, deadline=None)


@dataclass(frozen=True, eq=False)
class Watch:
    """A target, the frames in some states, and what there is to see it with and in its way."""

    cameras: tuple[Camera, ...]
    parts: tuple[Part, ...]
    target: Target
    states: SceneStates

    @cached_property
    def observer(self) -> Observer:
        return Observer(self.cameras, load_solids(self.parts))

    @cached_property
    def matrix(self) -> tuple[BoxVerdicts, ...]:
        (boxes,) = self.observer.verdicts([self.target], self.states)
        return boxes

    @cached_property
    def covered(self) -> NDArray[np.bool_]:
        (found,) = self.observer.coverage([self.target], self.states, [np.arange(STATES)])
        return found


@cache
def random_watch(seed: int) -> Watch:
    """Links that jump about with parts on them, cameras of three rates around, one in a hand, and up to three boxes."""
    rng = np.random.default_rng(seed)
    low, high = (-0.4, -0.4, 0.0), (0.4, 0.4, 0.6)
    frames = {f"link{i}": np.stack([random_pose(rng, low, high) for _ in range(STATES)]) for i in range(3)}
    frames |= {"world": pose()[None], "thing": random_pose(rng, low, high)[None]}
    extents = rng.uniform(0.02, 0.25, (5, 3))
    parts = [box_part(f"part{i}", tuple(extents[i].tolist()), pose(), f"link{i}") for i in range(3)]
    parts += [
        Part("rod", "link0", Cylinder(0.01, 0.4), random_pose(rng, (0, 0, 0), (0.1, 0.1, 0.1))),
        Part("ball", "link1", Sphere(0.04), random_pose(rng, (0, 0, 0), (0.1, 0.1, 0.1))),
        Part("pill", "world", Capsule(0.03, 0.2), random_pose(rng, low, high)),
        box_part("thing", tuple(extents[3].tolist()), pose(), "thing"),
        box_part("sheet", (0.3, 0.3, 0.002), random_pose(rng, low, high)),
    ]
    share = float(rng.choice([1.0, 0.9, 0.5, 0.2]))
    boxes = []
    for index in range(int(rng.integers(1, 4))):
        frame = str(rng.choice(["world", "link2", "thing"]))
        size = tuple((rng.uniform(0.02, 0.12, 3)).tolist())
        X_FB = random_pose(rng, low, high) if frame == "world" else random_pose(rng, (0, 0, 0), (0.1, 0.1, 0.1))
        detector = make_detector(share, (0.1, 3.0), float(rng.uniform(0.8, np.pi)), float(rng.uniform(0, 30)))
        normal = (0.0, 0.0, 1.0) if rng.random() < 0.3 else None
        encloses = [frame] if rng.random() < 0.7 else []
        boxes.append(
            make_box(size, X_FB, name=f"box{index}", frame=frame, detector=detector, normal=normal, encloses=encloses)
        )
    center = np.array([0.0, 0.0, 0.3])
    cameras = [
        make_camera(
            camera_pose_around(rng, center, rng.uniform(0.5, 1.5)),
            name=f"cam{i}",
            focal=(450.0, 450.0),
            near=0.05,
            far=float(rng.uniform(1.0, 4.0)),
            rate=float(rng.choice([5.0, 10.0, 25.0])),
            latency=float(rng.choice([0.05, 0.1])),
        )
        for i in range(4)
    ]
    cameras.append(make_camera(pose(position=(0, 0, -0.5)), name="in_hand", frame="link0", focal=(350.0, 350.0)))
    target = Target(Atom("seen"), int(rng.integers(1, 4)), tuple(boxes))
    return Watch(tuple(cameras), tuple(parts), target, SceneStates(STATES, frames))


def with_share(watch: Watch, share: float) -> Watch:
    boxes = tuple(replace(box, limits=replace(box.limits, min_visible=share)) for box in watch.target.boxes)
    return replace(watch, target=replace(watch.target, boxes=boxes))


@few
@given(seed=SEEDS)
def test_coverage_alone_is_what_the_full_matrix_gives(seed: int) -> None:
    watch = random_watch(seed)
    sees = np.all([box.cause == Cause.NONE for box in watch.matrix], axis=0)
    assert watch.covered.tolist() == (sees.sum(axis=1) >= watch.target.cameras).tolist()


@few
@given(seed=SEEDS, too_many=st.integers(1, 4))
def test_no_more_is_looked_at_once_too_much_is_lost(seed: int, too_many: int) -> None:
    watch = random_watch(seed)
    loss = Loss(np.ones((STATES, 2)), np.array([[too_many, 0.0], [0.0, STATES]]))
    (found,) = watch.observer.coverage([watch.target], watch.states, [np.arange(STATES)], loss)
    covered = watch.covered
    lost = np.cumsum(~covered & np.append(False, ~covered[:-1])) >= too_many
    assert found.tolist() == (covered & ~lost).tolist()


@few
@given(seed=SEEDS, data=st.data())
def test_targets_looked_at_together_give_what_each_gives_alone(seed: int, data: st.DataObject) -> None:
    watch = random_watch(seed)
    counts = st.integers(1, 3)
    alone = [replace(watch, target=Target(Atom(box.name), data.draw(counts), (box,))) for box in watch.target.boxes]
    watches = [watch, *alone]
    asked = [np.array(sorted(data.draw(st.sets(st.integers(0, STATES - 1)))), dtype=np.int64) for _ in watches]

    together = watch.observer.coverage([w.target for w in watches], watch.states, asked)
    matrices = watch.observer.verdicts([w.target for w in watches], watch.states)

    for each, rows, coverage, matrix in zip(watches, asked, together, matrices, strict=True):
        assert coverage.tolist() == each.covered[rows].tolist()
        for box, other in zip(matrix, each.matrix, strict=True):
            assert all(
                np.array_equal(getattr(box, f.name), getattr(other, f.name), equal_nan=True) for f in fields(box)
            )


@few
@given(seed=SEEDS)
def test_how_poses_lie_in_memory_does_not_matter(seed: int) -> None:
    """One that stands for all states is the same as a copy for each, or a view with its axes elsewhere."""
    watch = random_watch(seed)
    frames = {}
    for number, (name, X) in enumerate(watch.states.X_WF.items()):
        views = [np.broadcast_to(X, (STATES, 4, 4)), np.asfortranarray(X), np.repeat(X, STATES // len(X), axis=0)]
        frames[name] = views[(seed + number) % 3]
    other = replace(watch, states=SceneStates(STATES, frames))
    for box, again in zip(watch.matrix, other.matrix, strict=True):
        assert (box.cause == again.cause).all()
        assert (box.by == again.by).all()


@few
@given(seed=SEEDS, cameras=st.permutations(range(5)), solids=st.permutations(range(8)))
def test_the_order_of_cameras_and_solids_does_not_matter(seed: int, cameras: list[int], solids: list[int]) -> None:
    watch = random_watch(seed)
    shuffled = replace(
        watch, cameras=tuple(watch.cameras[i] for i in cameras), parts=tuple(watch.parts[i] for i in solids)
    )
    assert watch.covered.tolist() == shuffled.covered.tolist()
    for box, other in zip(watch.matrix, shuffled.matrix, strict=True):
        cause, by = box.cause[:, cameras], box.by[:, cameras]
        hidden = cause == Cause.HIDDEN
        assert (cause == other.cause).all()
        assert [watch.parts[i].name for i in by[hidden]] == [shuffled.parts[i].name for i in other.by[hidden]]


@few
@given(seed=SEEDS, elsewhere=st.integers(0, 2**32 - 1))
def test_neither_names_nor_the_place_of_the_whole_cell_matter(seed: int, elsewhere: int) -> None:
    watch = random_watch(seed)
    X_NW = random_pose(np.random.default_rng(elsewhere), (-5, -5, -5), (5, 5, 5))

    def other(name: str) -> str:
        return name if name == "world" else f"{name[::-1]}_2"

    def placed(frame: str, X: Array) -> Array:
        """What is fixed to the world goes with the cell; poses in frames stay."""
        return X_NW @ X if frame == "world" else X

    cameras = [
        replace(c, name=other(c.name), frame=other(c.frame), X_FC=placed(c.frame, c.X_FC)) for c in watch.cameras
    ]
    parts = [replace(p, name=other(p.name), parent=other(p.parent), X_PG=placed(p.parent, p.X_PG)) for p in watch.parts]
    boxes = [
        replace(
            b,
            name=other(b.name),
            frame=other(b.frame),
            X_FB=placed(b.frame, b.X_FB),
            encloses=tuple(map(other, b.encloses)),
        )
        for b in watch.target.boxes
    ]
    frames = {other(name): X if name == "world" else X_NW @ X for name, X in watch.states.X_WF.items()}
    target = replace(watch.target, boxes=tuple(boxes))
    moved = Watch(tuple(cameras), tuple(parts), target, SceneStates(STATES, frames))
    assert watch.covered.tolist() == moved.covered.tolist()


@few
@given(
    seed=SEEDS,
    gone=st.sets(st.integers(0, 7), min_size=1),
    shares=st.tuples(st.floats(0.05, 1), st.floats(0.05, 1)),
)
def test_coverage_never_falls_where_more_can_be_seen_or_less_is_asked(
    seed: int, gone: set[int], shares: tuple[float, float]
) -> None:
    watch = random_watch(seed)
    fewer = replace(watch, cameras=watch.cameras[:-1])
    cleared = replace(watch, parts=tuple(part for i, part in enumerate(watch.parts) if i not in gone))
    lenient, strict, all_of_it = (with_share(watch, share) for share in (*sorted(shares), 1.0))
    asked = [replace(watch, target=replace(watch.target, cameras=k)) for k in range(6, 0, -1)]
    rising = [(fewer, watch), (watch, cleared), (all_of_it, strict), (strict, lenient), *pairwise(asked)]
    assert [not (less.covered & ~more.covered).any() for less, more in rising] == [True] * len(rising)
    assert not asked[0].covered.any()  # there are five cameras


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 200))
def test_quality_keeps_these_laws_over_a_motion(ur5: RobotModel, seed: int) -> None:
    motion = watched_motion(seed, ur5)
    cameras, solids = motion.observer.cameras, motion.observer.solids

    def by(cameras: tuple[Camera, ...], solids: tuple[Solid, ...] = solids) -> tuple[float | None, float | None]:
        found = replace(motion, observer=Observer(cameras, solids)).timeline(FixedCount(40)).qualities
        return found.q_avg, found.q_eoi

    found = by(cameras)
    assert by(cameras[::-1]) == found
    cleared = by(cameras, tuple(solid for solid in solids if solid.part.name not in ("plate", "cable")))
    for fewer, more in ((by(cameras[1:]), found), (found, cleared)):
        assert all(less <= much + 1e-12 for less, much in zip(fewer, more, strict=True))


def test_two_processes_give_what_one_gives(tabletop: Workspace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "WORTH_WITH_WAYS", 1)
    task = read_task("pickup object=g2,g3", tabletop).candidates
    job = RankJob(FixedCount(20), cell=Cell.load(tabletop), world=tabletop.stated_world)
    one, two = (
        [{**vars(found), "candidate": found.candidate.name} for found in assess_all(job, task, jobs)] for jobs in (1, 2)
    )
    assert one == two
