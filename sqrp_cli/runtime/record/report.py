"""The report of a run: its outcome, its faults with their times, and which predictions came true."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

from pydantic import ConfigDict

PROCESSING = 0.02
"""Time to process an image [s]: measured, 15 ms for one of 640x480 pixels."""


TRUTH_SPACING = 0.002
"""When a fault has come true is known to this: a step of the physics [s]."""


def excess(fault: FaultRecord) -> float:
    """By how much a delay exceeds the longest that is predicted for it [s]; 0 where it does not, or none is known."""
    if fault.delay is None or fault.predicted_delay is None:
        return 0.0
    late = fault.delay - fault.predicted_delay
    return late if late > TRUTH_SPACING + 1e-9 else 0.0


Outcome = Literal["done", "stopped", "missed"]
"""Of a run: all steps were done; the robot stopped before; or all were done, but a fault that happened was never
noticed."""


class Stopped(Exception):  # noqa: N818
    """The run cannot go on; the message is the reason."""


class MonitoringLost(Stopped):
    """The run cannot go on because cameras or the process behind them fail.

    fault: the kind of fault in the reason. cameras: those in the reason.
    """

    def __init__(self, reason: str, fault: str, cameras: Collection[str]) -> None:
        super().__init__(reason)
        self.fault, self.cameras = fault, cameras


class _Recorded:
    """Of a report, whose fields the JSON Schema describes as they are described here."""

    __pydantic_config__ = ConfigDict(use_attribute_docstrings=True)


@dataclass
class FaultRecord(_Recorded):
    """A fault with its times on the run's clock [s]; None for what never happened."""

    name: str
    """As the skill calls it, or what was injected; of a violation that the skill lets pass, its formula."""
    injected: float | None = None
    """When it was injected [s]."""
    happened: float | None = None
    """When the fault's formula became true in the cell [s]."""
    detected: float | None = None
    """When the images showed it [s]; of a camera's fault, when the robot stopped for it."""
    acted: float | None = None
    """When the robot began to respond [s]: to try again, or to stop."""
    recovered: float | None = None
    """When the step was finally done [s]."""
    predicted_delay: float | None = None
    """From `happened` to `detected` as the program predicts it [s]."""
    moved_on: float | None = None
    """How long the robot then moved on, to where the condition of a retry can be seen [s]; None if it did not."""
    camera: str | None = None
    """The camera that failed, None for a fault of the step."""
    kind: str | None = None
    """What was injected, such as `miss-pick`; None if nothing was. Logs of earlier versions lack it."""

    @property
    def label(self) -> str:
        """For display: the name, after what was injected if that is called otherwise; and the camera that failed."""
        name = self.name if self.kind in (None, self.name) else f"{self.kind} ({self.name})"
        return name if self.camera is None else f"{name} {self.camera}"

    @property
    def delay(self) -> float | None:
        """Measured from `happened` to `detected` [s]."""
        if self.happened is None or self.detected is None:
            return None
        return self.detected - self.happened


@dataclass
class StepRecord(_Recorded):
    """A step as it was run; start and end on the run's clock [s]."""

    skill: str
    """Name of the skill."""
    parameters: Mapping[str, float | str]
    """Objects and motion parameters by name."""
    label: str
    """The skill with its objects."""
    start: float
    """When its first attempt began [s]."""
    end: float | None = None
    """When it was done [s]; None if the robot stopped before."""
    attempts: int = 1
    """How often it was tried, with the first time."""
    unseen: Mapping[str, float | None] = field(default_factory=dict)
    """Atoms that formulas require at the end of the motion but no image showed from then on: when one last did [s]."""


@dataclass
class Confusion(_Recorded):
    """How often a camera was predicted to see an atom (positive) and did (true), over its images."""

    tp: int = 0
    """Predicted, and did."""
    tn: int = 0
    """Not predicted, and did not."""
    fp: int = 0
    """Predicted, but did not."""
    fn: int = 0
    """Not predicted, but did."""

    def add(self, predicted: bool, detected: bool) -> None:
        """Count one image."""
        if predicted:
            self.tp, self.fp = self.tp + detected, self.fp + (not detected)
        else:
            self.tn, self.fn = self.tn + (not detected), self.fn + detected

    def __add__(self, other: Confusion) -> Confusion:
        return Confusion(self.tp + other.tp, self.tn + other.tn, self.fp + other.fp, self.fn + other.fn)

    @property
    def precision(self) -> float | None:
        """Share of the images predicted to show the atom that did; None if there is none."""
        predicted = self.tp + self.fp
        return self.tp / predicted if predicted else None


@dataclass(frozen=True)
class Disagreement(_Recorded):
    """An image in which a prediction was wrong."""

    step: int
    """Index of the step, from 0."""
    t: float
    """Of the step [s]."""
    atom: str
    """What was to be seen, such as `on(g2, tray)`."""
    camera: str
    """Name of the camera that took the image."""
    predicted: bool
    """Whether the camera was predicted to see the atom."""
    seen: str
    """The value from the image: `true`, `false` or `blind`."""
    true: bool
    """The value in the simulation; of a recording, the value as planned."""
    share: float
    """Of the boxes that could be judged in the image."""
    because: str
    """Why it was not seen if it was predicted to be: mask border, same colour behind, lighting or detector limit."""
    usual: bool = False
    """Whether it is a usual image: not predicted, but such images usually show it. Logs of earlier versions lack it."""


Prediction = dict[str, dict[str, Confusion]]
"""By atom and camera."""


def total_of(predictions: Iterable[Prediction]) -> Confusion:
    """The sum of the predictions of several steps."""
    return sum((found for step in predictions for cameras in step.values() for found in cameras.values()), Confusion())


@dataclass
class RunReport(_Recorded):
    """A whole run."""

    outcome: Outcome = "done"
    """Whether all steps were done, the robot stopped before, or it did not notice a fault."""
    reason: str | None = None
    """Why it stopped, or what was not noticed; None if it is done."""
    time: float = 0.0
    """Simulated [s]."""
    steps: list[StepRecord] = field(default_factory=list)
    """As they were run, in order; a step that was not begun is missing."""
    faults: list[FaultRecord] = field(default_factory=list)
    """Those that were injected or seen."""
    prediction: list[Prediction] = field(default_factory=list)
    """Per step, of its first attempt."""
    usual: list[Prediction] = field(default_factory=list)
    """Of the images that were not predicted to show an atom: whether such images usually do. Logs of earlier versions
    lack it."""
    disagreements: list[Disagreement] = field(default_factory=list)
    """Images in which a prediction was wrong."""
    conflicts: int = 0
    """How often cameras contradicted each other about an atom."""
    tracking: float | None = None
    """Distance of the tool from where it should have been [m], root mean square."""
    images: int = 0
    """How many images the cameras took."""
    wall: dict[str, float] = field(default_factory=dict)
    """Wall time by activity [s]."""
    stop_told: float | None = None
    """When the robot was last commanded to stop [s]."""
    stop_done: float | None = None
    """When it stood after that [s]."""

    @property
    def missed(self) -> list[FaultRecord]:
        """The faults that happened, but were never noticed."""
        return [fault for fault in self.faults if fault.happened is not None and fault.detected is None]

    @property
    def labels(self) -> list[str]:
        """For titles: what the steps do; of a dry run, which begins none, that it looks."""
        return [step.label for step in self.steps] or ["a look at the start"]

    def label_of(self, fault: FaultRecord) -> str:
        """For display: a fault's label, with the number of its step if there are several."""
        first = next((t for t in (fault.injected, fault.happened, fault.detected) if t is not None), 0.0)
        number = sum(step.start <= first for step in self.steps)
        return fault.label if len(self.steps) < 2 else f"{max(number, 1)}: {fault.label}"

    @property
    def total(self) -> Confusion:
        """Over all steps, atoms and cameras."""
        return total_of(self.prediction)
