"""What a candidate asks for, over time: its primitive actions, formulas and targets, and when images show faults."""

from __future__ import annotations

from dataclasses import field

from sqrp_cli.camera.camera import Camera
from sqrp_cli.document import LEFT_OUT, Pose, Record
from sqrp_cli.files.entries import completed
from sqrp_cli.logic.image_time import Window
from sqrp_cli.records import dataclass
from sqrp_cli.sight.targets import SoughtBox
from sqrp_cli.study.assessment import Study
from sqrp_cli.task.pieces import GroundFormula


@dataclass(frozen=True, kw_only=True)
class Span(Record):
    """A primitive action and when it is done [s]."""

    name: str
    """As in the skill."""
    start: float
    """From the start of the motion [s]."""
    end: float
    """From the start of the motion [s]."""
    does: str | None = field(default=None, metadata=LEFT_OUT)
    """What it does, in a word or two."""


@dataclass(frozen=True, kw_only=True)
class Formula(Record):
    """A temporal operator with its interval [s]."""

    text: str
    """The operator with its body, about the objects of the candidate."""
    operator: str
    """`always` or `eventually`."""
    start: float
    """Start of the closed interval, from the start of the motion [s]."""
    end: float
    """Its end, from the start of the motion [s]."""
    literals: list[str]
    """What must be seen throughout the interval: literals of the body outside deeper temporal operators."""
    fault: str | None
    """The fault that the formula describes, if any."""

    @classmethod
    def of(cls, formula: GroundFormula) -> Formula:
        """An operator of a formula about a candidate."""
        literals = [str(literal) for literal in formula.operator.literals]
        return completed(cls, formula, formula.operator, literals=literals)


@dataclass(frozen=True, kw_only=True)
class CameraTiming(Record):
    """When a camera has images."""

    rate: float
    """Images per second [Hz]."""
    latency: float
    """From exposure to the image being available [s]."""

    @classmethod
    def of(cls, camera: Camera) -> CameraTiming:
        """When a camera has images; a latency that is not stated is the one that is assumed."""
        return cls(rate=camera.rate, latency=camera.lag)


@dataclass(frozen=True, kw_only=True)
class RecoveryTimes(Record):
    """Time to stop and move back to the start, from given instants; linear in between."""

    t: list[float]
    """Instants at which the robot is to stop, from the start of the motion [s]."""
    duration: list[float]
    """From each of them until the robot is back at the start [s]."""


@dataclass(frozen=True, kw_only=True)
class ExplainedBox(Record):
    """A box: where to look, and what for."""

    name: str
    """As in the skill."""
    detector: str
    """Name of the detector in the workspace that looks for it."""
    normal: tuple[float, ...] | None
    """Unit vector in the box's own axes, away from the surface."""
    encloses: tuple[str, ...]
    """What is transparent to this box."""
    min_visible: float
    """Least share of the box that must be seen, in 0..1, from its detector."""
    frame: str
    """What the box moves with: `world`, a link or an object; `OBJECT@start` stays where the object was at the start."""
    size: tuple[float, ...]
    """Full extents [m]."""
    pose: Pose
    """Of the box in `frame`."""

    @classmethod
    def of(cls, box: SoughtBox) -> ExplainedBox:
        """A box of a target."""
        return completed(cls, box, min_visible=box.limits.min_visible, pose=box.X_FB.tolist())


@dataclass(frozen=True, kw_only=True)
class TargetBoxes(Record):
    """What decides a literal."""

    k: int
    """Cameras that must each see all boxes."""
    boxes: list[ExplainedBox]
    """Where to look; all of them decide the literal together."""


@dataclass(frozen=True, kw_only=True)
class SightOnset(Record):
    """From when on images show a fault that happens at a time x, at points in order; linear in between."""

    x: list[float]
    """When it happens [s]."""
    shown: list[float]
    """From when on images surely show it [s]."""
    usual: list[float]
    """From when on they usually show it [s]."""


@dataclass(frozen=True, kw_only=True)
class FaultSight(Record):
    """When images show a fault."""

    windows: list[Window]
    """In which they show it; those of cameras of one rate and latency in order, apart from each other."""
    onsets: list[SightOnset]
    """Of each interval in which it may happen."""

    @classmethod
    def of(cls, study: Study, fault: str) -> FaultSight:
        """As a study found it."""
        return cls(
            windows=list(study.windows[fault]),
            onsets=[
                SightOnset(x=one.x.tolist(), shown=one.shown.tolist(), usual=one.as_usual.shown.tolist())
                for one in study.onsets[fault]
            ],
        )


def targets_of(study: Study) -> dict[str, TargetBoxes]:
    """What decides each literal of the formulas, by literal."""
    literals = dict.fromkeys(literal for formula in study.formulas for literal in formula.operator.literals)
    by_atom = {target.atom: target for target in study.targets}
    return {
        str(literal): TargetBoxes(
            k=by_atom[literal.atom].cameras, boxes=[ExplainedBox.of(box) for box in by_atom[literal.atom].boxes]
        )
        for literal in literals
    }
