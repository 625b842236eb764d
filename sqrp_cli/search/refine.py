"""From sites on a grid to places between them: chosen cameras are moved and turned as far as their mounts allow."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from sqrp_cli.geometry import Array, Mask, read_only
from sqrp_cli.search.aiming import looking_at
from sqrp_cli.search.sites import Installation, blocked, hidden_by, pairs_apart, seen_by
from sqrp_cli.search.visibility_table import VisibilityTable

Pair = tuple[float | None, float | None]  # q_eoi and Q_avg of a way, in 0..1; None where undefined
_FINEST = 0.005  # moves are not tried in smaller steps than this [m]; aims not in less than a degree

_HALVINGS = 4  # how often the step is halved, at most


def refined(
    table: VisibilityTable,
    places: Sequence[Installation],
    numbers: Sequence[int],
    value: Callable[[Sequence[Pair]], tuple[float, float]],
) -> tuple[Installation, ...]:
    """The cameras, each moved and turned as long as what they see at the samples is worth more.

    numbers: of the ways. value: what Q_eoi and Q_avg of each way are worth, what counts first before the rest. Cameras
    that stay see with them; none touches or hides another one, and none of those.
    """
    cell, ways = table.question.cell, [table.ways[number] for number in numbers]
    best = [*places, *(table.options[option] for option in table.kept)]
    seen = [[seen_by(cell, way, [place])[0] for way in ways] for place in places]
    seen += [[table.sees[number][option] for number in numbers] for option in table.kept]

    def worth(each: Sequence[Sequence[Mask]]) -> tuple[float, float]:
        pairs: list[Pair] = []
        for number, way in enumerate(ways):
            scene, sample, state = way.scene, way.items.sample, np.any(way.required, axis=1)
            covered = sum(of_camera[number].astype(np.int64) for of_camera in each) >= way.needed
            state[sample[~covered]] = False
            steps = np.where(state[1:] & state[:-1], way.samples.steps, 0.0)
            interesting = steps[scene.stage.of_interest(way.samples)[:-1]]
            parts = ((interesting, scene.T_eoi), (steps, scene.T))
            q_eoi, q_avg = (float(part.sum() / total) if total > 0 else None for part, total in parts)
            pairs.append((q_eoi, q_avg))
        first, rest = value(pairs)
        return round(first, 6), round(rest, 6)

    def is_clear(place: Installation, rest: Sequence[Installation]) -> bool:
        spot = place.spot
        apart = not any(True for other in rest for _ in pairs_apart([spot, other.spot]))
        return apart and not any(blocked(cell, way.swept, [spot])[0] for way in ways)

    present = worth(seen)
    for halving in range(1, _HALVINGS + 1):
        for number, place in enumerate(best[: len(places)]):
            rest = best[:number] + best[number + 1 :]
            tried = [one for one in _around(place, 0.5**halving) if is_clear(one, rest)]
            if present >= (1.0, 1.0) or not tried:
                continue
            each = list(zip(*(seen_by(cell, way, tried) for way in ways), strict=True))
            gains = [worth([*seen[:number], one, *seen[number + 1 :]]) for one in each]
            first = max(range(len(tried)), key=gains.__getitem__)
            if gains[first] > present:
                best[number], seen[number], present = tried[first], list(each[first]), gains[first]
    for one, other in permutations(range(len(best)), 2):
        for way, sees in zip(ways, seen[other], strict=True):
            moved = min(one, other) < len(places)
            if moved and (hidden_by(way, best[one].spot, best[other].spot) & sees).any():
                return tuple(places)
    return tuple(best[: len(places)])


def _around(place: Installation, share: float) -> Iterator[Installation]:
    """The camera a share of a step away along its mount, and turned by a share of a step of its cone."""
    spot, entry = place.spot, place.spot.entry
    laid = entry.rail or entry.grid
    if laid is not None:
        start, end = np.array(laid.start), np.array(laid.end)
        way = end - start
        axes = [way / max(float(np.linalg.norm(way)), 1e-9)] if entry.rail else list(np.eye(3)[np.abs(way) > 0])
        for offset in (sign * share * laid.step * axis for axis in axes for sign in (-1.0, 1.0)):
            inside = np.clip(spot.position + offset, np.minimum(start, end), np.maximum(start, end))
            position = np.round(inside, 3) + 0.0
            if np.abs(position - spot.position).max() >= _FINEST:
                name = f"{spot.name.removesuffix(', moved')}, moved"
                yield _looking(replace(place, spot=replace(spot, name=name, position=read_only(position))), place.at)
    cone = None if entry.aims is None else entry.aims.cone
    if cone is None or place.at is None or share * cone.step < np.radians(1):
        return
    axis, forward = np.array(cone.axis) / np.linalg.norm(cone.axis), place.X_FC[:3, 2]
    for side in (place.X_FC[:3, 0], place.X_FC[:3, 1]):
        for sign in (-1.0, 1.0):
            turned = np.cos(share * cone.step) * forward + sign * np.sin(share * cone.step) * side
            if turned @ axis >= np.cos(cone.angle) - 1e-9:
                point = np.round(spot.position + float(np.linalg.norm(place.at - spot.position)) * turned, 6)
                yield _looking(place, point)


def _looking(place: Installation, point: Array | None) -> Installation:
    """The camera turned to a point, or in the same direction where there is none."""
    eye, X_FC = place.spot.position, place.X_FC.copy()
    if point is not None:
        return replace(place, X_FC=read_only(looking_at(eye[None], point[None], place.up)[0]), at=point)
    X_FC[:3, 3] = eye
    return replace(place, X_FC=read_only(X_FC))
