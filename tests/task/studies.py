"""Random motions of an arm past cameras, without inverse kinematics; random time lines without cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from hypothesis import strategies as st

from sqrp_cli.cell.workspace import World
from sqrp_cli.geometry import look_at, pose
from sqrp_cli.logic.formula_time import GroundOperator, TimeInterval
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.motion.plan_motion import Motion, TimedPrimitive
from sqrp_cli.motion.timing import MotionLimits, joint_move
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Cylinder, Part
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.sight.targets import Target
from sqrp_cli.study.sampling import Sampling
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import Observation, PlannedMotion, Timeline, observe
from sqrp_cli.task.pieces import cut_into_pieces, monitored_times
from sqrp_cli.trajectory import Trajectory
from tests.sight.views import box_part, camera_pose_around, make_box, make_camera, make_detector, random_pose

HOLD, PLACED = Atom("hold", ("cube",)), Atom("placed", ("cube",))
CUBE = (0.05, 0.05, 0.05)


@dataclass(frozen=True, eq=False)
class WatchedMotion:
    """A motion with everything that its time line needs. faults: columns of the literals of each fault."""

    stage: Stage
    observer: Observer
    targets: tuple[Target, ...]
    formulas: tuple[GroundOperator, ...]
    faults: Mapping[str, tuple[int, ...]]

    def timeline(self, sampling: Sampling, *, full: bool = False) -> Timeline:
        return observe(self.planned, self.observer, sampling, full=full)

    @property
    def planned(self) -> PlannedMotion:
        return planned_about(self.stage, self.targets, self.formulas, self.faults)


def planned_about(
    stage: Stage,
    targets: tuple[Target, ...],
    formulas: tuple[GroundOperator, ...],
    faults: Mapping[str, tuple[int, ...]],
) -> PlannedMotion:
    """A motion of no candidate, and what must be seen during it."""
    nobody: Any = None
    T, T_eoi = monitored_times(formulas)
    return PlannedMotion(
        candidate=nobody, world=nobody, motion=stage.motion, formulas=formulas, since={}, stage=stage, targets=targets,
        faults=faults, T=T, T_eoi=T_eoi,
    )  # fmt: skip


def always(start: float, end: float, *literals: Literal) -> GroundOperator:
    return GroundOperator(start, end, "always", "always", literals)


def eventually(start: float, end: float, *literals: Literal, fault: str | None = None) -> GroundOperator:
    return GroundOperator(start, end, "eventually", "eventually", literals, fault)


def watched_motion(seed: int, model: RobotModel, min_visible: float = 1.0) -> WatchedMotion:
    """A random motion among random plates, boxes and a cable, with four cameras."""
    rng = np.random.default_rng(seed)
    middle = model.home + rng.uniform(-0.8, 0.8, len(model.arm))
    waypoints = np.stack([middle + rng.uniform(-1, 1, len(model.arm)), middle, middle + rng.uniform(-1, 1, 6)])
    X_TO = pose(position=(0.0, 0.0, CUBE[2] / 2))
    # To the cube, a grasp, and on with the cube.
    limits = MotionLimits(model.velocity, model.acceleration, model.jerk)
    spot, primitives, start = model.tool_pose(waypoints[1]) @ X_TO, list[TimedPrimitive](), 0.0
    for name, trajectory, held in (
        ("a1", joint_move(waypoints[0], waypoints[1], limits), None),
        ("a2", Trajectory.standstill(waypoints[1], 0.7), None),
        ("a3", joint_move(waypoints[1], waypoints[2], limits), "cube"),
    ):
        resting, end = {} if held else {"cube": spot}, start + trajectory.duration
        primitives.append(TimedPrimitive(name, start, end, trajectory, held, X_TO if held else None, resting))
        start = end
    joints = dict(zip(model.arm, waypoints[2].tolist(), strict=True))
    motion = Motion(model.arm, tuple(primitives), World(frozenset(), {"cube": spot}, "cube", X_TO, joints))
    near_spot = spot[:3, 3] - 0.4, spot[:3, 3] + 0.4
    parts = [
        *model.parts,
        box_part("cube", CUBE, pose(), "cube"),
        box_part("plate", (0.2, 0.2, 0.003), random_pose(rng, *near_spot)),
        box_part("block", (0.1, 0.08, 0.12), random_pose(rng, *near_spot)),
        Part("cable", "world", Cylinder(0.002, 1.0), random_pose(rng, *near_spot)),
    ]
    cameras = [
        make_camera(
            camera_pose_around(rng, spot[:3, 3], rng.uniform(0.6, 1.5)),
            name=f"cam{i}",
            focal=(500.0, 500.0),
            rate=rate,
            latency=0.05,
        )
        for i, rate in enumerate((10.0, 25.0, 10.0))
    ]
    in_hand = look_at((0.09, 0.0, -0.02), (0.0, 0.0, 0.1), up=(1.0, 0.0, 0.0))
    cameras.append(make_camera(in_hand, name="in_hand", frame="tool0", focal=(400.0, 400.0), rate=30.0))
    detector = make_detector(min_visible, max_incidence=1.4, min_pixels=8.0)
    targets = (
        Target(HOLD, 1, (make_box(CUBE, frame="cube", encloses=["cube", *model.tool_links], detector=detector),)),
        Target(PLACED, 1, (make_box(CUBE, frame="cube@start", encloses=["cube"], detector=detector),)),
    )
    (_, a2, a3), time = motion.primitives, motion.time
    held, gone = Literal(HOLD), Literal(PLACED, positive=False)
    gap = float(rng.uniform(0.0, 0.3)) if rng.random() < 0.5 else 0.0
    formulas = (
        always(0.0, a2.end - gap, held.negated(), gone.negated()),
        always(a3.start, time, held, gone),
        eventually(a3.start, a3.start + 0.7 * (time - a3.start), held.negated(), gone.negated(), fault="slip"),
    )
    spans = [(primitive.start, primitive.end) for primitive in motion.primitives]
    stage = Stage(model, motion, cut_into_pieces(spans, formulas), {"cube": spot})
    return WatchedMotion(stage, Observer(tuple(cameras), load_solids(parts)), targets, formulas, {"slip": (0, 1)})


ATOMS = (Atom("hold"), Atom("placed"))


@dataclass(frozen=True, eq=False)
class Story:
    """A time line with the formulas behind it; `interval` is that of the fault `slip`. total: of the motion [s]."""

    timeline: Timeline
    formulas: tuple[GroundOperator, ...]
    interval: TimeInterval
    total: float


def make_story(
    durations: list[float], formulas: tuple[GroundOperator, ...], counts: list[int], seed: int, seen: float
) -> Story:
    """Samples at random instants, each covered with probability `seen`; the last formula is that of the fault."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(durations)
    pieces = cut_into_pieces(list(zip(ends - durations, ends, strict=True)), formulas)
    number, t = [], []
    for index, piece in enumerate(pieces):
        inner = np.sort(rng.uniform(piece.start, piece.end, counts[index % len(counts)]))
        instants = [piece.start, *inner, piece.end] if piece.end > piece.start else [piece.start]
        number += [index] * len(instants)
        t += instants
    samples = Samples(np.array(number), np.array(t))
    required = np.array([[any(lit.atom == a for lit in piece.literals) for a in ATOMS] for piece in pieces])[number]
    covered = required & (rng.random(required.shape) < seen)
    operator = formulas[-1]
    columns = tuple(ATOMS.index(literal.atom) for literal in operator.literals)
    primitives = [SimpleNamespace(held=None)] * len(durations)
    stage = Stage(None, SimpleNamespace(primitives=primitives), pieces, {})  # type: ignore[arg-type]
    timeline = Timeline(
        planned=planned_about(stage, (), formulas, {"slip": columns}),
        samples=samples,
        observation=Observation(
            looked=np.ones(len(required), dtype=bool),
            required=required,
            known=required,
            covered=covered,
            matrix=None,
        ),
    )
    return Story(timeline, formulas, TimeInterval(operator.start, operator.end), float(ends[-1]))


@st.composite
def stories(draw: st.DrawFn) -> Story:
    """Motions of one to four primitives with up to four formulas, some at an instant, some touching, some apart."""
    durations = draw(st.lists(st.sampled_from([0.5, 1.0, 1.7]), min_size=1, max_size=4))
    total = sum(durations)
    edge = st.sampled_from([0.0, 0.25, 0.5, 0.6, 1.0, 1.5, 2.0, 2.2, total]).map(lambda t: min(t, total))
    literals = st.sampled_from(
        [(Literal(ATOMS[0]),), (Literal(ATOMS[1], positive=False),), (Literal(ATOMS[0]), Literal(ATOMS[1]))]
    )
    formulas = []
    for kind in draw(st.lists(st.sampled_from([always, eventually]), max_size=3)):
        start, end = sorted((draw(edge), draw(edge)))
        formulas.append(kind(start, end, *draw(literals)))
    start, end = sorted((draw(edge), draw(edge)))
    formulas.append(eventually(start, end, *draw(literals), fault="slip"))
    counts = draw(st.lists(st.integers(0, 6), min_size=1, max_size=5))
    seed, seen = draw(st.integers(0, 2**32 - 1)), draw(st.sampled_from([0.0, 0.3, 0.6, 0.9, 1.0]))
    return make_story(durations, tuple(formulas), counts, seed, seen)


def stretches(formulas: tuple[GroundOperator, ...], kinds: tuple[str, ...]) -> list[tuple[float, float]]:
    """The union of the intervals of some operators, as intervals in order."""
    intervals = sorted((f.start, f.end) for f in formulas if f.operator in kinds)
    union: list[tuple[float, float]] = []
    for start, end in intervals:
        if union and start <= union[-1][1] + 1e-9:
            union[-1] = (union[-1][0], max(union[-1][1], end))
        else:
            union.append((start, end))
    return union


def moments(story: Story) -> list[tuple[float, bool]]:
    """Of every sample in order its time, and whether the fault is covered."""
    timeline = story.timeline
    covered = timeline.observation.covered[:, list(timeline.planned.faults["slip"])].all(axis=1)
    return list(zip(timeline.samples.t.tolist(), covered.tolist(), strict=True))
