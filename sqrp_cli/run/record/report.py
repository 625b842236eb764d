"""How runs went: the documents of `run` and `run --sweep`, which logs keep, and which predictions came true."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any, Literal

from sqrp_cli.document import LEFT_OUT, Record, WorkspaceDocument, how_many
from sqrp_cli.errors import SqrpError
from sqrp_cli.records import dataclass

PROCESSING = 0.02  # Time to process an image [s]: measured, 15 ms for one of 640x480 pixels
TRUTH_SPACING = 0.002  # When a fault has come true is known to this: a step of the physics [s]
Outcome = Literal["done", "stopped", "missed"]
"""Of a run: all steps were done; the robot stopped before; or all were done, but a fault that happened was never
noticed."""


class Stopped(SqrpError):  # noqa: N818
    """The run cannot go on; the message is the reason.

    fault: its kind where cameras or the processes behind them fail; cameras: those that do.
    """

    def __init__(self, reason: str, fault: str | None = None, cameras: Collection[str] = ()) -> None:
        super().__init__(reason)
        self.fault, self.cameras = fault, cameras


@dataclass
class FaultRecord(Record):
    """A fault with its times on the run's clock [s]; null for what never happened."""

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
    """How long the robot moved on, after `detected`, to where the condition of a retry can be seen [s]; null if it did
    not."""
    camera: str | None = None
    """The camera that failed; null for a fault of the step."""
    kind: str | None = None
    """What was injected, such as `miss-pick`; null if nothing was."""
    delay: float | None = None
    """From `happened` to `detected` [s]; of a fault of a run that has ended."""

    def __post_init__(self) -> None:
        """The delay follows from the times."""
        if self.happened is not None and self.detected is not None:
            self.delay = self.detected - self.happened
        else:
            self.delay = None

    @property
    def label(self) -> str:
        """For display: the name, after what was injected if that is called otherwise; and the camera that failed."""
        name = self.name if self.kind in (None, self.name) else f"{self.kind} ({self.name})"
        return name if self.camera is None else f"{name} {self.camera}"

    @property
    def excess(self) -> float:
        """By how much the delay exceeds the longest that is predicted [s]; 0 where it does not, or none is known."""
        late = 0.0 if self.delay is None or self.predicted_delay is None else self.delay - self.predicted_delay
        return late if late > TRUTH_SPACING + 1e-9 else 0.0


@dataclass
class StepRecord(Record):
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
    """When it was done [s]; null if the robot stopped before."""
    attempts: int = 1
    """How often it was tried, with the first time."""
    unseen: Mapping[str, float | None] = field(default_factory=dict)
    """Atoms that formulas require at the end of the motion but no image showed from then on: when one last did [s]."""
    says: Mapping[str, str] = field(default_factory=dict)
    """The facts in words, such as `the tool holds g2`, by atom."""


@dataclass
class Confusion(Record):
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
class Disagreement(Record):
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
    """Whether it is a usual image: not predicted, but such images usually show it."""


Prediction = dict[str, dict[str, Confusion]]  # By atom and camera


def total_of(predictions: Iterable[Prediction]) -> Confusion:
    """The sum of the predictions of several steps."""
    return sum((found for step in predictions for cameras in step.values() for found in cameras.values()), Confusion())


@dataclass(frozen=True)
class StopTimes(Record):
    """When the robot was last commanded to stop, and when it stood still [s]."""

    told: float | None = None
    """When the robot was last commanded to stop [s]; null if it never was."""
    standing: float | None = None
    """When it stood still after that [s]; null if it never was commanded to stop."""


@dataclass(frozen=True, repr=False)
class RunReport(WorkspaceDocument):
    """How a run went."""

    VIEW = "sqrp_cli.show.terminal.run_view:print_run"

    workspace: str = field(default="", kw_only=True)
    """Its name: that of its folder, or of its file if that is not `workspace.yaml`."""
    document: Literal["run"] = field(default="run", kw_only=True)
    outcome: Outcome = "done"
    """Whether all steps were done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    reason: str | None = None
    """Why it stopped, or what was not noticed; null if it is done."""
    time: float = 0.0
    """Simulated [s]."""
    steps: list[StepRecord] = field(default_factory=list)
    """As they were run, in order; a step that was not begun is missing."""
    faults: list[FaultRecord] = field(default_factory=list)
    """Those that were injected or seen."""
    prediction: list[Prediction] = field(default_factory=list)
    """Per step, of its first attempt, by literal and camera."""
    usual: list[Prediction] = field(default_factory=list)
    """Of the images that were not predicted to show a literal: usual images (`tp` + `fp`), of which `tp` showed it, and
    all others (`fn` + `tn`), of which `fn` did."""
    disagreements: list[Disagreement] = field(default_factory=list)
    """Images in which a prediction was wrong, usual images among them."""
    conflicts: int = 0
    """How often cameras contradicted each other about an atom."""
    tracking: float | None = None
    """Distance of the tool from where it should have been [m], root mean square."""
    images: int = 0
    """How many images the cameras took."""
    wall: dict[str, float] = field(default_factory=dict)
    """Where wall-clock time went [s]."""
    stop: StopTimes = StopTimes()
    """The last stop that was commanded."""

    @property
    def says(self) -> list[Mapping[str, str]]:
        """The facts of each step in words, by atom."""
        return [step.says for step in self.steps] + [{}] * (len(self.prediction) - len(self.steps))

    @property
    def done(self) -> bool:
        """Whether the program was completed."""
        return self.outcome == "done"

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        steps, faults = how_many(self.steps, "step"), how_many(self.faults, "fault")
        return f"{self.workspace}: {self.outcome} at {self.time:.2f} s, {steps}, {faults}, {self.images} images"

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


@dataclass(kw_only=True)
class SweptRun(FaultRecord):
    """A run of a sweep: what came of it, and of the slip that was injected."""

    x: float
    """When the fault was injected, in seconds of the step."""
    outcome: Outcome
    """Whether all steps were done, the robot stopped before, or a fault happened that was never noticed (`missed`)."""
    reason: str | None = None
    """Why it stopped, or what was not noticed; null if it is done."""
    time: float
    """Simulated [s]."""


@dataclass(frozen=True, kw_only=True, repr=False)
class SweepDocument(WorkspaceDocument):
    """What `sqrp run --sweep` finds: how the delays of slips compare with their predictions.

    What is predicted is the longest delay, whatever the phase of the cameras.
    """

    VIEW = "sqrp_cli.show.terminal.run_view:print_sweep"

    document: Literal["run --sweep"] = "run --sweep"
    sweep: str
    """What was swept, such as `slip@a4`."""
    step: int
    """Number of the step that was swept."""
    steps: list[str]
    """What each step of the program does."""
    count: int
    """How many runs were asked for."""
    tolerance: float
    """A delay that is shorter than its prediction by more counts as sooner [s]: a frame period of the slowest camera
    plus what it takes to look at an image."""
    predictable: int
    """Runs in which the fault came true and was predicted to be seen."""
    seen: int
    """Runs among them in which it was seen."""
    as_predicted: int
    """Runs among those in which it was seen within the longest delay predicted, by `tolerance` sooner at most."""
    sooner: int
    """Runs in which it was seen sooner than that, because images showed more than they were predicted to."""
    later: int
    """Runs in which it was seen later than predicted at worst, by more than a step of the physics (2 ms)."""
    runs: list[SweptRun]
    """In the order of `x`."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before all runs were finished."""

    @classmethod
    def of(cls, runs: Sequence[SweptRun], period: float, *, count: int, **asked: Any) -> SweepDocument:  # noqa: ANN401
        """The finished runs of a sweep, and their sums; period: of the slowest camera [s]. asked: the other fields."""
        pairs = [(run, run.delay, run.predicted_delay) for run in runs if run.happened is not None]
        able = [run for run, _, predicted in pairs if predicted is not None]
        lateness = [delay - best for _, delay, best in pairs if delay is not None and best is not None]
        sooner, later = (
            sum(late < -(period + PROCESSING) - 1e-9 for late in lateness),
            sum(run.excess > 0 for run in able),
        )
        return cls(
            **asked,
            count=count,
            tolerance=period + PROCESSING,
            predictable=len(able),
            seen=len(lateness),
            as_predicted=len(lateness) - sooner - later,
            sooner=sooner,
            later=later,
            runs=list(runs),
            interrupted=len(runs) < count or None,
        )

    @property
    def done(self) -> bool:
        """Whether all runs were completed."""
        return not self.interrupted and all(run.outcome == "done" for run in self.runs)

    @property
    def brief(self) -> str:
        """Its main figures, in a line."""
        done = sum(run.outcome == "done" for run in self.runs)
        cut = ", interrupted" if self.interrupted else ""
        return f"{self.sweep} in step {self.step}, {self.workspace}: {done} of {how_many(self.runs, 'run')} done{cut}"
