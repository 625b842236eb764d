"""The score of a candidate explained in a sentence or two.

Which literal is lost when, by which camera, behind what, and what would help.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sqrp_cli.geometry import Indices, Mask
from sqrp_cli.logic.formula_time import Stretch
from sqrp_cli.logic.literal import Atom
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.blind_spans import by_name, first_failing
from sqrp_cli.programming.coverage.stage import Samples, states_of
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.sensing.observer import BoxVerdicts, sees_all
from sqrp_cli.programming.targets import Target

_LOOKS, _LOOKS_OF_SEVERAL = 5, 25
"""Samples of a blind stretch at which the causes are looked up; where several cameras are needed, each may see at some
of them."""

NOTHING_MISSING = "Every literal is covered all the time."
"""The verdict on a candidate without loss."""

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
    Cause.OUT_OF_IMAGE: "turn {camera} {turn} or widen its view",
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
        turn = {"top": "up", "bottom": "down"}.get(self.by or "", f"to the {self.by}")
        words = {"camera": self.camera, "by": self.by, "figure": figure, "target": atom, "shadow": shadow, "turn": turn}
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
    """Causes of all cameras that do not see it; the one nearest to seeing it comes first."""
    seeing: tuple[str, ...]
    """The cameras that see it."""
    needed: int
    """Number of cameras that must see it."""

    def __str__(self) -> str:
        when = Stretch(self.start, self.end).when
        if not self.causes:
            cameras = "1 camera that sees" if self.needed == 1 else f"{self.needed} cameras that see"
            there = f"{'is' if len(self.seeing) == 1 else 'are'} only {len(self.seeing)}"
            return f"{self.atom} needs {cameras} it, but there {there}, {when}"
        if self.needed > 1:
            # No single camera is to blame, and each may see the target for a while.
            seen = f"; {', '.join(self.seeing)} {'sees' if len(self.seeing) == 1 else 'see'} it" if self.seeing else ""
            return f"Fewer than {self.needed} cameras see {self.atom} {when} ({_listed(self.causes)}{seen})"
        nearest, *others = self.causes
        sentence = f"{nearest.sentence(_SENTENCES, self.atom)} {when}"
        return f"{sentence}, and no other camera makes up for it ({_listed(others)})" if others else sentence

    @property
    def advice(self) -> str:
        """What would help."""
        if not self.causes:
            return "add a camera"
        return self.causes[0].sentence(_ADVICE, self.atom)


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
    return [
        _sentences(study, None if rows is None else next(explained))
        for study, rows in zip(studies, longest, strict=True)
    ]


def _sentences(study: Study, stretch: BlindStretch | None) -> str:
    ways = ", ".join(study.motion.ways_around)
    return _on_coverage(study, stretch) + (f" On the way {ways}." if ways else "")


def _on_coverage(study: Study, stretch: BlindStretch | None) -> str:
    if stretch is None:
        return NOTHING_MISSING
    skill = study.candidate.skill
    stated = any(not parameter.implicit for parameter in skill.motion_parameters)
    tried = study.candidate.branch or not (skill.waypoints or stated)
    return f"{stretch}{HELP}{stretch.advice.removesuffix(_OTHER_WAY) if tried else stretch.advice}."


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
    found = _look(cell, lost)
    parts = iter(_look(cell, [(look.study, look.longest_loss(cell)) for look in found if not look.is_lost.all()]))
    return [(look if look.is_lost.all() else next(parts)).stretch(cell) for look in found]


def _look(cell: Cell, lost: Sequence[tuple[Study, Indices]]) -> list[_WorstLoss]:
    """The literal that is lost in most of a few samples of each run, by verdicts on all runs at once."""
    if not lost:
        return []
    looks = [_CauseLook.of(study, rows) for study, rows in lost]
    states = states_of([study.stage for study, _ in lost], [look.samples for look in looks])
    first = np.cumsum([0, *(len(look.samples) for look in looks)]).tolist()
    rows = [np.arange(*ends) for look, ends in zip(looks, pairwise(first), strict=True) for _ in look.targets]
    targets = [target for look in looks for target in look.targets]
    matrices = iter(cell.observer.verdicts(targets, states, rows=rows, shares=False))
    return [look.worst([next(matrices) for _ in look.targets]) for look in looks]


@dataclass(frozen=True, eq=False)
class _CauseLook:
    """A look at a few samples of a stretch that is not covered."""

    study: Study
    """Whose stretch it is."""
    rows: Indices
    """All samples of the stretch."""
    samples: Samples
    """m of them."""
    targets: tuple[Target, ...]
    """Those that are not covered in some of the samples."""
    uncovered: Mask
    """Which of them is required and not covered in which sample, shape (m, targets)."""

    @classmethod
    def of(cls, study: Study, rows: Indices) -> _CauseLook:
        """A look at some of the samples `rows`."""
        timeline, samples = study.timeline, study.timeline.samples
        looks = _LOOKS_OF_SEVERAL if any(target.cameras > 1 for target in study.targets) else _LOOKS
        chosen = rows[np.unique(np.linspace(0, len(rows) - 1, looks).round().astype(np.int64))]
        uncovered = timeline.observation.required[chosen] & ~timeline.observation.covered[chosen]
        columns = np.flatnonzero(uncovered.any(axis=0))
        return cls(
            study=study,
            rows=rows,
            samples=samples.some(chosen),
            targets=tuple(study.targets[column] for column in columns.tolist()),
            uncovered=uncovered[:, columns],
        )

    def worst(self, matrices: Sequence[tuple[BoxVerdicts, ...]]) -> _WorstLoss:
        """The target that is lost in most of the samples, by the verdicts on each target in them."""
        lost = [
            uncovered & _is_lost(target, boxes)
            for uncovered, target, boxes in zip(self.uncovered.T, self.targets, matrices, strict=True)
        ]
        most = int(np.sum(lost, axis=1).argmax())
        return _WorstLoss(self.study, self.rows, self.targets[most], matrices[most], lost[most])


def _is_lost(target: Target, boxes: Sequence[BoxVerdicts]) -> Mask:
    """The samples in which fewer cameras than needed see the target, shape (m,)."""
    seeing: Indices = sees_all(boxes).sum(axis=1)
    return seeing < target.cameras


@dataclass(frozen=True, eq=False)
class _WorstLoss:
    """The target that is lost in most of a few samples of a stretch that is not covered."""

    study: Study
    """Whose stretch it is."""
    rows: Indices
    """All samples of the stretch."""
    target: Target
    boxes: tuple[BoxVerdicts, ...]
    """The verdicts on its boxes in the few samples."""
    is_lost: Mask
    """In which of these it is lost, shape (m,)."""

    def longest_loss(self, cell: Cell) -> Indices:
        """The samples of the longest part of the stretch in which the target is required and lost."""
        timeline, rows = self.study.timeline, self.rows
        samples = timeline.samples.some(rows)
        every = np.arange(len(rows))
        states = states_of([self.study.stage], [samples])
        (boxes,) = cell.observer.verdicts([self.target], states, rows=[every], shares=False)
        column = self.study.targets.index(self.target)
        parts = stretches(timeline.observation.required[rows, column] & _is_lost(self.target, boxes))
        return rows[max(parts, key=lambda part: samples.t[part[-1]] - samples.t[part[0]])]

    def stretch(self, cell: Cell) -> BlindStretch:
        """What the verdicts say about the stretch."""
        causes = tuple(_camera_causes(cell, self.boxes, np.flatnonzero(self.is_lost)))
        blind = {cause.camera for cause in causes}
        t = self.study.timeline.samples.t
        return BlindStretch(
            start=float(t[self.rows[0]]),
            end=float(t[self.rows[-1]]),
            atom=self.target.atom,
            causes=causes,
            seeing=tuple(camera.name for camera in cell.observer.cameras if camera.name not in blind),
            needed=self.target.cameras,
        )


def _camera_causes(cell: Cell, boxes: Sequence[BoxVerdicts], rows: Indices) -> Sequence[CameraCause]:
    """The commonest cause of each camera that does not see all boxes.

    Cameras that fail all the time come first, and among them those that fail at the latest check.
    """
    found = []
    columns = (values.T.tolist() for values in first_failing(boxes, rows)[:3])
    for camera, *of_camera in zip(cell.observer.cameras, *columns, strict=True):
        figures: dict[tuple[int, int], list[float]] = defaultdict(list)
        for code, by, figure in zip(*of_camera, strict=True):
            if code != Cause.NONE:
                figures[code, by].append(figure)
        if figures:
            (code, by), missed = max(figures.items(), key=lambda kind: len(kind[1]))
            cause, partly = Cause(code), sum(map(len, figures.values())) < len(rows)
            name = by_name(cell, cause, by)
            found.append(
                CameraCause(camera=camera.name, cause=cause, by=name, figure=float(np.mean(missed)), partly=partly)
            )
    return sorted(found, key=lambda camera_cause: (camera_cause.partly, -camera_cause.cause))
