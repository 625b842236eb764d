"""The score of a candidate explained in a sentence or two: what no camera sees when, why, and what would help."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import acos, cos, degrees, radians
from typing import NamedTuple

import numpy as np

from sqrp_cli.camera.camera import Camera
from sqrp_cli.camera.projection import Projection
from sqrp_cli.geometry import Array, Indices, Mask, axis_rotation, box_corners, inverse, pose, transform
from sqrp_cli.kernel.kernel import BoxVerdicts
from sqrp_cli.logic.formula_time import TimeInterval
from sqrp_cli.logic.literal import Atom
from sqrp_cli.motion.cell import Cell
from sqrp_cli.records import dataclass
from sqrp_cli.sight.limits import Cause, Reason
from sqrp_cli.sight.observer import first_failing, sees_all
from sqrp_cli.sight.scene_states import SceneStates
from sqrp_cli.sight.targets import Target
from sqrp_cli.skill.target_box import fact_words
from sqrp_cli.study.result import NOTHING_MISSING, CandidateResult
from sqrp_cli.study.timeline import Timeline

_LOOKS, _LOOKS_OF_SEVERAL = 5, 25
"""Samples of a blind stretch at which the causes are looked up; where several cameras are needed, each may see at some
of them."""

_MOST_TURN, _MOST_SHIFT, _TRIED = 30, 1.0, 3
"""By how much a camera may be turned [deg] or moved [m] to close a gap, and how many are tried, the least first."""

_ADVICE = {
    Cause.BEHIND: "turn camera `{camera}` round, or say `convention: body`",
    Cause.TOO_NEAR: "move camera `{camera}` back",
    Cause.TOO_FAR: "move camera `{camera}` closer or raise its far range",
    Cause.OUT_OF_IMAGE: "",  # no turn that is tried shows all of it
    Cause.DETECTOR_NEAR: "move camera `{camera}` back",
    Cause.DETECTOR_FAR: "move camera `{camera}` closer",
    Cause.OBLIQUE: "move camera `{camera}` round to face it",
    Cause.TOO_SMALL: "move camera `{camera}` closer or narrow its view",
    Cause.HIDDEN: "move camera `{camera}` to where `{by}` is not in its way, or try another approach",
    Cause.SAME_COLOUR: "move camera `{camera}` to where `{by}` is not behind it, or give `{by}` another colour",
    Cause.TOO_DARK: "raise the gain of camera `{camera}` or add light from where nothing shades it",
    Cause.TOO_BRIGHT: "lower the gain of camera `{camera}` or dim `{by}`",
}

_CHANGED = frozenset(
    (Cause.BEHIND, Cause.OUT_OF_IMAGE, Cause.TOO_NEAR, Cause.TOO_FAR, Cause.DETECTOR_NEAR, Cause.DETECTOR_FAR)
)
"""The limits for which changes of a camera are tried: turns for the first two, moves for the others."""
_OTHER_WAY = ", or try another approach"
"""What is left out where all ways were tried already, and where a skill goes nowhere in more ways than one."""


@dataclass(frozen=True)
class CameraChange:
    """A turn of a camera about its lens, or a move along its optical axis."""

    up: float = 0.0  # [deg]; negative: down
    right: float = 0.0  # [deg]; negative: left. First it turns to the right, then up, by whole degrees in all.
    back: float = 0.0  # Whole centimetres [m]; negative: closer

    @property
    def angle(self) -> float:
        """The angle of the turn in all [deg]."""
        up, right = cos(radians(self.up)), cos(radians(self.right))
        return degrees(acos(min(max(0.5 * (up + right + up * right - 1.0), -1.0), 1.0)))  # of the rotation's trace

    def __str__(self) -> str:
        if self.back:
            return f"moving camera `{{}}` {100 * abs(self.back):.0f} cm {'back' if self.back > 0 else 'closer'}"
        sides = ((self.right, "to the right", "to the left"), (self.up, "up", "down"))
        words = [back if value < 0 else forth for value, forth, back in sides if abs(value) > 0.1 * self.angle]
        return f"turning camera `{{}}` {self.angle:.0f} deg {' and '.join(words)}"


@dataclass(frozen=True, kw_only=True)
class CameraCause(Reason):
    """Why a camera does not see a target over a stretch: its commonest first failing limit."""

    camera: str
    """Its name."""
    figure: float
    """Mean amount by which the limit is missed, in the limit's unit."""
    partly: bool
    """Whether the camera sees the target for a part of the stretch."""
    change: CameraChange | None = None
    """With which enough cameras see the target wherever it is not covered in the stretch, if one was found."""

    def __str__(self) -> str:
        """The camera and the cause: "camera `left`: above its image"."""
        match self.limit:
            case Cause.OBLIQUE:
                figure = f"{np.degrees(self.figure):.0f} deg"
            case Cause.TOO_SMALL:
                figure = f"{self.figure:.0f} px"
            case _:
                figure = f"{self.figure:.2f} m"
        return f"camera `{self.camera}`: {self.limit.by(self.by, figure)}{' for a part of it' * self.partly}"


@dataclass(frozen=True)
class BlindSpot:
    """A stretch of time in which a state is not covered."""

    start: float  # First uncovered sample [s]
    end: float  # Last uncovered sample [s]
    atom: Atom  # One whose target is not covered
    fact: str  # The atom in words
    causes: tuple[CameraCause, ...]
    """Causes of all cameras that do not see it; the one for which the least change closes the gap comes first."""
    needed: int  # Number of cameras that must see it

    def __str__(self) -> str:
        """When no camera sees it, and why not the one that comes nearest; where several have to, all that do not."""
        when = TimeInterval(self.start, self.end).when
        who = "no camera sees" if self.needed == 1 else f"fewer than {self.needed} cameras see"
        shown = self.causes[: 1 if self.needed == 1 else None]
        why = "; ".join(map(str, shown)) or ("there is none" if self.needed == 1 else "there are no more")
        return f"{when[0].upper()}{when[1:]} {who} whether {self.fact} ({why})"

    @property
    def remedy(self) -> str:
        """What would or may help, as the end of a sentence; empty where nothing is known to."""
        if not self.causes:
            return "it may help to add a camera"
        nearest = self.causes[0]
        if nearest.change is not None:  # it was tried
            return f"{str(nearest.change).format(nearest.camera)} would help"
        advice = _ADVICE[nearest.limit].format(camera=nearest.camera, by=nearest.by)
        return advice and f"it may help to {advice}"


def with_verdict(cell: Cell, seen: Timeline, result: CandidateResult) -> CandidateResult:
    """A feasible result with its verdict: its longest blind spot, and what would help.

    Moves that go around something are named at the end.
    """
    blind_spot, remedy, candidate = NOTHING_MISSING, "", seen.planned.candidate
    motion = seen.planned.motion
    remarks = [candidate.skill.in_pieces(one) for one in motion.remarks]
    if (stretch := longest_blind_spot(cell, seen)) is not None:
        stated = any(not parameter.implicit for parameter in candidate.skill.motion_parameters)
        may_vary = candidate.skill.recorded is None and (candidate.skill.waypoints or stated)
        all_tried = candidate.branch or not may_vary
        blind_spot = str(stretch)
        remedy = stretch.remedy.removesuffix(_OTHER_WAY) if all_tried else stretch.remedy
    doubts, way = remarks[: len(motion.doubts)], remarks[len(motion.doubts) :]
    sentences = ("; ".join(filter(None, (blind_spot, remedy))), *doubts, way and f"On the way {', '.join(way)}")
    return replace(
        result,
        verdict=" ".join(f"{one[:1].upper()}{one[1:]}." for one in sentences if one),
        blind_spot=blind_spot,
        remedy=remedy,
    )


def longest_blind_spot(cell: Cell, seen: Timeline) -> BlindSpot | None:
    """The longest stretch that is not covered, if any is; stretches within the events of interest come first."""
    t, blind = seen.samples.t, seen.observation.blind
    of_interest = blind & seen.of_interest
    runs = list(stretches(of_interest if of_interest.any() else blind))
    return explain_blind_spot(cell, seen, max(runs, key=lambda rows: t[rows[-1]] - t[rows[0]])) if runs else None


def stretches(blind: Mask) -> Iterator[Indices]:
    """Runs of neighbouring samples for which `blind` holds; pieces that share an instant are neighbours."""
    rows = np.flatnonzero(blind)
    yield from (run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run))


def explain_blind_spot(cell: Cell, timeline: Timeline, rows: Indices) -> BlindSpot:
    """Which literal is not covered in a run of uncovered samples, and why; of several, that in most of a few samples.

    Where that one is uncovered for a part of the run only, the blind spot is the longest such part.
    """
    worst, planned = _worst_uncovered(cell, timeline, rows), timeline.planned
    if not worst.uncovered.all():
        samples, target = timeline.samples.some(rows), worst.target
        (boxes,) = cell.observer.verdicts([target], planned.stage.states(samples), shares=False, culprits=False)
        uncovered = sees_all(boxes).sum(axis=1) < target.cameras
        parts = stretches(timeline.observation.required[rows, worst.column] & uncovered)
        rows = rows[max(parts, key=lambda part: samples.t[part[-1]] - samples.t[part[0]])]
        worst = _worst_uncovered(cell, timeline, rows)
    names = [camera.name for camera in cell.observer.cameras]
    sees = sees_all(worst.boxes) & timeline.observation.required[worst.look, worst.column][:, None]
    start, end = np.flatnonzero(worst.few)[[0, -1]].tolist()
    beside = sees[:start].any(axis=0) | sees[end + 1 :].any(axis=0)  # which cameras see it right before or after
    # Why each camera does not see the uncovered target, if it does not: its commonest first failing limit.
    looked = np.flatnonzero(worst.few)[worst.uncovered]
    first, _ = first_failing(worst.boxes, looked)
    causes = []
    for index, name in enumerate(names):
        missed: dict[tuple[int, int], list[float]] = defaultdict(list)
        columns = (values[:, index].tolist() for values in (first.cause, first.by, first.figure))
        for code, by, figure in zip(*columns, strict=True):
            if code != Cause.NONE:
                missed[code, by].append(figure)
        if missed:
            (code, by), figures = max(missed.items(), key=lambda kind: len(kind[1]))
            cause, partly = Cause(code), sum(map(len, missed.values())) < len(looked)
            label, who, missing = cause.label, cell.observer.by_name(cause, by), float(np.mean(figures))
            causes.append(CameraCause(camera=name, cause=label, by=who, figure=missing, partly=partly))
    changed = _least_change(cell, timeline, worst, rows, causes)
    # A change that closes the gap comes first; else one who sees it before or after is nearest to seeing it.
    causes = sorted(
        (replace(cause, change=changed.get(cause.camera)) for cause in causes),
        key=lambda one: (one.change is None, one.partly, not beside[names.index(one.camera)], -one.limit),
    )
    return BlindSpot(
        start=float(timeline.samples.t[rows[0]]),
        end=float(timeline.samples.t[rows[-1]]),
        atom=worst.target.atom,
        fact=fact_words(str(worst.target.atom), worst.target.boxes, cell.workspace.objects),
        causes=tuple(causes),
        needed=worst.target.cameras,
    )


class _UncoveredTarget(NamedTuple):
    """A target that is not covered in a run of samples, looked at in a few of them."""

    column: int  # Index of the target
    target: Target
    look: Indices  # The few samples, and those beside them in which the target is covered or not required, shape (m,)
    few: Mask  # Which of these are in the run, shape (m,)
    boxes: tuple[BoxVerdicts, ...]  # The verdicts on the target's boxes in these samples
    uncovered: Mask  # In which of the few the target is required, and fewer cameras than needed see it


def _worst_uncovered(cell: Cell, timeline: Timeline, rows: Indices) -> _UncoveredTarget:
    """The target that is uncovered in most of a few samples of a run."""
    planned = timeline.planned
    count = _LOOKS_OF_SEVERAL if any(target.cameras > 1 for target in planned.targets) else _LOOKS
    few = rows[sorted({*np.linspace(0, len(rows) - 1, count).round().astype(np.int64).tolist()})]
    seen = timeline.observation
    found = []
    for column in np.flatnonzero(seen.uncovered[few].any(axis=0)).tolist():
        others, target = np.flatnonzero(~seen.uncovered[:, column]), planned.targets[column]
        look = np.concatenate([others[others < few[0]][-1:], few, others[others > few[-1]][:1]])
        states = planned.stage.states(timeline.samples.some(look))
        (boxes,) = cell.observer.verdicts([target], states, shares=False)
        uncovered = seen.required[look, column] & (sees_all(boxes).sum(axis=1) < target.cameras)
        inside = np.isin(look, few)
        found.append(_UncoveredTarget(column, target, look, inside, boxes, uncovered[inside]))
    return max(found, key=lambda worst: worst.uncovered.sum())


def _least_change(
    cell: Cell, timeline: Timeline, worst: _UncoveredTarget, rows: Indices, causes: Sequence[CameraCause]
) -> dict[str, CameraChange]:
    """The camera with the least turn, else the least move along its axis, that closes a gap; empty if none does.

    Whether enough cameras then see the target is asked of the observer, in all samples of the run `rows` in which too
    few do.
    """
    target, limits = worst.target, {cause.camera: cause.limit for cause in causes}
    if not _CHANGED.intersection(limits.values()):
        return {}
    seen = timeline.observation
    rows = rows[seen.uncovered[rows, worst.column]]
    states = timeline.planned.stage.states(timeline.samples.some(rows))
    others = dict.fromkeys(limits, np.zeros(len(rows), dtype=np.int64))
    uncovered = np.ones(len(rows), dtype=bool)
    if target.cameras > 1:
        (present,) = cell.observer.verdicts([target], states, shares=False, culprits=False)
        sees = sees_all(present)
        uncovered = sees.sum(axis=1) < target.cameras
        for number, camera in enumerate(cell.observer.cameras):
            others[camera.name] = sees.sum(axis=1) - sees[:, number]
    items = np.arange(len(rows)), np.zeros(len(rows), dtype=np.int64)
    changes = _changes(cell.observer.projections, limits, target, states, uncovered)
    for camera, change in sorted(changes, key=lambda one: (abs(one[1].back), one[1].angle))[:_TRIED]:
        missing = target.cameras - others[camera.name]
        turn = axis_rotation(1, np.radians(change.right)) @ axis_rotation(0, np.radians(change.up))
        X_FD = camera.X_FC @ pose(turn, np.array([0.0, 0.0, -change.back]))
        ((then,),) = cell.observer.seen_from([camera], X_FD[None], [target], states, *items, decisive=missing > 0)
        if bool(np.all(then >= missing)):
            return {camera.name: change}
    return {}


def _changes(
    projections: Sequence[Projection], limits: Mapping[str, Cause], target: Target, states: SceneStates, uncovered: Mask
) -> Iterator[tuple[Camera, CameraChange]]:
    """Least changes of cameras by the limits that they miss: what may let each see a target in the states `uncovered`.

    A turn brings the corners of all boxes within the image, a move brings them within the range.
    """
    poses = [np.broadcast_to(states.box_poses(box), (len(uncovered), 4, 4))[uncovered] for box in target.boxes]
    corners = [transform(X, box_corners(box.size)) for X, box in zip(poses, target.boxes, strict=True)]
    every = np.concatenate(corners, axis=1)
    cameras = [one.camera for one in projections if limits.get(one.camera.name) in _CHANGED]
    X_WC = {camera.name: states.camera_poses(camera) for camera in cameras}
    X_CW = {name: inverse(X if len(X) == 1 else X[uncovered]) for name, X in X_WC.items()}  # shape (m or 1, 4, 4) each

    def beyond(seen: Array, upper: Array, lower: Array) -> Array:
        """By how much angles are beyond those that each camera shows, shape (c, 1, 1) [rad]."""
        over, under = seen.max(axis=(1, 2), keepdims=True) - upper, seen.min(axis=(1, 2), keepdims=True) + lower
        least: Array = np.where(over > 0.0, over, np.minimum(under, 0.0))
        return least

    turned = [one for one in projections if limits.get(one.camera.name) in (Cause.BEHIND, Cause.OUT_OF_IMAGE)]
    if turned:
        # All cameras at once, as a cell may have dozens.
        x, y, z = np.moveaxis(np.array([transform(X_CW[one.camera.name], every) for one in turned]), -1, 0)
        right, left, top, bottom = np.array([one.view_angles for one in turned]).T[..., None, None]
        sideways = np.arctan2(x, z)
        pan = beyond(sideways, right, left)
        tilt = beyond(np.arctan2(-y, np.hypot(x, z) * np.cos(sideways - pan)), top, bottom)
        for one, up, aside in zip(turned, np.degrees(tilt).ravel(), np.degrees(pan).ravel(), strict=True):
            least = CameraChange(float(up), float(aside))
            if 0.0 < least.angle <= _MOST_TURN:
                whole = np.ceil(least.angle) / least.angle  # nobody turns a camera by less than a degree
                yield one.camera, CameraChange(float(whole * least.up), float(whole * least.right))
    for camera in cameras:
        if limits[camera.name] not in (Cause.BEHIND, Cause.OUT_OF_IMAGE):
            z = transform(X_CW[camera.name], every)[..., 2]
            back, closer = camera.near - z.min(), z.max() - camera.far
            for X, box in zip(poses, target.boxes, strict=True):
                x, y, depth = np.moveaxis(transform(X_CW[camera.name], X[:, None, :3, 3])[:, 0], -1, 0)
                near, far = (np.sqrt(np.maximum(edge**2 - x**2 - y**2, 0.0)) - depth for edge in box.limits.distance)
                back, closer = max(back, near.max()), max(closer, -far.min())
            move = np.ceil(100 * back - 1e-6) if back > 0 else -np.ceil(100 * closer - 1e-6)
            if 0.0 < abs(move) <= 100 * _MOST_SHIFT:
                yield camera, CameraChange(back=float(move / 100))
