"""The score of a candidate explained in a sentence or two.

Which literal is lost when, by which camera, behind what, who sees it before and after, and what would help.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np

from sqrp_cli.geometry import Array, Indices, Mask, axis_rotation, box_corners, inverse, pose, transform
from sqrp_cli.knowledge.camera.camera import Camera
from sqrp_cli.knowledge.camera.projection import Projection
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.blind_spans import by_name, first_failing
from sqrp_cli.programming.coverage.stage import states_of
from sqrp_cli.programming.result import NOTHING_MISSING
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts, sees_all
from sqrp_cli.programming.targets import Target

_LOOKS, _LOOKS_OF_SEVERAL = 5, 25
"""Samples of a blind stretch at which the causes are looked up; where several cameras are needed, each may see at some
of them."""

_MOST_TURN, _TURNS = 30, 3
"""By how much a camera may be turned to close a gap [deg], and how many cameras are tried, the least turn first."""


HELP = ". It would help to "
"""Separates the sentence about the loss from the one about the remedy."""

_SENTENCES = {
    Cause.BEHIND: "{camera} looks away from {target}",
    Cause.TOO_NEAR: "{camera} is {figure} too near to {target}",
    Cause.TOO_FAR: "{camera} is {figure} too far from {target}",
    Cause.OUT_OF_IMAGE: "{camera} has {target} outside its image ({by})",
    Cause.DETECTOR_NEAR: "{camera} is {figure} too near to {target} for its detector",
    Cause.DETECTOR_FAR: "{camera} is {figure} too far from {target} for its detector",
    Cause.OBLIQUE: "{camera} sees {target} {figure} too obliquely",
    Cause.TOO_SMALL: "{camera} sees {target} {figure} too small",
    Cause.HIDDEN: "{camera} cannot see {target} behind {by}",
    Cause.SAME_COLOUR: "{camera} cannot tell {target} from {by} of the same colour behind it",
    Cause.TOO_DARK: "{target} is too dark for {camera}{shadow}",
    Cause.TOO_BRIGHT: "{target} is too bright for {camera} in the light of {by}",
}

_ADVICE = {
    Cause.BEHIND: "turn {camera} round, or say `convention: body`",
    Cause.TOO_NEAR: "move {camera} {figure} back",
    Cause.TOO_FAR: "move {camera} {figure} closer or raise its far range",
    Cause.OUT_OF_IMAGE: "turn {camera} {side} or widen its view",
    Cause.DETECTOR_NEAR: "move {camera} {figure} back",
    Cause.DETECTOR_FAR: "move {camera} {figure} closer",
    Cause.OBLIQUE: "move {camera} round to face it",
    Cause.TOO_SMALL: "move {camera} closer or narrow its view",
    Cause.HIDDEN: "move {camera} to where {by} is not in its way, or try another approach",
    Cause.SAME_COLOUR: "move {camera} to where {by} is not behind it, or give {by} another colour",
    Cause.TOO_DARK: "raise the gain of {camera} or add light from where nothing shades {target}",
    Cause.TOO_BRIGHT: "lower the gain of {camera} or dim {by}",
}

_OTHER_WAY = ", or try another approach"
"""What is left out where all ways were tried already, and where a skill goes nowhere in more ways than one."""


@dataclass(frozen=True)
class Turn:
    """A turn of a camera about its lens, whole degrees in all."""

    up: float
    """[deg]; negative: down."""
    right: float
    """[deg]; negative: left."""

    @property
    def angle(self) -> float:
        """The angle in all [deg]."""
        return float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(self.rotation) - 1.0), -1.0, 1.0))))

    @property
    def rotation(self) -> Array:
        """The turned optical frame in the one before: first to the right, then up; shape (3, 3)."""
        return axis_rotation(1, np.radians(self.right)) @ axis_rotation(0, np.radians(self.up))

    def __str__(self) -> str:
        sides = ((self.right, "to the right", "to the left"), (self.up, "up", "down"))
        words = [back if value < 0 else forth for value, forth, back in sides if abs(value) > 0.1 * self.angle]
        return f"{self.angle:.0f} deg {' and '.join(words)}"


@dataclass(frozen=True)
class CameraCause:
    """Why a camera does not see a target over a stretch: its commonest first failing limit."""

    camera: str
    """Its name."""
    cause: Cause
    """The limit."""
    by: str | None
    """The occluder, what has the same colour behind it, what shades it or the light on it, or the side of the image."""
    figure: float
    """Mean amount by which the limit is missed, in the limit's unit."""
    partly: bool
    """Whether the camera sees the target for a part of the stretch."""
    turn: Turn | None = None
    """With which it would see the target in every sample of the stretch that was looked at, where that is known."""

    def sentence(self, templates: dict[Cause, str], atom: Atom) -> str:
        """One of the sentences above about this camera."""
        match self.cause:
            case Cause.OBLIQUE:
                figure = f"{np.degrees(self.figure):.0f} deg"
            case Cause.TOO_SMALL:
                figure = f"{self.figure:.0f} px"
            case _:
                figure = f"{self.figure:.2f} m"
        shadow = f", in the shadow of {self.by}" if self.by else ""
        side = {"top": "up", "bottom": "down"}.get(self.by or "", f"to the {self.by}")
        words = {"camera": self.camera, "by": self.by, "figure": figure, "target": atom, "shadow": shadow, "side": side}
        return templates[self.cause].format_map(words)

    @property
    def words(self) -> str:
        """The cause in a few words."""
        words = f"behind {self.by}" if self.cause is Cause.HIDDEN else self.cause.words
        if self.cause in (Cause.SAME_COLOUR, Cause.TOO_DARK, Cause.TOO_BRIGHT):
            words = self.cause.by(self.by)
        return f"{words} for a part of that time" if self.partly else words


@dataclass(frozen=True)
class BlindStretch:
    """A stretch of time in which a state is not covered."""

    start: float
    """First uncovered sample [s]."""
    end: float
    """Last uncovered sample [s]."""
    atom: Atom
    """One whose target is not covered."""
    causes: tuple[CameraCause, ...]
    """Causes of all cameras that do not see it; the one for which the least change closes the gap comes first."""
    seeing: tuple[str, ...]
    """The cameras that see it."""
    needed: int
    """Number of cameras that must see it."""
    before: tuple[str, ...] = ()
    """The cameras that see it right before."""
    after: tuple[str, ...] = ()
    """The cameras that see it right after."""

    def __str__(self) -> str:
        when = Stretch(self.start, self.end).when
        if not self.causes:
            cameras = "1 camera that sees" if self.needed == 1 else f"{self.needed} cameras that see"
            there = f"{'is' if len(self.seeing) == 1 else 'are'} only {len(self.seeing)}"
            return f"{self.atom} needs {cameras} it, but there {there}, {when}"
        if self.needed > 1:
            # No single camera is to blame, and each may see the target for a while.
            seen = f"; {', '.join(self.seeing)} {_see(self.seeing)} it" if self.seeing else ""
            return f"Fewer than {self.needed} cameras see {self.atom} {when} ({_listed(self.causes)}{seen})"
        nearest, *others = self.causes
        sentence = f"{nearest.sentence(_SENTENCES, self.atom)} {when}"
        if not others:
            return sentence
        return f"{sentence}, and no other camera makes up for it ({_listed(others)}){self._around}"

    @property
    def _around(self) -> str:
        """Who sees it before and after the stretch, in words."""
        both = self.before == self.after
        times = [(self.before, "before and after")] if both else [(self.before, "before"), (self.after, "after")]
        said = [f"{', '.join(names)} {_see(names)} it {word}" for names, word in times if names]
        return f"; {', '.join(said)}" if said else ""

    @property
    def advice(self) -> str:
        """What would help."""
        if not self.causes:
            return "add a camera"
        nearest = self.causes[0]
        if nearest.turn is None:
            return nearest.sentence(_ADVICE, self.atom)
        wider = " or widen its view" if nearest.cause is Cause.OUT_OF_IMAGE else ""
        return f"turn {nearest.camera} {nearest.turn}{wider}"


def _see(cameras: Sequence[str]) -> str:
    return "sees" if len(cameras) == 1 else "see"


def _listed(causes: Sequence[CameraCause]) -> str:
    """Cameras grouped by their causes."""
    groups: dict[str, list[str]] = defaultdict(list)
    for cause in causes:
        groups[cause.words].append(cause.camera)
    return "; ".join(f"{', '.join(cameras)}: {words}" for words, cameras in groups.items())


def verdict(cell: Cell, study: Study) -> str:
    """One or two sentences about a feasible candidate: the longest stretch that is not covered, and what would help.

    Stretches within the events of interest come first. Moves that go around something are named at the end.
    """
    return verdicts(cell, [study])[0]


def verdicts(cell: Cell, studies: Sequence[Study]) -> list[str]:
    """As `verdict` of each of several candidates, which is faster together."""
    longest = list(map(_longest_loss, studies))
    lost = [(study, rows) for study, rows in zip(studies, longest, strict=True) if rows is not None]
    explained = iter(explain_stretches(cell, lost))
    found = []
    for study, rows in zip(studies, longest, strict=True):
        sentences = NOTHING_MISSING
        if rows is not None:
            stretch, skill = next(explained), study.candidate.skill
            stated = any(not parameter.implicit for parameter in skill.motion_parameters)
            tried = study.candidate.branch or not (skill.waypoints or stated)
            advice = stretch.advice.removesuffix(_OTHER_WAY) if tried else stretch.advice
            sentences = f"{stretch}{HELP}{advice}."
        ways = ", ".join(study.motion.remarks)
        found.append(sentences + (f" On the way {ways}." if ways else ""))
    return found


def _longest_loss(study: Study) -> Indices | None:
    """The samples of the longest stretch that is not covered; None if there is none."""
    timeline = study.timeline
    blind = timeline.monitored & ~timeline.covered
    interesting = blind & timeline.interesting
    t = timeline.samples.t
    candidates = list(stretches(interesting if interesting.any() else blind))
    return max(candidates, key=lambda rows: t[rows[-1]] - t[rows[0]]) if candidates else None


def stretches(blind: Mask) -> Iterator[Indices]:
    """Runs of neighbouring samples for which `blind` holds; pieces that share an instant are neighbours."""
    rows = np.flatnonzero(blind)
    yield from (run for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(run))


def explain_stretches(cell: Cell, lost: Sequence[tuple[Study, Indices]]) -> list[BlindStretch]:
    """The lost literal in each run of uncovered samples, and why; of several literals, that lost in most of a few.

    Where that one is lost for a part of the run only, the stretch is the longest such part.
    """
    found = _worst_losses(cell, lost)
    parts = iter(_worst_losses(cell, [(loss.study, loss.longest_part(cell)) for loss in found if not loss.lost.all()]))
    return [(loss if loss.lost.all() else next(parts)).stretch(cell) for loss in found]


def _worst_losses(cell: Cell, runs: Sequence[tuple[Study, Indices]]) -> list[_Loss]:
    """The literal that is lost in most of a few samples of each run, by verdicts on all runs at once."""
    if not runs:
        return []
    losses = []
    for number, (study, rows) in enumerate(runs):
        count = _LOOKS_OF_SEVERAL if any(target.cameras > 1 for target in study.targets) else _LOOKS
        few = rows[np.unique(np.linspace(0, len(rows) - 1, count).round().astype(np.int64))]
        uncovered = study.timeline.observation.required & ~study.timeline.observation.covered
        for column in np.flatnonzero(uncovered[few].any(axis=0)).tolist():
            others = np.flatnonzero(~uncovered[:, column])
            before, after = others[others < few[0]][-1:], others[others > few[-1]][:1]
            look = np.concatenate([before, few, after])
            losses.append(_Loss(number, study, rows, column, look, np.isin(look, few)))
    sampled = [loss.study.timeline.samples.some(loss.look) for loss in losses]
    states = states_of([loss.study.stage for loss in losses], sampled)
    ends = np.cumsum([0, *map(len, sampled)]).tolist()
    places = [np.arange(*pair) for pair in pairwise(ends)]
    matrices = cell.observer.verdicts([loss.target for loss in losses], states, rows=places, shares=False)
    seen = [replace(loss, boxes=boxes) for loss, boxes in zip(losses, matrices, strict=True)]
    return [max(of_run, key=lambda loss: loss.lost.sum()) for _, of_run in groupby(seen, key=lambda loss: loss.run)]


@dataclass(frozen=True, eq=False)
class _Loss:
    """A target that is not covered in a run of samples, looked at in a few of them."""

    run: int
    """Number of the run."""
    study: Study
    """Whose run it is."""
    rows: Indices
    """All samples of the run."""
    column: int
    """Index of the target."""
    look: Indices
    """The few samples, and those beside them in which the target is covered or not required, shape (m,)."""
    few: Mask
    """Which of these are in the run, shape (m,)."""
    boxes: tuple[BoxVerdicts, ...] = ()
    """The verdicts on its boxes in these samples."""

    @property
    def target(self) -> Target:
        """The target."""
        return self.study.targets[self.column]

    @property
    def lost(self) -> Mask:
        """In which of the few samples the target is required, and fewer cameras than needed see it."""
        required = self.study.timeline.observation.required[self.look, self.column]
        lost: Mask = required & (sees_all(self.boxes).sum(axis=1) < self.target.cameras)
        return lost[self.few]

    def longest_part(self, cell: Cell) -> Indices:
        """The samples of the longest part of the run in which the target is required and lost."""
        timeline, rows = self.study.timeline, self.rows
        samples = timeline.samples.some(rows)
        states = states_of([self.study.stage], [samples])
        (boxes,) = cell.observer.verdicts([self.target], states, shares=False)
        lost = sees_all(boxes).sum(axis=1) < self.target.cameras
        parts = stretches(timeline.observation.required[rows, self.column] & lost)
        return rows[max(parts, key=lambda part: samples.t[part[-1]] - samples.t[part[0]])]

    def stretch(self, cell: Cell) -> BlindStretch:
        """What the verdicts say about the run."""
        names = [camera.name for camera in cell.observer.cameras]
        sees = sees_all(self.boxes) & self.study.timeline.observation.required[self.look, self.column][:, None]
        start, end = np.flatnonzero(self.few)[[0, -1]].tolist()
        before, after = (
            tuple(name for name, seen in zip(names, rows.any(axis=0), strict=True) if seen)
            for rows in (sees[:start], sees[end + 1 :])
        )
        rows = np.flatnonzero(self.few)[self.lost]
        causes = []
        columns = (values.T.tolist() for values in first_failing(self.boxes, rows)[:3])
        for name, *of_camera in zip(names, *columns, strict=True):
            figures: dict[tuple[int, int], list[float]] = defaultdict(list)
            for code, by, figure in zip(*of_camera, strict=True):
                if code != Cause.NONE:
                    figures[code, by].append(figure)
            if figures:
                (code, by), missed = max(figures.items(), key=lambda kind: len(kind[1]))
                partly = sum(map(len, figures.values())) < len(rows)
                cause, culprit = Cause(code), by_name(cell, Cause(code), by)
                causes.append(CameraCause(name, cause, culprit, float(np.mean(missed)), partly))
        outside = {cause.camera for cause in causes if cause.cause in (Cause.BEHIND, Cause.OUT_OF_IMAGE)}
        turns = self._least_turn(cell, [camera for camera in cell.observer.cameras if camera.name in outside])
        # A turn that closes the gap is the least change; else one who sees it before or after is nearest to seeing it.
        causes = sorted(
            (replace(cause, turn=turns.get(cause.camera)) for cause in causes),
            key=lambda one: (one.turn is None, one.partly, one.camera not in (*before, *after), -one.cause),
        )
        blind = {cause.camera for cause in causes}
        t = self.study.timeline.samples.t
        return BlindStretch(
            start=float(t[self.rows[0]]),
            end=float(t[self.rows[-1]]),
            atom=self.target.atom,
            causes=tuple(causes),
            seeing=tuple(name for name in names if name not in blind),
            needed=self.target.cameras,
            before=before,
            after=after,
        )

    def _least_turn(self, cell: Cell, cameras: Sequence[Camera]) -> dict[str, Turn]:
        """Of some cameras, the one that sees all the lost samples after the least turn; empty if none does.

        The turn brings the corners of all boxes within the image; whether it then shows them is asked of the observer.
        """
        rows = self.look[self.few][self.lost]
        states = states_of([self.study.stage], [self.study.timeline.samples.some(rows)])
        corners = [transform(states.box_poses(box), box_corners(box.size)) for box in self.target.boxes]
        corners_W = np.concatenate([np.broadcast_to(of_box, (len(rows), 8, 3)) for of_box in corners], axis=1)
        turns = []
        for camera in cameras:
            x, y, z = np.moveaxis(transform(inverse(states.camera_poses(camera)), corners_W), -1, 0)
            right, left, top, bottom = _reaches(Projection.of(camera))
            aside = np.arctan2(x, z)
            pan = max(aside.max() - right, 0.0) or min(aside.min() + left, 0.0)
            above = np.arctan2(-y, np.hypot(x, z) * np.cos(aside - pan))
            tilt = max(above.max() - top, 0.0) or min(above.min() + bottom, 0.0)
            least = Turn(*np.degrees([tilt, pan]))
            if 0.0 < least.angle <= _MOST_TURN:
                whole = np.ceil(least.angle) / least.angle  # nobody turns a camera by less than a degree
                turns.append((camera, Turn(whole * least.up, whole * least.right)))
        turns = sorted(turns, key=lambda turn: turn[1].angle)[:_TURNS]
        if not turns:
            return {}
        moved = tuple(replace(camera, X_FC=camera.X_FC @ pose(turn.rotation)) for camera, turn in turns)
        (found,) = replace(cell.observer, cameras=moved, memory=None).verdicts([self.target], states, shares=False)
        closes: list[bool] = np.all(sees_all(found), axis=0).tolist()
        return next(({camera.name: turn} for (camera, turn), sees in zip(turns, closes, strict=True) if sees), {})


def _reaches(projection: Projection) -> list[float]:
    """How far the image reaches from the optical axis to the right, left, top and bottom, to half a degree [rad]."""
    angles = np.radians(np.arange(0.0, 90.0, 0.5))
    sides = np.array([(1, 0), (-1, 0), (0, -1), (0, 1)])
    rays = np.dstack([sides[:, :1] * np.sin(angles), sides[:, 1:] * np.sin(angles), np.tile(np.cos(angles), (4, 1))])
    return [float(angles[max(row.sum() - 1, 0)]) for row in np.minimum.accumulate(projection.shows(rays), axis=1)]
