"""Runs in the terminal: a live view while they happen, then tables."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from itertools import pairwise
from math import ceil
from typing import Any

from sqrp_cli.logic.truth import Truth
from sqrp_cli.run.record import events
from sqrp_cli.run.record.report import Confusion, Disagreement, Prediction, RunReport, SweepDocument
from sqrp_cli.show.sentences import short_times
from sqrp_cli.show.terminal.console import (
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
from sqrp_cli.show.terminal.progress_lines import Advance

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


def print_run(found: RunReport) -> None:
    """The outcome of a run: what was done, the faults, and whether predictions came true."""
    what = f"{'; '.join(found.labels)} in {found.workspace}: "
    tries = sum(step.attempts - 1 for step in found.steps)
    after = f" after {tries} {'retry' if tries == 1 else 'retries'}" if tries else ""
    if found.outcome == "done":
        say(joined([what, ("done", "bold green"), f"{after}, {found.time:.2f} s"]))
    elif found.outcome == "missed":
        say(joined([what, ("missed", "bold red"), f" a fault{after}, {found.time:.2f} s"]))
    else:
        say(joined([what, ("stopped", "bold red"), f" at {found.time:.2f} s"]))
        stopped = "The robot stopped" if found.steps else "Nothing was commanded: the look stopped"
        say(f"{stopped} because {short_times(found.reason or '')}.")
    for fault in found.missed:
        say(f"No image showed {fault.name}, which happened at {seconds(fault.happened)} s.", "yellow")
    for number, step in enumerate(found.steps, 1):
        if step.end is not None and step.unseen:  # what no camera saw at its end, so that a fault may be unnoticed
            end = "the motion" if len(found.steps) == 1 else f"step {number}"
            last = {atom: "never before" if t is None else f"last at {t:.2f} s" for atom, t in step.unseen.items()}
            atoms = events.listed([f"{atom} ({when})" for atom, when in last.items()])
            then = "" if found.missed else ": a fault after that would not be noticed by then"
            say(f"At the end of {end} no image shows {atoms}{then}.", "yellow")
    if found.faults:
        say()
        _print_faults(found)
    if found.prediction:
        say()
        print_prediction(found.prediction, found.usual)
        print_disagreements(found.disagreements, len(found.prediction))
        say()
    times = "once" if found.conflicts == 1 else f"{found.conflicts} times"
    facts = [f"cameras contradicted each other {times}"] if found.conflicts else []
    if found.tracking is not None:
        facts.append(f"the tool was off its path by {1000 * found.tracking:.3f} mm rms")
    if facts:
        say("; ".join(facts).capitalize() + ".")


def _print_faults(found: RunReport) -> None:
    columns = ("injected", "t_f", "t_r", "t_r - t_f", "predicted", "t_redo", "t_e")
    rows = [
        [
            found.label_of(fault),
            *(seconds(t) for t in (fault.injected, fault.happened, fault.detected, fault.delay)),
            seconds(fault.predicted_delay, "<="),
            *(seconds(t) for t in (fault.acted, fault.recovered)),
        ]
        for fault in found.faults
    ]
    print_table([Column("fault [s]"), *numbers(*columns)], rows)
    say("t_f happened, t_r seen, t_redo the robot responded, t_e the step was done", "dim")
    for fault in found.faults:
        if fault.moved_on is not None:
            say(
                f"After it had seen {fault.name}, the robot moved on to look for {fault.moved_on:.2f} s: where it was, "
                "the cameras could not judge whether to try again."
            )
    for fault in found.faults:
        if fault.excess:
            say(f"The images showed {fault.name} {fault.excess:.3f} s later than predicted at worst.", "yellow")


def print_prediction(prediction: Sequence[Prediction], usual: Sequence[Prediction]) -> None:
    """How often images showed what they were promised to show, or else usually show."""

    def cells(found: Confusion, rest: Confusion) -> list[Any]:
        share = found.precision
        true = "-" if share is None else f"{found.tp}  {100 * share:5.1f} %"
        style = "" if share is None or share >= 0.97 else "yellow" if share >= 0.9 else "red"
        others = (f"{some} of {some + more}" for some, more in ((rest.tp, rest.fp), (rest.fn, rest.tn)))
        return [str(found.tp + found.fp), plain(true, style), *others]

    titles = ("images\npromised", "came true", "usual images\nthat showed it", "others that\nshowed it")
    columns = [Column("literal"), Column("camera"), *numbers(*titles)]
    rows, of_all = [], (Confusion(), Confusion())
    for number, (step, others) in enumerate(zip(prediction, usual, strict=True), 1):
        for atom, cameras in step.items():
            label = atom if len(prediction) == 1 else f"{number}: {atom}"
            for name, found in cameras.items():
                rest = others[atom][name]
                if found.tp + found.fp + found.fn + rest.fp:
                    rows.append([label, name, *cells(found, rest)])
                    of_all = of_all[0] + found, of_all[1] + rest
    if fits(columns, rows):  # else each row says for itself what it is about
        for above, row in reversed(list(pairwise(rows))):
            row[0] = "" if row[0] == above[0] else row[0]
    rows.append([plain("all", "bold"), "", *cells(*of_all)])
    print_table(columns, rows)
    if of_all[1].tp + of_all[1].fp:
        say("usual images were not promised to show the literal, but such images mostly do", "dim")


def print_disagreements(found: Sequence[Disagreement], steps: int) -> None:
    """Where predictions were wrong: stretches of images of a camera, the overconfident ones first.

    Not among them are images that were not promised to show what they usually show.

    steps: of the program; where there are several, each row names its own.
    """
    groups: dict[tuple[bool, int, str, str, str], list[Disagreement]] = {}
    for one in found:
        if not one.usual:
            groups.setdefault((not one.predicted, one.step, one.atom, one.camera, one.seen), []).append(one)
    listed = sorted(groups.items())[:MOST_DISAGREEMENTS]
    for unforeseen, title in ((False, "Promised, but not seen:"), (True, "Seen, though neither promised nor usual:")):
        rows = []
        for (of_other, step, atom, camera, seen), images in listed:
            if of_other is unforeseen:
                # Of a recording, the start of a step is known to some microseconds: 0.45 must not become 0.4 there,
                # 0.5 here.
                times, shares = [round(one.t, 3) for one in images], [one.share for one in images]
                reasons = ", ".join(sorted({one.because for one in images}))
                label = atom if steps == 1 else f"{step + 1}: {atom}"
                shown = seen if unforeseen else f"{seen} ({reasons})"
                between = f"{min(times):.1f} - {max(times):.1f}"
                judged = f"{100 * min(shares):.0f} - {100 * max(shares):.0f}"
                rows.append([label, camera, shown, str(len(images)), between, judged])
        if rows:
            say()
            say(title)
            columns = [Column("literal"), Column("camera"), Column("shown", shrink=True)]
            print_table([*columns, *numbers("images", "from - to [s]", "judged [%]")], rows)
    if len(groups) > MOST_DISAGREEMENTS:
        say(f"and {len(groups) - MOST_DISAGREEMENTS} more; --json lists every image", "dim")


def print_sweep(found: SweepDocument) -> None:
    """The runs of a sweep, and how predicted and measured delays compare."""
    if found.runs:
        _print_swept(found)
    if found.interrupted:
        done = len(found.runs)
        are = "is" if 1 in (done, found.count) else "are"
        of_all = f"of {found.count} slip{'' if found.count == 1 else 's'}"
        say(f"Interrupted: {done} {of_all} {are} finished.", "yellow")


def _print_swept(found: SweepDocument) -> None:
    alone, runs = len(found.steps) == 1, found.runs
    instants = f"{len(runs)} instant{'' if len(runs) == 1 else 's'}"
    step = "" if alone else f"step {found.step}, "
    say(f"{step}{found.steps[found.step - 1]} in {found.workspace}: {found.sweep} at {instants}")
    say()
    rows = [
        [
            f"{run.x:.2f}",
            *(seconds(t) for t in (run.happened, run.detected, run.delay)),
            seconds(run.predicted_delay, "<="),
            seconds(run.recovered),
            run.outcome,
        ]
        for run in runs
    ]
    print_table([*numbers("slip at", "t_f", "t_r", "t_r - t_f", "predicted", "t_e"), Column("outcome")], rows)
    clocks = "all in s" if alone else f"in s of the run (slip at: of step {found.step})"
    say(f"t_f it happened, t_r it was seen, t_e the step was done, {clocks}", "dim")
    # Why runs stopped, each reason once, and which slips nobody noticed.
    stopped: dict[str, list[str]] = {}
    for run in runs:
        if run.outcome == "stopped":
            stopped.setdefault(run.reason or "", []).append(f"{run.x:.2f}")
    for reason, places in stopped.items():
        say(f"Stopped with the slip at {', '.join(places)}: {short_times(reason)}.")
    missed = [f"{run.x:.2f}" for run in runs if run.outcome == "missed"]
    if missed:
        say(f"Missed: no image showed the slip at {', '.join(missed)}.", "red")
    say()
    happened = [run for run in runs if run.happened is not None]
    unpromised = [run.delay for run in happened if run.predicted_delay is None]
    if found.predictable:
        sooner = f"{found.sooner} sooner by more than {1000 * found.tolerance:.0f} ms"
        say(
            f"{found.seen} of {found.predictable} slips that the prediction says can be seen were seen: "
            f"{found.as_predicted} as predicted, {sooner}, {found.later} later than predicted at worst."
        )
        excess = max(run.excess for run in happened)
        if excess:
            say(f"These exceed what was predicted by up to {excess:.3f} s.", "yellow")
    if unpromised:
        which = "the others" if found.predictable else "the slips"
        seen = f"{sum(delay is not None for delay in unpromised)} of {len(unpromised)} were seen"
        say(f"No image is promised to show {which}, but usual images may: {seen}.")
    elif not found.predictable:
        say("No slip came true.")
    ends = [run.recovered for run in runs if run.recovered is not None]
    if delays := [run.delay for run in happened if run.delay is not None]:
        done = f"; done after {sum(ends) / len(ends):.1f} s on average" if ends else ""
        say(f"Seen after {sum(delays) / len(delays):.2f} s on average, {max(delays):.2f} s at worst{done}.")


def wall_time(found: RunReport) -> str:
    """Where the wall time of a run went, in one line."""
    wall = dict(found.wall)
    total, apart = wall.pop("all"), wall.pop("perception (in parallel)")
    parts = [f"{name} {seconds:.1f}" for name, seconds in wall.items()]
    rest = total - sum(wall.values())
    return (
        f"{total:.1f} s of wall time for {found.time:.1f} s and {found.images} images: "
        f"{', '.join(parts)}, the rest {rest:.1f} s; perception {apart:.1f} s of CPU in its own processes"
    )
