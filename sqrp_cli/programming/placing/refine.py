"""From places on a grid to places between them: chosen cameras are moved and turned as far as their mounts allow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sqrp_cli.geometry import Array, Mask, read_only
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.workspace.mounts import LensChoice, MountEntry, Spot
from sqrp_cli.programming.advice.aiming import looking_at
from sqrp_cli.programming.placing.scenes import JudgedWay, View, camera_of

_FINEST = 0.005
"""Moves are not tried in smaller steps than this [m]; aims not in less than a degree."""

_HALVINGS = 4
"""How often the step is halved, at most."""


@dataclass(frozen=True, eq=False)
class CameraSeat:
    """A camera somewhere on its mount."""

    spot: Spot
    view: View
    lens: LensChoice

    def camera(self, name: str) -> Camera:
        """The camera there."""
        return camera_of(name, self.spot, self.view, self.lens)


Sees = Callable[[Sequence[CameraSeat]], list[Mask]]
"""What several seats see of each way, shape (seats, items) each."""


def refined(
    seats: Sequence[CameraSeat],
    ways: Sequence[JudgedWay],
    others: Sequence[Array],
    sees: Sees,
    free: Callable[[Sequence[CameraSeat], Sequence[CameraSeat]], Mask],
) -> tuple[CameraSeat, ...]:
    """The cameras, each moved and turned as long as that improves the least quality, else the mean of all.

    others: how many cameras that stay see each item of each way. free: which of some seats may be taken besides others.
    """
    best, seen = list(seats), [sees([seat]) for seat in seats]
    worth = _worth(ways, others, seen)
    for halving in range(1, _HALVINGS + 1):
        for number in range(len(best)):
            rest = [seat for index, seat in enumerate(best) if index != number]
            tried = list(_around(best[number], 0.5**halving))
            tried = [seat for seat, good in zip(tried, free(tried, rest), strict=True) if good]
            if worth >= (1.0, 1.0) or not tried:
                continue
            found = sees(tried)
            each = [[of_way[index : index + 1] for of_way in found] for index in range(len(tried))]
            gains = [_worth(ways, others, [*seen[:number], one, *seen[number + 1 :]]) for one in each]
            first = max(range(len(tried)), key=gains.__getitem__)
            if gains[first] > worth:
                best[number], seen[number], worth = tried[first], each[first], gains[first]
    return tuple(best)


def _worth(ways: Sequence[JudgedWay], others: Sequence[Array], seen: Sequence[Sequence[Mask]]) -> tuple[float, float]:
    """The least of all qualities of some ways and their mean, rounded."""
    found: list[float] = []
    for number, (way, count) in enumerate(zip(ways, others, strict=True)):
        total = count + sum(of_seat[number][0].astype(np.int64) for of_seat in seen)
        found += qualities(way, total >= way.needed)
    return round(min(found, default=1.0), 6), round(float(np.mean(found)) if found else 1.0, 6)


def qualities(way: JudgedWay, covered: Mask) -> list[float]:
    """Q_eoi and Q_avg of a way at its samples, those that are defined, if these items are covered, shape (items,)."""
    sample, samples, scene = way.items.sample, way.samples, way.scene
    state: Mask = np.array(np.any(way.required, axis=1, keepdims=True))[:, 0]
    state[sample[~covered]] = False
    steps = np.where(state[1:] & state[:-1], samples.steps, 0.0)
    interesting = scene.stage.of_interest(samples)[:-1]
    found = [float(steps[interesting].sum() / scene.T_eoi)] if scene.T_eoi > 0 else []
    return [*found, float(steps.sum() / scene.T)] if scene.T > 0 else found


def _around(seat: CameraSeat, share: float) -> Iterator[CameraSeat]:
    """The camera a share of a step away along its mount, and turned by a share of a step of its cone."""
    for offset in _offsets(seat.spot.entry, share):
        position = np.round(_within(seat.spot.entry, seat.spot.position + offset), 3) + 0.0
        if np.abs(position - seat.spot.position).max() >= _FINEST:
            yield _moved(seat, position)
    aims, at = seat.spot.entry.aims, seat.view.at
    cone = None if aims is None else aims.cone
    if cone is None or at is None:
        return
    axis = np.array(cone.axis) / np.linalg.norm(cone.axis)
    for side in (seat.view.X_FC[:3, 0], seat.view.X_FC[:3, 1]):
        for sign in (-1.0, 1.0):
            turned = np.cos(share * cone.step) * seat.view.X_FC[:3, 2] + sign * np.sin(share * cone.step) * side
            if turned @ axis >= np.cos(cone.angle) - 1e-9 and share * cone.step >= np.radians(1):
                point = np.round(seat.spot.position + float(np.linalg.norm(at - seat.spot.position)) * turned, 6)
                yield replace(seat, view=_view(seat.view, seat.spot.position, point))


def _offsets(entry: MountEntry, share: float) -> Iterator[Array]:
    laid = entry.rail or entry.grid
    if laid is None:
        return
    way = np.array(laid.end) - np.array(laid.start)
    axes = [way / max(float(np.linalg.norm(way)), 1e-9)] if entry.rail else list(np.eye(3)[np.abs(way) > 0])
    for axis in axes:
        for sign in (-1.0, 1.0):
            yield sign * share * laid.step * axis


def _within(entry: MountEntry, position: Array) -> Array:
    """A position moved onto the rail or into the box of a mount."""
    laid = entry.rail or entry.grid
    if laid is None:
        return position
    low, high = np.minimum(laid.start, laid.end), np.maximum(laid.start, laid.end)
    return np.clip(position, low, high)


def _moved(seat: CameraSeat, position: Array) -> CameraSeat:
    """The camera elsewhere: it looks at the same point, or in the same direction."""
    spot = replace(seat.spot, name=f"{seat.spot.name}, moved", position=read_only(position))
    if seat.view.at is not None:
        view = _view(seat.view, position, seat.view.at)
    else:
        X_FC = seat.view.X_FC.copy()
        X_FC[:3, 3] = position
        view = replace(seat.view, X_FC=read_only(X_FC))
    name = seat.spot.name if seat.spot.name.endswith(", moved") else spot.name
    return replace(seat, spot=replace(spot, name=name), view=view)


def _view(view: View, eye: Array, point: Array) -> View:
    return replace(view, X_FC=read_only(looking_at(eye[None], point[None], view.up)[0]), at=point)
