"""Of a box of which a share must be seen, the part is named that hides the largest share: by single rays of Embree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.geometry import BOX_SIGNS, Array, inverse, look_at, pose, transform
from sqrp_cli.logic.literal import Atom
from sqrp_cli.robot.kinematics import RobotModel
from sqrp_cli.sight.limits import Cause
from sqrp_cli.sight.observer import Observer
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.solids import Solid, load_solid, load_solids
from sqrp_cli.sight.targets import SoughtBox, Target
from tests.sight.test_laws import random_watch, with_share
from tests.sight.test_truth import Comparison, random_scene
from tests.sight.views import box_part, make_box, make_camera, make_detector

SIDE = 100
"""Rays along each side of a box's image."""

TIED = 0.02
"""Shares that are no further apart may be told apart wrongly."""

SKIN = 1e-3


@dataclass(frozen=True)
class Hidden:
    """A hidden verdict: the part that was named, and the share that each part hides, by rays of our own."""

    named: str
    shares: dict[str, float]

    @property
    def lead(self) -> float:
        """By how much the largest share exceeds that of the part that was named."""
        return max(self.shares.values()) - self.shares[self.named]


def rays_to(box: SoughtBox, X_WC: Array, X_WB: Array) -> tuple[Array, Array]:
    """Rays of a grid that meet the box without its skin, (n, 3), and how far along them they leave it; by slabs."""
    extents, offset = np.array(box.size), np.zeros(3)
    if (extents <= 2 * SKIN).any():
        offset = SKIN * np.array(box.normal or (0.0, 0.0, 0.0))
    half = np.where(extents <= 2 * SKIN, extents, extents - 2 * SKIN) / 2
    corners_C = transform(inverse(X_WC) @ X_WB, half * BOX_SIGNS + offset)
    image = corners_C[:, :2] / corners_C[:, 2:]
    low, high = image.min(axis=0), image.max(axis=0)
    steps = (np.arange(SIDE) + 0.5) / SIDE
    u, v = np.meshgrid(*(low + steps[:, None] * (high - low)).T)
    rays_W = np.column_stack([u.ravel(), v.ravel(), np.ones(u.size)]) @ X_WC[:3, :3].T
    X_BW = inverse(X_WB)
    eye_B = transform(X_BW, X_WC[None, :3, 3])[0] - offset
    with np.errstate(divide="ignore"):
        sides = np.stack([(sign * half - eye_B) / (rays_W @ X_BW[:3, :3].T) for sign in (-1, 1)])
    enters, leaves = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
    met = enters <= leaves
    return rays_W[met], leaves[met]


@cache
def mesh_of(solid: Solid) -> trimesh.Trimesh:
    return trimesh.Trimesh(solid.vertices, solid.triangles, process=False)


def blocks(solid: Solid, X_WP: Array, eye_W: Array, rays_W: Array, leaves: Array) -> NDArray[np.bool_]:
    """Which rays meet a solid before they leave the box."""
    X_PW = inverse(X_WP)
    eye, rays = transform(X_PW, eye_W[None])[0], rays_W @ X_PW[:3, :3].T
    places, ray, _ = mesh_of(solid).ray.intersects_location(np.broadcast_to(eye, rays.shape), rays, multiple_hits=False)
    blocked = np.zeros(len(rays), dtype=bool)
    blocked[ray] = np.linalg.norm(places - eye, axis=1) < leaves[ray] * np.linalg.norm(rays[ray], axis=1)
    return blocked


def at(X: Array, state: int) -> Array:
    return X[state if len(X) > 1 else 0]


def hidden_verdicts(observer: Observer, states: SceneStates, boxes: Sequence[SoughtBox]) -> Iterator[Hidden]:
    """Every hidden verdict about some boxes."""
    (found,) = observer.verdicts([Target(Atom("seen"), 1, tuple(boxes))], states)
    solids = sorted(observer.solids, key=lambda solid: solid.name)
    for box, verdicts in zip(boxes, found, strict=True):
        for state, camera in np.argwhere(verdicts.cause == Cause.HIDDEN):
            X_WC = at(states.camera_poses(observer.cameras[camera]), state)
            rays_W, leaves = rays_to(box, X_WC, at(states.box_poses(box), state))
            shares = {}
            for name, pieces in groupby(solids, key=lambda solid: solid.name):
                opaque = [
                    piece for piece in pieces if not {piece.part.name, piece.part.parent}.intersection(box.encloses)
                ]
                blocked = [
                    blocks(piece, at(states.X_WF[piece.part.parent], state), X_WC[:3, 3], rays_W, leaves)
                    for piece in opaque
                ]
                shares[name] = float(np.any(blocked, axis=0).mean()) if blocked else 0.0
            yield Hidden(observer.solids[verdicts.by[state, camera]].name, shares)


def assert_largest(found: list[Hidden], least: int) -> None:
    contested = [verdict for verdict in found if sum(share > 0 for share in verdict.shares.values()) > 1]
    wrong = [verdict for verdict in contested if verdict.lead > TIED]
    unequal = [verdict for verdict in contested if verdict.lead > 0]
    print(
        f"\n{len(found)} hidden, {len(contested)} by several parts, {len(unequal)} by a share that is not the largest"
    )
    assert len(contested) >= least
    assert wrong == []
    assert len(unequal) <= 0.02 * len(contested)


@pytest.mark.parametrize("share", [0.95, 0.5])
def test_among_loose_shapes_the_part_that_hides_most_is_named(share: float) -> None:
    found: list[Hidden] = []
    for seed in range(40):
        watch = with_share(random_watch(seed), share)
        # A link of two pieces is one part.
        names = {"rod": "part0", "ball": "part1"}
        observer = Observer(
            watch.cameras, tuple(load_solid(part, names.get(part.name, part.name)) for part in watch.parts)
        )
        found += hidden_verdicts(observer, watch.states, watch.target.boxes)
    assert_largest(found, 50)


def test_around_a_robot_the_part_that_hides_most_is_named(tabletop: Workspace, ur5: RobotModel) -> None:
    found: list[Hidden] = []
    for seed in range(3):
        comparison = Comparison(random_scene(seed, ur5), seed, tabletop, ur5)
        boxes = [replace(box, limits=make_detector(0.5)) for box in comparison.scene.boxes]
        found += hidden_verdicts(comparison.observer, comparison.states, boxes)
    assert_largest(found, 150)


CUBE = make_box((0.1, 0.1, 0.1), detector=make_detector(0.9))


def culprit(**widths: tuple[float, float, float]) -> str:
    """Who hides the cube from a camera 1 m before it, of upright plates: depth, from and to where across [m]."""
    parts = [
        box_part(name.split("_")[0], (abs(end - start), 1.0, 0.001), pose(position=((start + end) / 2, 0.0, depth)))
        for name, (depth, start, end) in widths.items()
    ]
    observer = Observer((make_camera(look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))),), load_solids(parts))
    states = SceneStates(1, {"world": pose()[None]})
    ((verdicts,),) = observer.verdicts([Target(Atom("seen"), 1, (CUBE,))], states)
    assert verdicts.cause[0, 0] == Cause.HIDDEN
    return observer.solids[verdicts.by[0, 0]].name


def test_a_sliver_before_the_middle_is_not_named_before_what_hides_half() -> None:
    assert culprit(sliver=(0.6, -0.001, 0.001), wall=(0.2, 0.0, 0.5)) == "wall"


def test_what_another_part_hides_already_counts_all_the_same() -> None:
    """The wall's share is larger than the screen's, though most of it lies behind the screen."""
    assert culprit(screen=(0.5, -0.02, 0.5), wall=(0.2, -0.036, 0.5)) == "wall"


def test_of_parts_that_hide_the_same_share_the_first_by_name_is_named() -> None:
    assert culprit(b=(0.6, -0.5, 0.5), a=(0.2, -0.5, 0.5)) == "a"
    assert culprit(a=(0.6, -0.5, 0.5), b=(0.2, -0.5, 0.5)) == "a"


def test_pieces_with_one_name_are_one_part() -> None:
    pieces = {"post_1": (0.2, -0.04, -0.02), "post_2": (0.2, 0.01, 0.04)}
    assert culprit(**pieces, bar_1=(0.3, -0.03, 0.005)) == "post"
    assert culprit(post_1=pieces["post_1"], bar_1=(0.3, -0.03, 0.005)) == "bar"
