"""Occlusion agrees with an independent renderer: MuJoCo's depth images of random scenes around a UR5.

For each box that passes every other limit, a picture of the scene without what the box encloses is rendered through a
window that just holds the box, and compared with the analytic depth at which the ray of each pixel leaves the box.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, grey_dilation

from sqrp_cli.camera.camera import Camera
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import BOX_SIGNS, Array, axis_rotation, inverse, pose, transform
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.literal import Atom
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.shapes import Cylinder, Part
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import load_solids
from sqrp_cli.sight.targets import SoughtBox, Target
from tests.sight.plain_geometry import through_box
from tests.sight.reference import Scene
from tests.sight.renderer import MujocoScene, Picture
from tests.sight.views import (
    box_part,
    camera_pose_around,
    make_box,
    make_camera,
    make_detector,
    random_pose,
)

pytestmark = pytest.mark.slow

SCENES, STATES, RESOLUTION = 10, 12, 200
SHARES = (1.0, 0.5)
DEPTH_BAND = 2e-3
"""How far from the boundary of a verdict a disagreement may be: so much, or one pixel of the pictures [m]."""

HELD_SIZE, CUBE_SIZE = (0.06, 0.05, 0.04), (0.05, 0.05, 0.05)


class RandomScene(NamedTuple):
    """The robot in `joints`, shape (states, n), with an object in its tool."""

    joints: Array
    X_TO: Array
    things: dict[str, Array]
    fixtures: tuple[Part, ...]
    cameras: tuple[Camera, ...]
    boxes: tuple[SoughtBox, ...]


@dataclass(frozen=True, eq=False)
class View:
    """One box of one scene as the renderer shows it to one camera in one state.

    center: of the box, in the optical frame [m]. leaves: optical z at which each pixel's ray leaves the shrunk box, 0
    outside its silhouette. blocked: where something opaque lies before that. pixel: width of a pixel at the box [m].
    """

    name: str
    state: int
    camera: int
    box: int
    X_WC: Array
    center: Array
    picture: Picture
    leaves: Array
    pixel: float

    @cached_property
    def silhouette(self) -> NDArray[np.bool_]:
        return self.leaves > 0

    @cached_property
    def blocked(self) -> NDArray[np.bool_]:
        return self.silhouette & (self.picture.depth < self.leaves)

    @cached_property
    def share(self) -> float:
        return 1.0 - float(self.blocked.sum() / self.silhouette.sum())

    @property
    def band(self) -> int:
        """One pixel, or as many as 2 mm have."""
        return max(1, int(DEPTH_BAND / self.pixel))

    def share_range(self, pixels: int) -> tuple[float, float]:
        """The visible share if every boundary of what blocks lay up to so many pixels elsewhere."""
        area = self.silhouette.sum()
        wide = (binary_dilation(self.blocked, wider(pixels)) & self.silhouette).sum()
        narrow = (self.blocked & ~binary_dilation(~self.blocked, wider(pixels))).sum()
        return 1.0 - float(wide / area), 1.0 - float(narrow / area)

    def margin(self, hidden: bool) -> str | None:
        """How near the boundary a box is that was wrongly called hidden, or wrongly not; None if beyond the band."""
        for pixels in range(1, self.band + 1):
            for depth in (0.0, DEPTH_BAND):
                if hidden:
                    reach = grey_dilation(self.leaves, footprint=wider(pixels), mode="constant") + depth
                    near = bool((self.picture.depth < reach).any())
                else:
                    inner = ~binary_dilation(~self.silhouette, wider(pixels))
                    near = not (inner & (self.picture.depth < self.leaves - depth)).any()
                if near:
                    return f"within {pixels} pixels ({1000 * pixels * self.pixel:.2f} mm) and {1000 * depth:g} mm"
        return None


def wider(pixels: int) -> NDArray[np.bool_]:
    """So many pixels in all eight directions."""
    return np.ones((2 * pixels + 1,) * 2, dtype=bool)


def picture_of(stage: MujocoScene, X_CB: Array, X_WC: Array, box: SoughtBox) -> tuple[Picture, Array, float]:
    """By a camera at X_WC of a box without its skin; where its rays leave the box; the size of a pixel there [m]."""
    bare = Scene(make_camera(), box, (), {name: pose() for name in ("world", box.frame)})
    half, middle = bare.half, bare.middle
    corners_C = transform(X_CB, middle + BOX_SIGNS * half)
    image = corners_C[:, :2] / corners_C[:, 2:]
    side = 1.04 * float((image.max(axis=0) - image.min(axis=0)).max())
    near = float(corners_C[:, 2].min()) / 300
    picture = stage.picture(X_WC, (image.max(axis=0) + image.min(axis=0) - side) / 2, side, near)
    rays = np.stack([picture.u, picture.v, np.ones_like(picture.u)], axis=-1).reshape(-1, 3)
    enter, leave = through_box(np.zeros(3), rays, X_CB, half, middle)
    leaves = np.where((enter <= leave) & (leave > 0), leave, 0.0).reshape(picture.u.shape)
    return picture, leaves, side / RESOLUTION * float(corners_C[:, 2].mean())


def random_scene(seed: int, model: RobotModel) -> RandomScene:
    rng = np.random.default_rng(seed)
    low, high = np.maximum(model.lower, -np.pi), np.minimum(model.upper, np.pi)
    low[1], high[1] = -2.8, -0.3
    tool = tuple(model.tool_links)
    angles = rng.uniform(0, 2 * np.pi, 3) + np.array([0.0, 2.0, 4.0])
    reach = rng.uniform(0.3, 0.7, 3)
    things = {
        f"cube{i}": pose(axis_rotation(2, 7 * angles[i]), (reach[i] * np.cos(a), reach[i] * np.sin(a), 0.025))
        for i, a in enumerate(angles)
    }
    everywhere = (-0.8, -0.8, 0.05), (0.8, 0.8, 0.8)
    sizes = [(float(a), float(b), float(c)) for a, b, c in rng.uniform(0.03, 0.25, (3, 3))]
    fixtures = [box_part(f"fixture{i}", size, random_pose(rng, *everywhere)) for i, size in enumerate(sizes)]
    fixtures += [box_part(f"plate{i}", (0.3, 0.2, 0.003), random_pose(rng, *everywhere)) for i in range(2)]
    fixtures.append(Part("cable", "world", Cylinder(0.0015, 1.5), random_pose(rng, (-0.4, -0.4, 0.2), (0.4, 0.4, 0.6))))
    fixtures.append(box_part("table", (1.9, 2.0, 0.04), pose(position=(0.0, 0.0, -0.02))))

    float_size = tuple(rng.uniform(0.02, 0.15, 3).tolist())
    empty = pose(position=(-things["cube0"][0, 3], -things["cube0"][1, 3], 0.02))
    marker = pose(position=(0.0, 0.0, 0.0255))
    boxes = (
        make_box(CUBE_SIZE, name="at_cube", frame="cube0", encloses=["cube0"]),
        make_box((0.04, 0.04, 0.04), empty, name="empty_place"),
        make_box(HELD_SIZE, name="at_cup", frame="held", encloses=["held", *tool]),
        make_box(HELD_SIZE, name="held", frame="held", encloses=["held"]),
        make_box((0.03, 0.03, 0.001), marker, name="marker", frame="cube2", normal=(0.0, 0.0, 1.0)),
        make_box((0.1, 0.1, 0.1), name="wrist", frame="wrist_3_link", encloses=["wrist_3_link", "ee_link", *tool]),
        make_box(float_size, random_pose(rng, *everywhere), name="floating"),
    )
    spots = [things["cube0"][:3, 3], things["cube1"][:3, 3], np.array([0.0, 0.0, 0.4])]
    lens = {"plumb_bob": (-0.15, 0.04, 1e-3, -5e-4, -0.004), "equidistant": (0.02, -0.01, 0.003, -0.0005)}
    cameras = [
        make_camera(camera_pose_around(rng, spot, rng.uniform(1.0, 2.2)), name=f"far{i}")
        for i, spot in enumerate([spots[2], spots[int(rng.integers(2))]])
    ]
    cameras += [
        make_camera(camera_pose_around(rng, spots[2], rng.uniform(0.8, 1.4)), name=name, model=name, distortion=values)
        for name, values in lens.items()
    ]
    cameras.append(make_camera(camera_pose_around(rng, spots[0], rng.uniform(0.15, 0.4)), name="close"))
    in_hand = pose(axis_rotation(0, rng.uniform(-0.4, 0.4)), (0.08, rng.uniform(-0.05, 0.05), rng.uniform(-0.05, 0.05)))
    cameras.append(make_camera(in_hand, name="in_hand", frame="tool0"))
    wide = [replace(c, matrix=c.matrix * [[0.7, 1, 1], [1, 0.7, 1], [1, 1, 1]]) for c in cameras]
    X_TO = pose(position=(0.0, 0.0, HELD_SIZE[2] / 2))
    return RandomScene(rng.uniform(low, high, (STATES, len(low))), X_TO, things, tuple(fixtures), tuple(wide), boxes)


class Comparison:
    """The package's verdicts on a scene beside the renderer's views of it."""

    def __init__(self, scene: RandomScene, seed: int, workspace: Workspace, model: RobotModel) -> None:
        self.scene, self.seed, self.workspace, self.model = scene, seed, workspace, model
        self.held = box_part("held", HELD_SIZE, pose(), "held")
        cubes = [box_part(name, CUBE_SIZE, pose(), name) for name in scene.things]
        self.solids = load_solids([*model.parts, *cubes, *scene.fixtures, self.held])
        self.observer = Observer(scene.cameras, self.solids)
        frames = {name: X[None] for name, X in scene.things.items()}
        links = model.link_poses(scene.joints)
        frames |= {**links, "world": pose()[None], "held": links[model.tool_frame] @ scene.X_TO}
        self.states = SceneStates(STATES, frames)
        self.verdicts: dict[float, list[BoxVerdicts]] = {}
        for share in SHARES:
            boxes = [replace(box, limits=make_detector(share)) for box in scene.boxes]
            found = self.observer.verdicts([Target(Atom("seen"), 1, (box,)) for box in boxes], self.states)
            self.verdicts[share] = [verdicts for (verdicts,) in found]

    def name_of(self, solid: int) -> str:
        part = self.solids[solid].part
        return part.parent if part in self.model.parts else part.name

    @cached_property
    def part_shares(self) -> dict[tuple[int, int, int], dict[str, float]]:
        """What each part hides, by box, state and camera, where no other limit fails."""
        names = {solid.name: self.name_of(index) for index, solid in enumerate(self.solids)}
        found: dict[tuple[int, int, int], dict[str, float]] = {}
        for number, box in enumerate(self.scene.boxes):
            cause = self.verdicts[1.0][number].cause
            camera, state = np.nonzero(((cause == Cause.NONE) | (cause == Cause.HIDDEN)).T)
            hiding = self.observer.occluders([box], self.states, np.zeros_like(state), camera, state)
            for at, parts in zip(zip(state, camera, strict=True), hiding, strict=True):
                shares: dict[str, float] = {}
                for part in parts:
                    shares[names[part.name]] = shares.get(names[part.name], 0.0) + part.share
                found[number, int(at[0]), int(at[1])] = shares
        return found

    def views(self) -> Iterator[tuple[View, tuple[str, ...]]]:
        """Every view that passes the other limits, with the names of the parts in its picture."""
        scene = self.scene
        cubes = [box_part(name, CUBE_SIZE, X_WO) for name, X_WO in scene.things.items()]
        stage = MujocoScene(self.workspace.robot, [*cubes, *scene.fixtures], self.held, RESOLUTION)
        try:
            for state in range(STATES):
                stage.move(dict(zip(self.model.arm, scene.joints[state], strict=True)))
                stage.place("held", stage.body_pose(self.model.tool_frame) @ scene.X_TO)
                frames = {**scene.things, "world": pose(), "held": stage.body_pose("held")}
                for number, box in enumerate(scene.boxes):
                    stage.show([i for i, name in enumerate(stage.names) if name in box.encloses])
                    X_WF = frames[box.frame] if box.frame in frames else stage.body_pose(box.frame)
                    cause = self.verdicts[1.0][number].cause[state]
                    for index in np.flatnonzero((cause == Cause.NONE) | (cause == Cause.HIDDEN)):
                        camera = scene.cameras[index]
                        X_WC = camera.X_FC if camera.frame == "world" else stage.body_pose(camera.frame) @ camera.X_FC
                        X_CB = inverse(X_WC) @ X_WF @ box.X_FB
                        name = f"scene {self.seed}, state {state}, {camera.name}, {box.name}"
                        at = name, state, int(index), number, X_WC, X_CB[:3, 3]
                        yield View(*at, *picture_of(stage, X_CB, X_WC, box)), stage.names
        finally:
            stage.close()


@dataclass
class Tally:
    """What all comparisons found; part_errors: of what single parts hide, where several do."""

    verdicts: Counter[float] = field(default_factory=Counter)
    hidden: Counter[float] = field(default_factory=Counter)
    wrong: list[tuple[str, str | None]] = field(default_factory=list)
    share_errors: list[tuple[float, str]] = field(default_factory=list)
    culprits: int = 0
    wrong_culprits: list[str] = field(default_factory=list)
    part_errors: list[tuple[float, str]] = field(default_factory=list)


def judge(comparison: Comparison, tally: Tally) -> None:
    for view, names in comparison.views():
        truth = {1.0: bool(view.blocked.any()), 0.5: view.share < 0.5}
        at = view.state, view.camera
        for share in SHARES:
            hidden = bool(comparison.verdicts[share][view.box].cause[at] == Cause.HIDDEN)
            tally.verdicts[share] += 1
            tally.hidden[share] += hidden
            if hidden != truth[share]:
                kind = f"{view.name}, min_visible {share}: called {'hidden' if hidden else 'visible'}"
                tally.wrong.append((kind, near_miss(view, share, hidden)))
        full = comparison.verdicts[1.0][view.box]
        error = abs(float(full.visible[at]) - view.share)
        tally.share_errors.append((error, view.name))
        tally.part_errors += part_errors(view, names, comparison.part_shares[view.box, *at], float(full.visible[at]))
        if full.cause[at] == Cause.HIDDEN and truth[1.0]:
            expected = true_culprit(view)
            if expected is not None:
                tally.culprits += 1
                named = comparison.name_of(int(full.by[at]))
                if named != names[expected]:
                    tally.wrong_culprits.append(f"{view.name}: {named} instead of {names[expected]}")


def part_errors(
    view: View, names: tuple[str, ...], shares: dict[str, float], visible: float
) -> Iterator[tuple[float, str]]:
    """How far what each part hides is from the pixels that show it before the box; one entry for each part."""
    assert sum(shares.values()) == pytest.approx(1.0 - visible, abs=1e-12)
    shown = {
        names[part]: float((view.blocked & (view.picture.part == part)).sum() / view.silhouette.sum())
        for part in np.unique(view.picture.part[view.blocked])
    }
    if len(shown) > 1:
        for name in {*shares, *shown}:
            yield abs(shares.get(name, 0.0) - shown.get(name, 0.0)), f"{view.name}: {name}"


def near_miss(view: View, share: float, hidden: bool) -> str | None:
    if share == 1.0:
        return view.margin(hidden)
    for pixels in range(1, view.band + 1):
        fewest, most = view.share_range(pixels)
        if fewest <= share <= most:
            return f"share {view.share:.4f}, within {pixels} pixels ({1000 * pixels * view.pixel:.2f} mm)"
    return None


def true_culprit(view: View) -> int | None:
    """Index of the part to name, None where the picture does not tell for sure."""
    picture = view.picture
    u, v = view.center[:2] / view.center[2]
    step = picture.u[0, 1] - picture.u[0, 0]
    column, row = round((u - picture.u[0, 0]) / step), round((v - picture.v[0, 0]) / step)
    around = (slice(max(row - 1, 0), row + 2), slice(max(column - 1, 0), column + 2))
    before = picture.depth[around] < view.center[2]
    parts = np.unique(picture.part[around])
    clear = np.abs(picture.depth[around] - view.center[2]) > DEPTH_BAND
    if not clear.all() or (before.any() and not (before.all() and len(parts) == 1)):
        return None
    if before.all():
        return int(parts[0])
    distance = picture.depth * np.sqrt(picture.u**2 + picture.v**2 + 1)
    nearest = sorted(
        (float(distance[mask].min()), int(part))
        for part in np.unique(picture.part[view.blocked])
        if (mask := view.blocked & (picture.part == part)).any()
    )
    if len(nearest) > 1 and nearest[1][0] - nearest[0][0] < DEPTH_BAND:
        return None
    return nearest[0][1]


@pytest.fixture(scope="module")
def tally(tabletop: Workspace, ur5: RobotModel) -> Tally:
    result = Tally()
    for seed in range(SCENES):
        judge(Comparison(random_scene(seed, ur5), seed, tabletop, ur5), result)
    return result


def test_at_least_995_of_1000_verdicts_agree_with_the_renderer(tally: Tally) -> None:
    count = sum(tally.verdicts.values())
    assert count >= 5000
    assert all(0.05 * tally.verdicts[share] < tally.hidden[share] < 0.95 * tally.verdicts[share] for share in SHARES)
    assert len(tally.wrong) <= 0.005 * count, tally.wrong


def test_every_disagreement_lies_within_a_pixel_or_two_millimetres_of_the_boundary(tally: Tally) -> None:
    assert [verdict for verdict, margin in tally.wrong if margin is None] == []


def test_visible_shares_are_right_to_two_points(tally: Tally) -> None:
    assert [(name, error) for error, name in tally.share_errors if error > 0.02] == []


def test_the_part_that_hides_is_the_one_that_the_renderer_shows(tally: Tally) -> None:
    assert tally.culprits >= 500
    assert len(tally.wrong_culprits) <= 0.005 * tally.culprits, tally.wrong_culprits


def test_what_each_part_hides_is_what_the_renderer_shows_of_it_before_the_box(tally: Tally) -> None:
    assert len(tally.part_errors) >= 500
    assert [(name, error) for error, name in tally.part_errors if error > 0.012] == []
