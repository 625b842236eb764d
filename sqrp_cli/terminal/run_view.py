"""Runs in the terminal: a live view while they happen, then tables."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any

from sqrp_cli.logic.truth import Truth
from sqrp_cli.program.record import Program
from sqrp_cli.report.sentences import short_times
from sqrp_cli.runtime.record import events
from sqrp_cli.runtime.record.report import Confusion, Disagreement, FaultRecord, Prediction, RunReport, excess, total_of
from sqrp_cli.terminal.console import (
    Column,
    Show,
    fits,
    joined,
    live,
    numbers,
    plain,
    print_table,
    progress,
    say,
    seconds,
)
from sqrp_cli.terminal.progress_lines import Advance

if TYPE_CHECKING:
    from sqrp_cli.runtime.run.simulation import SweepRun, SweepSummary

MOST_DISAGREEMENTS = 8
"""Groups of disagreements in a table."""

_STYLES = {Truth.TRUE: "green", Truth.FALSE: "cyan", Truth.UNKNOWN: "yellow"}

_REPLAY_SPEED = 4.0
"""Speed of a replay, as a multiple of real time."""


class LiveView:
    """Shows live what happens on stderr: a listener of a run and a context manager.

    Where stderr is no terminal, a line now and then says how far the run has come.
    """

    def __init__(self, cameras: Sequence[str], *, pace: bool = False, planned: float | None = None) -> None:
        """pace: show events at a steady pace, not as they come. planned: how long the run takes without a retry [s]."""
        self._cameras, self._pace, self._planned = list(cameras), pace, planned
        self._stack = ExitStack()
        self._show: Show | None = None
        self._advance: Advance | None = None
        self._doing, self._last, self._t = "looks", "", 0.0
        self._literals: Mapping[str, events.ShownAtom] = {}

    def __enter__(self) -> LiveView:
        self._show = self._stack.enter_context(live())
        if self._show is None and self._planned is not None:
            self._advance = self._stack.enter_context(progress("Running, seconds of the motion", ceil(self._planned)))
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def __call__(self, event: events.Event) -> None:
        """Show an event."""
        if self._advance is not None:
            self._advance(int(event.t) - int(self._t))
            self._t = event.t
        if self._show is None or isinstance(event, events.State):
            return
        if self._pace and event.t > self._t:
            time.sleep((event.t - self._t) / _REPLAY_SPEED)
        self._t = event.t
        match event:
            case events.PrimitiveBegan(name=name):
                self._doing = name
            case events.EvidenceSeen(literals=literals):
                self._literals = literals
            case events.Stopping():
                self._doing = "stops"
            case events.MovingOn():
                self._doing = "moves on to look"
        if (happens := event_in_words(event)) is not None:
            self._last = f"{event.t:.2f} s: {happens}"
        self._show(self._text())

    def _text(self) -> Any:  # noqa: ANN401
        width = max((len(atom) for atom in self._literals), default=0)
        parts: list[Any] = [(f"{self._t:7.2f} s  {self._doing}", "bold"), "\n"]
        for atom, found in self._literals.items():
            value = found.value.word if found.asked else f"({found.value.word})"
            parts += [f"  {atom:{width}}  ", (f"{value:8}", _STYLES[found.value])]
            for camera in self._cameras:
                vote = found.cameras.get(camera)
                parts.append((" " + "·" * len(camera), "dim") if vote is None else (f" {camera}", _STYLES[vote]))
            blind = found.value is Truth.UNKNOWN and not found.predicted
            parts.append("  blind as predicted\n" if blind else "\n")
        return joined([*parts, (self._last, "yellow")])


class FinishedSteps:
    """How far a run has come: a listener of it."""

    def __init__(self, tasks: Sequence[str]) -> None:
        """tasks: what each of its steps does, in short."""
        self._tasks = tasks
        self._ends: list[float] = []
        self._told: list[str] = []
        self._t = 0.0

    def __str__(self) -> str:
        return f"{self._t:.2f} s of the run, when {len(self._ends)} of {len(self._tasks)} steps were finished"

    def __call__(self, event: events.Event) -> None:
        """Take note of an event."""
        self._t = event.t
        if isinstance(event, events.StepBegan) and event.number > len(self._ends) + 1:  # the one before is done
            self._ends.append(event.t)
        if (happens := event_in_words(event)) is not None:
            self._told.append(f"{event.t:.2f} s: {happens}")

    def show(self, workspace: str) -> None:
        """Print the steps that are finished, and what happened."""
        for number, (task, end) in enumerate(zip(self._tasks, self._ends, strict=False), 1):
            say(joined([f"{number}: {task} in {workspace}: ", ("done", "bold green"), f", {end:.2f} s"]))
        for line in self._told:
            say(line)


def event_in_words(event: events.Event) -> str | None:
    """The event in words; None if the view shows it elsewhere."""
    match event:
        case events.FaultInjected(fault=fault):
            return f"{fault} is made to happen"
        case events.FaultHappened(fault=fault):
            return f"{fault} has happened"
        case events.FaultSeen(name=name):
            return f"{name} is seen"
        case events.MovingOn(to_see=condition):
            return f"moves on to where `{condition}` can be seen"
        case events.Retrying(attempt=attempt, of=of):
            return f"tries again ({attempt} of {of})"
    return None


def print_run(workspace: str, report: RunReport) -> None:
    """The outcome of a run: what was done, the faults, and whether predictions came true."""
    what = "; ".join(report.labels)
    tries = sum(step.attempts - 1 for step in report.steps)
    after = f" after {tries} {'retry' if tries == 1 else 'retries'}" if tries else ""
    if report.outcome == "done":
        say(joined([f"{what} in {workspace}: ", ("done", "bold green"), f"{after}, {report.time:.2f} s"]))
    elif report.outcome == "missed":
        say(joined([f"{what} in {workspace}: ", ("missed", "bold red"), f" a fault{after}, {report.time:.2f} s"]))
    else:
        say(joined([f"{what} in {workspace}: ", ("stopped", "bold red"), f" at {report.time:.2f} s"]))
        stopped = "The robot stopped" if report.steps else "Nothing was commanded: the look stopped"
        say(f"{stopped} because {short_times(report.reason or '')}.")
    for fault in report.missed:
        say(f"No image showed {fault.name}, which happened at {seconds(fault.happened)} s.", "yellow")
    _print_unseen(report, told=bool(report.missed))
    if report.faults:
        say()
        _print_faults(report)
        _print_late(report.faults)
    if report.prediction:
        say()
        print_prediction(report.prediction, report.usual)
        print_disagreements(report.disagreements, len(report.prediction))
        say()
    times = "once" if report.conflicts == 1 else f"{report.conflicts} times"
    conflicts = f"cameras contradicted each other {times}" if report.conflicts else ""
    off = report.tracking
    tracking = "" if off is None else f"the tool was off its path by {1000 * off:.3f} mm rms"
    if conflicts or tracking:
        say("; ".join(part for part in (conflicts, tracking) if part).capitalize() + ".")


def _print_unseen(report: RunReport, *, told: bool) -> None:
    """The literals that no camera saw at the end of finished steps, so that a fault may be unnoticed.

    told: whether that of one is told already.
    """
    for number, step in enumerate(report.steps, 1):
        if step.end is not None and step.unseen:
            end = "the motion" if len(report.steps) == 1 else f"step {number}"
            atoms = events.listed([f"{atom} ({_last(t)})" for atom, t in step.unseen.items()])
            then = "" if told else ": a fault after that would not be noticed by then"
            say(f"At the end of {end} no image shows {atoms}{then}.", "yellow")


def _last(t: float | None) -> str:
    return "never before" if t is None else f"last at {t:.2f} s"


def _print_faults(report: RunReport) -> None:
    columns = ("injected", "t_f", "t_r", "t_r - t_f", "predicted", "t_redo", "t_e")
    rows = [
        [
            report.label_of(fault),
            *(seconds(t) for t in (fault.injected, fault.happened, fault.detected, fault.delay)),
            seconds(fault.predicted_delay, "<="),
            *(seconds(t) for t in (fault.acted, fault.recovered)),
        ]
        for fault in report.faults
    ]
    print_table([Column("fault [s]"), *numbers(*columns)], rows)
    say("t_f happened, t_r seen, t_redo the robot responded, t_e the step was done", "dim")
    for fault in report.faults:
        if fault.moved_on is not None:
            say(
                f"After it had seen {fault.name}, the robot moved on to look for {fault.moved_on:.2f} s: where it was, "
                "the cameras could not judge whether to try again."
            )


def _print_late(faults: Sequence[FaultRecord]) -> None:
    """The faults that were seen later than predicted at worst."""
    for fault in faults:
        if late := excess(fault):
            say(f"The images showed {fault.name} {late:.3f} s later than predicted at worst.", "yellow")


def print_prediction(prediction: Sequence[Prediction], usual: Sequence[Prediction]) -> None:
    """How often images showed what they were promised to show, or else usually show."""
    titles = ("images\npromised", "came true", "usual images\nthat showed it", "others that\nshowed it")
    columns = [Column("literal"), Column("camera"), *numbers(*titles)]
    rows = []
    for number, (step, others) in enumerate(zip(prediction, usual, strict=True), 1):
        for atom, cameras in step.items():
            shown = {
                name: found for name, found in cameras.items() if found.tp + found.fp + found.fn + others[atom][name].fp
            }
            label = atom if len(prediction) == 1 else f"{number}: {atom}"
            rows += [[label, name, *_cells(found, others[atom][name])] for name, found in shown.items()]
    if fits(columns, rows):  # else each row says for itself what it is about
        for above, row in reversed(list(pairwise(rows))):
            row[0] = "" if row[0] == above[0] else row[0]
    rest = total_of(usual)
    rows.append([plain("all", "bold"), "", *_cells(total_of(prediction), rest)])
    print_table(columns, rows)
    if rest.tp + rest.fp:
        say("usual images were not promised to show the literal, but such images mostly do", "dim")


def _cells(found: Confusion, rest: Confusion) -> list[Any]:
    share = found.precision
    true = "-" if share is None else f"{found.tp}  {100 * share:5.1f} %"
    style = "" if share is None or share >= 0.97 else "yellow" if share >= 0.9 else "red"
    others = (f"{some} of {some + more}" for some, more in ((rest.tp, rest.fp), (rest.fn, rest.tn)))
    return [str(found.tp + found.fp), plain(true, style), *others]


def print_disagreements(found: Sequence[Disagreement], steps: int) -> None:
    """Where predictions were wrong: stretches of images of a camera, the overconfident ones first.

    Not among them are images that were not promised to show what they usually show.

    steps: of the program; where there are several, each row names its own.
    """
    groups: dict[tuple[bool, int, str, str, str], list[Disagreement]] = {}
    for entry in found:
        if entry.usual:
            continue
        groups.setdefault((not entry.predicted, entry.step, entry.atom, entry.camera, entry.seen), []).append(entry)
    listed_groups = sorted(groups.items())[:MOST_DISAGREEMENTS]
    for unforeseen, title in ((False, "Promised, but not seen:"), (True, "Seen, though neither promised nor usual:")):
        rows = [_disagreement(entries, steps) for group, entries in listed_groups if group[0] is unforeseen]
        if rows:
            say()
            say(title)
            columns = [Column("literal"), Column("camera"), Column("shown", shrink=True)]
            print_table([*columns, *numbers("images", "from - to [s]", "judged [%]")], rows)
    if len(groups) > MOST_DISAGREEMENTS:
        say(f"and {len(groups) - MOST_DISAGREEMENTS} more; --json lists every image", "dim")


def _disagreement(entries: Sequence[Disagreement], steps: int) -> list[str]:
    """The row of images that disagree with the same prediction in the same way."""
    first, shares = entries[0], [entry.share for entry in entries]
    # Of a recording, the start of a step is known to some microseconds: 0.45 must not become 0.4 there, 0.5 here.
    times = [round(entry.t, 3) for entry in entries]
    reasons = ", ".join(sorted({entry.because for entry in entries}))
    return [
        first.atom if steps == 1 else f"{first.step + 1}: {first.atom}",
        first.camera,
        f"{first.seen} ({reasons})" if first.predicted else first.seen,
        str(len(entries)),
        f"{min(times):.1f} - {max(times):.1f}",
        f"{100 * min(shares):.0f} - {100 * max(shares):.0f}",
    ]


def print_sweep(
    program: Program, number: int, workspace: str, text: str, runs: Sequence[SweepRun], summary: SweepSummary
) -> None:
    """The runs of a sweep, and how predicted and measured delays compare. number: of the step that was swept."""
    step = "" if len(program.steps) == 1 else f"step {number}, "
    instants = f"{len(runs)} instant{'' if len(runs) == 1 else 's'}"
    say(f"{step}{program.steps[number - 1].short_task} in {workspace}: {text} at {instants}")
    say()
    columns = ("slip at", "t_f", "t_r", "t_r - t_f", "predicted", "t_e")
    print_table(
        [*numbers(*columns), Column("outcome")],
        [
            [
                f"{run.x:.2f}",
                *(seconds(t) for t in (run.fault.happened, run.fault.detected, run.fault.delay)),
                seconds(run.fault.predicted_delay, "<="),
                seconds(run.fault.recovered),
                run.report.outcome,
            ]
            for run in runs
        ],
    )
    clocks = "all in s" if len(program.steps) == 1 else f"in s of the run (slip at: of step {number})"
    say(f"t_f it happened, t_r it was seen, t_e the step was done, {clocks}", "dim")
    _print_stops(runs)
    say()
    _print_comparison(summary)


def _print_comparison(summary: SweepSummary) -> None:
    """How predicted and measured delays of a sweep compare, in sentences."""
    if summary.predictable:
        sooner = f"{summary.sooner} sooner by more than {1000 * summary.tolerance:.0f} ms"
        say(
            f"{summary.seen} of {summary.predictable} slips that the prediction says can be seen were seen: "
            f"{summary.as_predicted} as predicted, {sooner}, {summary.later} later than predicted at worst."
        )
        if summary.excesses:
            say(f"These exceed what was predicted by up to {max(summary.excesses):.3f} s.", "yellow")
    unpromised = [delay for delay in summary.unpromised if delay is not None]
    if summary.unpromised:
        which = "the others" if summary.predictable else "the slips"
        seen = f"{len(unpromised)} of {len(summary.unpromised)} were seen"
        say(f"No image is promised to show {which}, but usual images may: {seen}.")
    elif not summary.predictable:
        say("No slip came true.")
    if delays := [*summary.delays, *unpromised]:
        done = f"; done after {sum(summary.ends) / len(summary.ends):.1f} s on average" if summary.ends else ""
        say(f"Seen after {sum(delays) / len(delays):.2f} s on average, {max(delays):.2f} s at worst{done}.")


def _print_stops(runs: Sequence[SweepRun]) -> None:
    """Why runs of a sweep stopped, each reason once, and which slips nobody noticed."""
    stopped: dict[str, list[str]] = {}
    missed = [f"{run.x:.2f}" for run in runs if run.report.outcome == "missed"]
    for run in runs:
        if run.report.outcome == "stopped":
            stopped.setdefault(run.report.reason or "", []).append(f"{run.x:.2f}")
    for reason, places in stopped.items():
        say(f"Stopped with the slip at {', '.join(places)}: {short_times(reason)}.")
    if missed:
        say(f"Missed: no image showed the slip at {', '.join(missed)}.", "red")


def wall_time(report: RunReport) -> str:
    """Where the wall time of a run went, in one line."""
    wall = dict(report.wall)
    total, apart = wall.pop("all"), wall.pop("perception (in parallel)")
    parts = [f"{name} {seconds:.1f}" for name, seconds in wall.items()]
    rest = total - sum(wall.values())
    return (
        f"{total:.1f} s of wall time for {report.time:.1f} s and {report.images} images: "
        f"{', '.join(parts)}, the rest {rest:.1f} s; perception {apart:.1f} s of CPU in its own processes"
    )
