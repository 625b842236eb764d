"""`place`: cameras on mounts, and the proof that no others are better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import inf
from typing import Literal

from sqrp_cli.document import LEFT_OUT, Pose, Record, WorkspaceDocument
from sqrp_cli.knowledge.text.entries import completed
from sqrp_cli.programming.advice.result import AdvisedFigures
from sqrp_cli.programming.advice.wish import Wish
from sqrp_cli.programming.placing import place
from sqrp_cli.programming.placing.problem import FewestPossible, Objective
from sqrp_cli.programming.placing.table import UnseenTarget

_COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


@dataclass(frozen=True, kw_only=True)
class CameraPlaced(Record):
    """A camera on a mount."""

    name: str
    """Its name in the patched workspace."""
    mount: str
    """The place, such as `ceiling 17`: the mount and the number of its place, from 1."""
    lens: str
    """Name of the camera with its lens."""
    pose: Pose
    """Of the optical frame in `frame`, 4x4."""
    frame: str
    """`world`, or the link that carries it."""
    look_at: tuple[float, float, float] | None
    """The point in the middle of its image, in `frame` [m]; null where the mount states an orientation."""
    moved: float
    """How far it is from that place, between places, which improves the exact figures [m]; 0 where nothing does."""
    price: float
    """Of the camera and of mounting it."""
    alone: float
    """The quality that counts, least or mean, with no other camera, and none that fails, in 0..1."""
    loss: float
    """By how much that quality falls if this camera is lost, and no other one."""

    @classmethod
    def of(cls, placed: place.PlacedCamera) -> CameraPlaced:
        """A camera as a record."""
        at = placed.place.view.at
        return completed(
            cls,
            placed,
            name=placed.camera.name,
            mount=placed.place.view.spot.name,
            lens=placed.place.lens.name,
            pose=placed.camera.X_FC.tolist(),
            frame=placed.camera.frame,
            look_at=None if at is None else (float(at[0]), float(at[1]), float(at[2])),
        )


@dataclass(frozen=True, kw_only=True)
class PlacedCandidate(AdvisedFigures):
    """A candidate with the cameras, in the way that was chosen for it: its exact figures."""

    task: str
    """As it was asked for."""
    candidate: str
    """Its name."""
    ranked: AdvisedFigures | None
    """The figures of the way that `rank` and `score` take in the patched workspace, if those are others."""

    @classmethod
    def of_candidate(cls, judged: place.JudgedCandidate) -> PlacedCandidate:
        """The figures of a candidate."""
        ranked = None if judged.ranked is None else AdvisedFigures.of(judged.ranked)
        return completed(cls, judged.found, task=judged.task, candidate=judged.candidate.name, ranked=ranked)


@dataclass(frozen=True, kw_only=True)
class InfeasibleCandidate(Record):
    """A candidate that cannot be done; it counts for nothing."""

    task: str
    """As it was asked for."""
    candidate: str
    """Its name."""
    reason: str
    """Why not."""


@dataclass(frozen=True, kw_only=True)
class Compared(Record):
    """What the proof is about."""

    mounts: int
    """Places."""
    in_the_way: int
    """How many of them cannot be used: a camera there would touch something."""
    options: int
    """Poses with lenses at them."""
    ways: int
    """Ways of candidates."""
    samples: int
    """Samples of these ways."""
    fastest: bool
    """Whether they are one way of each candidate: the fastest of all, or that with `--ways fastest`."""


@dataclass(frozen=True, kw_only=True, repr=False)
class PlaceDocument(WorkspaceDocument):
    """What `sqrp place` finds."""

    document: Literal["place"] = "place"
    tasks: Sequence[str]
    """As they were asked for."""
    mounts: int
    """Places for a camera to choose from."""
    want: Wish
    """What every candidate is to reach; null where anything will do."""
    met: bool
    """Whether the cameras are as they were wanted."""
    cameras: Sequence[CameraPlaced]
    """Those on mounts."""
    keep: Sequence[str]
    """Cameras of the workspace that stay."""
    survive: int
    """So many cameras may fail: only what is seen then still counts in `objective`, `bound` and `fewer`."""
    by: Objective
    """Which quality counts first: the least of all Q_eoi and Q_avg of all candidates, or their mean."""
    objective: float
    """That quality, exactly, of the cameras at their mounts, in 0..1."""
    bound: float
    """No choice of cameras and ways has more, as long as each camera that sees something between two samples sees it at
    one of them, too."""
    gap: float
    """Between both; 0 where they differ by less than 0.05 points: nothing better exists."""
    proven: bool
    """Whether nothing better exists in any aim, or that nothing meets `want`."""
    proof: str
    """The same in words."""
    too_slow: bool
    """Whether a candidate takes longer than `want` in all of its ways."""
    quickest: float
    """The shortest time until any camera shows a fault that it sees: its frame period and latency [s]."""
    delay_worst: float | None
    """The longest time until a fault of any candidate is noticed, from the exact figures [s]; null without faults, and
    where one may never be noticed."""
    unseen_faults: float | None
    """The largest share of times after which a fault may never be noticed, in 0..1; null without faults."""
    price: float
    """Of all cameras on mounts."""
    fewest: int | None
    """Fewer cameras than this do not meet `want`; null without one."""
    fewer: place.WithFewer | None
    """What one camera less could do; null if there cannot be fewer."""
    floor: FewestPossible | None
    """How many there have to be; null if any number will do."""
    reason: str
    """Why no cameras can be chosen at all; empty if some can."""
    without_spare: place.SpareCost | None
    """With `survive`: what would do if no camera could fail."""
    candidates: Sequence[PlacedCandidate]
    """The exact figures of each, those of `sqrp score` for the patched workspace unless `ranked` says others."""
    ways: Mapping[str, Mapping[str, float | str]]
    """Of each candidate, `TASK: NAME`, the parameters of the way that was chosen for it."""
    infeasible: Sequence[InfeasibleCandidate]
    """Candidates that cannot be done."""
    unseen: Sequence[UnseenTarget]
    """If nothing meets `want`: what no choice of mounts covers, of each candidate and literal the first instant."""
    compared: Compared
    """What the proof is about."""
    patch: str
    """A unified diff of the workspace file; empty if nothing is to be changed."""
    interrupted: bool | None = field(default=None, metadata=LEFT_OUT)
    """True if Ctrl-C came before the proof was complete."""


def placed(found: place.Solution, patch: str) -> PlaceDocument:
    """A placement as a document."""
    question, wanted = found.question, found.question.requirements
    delays = [one.found.latest for one in found.candidates if one.found.latest is not None]
    shares = [one.found.unseen for one in found.candidates if one.found.unseen is not None]
    return completed(
        PlaceDocument,
        found,
        workspace=question.cell.workspace.name,
        tasks=[task.text for task in question.tasks],
        mounts=len(question.mounts.spots),
        want=wanted.wish or Wish(),
        cameras=[CameraPlaced.of(camera) for camera in found.cameras],
        keep=list(question.keep),
        survive=wanted.failure_tolerance,
        by=wanted.objective,
        proof=_proof_in_words(found),
        delay_worst=None if inf in delays else max(delays, default=None),
        unseen_faults=max(shares, default=None),
        price=sum(camera.price for camera in found.cameras),
        floor=wanted.floor,
        reason=found.why,
        candidates=[PlacedCandidate.of_candidate(one) for one in found.candidates],
        ways={f"{one.task}: {one.candidate.name}": one.found.way.parameters for one in found.candidates},
        infeasible=[
            InfeasibleCandidate(task=task, candidate=one.candidate.name, reason=one.reasons[0])
            for task, one in found.infeasible
        ],
        compared=completed(Compared, found, mounts=len(question.mounts.spots), in_the_way=int(found.shut.sum())),
        patch=patch,
        interrupted=found.interrupted or None,
    )


def _proof_in_words(found: place.Solution) -> str:
    """What is proven, and about what, in a few sentences."""
    mounts = _mounts(len(found.question.mounts.spots))
    if found.why:
        return f"No camera can be chosen: {found.why}."
    if not found.cameras and not found.proven:
        return f"No choice of {mounts} was found, and that there is none is not proven."
    wanted, number = found.question.requirements, in_words(len(found.cameras))
    sentences = [_best(found, mounts)]
    if wanted.floor is not None and len(found.cameras) == wanted.floor.cameras:
        stay = ", with those that stay" if found.question.keep else ""
        sentences.append(f"Fewer than {number} cannot be{stay}: {wanted.floor.reason}.")
    elif wanted.wish is not None and found.met and found.fewest is not None and 1 < found.fewest == len(found.cameras):
        sentences.append(f"Fewer than {number} do not reach {wanted.wish} in {_scope(found)}.")
    if found.fewer is not None:
        fewer = in_words(found.fewer.cameras)
        sentences.append(f"With {fewer}, in {_scope(found)}, it is at most {_percent(found.fewer.bound)}.")
    return " ".join(sentences)


def _best(found: place.Solution, mounts: str) -> str:
    """How good the chosen cameras are, and that no others are better, or how much better they could be."""
    number, places = in_words(len(found.cameras)), len(found.question.mounts.spots)
    which = f"{found.question.requirements.objective} Q"
    quality, about = _percent(found.objective), _scope(found)
    decided = found.question.requirements.objective == "least" and found.objective == 0.0 and not found.interrupted
    mean = ", so that the mean decided" if decided and found.cameras else ""
    if found.gap > 0.0:
        return (
            f"The {which} is {quality}{mean}; no choice of {mounts} has more than {_percent(found.bound)} in {about}. "
            "Whether there is a better one is not proven."
        )
    if not found.cameras:
        return f"No camera on {mounts} adds to the {which} of {quality} in {about} (gap 0)."
    if places == 1:
        return f"A camera on the only mount gives a {which} of {quality} in {about} (gap 0)."
    best = f"None of {mounts} does" if number == "one" else f"No {number} of {mounts} do"
    rest = "" if found.proven else " Whether others that see as much are quicker or cheaper is not proven."
    return f"{best} better than a {which} of {quality} in {about} (gap 0){mean}.{rest}"


def _scope(found: place.Solution) -> str:
    if found.question.fastest:
        return "the way of each candidate with --ways fastest" if found.ways > 1 else "the way with --ways fastest"
    if found.fastest:
        return "the fastest of all ways of each candidate" if found.ways > 1 else "the fastest of all ways"
    return f"these {found.ways} ways"


def _mounts(count: int) -> str:
    return "the only mount" if count == 1 else f"these {count} mounts"


def unmet_in_words(found: PlaceDocument, wish: Wish | None) -> str:
    """That the wish cannot be met, and what is shown instead; empty if it is met, or nothing can be chosen at all."""
    if found.met or found.reason or wish is None:
        return ""
    if wish.delay is not None and wish.delay < found.quickest:
        return (
            f"No choice of these mounts reaches {wish}: a frame period and the latency of the fastest of these cameras "
            f"are {found.quickest:.4g} s at worst, and the time that tool and part take to part comes on top. The "
            "nearest is below."
        )
    if found.fewest:
        return f"So many cameras do not reach {wish}; {in_words(found.fewest)} do:"
    if found.too_slow:
        return f"Not every candidate can be done within {wish.time:.4g} s, whatever the cameras."
    if not found.proven:
        return f"No choice that reaches {wish} was found; that none does is not proven. The nearest is below."
    if wish.delay is not None:
        return f"No choice of these mounts reaches {wish}. The best whatever the delay is below."
    return f"No choice of these mounts reaches {wish}. The nearest is below."


def compared_in_words(found: PlaceDocument) -> str:
    """What was compared, in numbers."""
    one = found.compared
    way = f" ({one.in_the_way} in the way)" if one.in_the_way else ""
    return (
        f"{_count(one.mounts, 'mount')}{way}, {_count(one.options, 'pose')} with lenses, "
        f"{_count(one.ways, 'way')}, {_count(one.samples, 'sample')}"
    )


def moved_in_words(found: PlaceDocument) -> str:
    """By how much the chosen cameras were moved from their mounts; empty if they were not."""
    moved = ", ".join(f"{one.name} {100 * one.moved:.1f} cm" for one in found.cameras if one.moved)
    return (
        moved
        and f"The cameras were then moved between the places ({moved}), which the figures of the candidates are for."
    )


def ranked_in_words(found: PlaceDocument) -> str:
    """Which candidates `rank` does in another way in the patched workspace, with other figures; empty if none."""
    others = [
        f"{one.candidate} (Q_eoi {_percent_or_none(one.ranked.q_eoi)}, Q_avg {_percent_or_none(one.ranked.q_avg)})"
        for one in found.candidates
        if one.ranked is not None
    ]
    return f"In the patched workspace, `rank` takes another way of {', '.join(others)}." if others else ""


def scope_in_words(found: PlaceDocument) -> str:
    """What the proof is about, or why there is none."""
    if found.interrupted and found.proven:
        return "Interrupted once that was proven: no camera was moved between places, nor was one less looked at."
    if found.interrupted:
        return "Interrupted: the best so far." if found.cameras else "Interrupted: nothing was found yet."
    if found.reason:
        return ""
    if found.proven:
        return "The proof is about these mounts and ways; the figures are exact, between the samples, too."
    return "Not proven to be the best: the search ended before its proof."


def in_words(count: int) -> str:
    """A number as text, such as `two`."""
    return _COUNTS[count] if count < len(_COUNTS) else str(count)


def _percent(quality: float) -> str:
    return f"{100 * quality:.1f} %"


def _percent_or_none(quality: float | None) -> str:
    return "-" if quality is None else _percent(quality)


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
