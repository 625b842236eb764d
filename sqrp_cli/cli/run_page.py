"""The page about a run: what the images showed, when, and what was done about it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sqrp_cli.cli.console import note
from sqrp_cli.cli.report_page import origin
from sqrp_cli.report.packing import packed
from sqrp_cli.report.page import Entry, PageContent, write_page
from sqrp_cli.runtime.outcome import Event, FaultRecord, RunReport


class EventRecorder:
    """Keeps what happens in a run."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def __call__(self, event: Event) -> None:
        """Keep it."""
        self.events.append(event)


def write_run(
    workspace: str,
    cameras: Sequence[str],
    report: RunReport,
    events: Sequence[Event],
    path: Path,
    arguments: Sequence[str],
) -> None:
    """Write the page about a run. arguments: of the command. Raises InputError where it cannot be written."""
    names = [
        " ".join((step.skill, *(str(v) for v in step.parameters.values() if isinstance(v, str))))
        for step in report.steps
    ]
    figures = [("simulated time", f"{report.time:.2f} s"), ("images", f"{report.images}")]
    if report.total.precision is not None:
        figures.append(("predicted to see, and did", f"{100 * report.total.precision:.1f} %"))
    for fault in report.faults:
        if fault.delay is not None:
            figures.append((f"{fault.name}: seen after", f"{fault.delay:.2f} s"))
        if fault.delay is not None and fault.predicted_delay is not None:
            figures.append(("predicted: within", f"{fault.predicted_delay:.2f} s"))
    watched = any(event.kind == "evidence" for event in events)
    entry = Entry(
        name=", ".join(names),
        mark=report.outcome,
        labels={"steps": len(names)},
        candidate=None,
        reasons=[] if report.reason is None else [report.reason],
        scene=None,
        detail=packed(_detail(cameras, report, events)) if watched else None,
        figures=figures,
    )
    title = f"A run in {workspace}"
    summary = f"{', '.join(names)}: {report.outcome} at {report.time:.2f} s. What follows is what the images showed."
    write_page(PageContent(title, summary, "Steps", origin(arguments), [entry], []), path)
    note(f"open {path} in a browser")


def _detail(cameras: Sequence[str], report: RunReport, events: Sequence[Event]) -> dict[str, Any]:
    """What the page reads of a motion, with what images showed in place of what was predicted."""
    starts = [event for event in events if event.kind == "primitive"]
    ends = [event.t for event in starts[1:]] + [report.time]
    return {
        "time": report.time,
        "still": {},
        "cameras": {name: {} for name in cameras},
        "primitives": [
            {"name": event.fields["name"], "start": event.t, "end": end}
            for event, end in zip(starts, ends, strict=True)
        ],
        "formulas": [],
        "targets": {},
        "marks": [{"label": fault.name, "spans": _spans(fault, report.time)} for fault in report.faults],
        "samples": [_sample(cameras, event) for event in events if event.kind == "evidence"],
    }


def _spans(fault: FaultRecord, end: float) -> list[dict[str, Any]]:
    """When a fault had happened and was not seen, and when it was seen and not yet made good."""
    spans = []
    if fault.happened is not None:
        seen = end if fault.detected is None else fault.detected
        spans.append({"start": fault.happened, "end": seen, "text": f"{fault.name} has happened and is not seen"})
    if fault.detected is not None:
        acted = end if fault.acted is None else fault.acted
        spans.append({"start": fault.detected, "end": acted, "text": f"{fault.name} is seen, the robot stops"})
    return spans


def _sample(cameras: Sequence[str], event: Event) -> dict[str, Any]:
    asked = {name: found for name, found in event.fields["literals"].items() if found["asked"]}
    return {
        "t": event.fields["exposed"],
        "q": {},
        "objects": {},
        "covered": all(found["value"] != "blind" for found in asked.values()) if asked else None,
        "literals": {name: _literal(cameras, found) for name, found in asked.items()},
    }


def _literal(cameras: Sequence[str], found: Mapping[str, Any]) -> dict[str, Any]:
    shown = {name: _verdict(found["cameras"].get(name, "blind")) for name in cameras}
    return {**_verdict(found["value"]), "boxes": [], "cameras": shown}


def _verdict(shown: str) -> dict[str, Any]:
    """What images show of an atom: `true`, `false`, or `blind` where they show nothing."""
    kind = "unseen" if shown == "blind" else f"shown_{shown}"
    return {"covered": shown != "blind", "kind": kind, "cause": None, "by": None}
