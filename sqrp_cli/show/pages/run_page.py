"""The page about a run: what really happened in the simulated cell, and what the images showed when."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.logic.truth import TruthWord
from sqrp_cli.run.record.events import BETWEEN, AskedBox, Event
from sqrp_cli.run.record.log import Track
from sqrp_cli.run.record.report import RunReport
from sqrp_cli.show.documents.explanation import Span
from sqrp_cli.show.pages.assembly import FigureShown, PageContent, PageRow, packed, write_page
from sqrp_cli.show.pages.candidate_page import cell_scene, origin

WITNESSED = (
    "The robot and the objects move here as they really did in the simulation. The monitors do not know that: they"
    " judge by images alone. Frames are where monitors looked for something; their colours, and those of the lines to"
    " the cameras, say what the images taken at that time showed."
)
"""What is shown in three dimensions, in words."""
_TRUE = "predicted images that showed it"


def write_run(
    began: Event,
    report: RunReport,
    events: Sequence[Event],
    path: Path,
    arguments: Sequence[str],
    workspace: Workspace | None = None,
    why_flat: str = "",
) -> None:
    """Write the page about a run. arguments: of the command. Raises InputError where it cannot be written.

    began: how a log of it begins. workspace: None if its files are not at hand. why_flat: why there is no playback in
    three dimensions, if so.
    """
    from sqrp_cli.motion.cell import Cell

    names, track = ", ".join(report.labels), Track.of(events)
    why_flat = why_flat if track is not None else "this log does not say where everything was"
    scenes = [] if workspace is None or track is None else [cell_scene(Cell.load(workspace))]
    figures, noted = list[FigureShown](), []
    for fault in report.faults:
        if fault.delay is not None:
            figures.append((f"{report.label_of(fault)} noticed after", f"{fault.delay:.2f} s", "it was noticed after"))
            if fault.predicted_delay is not None:
                figures.append(("predicted: at the latest", f"{fault.predicted_delay:.2f} s", "predicted"))
        noted += [t for t in (fault.happened, fault.detected, fault.injected) if t is not None][:1]
    if report.total.precision is not None:
        figures.append((_TRUE, f"{100 * report.total.precision:.1f} %", _TRUE))
    figures.append(("images", f"{report.images}", ""))
    figures.append(("simulated time", f"{report.time:.2f} s", ""))
    detail = None
    if scenes or any(event.event == "evidence" for event in events):
        detail = packed(_detail(began.cameras, report, events, track if scenes else None, why_flat))
    reasons, scene = [] if report.reason is None else [report.reason], 0 if scenes else None
    entry = PageRow(names, report.outcome, {"steps": names}, None, reasons, scene, detail, figures=figures)
    title = f"{names} in {began.workspace}: {report.outcome}"
    about = [*origin(arguments), ("workspace", began.workspace), ("digest", began.digest)]
    opens_at = min(noted, default=0.0 if report.done else report.time)
    content = PageContent(title, story(report), "Steps", about, [entry], scenes, of_images=True, opens_at=opens_at)
    write_page(content, path)


def story(report: RunReport) -> str:
    """What happened, in one sentence: when each fault was, when it was seen, retries and the outcome."""
    told = [] if report.faults else ["no fault"]
    for fault in report.faults:
        label = report.label_of(fault)
        if fault.happened is not None:
            seen = "never noticed" if fault.delay is None else f"noticed after {fault.delay:.2f} s"
            told.append(f"{label} at {fault.happened:.2f} s, {seen}")
        elif fault.detected is not None:
            told.append(f"{label} noticed at {fault.detected:.2f} s")
        else:
            told.append(f"{label} injected, but it never came true")
    retries = sum(step.attempts - 1 for step in report.steps)
    told += [] if not retries else ["tried again" if retries == 1 else f"tried again {retries} times"]
    sentence = ", ".join([*told, f"{report.outcome} at {report.time:.2f} s"])
    return f"{sentence[0].upper()}{sentence[1:]}."


def _detail(
    cameras: Sequence[str], report: RunReport, events: Sequence[Event], track: Track | None, why_flat: str
) -> Mapping[str, object]:
    """The playback of a run: the fields of a candidate's, with what images showed, and when faults were not noticed."""
    marks, end = [], report.time
    for fault in report.faults:
        label, spans = report.label_of(fault), []
        for kind, start, until, what in (
            ("unnoticed", fault.happened, fault.detected, "has happened and is not noticed"),
            ("handled", fault.detected, fault.acted, "is noticed, the robot stops and looks"),
        ):
            if start is not None:
                text = f"{label} {what}"
                spans.append({"kind": kind, "start": start, "end": end if until is None else until, "text": text})
        marks += [{"label": label, "spans": spans}] if spans else []
    # The primitives, and in words what the robot does between them.
    begun = [event for event in events if event.event == "primitive" or event.event in BETWEEN]
    doings = []
    for event, until in zip(begun, [*(one.t for one in begun), end][1:], strict=True):
        is_own = event.event == "primitive"
        named = {"name": event.name, "does": event.does} if is_own else {"name": BETWEEN[event.event]}
        doings += [Span(**named, start=event.t, end=until)] if until > event.t else []
    # What the images of each time showed. The last ones count for as long as any before them, then none.
    seen = {event.exposed: event for event in events if event.event == "evidence"}
    times = sorted(seen)
    longest = max((after - t for t, after in pairwise(times)), default=end)
    over = min(end, times[-1] + longest) if times else 0.0
    return {
        "of_images": True,  # tells a run from a candidate
        "time": end,
        "still": {},
        "cameras": {name: {} for name in cameras},
        "primitives": doings,
        "formulas": [],
        "says": {atom: words for step in report.steps for atom, words in step.says.items()},
        "targets": {} if track is None else _targets(events, end),
        "marks": marks,
        "moments": _moments(report, events),
        "note": WITNESSED if track is not None else f"There is no playback in three dimensions: {why_flat}.",
        "samples": [*(_sample(cameras, seen[t]) for t in times), {"t": over, "covered": None, "literals": {}}],
        "track": None if track is None else track_shown(track),
    }


def track_shown(track: Track) -> Mapping[str, object]:
    """Where everything is at some instants; of an object only the poses that change, each after its index."""
    return {
        "t": track.t.tolist(),
        "joints": list(track.joints),
        "q": track.q.tolist(),
        "held": list(track.held),
        "objects": {name: [[index, *pose] for index, pose in poses] for name, poses in track.poses.items()},
    }


def _targets(events: Sequence[Event], end: float) -> dict[str, dict[str, list[Mapping[str, object]]]]:
    """The boxes of each atom, with the times `from` and `to` between which they count: each attempt has its own."""
    starts = [event for event in events if event.event == "step"]
    ends = [*(event.t for event in starts), end + 1.0][1:]
    spans: dict[str, list[tuple[AskedBox, float, float]]] = {}
    for event, until in zip(starts, ends, strict=True):
        for atom, boxes in event.boxes.items():
            own = spans.setdefault(atom, [])
            for box in boxes:
                index = next((i for i, (old, _, to) in enumerate(own) if old == box and to == event.t), len(own))
                since = own[index][1] if index < len(own) else event.t
                own[index : index + 1] = [(box, since, until)]
    return {
        atom: {"boxes": [{**box.model_dump(), "from": since, "to": until} for box, since, until in own]}
        for atom, own in spans.items()
    }


def _moments(report: RunReport, events: Sequence[Event]) -> list[Mapping[str, object]]:
    """Times worth a look, with what happens then."""
    happens: dict[float, list[str]] = defaultdict(list)
    for fault in report.faults:
        injected, label = fault.injected if fault.happened is None else None, report.label_of(fault)
        for t, what in (injected, "is injected"), (fault.happened, "happens"), (fault.detected, "is seen"):
            if t is not None:
                happens[round(t, 6)].append(f"{label} {what}")
    words = {kind: f"the robot {BETWEEN[kind]}" for kind in ("moving on", "stopping")}
    words |= {"contact": "the tool feels contact", "retry": "the robot tries again"}
    for event in events:
        if event.event in words:
            happens[event.t].append(words[event.event])
    for t in sorted({fault.recovered for fault in report.faults if fault.recovered is not None}):
        happens[round(t, 6)].append("the step is done")
    return [{"t": t, "text": ", ".join(texts)} for t, texts in sorted(happens.items())]


def _sample(cameras: Sequence[str], event: Event) -> Mapping[str, object]:
    """What the images of a time showed of the required literals; it counts until the next ones."""

    def shown(value: TruthWord, blind: str) -> dict[str, object]:
        """What images show of an atom; blind: the kind where they show nothing. They do not say why."""
        covered = value != "blind"
        kind = f"shown_{value}" if covered else blind
        return {"covered": covered, "kind": kind, "cause": None, "by": None}

    required = {name: found for name, found in event.literals.items() if found.asked}
    known = all(found.value != "blind" for found in required.values())
    literals = {
        atom: {
            **shown(found.value, "unseen"),
            "boxes": [],  # images count for all boxes together
            "cameras": {name: shown(found.cameras.get(name, "blind"), "nothing") for name in cameras},
            "really": found.true,
        }
        for atom, found in required.items()
    }
    kind = "known" if known else "unknown"
    return {"t": event.exposed, "covered": known if required else None, "kind": kind, "literals": literals}
