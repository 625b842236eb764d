"""Runs in the terminal: a live view while they happen, then tables; and what recorded images say in an audit."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from itertools import groupby
from math import ceil, degrees, hypot
from typing import TYPE_CHECKING, Any

from sqrp_cli.document import how_many
from sqrp_cli.errors import first_names
from sqrp_cli.run.record.events import BETWEEN, Event, ShownAtom, listed
from sqrp_cli.run.record.report import Confusion, Disagreement, Prediction, RunReport, SweepDocument
from sqrp_cli.show.terminal.console import (
    Column,
    TableCell,
    changing_text,
    fits,
    joined,
    numbers,
    print_table,
    progress,
    say,
    seconds,
    styled,
)
from sqrp_cli.show.terminal.progress_lines import Verbosity, verbosity
from sqrp_cli.skill.target_box import fact_words

if TYPE_CHECKING:
    from sqrp_cli.field.audit.report import AuditDocument, AuditedCamera
    from sqrp_cli.field.calibrating.fit import CalibrateDocument

MOST_DISAGREEMENTS = 8  # groups of disagreements in a table
LONG_AGO = 0.1  # a fault that came true later than that after it was asked for [s] has a sentence about it
TAIL = 0.3  # a step whose last image that is compared is earlier than this before its end [s] is not seen to its end
_STYLES = {"true": "green", "false": "cyan", "blind": "yellow"}
_REPLAY_SPEED = 4.0  # speed of a replay, as a multiple of real time


@contextmanager
def live_view(
    cameras: Sequence[str], *, pace: bool = False, planned: float | None = None
) -> Iterator[Callable[[Event], None]]:
    """A listener that shows what happens, in logs now and then. pace: steadily. planned: time without retries [s]."""
    doing, last, now = BETWEEN["step"], "", 0.0
    literals: Mapping[str, ShownAtom] = {}
    says: Mapping[str, str] = {}

    def tell(event: Event) -> None:
        nonlocal doing, last, now, literals, says
        if advance is not None:
            advance(int(event.t) - int(now))
            now = event.t
        if show is None or event.event == "state":
            return
        if pace and event.t > now:
            time.sleep((event.t - now) / _REPLAY_SPEED)
        now = event.t
        match event.event:
            case "primitive":
                doing = event.name
            case "evidence":
                literals = event.literals
            case kind:
                doing, says = BETWEEN.get(kind, doing), event.says if kind == "step" else says
        if (happens := event_in_words(event)) is not None:
            last = f"{event.t:.2f} s: {happens}"
        width = max((len(says.get(atom, atom)) for atom in literals), default=0)
        parts: list[Any] = [(f"{now:7.2f} s  {doing}", "bold"), "\n"]
        for atom, found in literals.items():
            value = found.value if found.asked else f"({found.value})"
            parts += [f"  {says.get(atom, atom):{width}}  ", (f"{value:8}", _STYLES[found.value])]
            for camera in cameras:
                vote = found.cameras.get(camera)
                parts.append((" " + "·" * len(camera), "dim") if vote is None else (f" {camera}", _STYLES[vote]))
            blind = found.value == "blind" and not found.predicted
            parts.append("  not seen, as predicted\n" if blind else "\n")
        show(joined([*parts, (last, "yellow")]))

    with ExitStack() as stack:
        show, advance = stack.enter_context(changing_text()), None
        if show is None and planned is not None:
            advance = stack.enter_context(progress("Running, seconds of the motion", ceil(planned)))
        yield tell


def print_finished(tasks: Sequence[str], events: Sequence[Event], workspace: str, *, quiet: bool = False) -> str:
    """Print what an interrupted run had done, unless quiet; returns how far it was. tasks: of its steps, in short."""
    ends: list[float] = []
    for event in events:
        if event.event == "step" and event.number > len(ends) + 1:  # the one before is done
            ends.append(event.t)
    for number, (task, end) in enumerate(zip(tasks, () if quiet else ends, strict=False), 1):
        say(joined([f"{number}: {task} in {workspace}: ", ("done", "bold green"), f", {end:.2f} s"]))
    for event in () if quiet else events:
        if (happens := event_in_words(event)) is not None:
            say(f"{event.t:.2f} s: {happens}")
    t = events[-1].t if events else 0.0
    return f"{t:.2f} s of the run, when {len(ends)} of {len(tasks)} steps were finished"


def event_in_words(event: Event) -> str | None:
    """The event in words; None if the view shows it elsewhere."""
    match event.event:
        case "injected":
            return f"{event.fault} is made to happen"
        case "happened":
            return f"{event.fault} has happened"
        case "fault":
            return f"{event.name} is seen"
        case "moving on":
            return "moves on to where the cameras can judge whether to try again"
        case "retry":
            return f"tries again ({event.attempt} of {event.of})"
    return None


def print_run(found: RunReport) -> None:
    """The outcome of a run, how late faults were noticed, whether images showed what was predicted, and the tables."""
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
        say(f"{stopped} because {found.reason}.")
    for fault in found.faults:
        label = found.label_of(fault)
        if fault.delay is not None:
            late = f", exceeded by {fault.excess:.3f} s" if fault.excess else ""
            most = seconds(fault.predicted_delay)
            predicted = "" if most == "-" else f" (predicted: at the latest after {most} s{late})"
            say(f"Noticed after {fault.delay:.2f} s: {label}{predicted}.", "yellow" if late else None)
        elif fault.happened is not None:
            say(f"Never noticed: {label} at {fault.happened:.2f} s; no image showed it.", "red")
        untold = 0.0 if fault.injected is None else (fault.happened or 0.0) - fault.injected
        if untold > LONG_AGO and fault.kind == "slip" and fault.delay is not None:  # the part is loose at once
            most = "-" if fault.predicted_delay is None else seconds(fault.predicted_delay + untold)
            bound = "" if most == "-" else f" (as `rank` counts: at the latest {most} s)"
            after = f"That is {fault.delay + untold:.2f} s after it let go{bound}"
            say(f"{after}, of which images could not tell it for {untold:.2f} s.")
        elif fault.injected is not None and untold > LONG_AGO:
            until = "" if fault.detected is None else f" {fault.detected - fault.injected:.2f} s before that,"
            told = f"images can tell it only from {fault.happened:.2f} s on, and its delay counts from there"
            say(f"{label} was asked for{until} at {fault.injected:.2f} s: {told}.")
        if fault.moved_on is not None:
            moved = f"After it had seen {fault.name}, the robot moved on to look for {fault.moved_on:.2f} s"
            say(f"{moved}: where it was, the cameras could not judge whether to try again.")
    if (total := found.total).precision is not None:
        say(f"{total.tp} of {total.tp + total.fp} predicted images showed what they should.")
    for number, step in enumerate(found.steps, 1):
        if step.end is not None and step.unseen:  # what no camera saw at its end, so that a fault may be unnoticed
            end = "the motion" if len(found.steps) == 1 else f"step {number}"
            last = {atom: "never before" if t is None else f"last at {t:.2f} s" for atom, t in step.unseen.items()}
            words = {atom: _fact(atom, number - 1, found.says, numbered=False) for atom in last}
            unseen = listed([f"whether {words[atom]} ({when})" for atom, when in last.items()])
            then = "" if found.missed else ": a fault after that would not be noticed by then"
            say(f"At the end of {end} no image shows {unseen}{then}.", "yellow")
    if found.faults:
        say()
        columns = ("asked\nfor", "came\ntrue", "noticed", "noticed\nafter", "predicted", "reacted", "done")
        rows = []
        for fault in found.faults:
            known = map(seconds, (fault.injected, fault.happened, fault.detected, fault.delay))
            rest = map(seconds, (fault.acted, fault.recovered))
            rows.append([found.label_of(fault), *known, seconds(fault.predicted_delay, "<="), *rest])
        print_table([Column("fault [s]"), *numbers(*columns)], rows)
    if found.prediction:
        say()
        print_prediction(found.prediction, found.usual, found.says)
        print_disagreements(found.disagreements, found.says)
    times = "once" if found.conflicts == 1 else f"{found.conflicts} times"
    facts = [f"cameras contradicted each other {times}"] if found.conflicts else []
    if found.tracking is not None and verbosity.get() is Verbosity.VERBOSE:
        facts.append(f"the tool was off its path by {1000 * found.tracking:.3f} mm (root mean square)")
    if facts:
        say(f"\n{'; '.join(facts).capitalize()}.")


def print_prediction(
    prediction: Sequence[Prediction], usual: Sequence[Prediction], says: Sequence[Mapping[str, str]]
) -> None:
    """How often images showed what they were predicted to, or else mostly show. says: of each step, see reports."""

    def cells(found: Confusion, rest: Confusion) -> list[Any]:
        share = found.precision
        true = "-" if share is None else f"{found.tp}  {100 * share:5.1f} %"
        style = "" if share is None or share >= 0.97 else "yellow" if share >= 0.9 else "red"
        others = (f"{some} of {some + more}" for some, more in ((rest.tp, rest.fp), (rest.fn, rest.tn)))
        return [str(found.tp + found.fp), styled(true, style), *others]

    titles = ("predicted\nimages", "showed it", "not counted on,\nbut most show it", "others that\nshowed it")
    columns = [Column("fact"), Column("camera"), *numbers(*titles)]
    rows, of_all = [], (Confusion(), Confusion())
    for number, (step, others) in enumerate(zip(prediction, usual, strict=True), 1):
        for atom, cameras in step.items():
            label = _fact(atom, number - 1, says)
            for name, found in cameras.items():
                rest = others[atom][name]
                if found.tp + found.fp + found.fn + rest.fp:
                    rows.append([label, name, *cells(found, rest)])
                    of_all = of_all[0] + found, of_all[1] + rest
    grouped: list[list[Any]] = []
    for fact, own in groupby(rows, key=lambda row: row[0]):  # each camera below its fact
        grouped += [[fact, *[""] * 4], *([f"  {camera}", *figures] for _, camera, *figures in own)]
    if fits(together := [Column("fact and camera"), *columns[2:]], grouped):  # else each row says what it is about
        print_table(together, [*grouped, [styled("all", "bold"), *cells(*of_all)]])
    else:
        print_table(columns, [*rows, [styled("all", "bold"), "", *cells(*of_all)]])


def _fact(atom: str, index: int, says: Sequence[Mapping[str, str]], *, numbered: bool = True) -> str:
    """A fact of the step of an index in words; numbered: with its number if there are several steps."""
    words = (says[index] if index < len(says) else {}).get(atom) or fact_words(atom, (), ())
    return f"{index + 1}: {words}" if numbered and len(says) > 1 else words


def print_disagreements(found: Sequence[Disagreement], says: Sequence[Mapping[str, str]]) -> None:
    """Where predictions were wrong, the overconfident first; no images that were not counted on. says: see reports."""
    groups: dict[tuple[bool, int, str, str, str], list[Disagreement]] = {}
    for one in found:
        if not one.usual:
            groups.setdefault((not one.predicted, one.step, one.atom, one.camera, one.seen), []).append(one)
    rows: dict[bool, list[list[str]]] = {False: [], True: []}
    for (unforeseen, step, atom, camera, seen), images in sorted(groups.items())[:MOST_DISAGREEMENTS]:
        # Of a recording, the start of a step is known to some microseconds: 0.45 must not become 0.4 there, 0.5 here.
        times, shares = sorted(round(one.t, 3) for one in images), sorted(100 * one.share for one in images)
        ends = (f"{times[0]:.1f}", f"{times[-1]:.1f}"), (f"{shares[0]:.0f}", f"{shares[-1]:.0f}")
        reasons = "" if unforeseen else f" ({', '.join(sorted({one.because for one in images}))})"
        shown = f"{'none' if seen == 'blind' else seen}{reasons}"
        spans = (" - ".join(dict.fromkeys(each)) for each in ends)
        rows[unforeseen].append([_fact(atom, step, says), camera, shown, str(len(images)), *spans])
    columns = [Column("fact", shrink=True), Column("camera"), Column("shown", shrink=True)]
    columns += numbers("images", "from - to [s]", "visible [%]")
    for unforeseen, title in ((False, "Predicted, but not seen:"), (True, "Seen, though not predicted:")):
        if rows[unforeseen]:
            say(f"\n{title}")
            print_table(columns, rows[unforeseen])
    if len(groups) > MOST_DISAGREEMENTS:
        say(f"and {len(groups) - MOST_DISAGREEMENTS} more; --json lists every image", "dim")


def print_sweep(found: SweepDocument) -> None:
    """The runs of a sweep, and how predicted and measured delays compare."""
    if found.runs:
        _print_swept(found)
    if found.interrupted:
        done, are = len(found.runs), "is" if 1 in (len(found.runs), found.count) else "are"
        say(f"Interrupted: {done} of {found.count} slip{'s' * (found.count != 1)} {are} finished.", "yellow")


def _print_swept(found: SweepDocument) -> None:
    alone, runs = len(found.steps) == 1, found.runs
    instants = how_many(runs, "instant")
    step = "" if alone else f"step {found.step}, "
    say(f"{step}{found.steps[found.step - 1]} in {found.workspace}: {found.sweep} at {instants}")
    happened = [run for run in runs if run.happened is not None]
    ends = [run.recovered for run in runs if run.recovered is not None]
    if delays := [run.delay for run in happened if run.delay is not None]:
        done = f"; done after {sum(ends) / len(ends):.1f} s on average" if ends else ""
        mean = sum(delays) / len(delays)
        say(f"Noticed after {mean:.2f} s on average, at the latest after {max(delays):.2f} s{done}.")
    missed = [f"{run.x:.2f}" for run in runs if run.outcome == "missed"]
    if missed:
        say(f"Never noticed: the slip at {', '.join(missed)} s; no image showed it.", "red")
    unpromised = [run.delay for run in happened if run.predicted_delay is None]
    if found.predictable:
        sooner = f"{found.sooner} sooner by more than {1000 * found.tolerance:.0f} ms"
        excess = max(run.excess for run in happened)
        late = f" by up to {excess:.3f} s" if excess else ""
        say(
            f"{found.seen} of {found.predictable} slips that are predicted to be noticed were: "
            f"{found.as_predicted} as predicted, {sooner}, {found.later} later{late}.",
            "yellow" if excess else None,
        )
    if unpromised:
        which = "other slips" if found.predictable else "slips"
        seen = f"{sum(delay is not None for delay in unpromised)} of {len(unpromised)}"
        say(f"Not counted on, but noticed: {seen} {which}.")
    elif not found.predictable:
        say("No slip came true.")
    say()
    rows = []
    for run in runs:
        known, most = map(seconds, (run.x, run.happened, run.detected, run.delay)), seconds(run.predicted_delay, "<=")
        rows.append([*known, most, seconds(run.recovered), run.outcome])
    titles = ("asked for\n[s]", "came true\n[s]", "noticed\n[s]", "noticed\nafter [s]", "predicted\n[s]", "done\n[s]")
    print_table([*numbers(*titles), Column("outcome")], rows)
    if not alone:
        say(f"asked for: since step {found.step} began; others: since the run began", "dim")
    # Why runs stopped, each reason once.
    stopped: dict[str, list[str]] = {}
    for run in runs:
        if run.outcome == "stopped":
            stopped.setdefault(run.reason or "", []).append(f"{run.x:.2f}")
    for reason, places in stopped.items():
        say(f"Stopped with the slip at {', '.join(places)} s: {reason}.")


def wall_time(found: RunReport) -> str:
    """Where the wall time of a run went, in one line."""
    wall = dict(found.wall)
    total, apart = wall.pop("all"), wall.pop("perception (in parallel)")
    parts = ", ".join(f"{name} {seconds:.1f}" for name, seconds in wall.items())
    rest = f"the rest {total - sum(wall.values()):.1f} s; perception {apart:.1f} s of CPU in its own processes"
    return f"{total:.1f} s of wall time for {found.time:.1f} s and {found.images} images: {parts}, {rest}"


def print_audit(found: AuditDocument) -> None:
    """Whether a recording shows what a program predicts, what of it is not compared, and the tables."""
    wrong = f"Not passed: {listed(found.not_as_stated)}. " if found.not_as_stated else ""
    if found.precision is None:
        say(f"{wrong}No image was predicted to show anything, so there is nothing to confirm.")
    else:
        verdict = wrong or ("Passed: " if found.passed else "Not passed: ")
        seen = f"{100 * found.precision:.1f} % of the predicted images showed it"
        say(f"{verdict}{seen} ({100 * found.threshold:g} % needed).", "green" if found.passed else "red")
    what = "; ".join(found.steps)
    say(f"{what} in {found.workspace}: {found.images} images compared, {found.skipped} skipped (not as planned)")
    if found.runs > 1:
        say(f"The motion is there {found.runs} times (runs, or a retry): the first is compared.", "yellow")
    if found.damaged:
        count = "1 image is" if found.damaged == 1 else f"{found.damaged} images are"
        say(f"{count} damaged and left out: {found.damage}.", "yellow")
    for name, after in found.apart.items():
        when = f"{abs(after):,.0f} s {'after' if after > 0 else 'before'} the robot's motion"
        say(f"All images of {name} are, by their stamps, {when} or more: its clock is not the robot's.", "red")
    if found.missing:
        them = "them" if len(found.missing) > 1 else "it"
        said = f"There are no images of {listed(found.missing)}: what was predicted of {them} is left out."
        if topics := found.other_topics:  # whose images may be theirs
            said += f" Images of no camera are on {first_names(topics)}: --topic {found.missing[0]}={topics[0]}"
        say(said, "yellow")
    if found.repeated:
        same = "images are bit by bit the same as the one before them; they count as showing nothing"
        say(f"{found.repeated} {same}.", "yellow")
    for number, (whole, t) in enumerate(zip(found.times, found.until, strict=True), 1):
        motion = "the motion" if len(found.steps) == 1 else f"step {number}"
        if t is None:
            say(f"No image of {motion} is compared.", "yellow")
        elif t < whole - TAIL:
            upto = f"Images are compared up to {t:.2f} s of {whole:.2f} s of {motion}"
            say(f"{upto}: then the recording ends, or the robot does not do as planned.", "yellow")
    say()
    if found.unsurveyed is not None:
        say(f"Whether cameras have moved is not known: {found.unsurveyed}.", "yellow")
    else:
        _print_cameras(found.cameras, written=bool(found.written))
    say()
    print_prediction(found.prediction, found.usual, found.says)
    print_disagreements(found.disagreements, found.says)
    for one in found.lost:
        wrong = _fact(one.atom, one.step - 1, found.says, numbered=False)
        since = f"From {one.t:.2f} s of step {one.step} on, all {one.images} images that show whether {wrong} say no"
        say(f"{since}: perhaps the part was lost there, and its detector is right.", "yellow")


def _print_cameras(cameras: Mapping[str, AuditedCamera], *, written: bool) -> None:
    """A row for each camera, and what is wrong with some. written: whether a patch is, for those that have moved."""
    titles = ("images", "clock [ms]", "turned [deg]", "shifted [mm]", "off by [px]")
    rows: list[list[TableCell]] = []
    for name, one in cameras.items():
        cells: list[TableCell] = ["-"] * 4
        if one.pose is not None:
            offset, error = one.clock.offset, one.clock.error
            clock = "-" if offset is None or error is None else f"{1e3 * offset:+z.1f} ±{1e3 * error:.1f}"
            turn, turn_error = (degrees(hypot(*v)) for v in (one.pose.turn, one.pose.turn_error))
            shift, shift_error = (1e3 * hypot(*v) for v in (one.pose.shift, one.pose.shift_error))
            style = "red" if one.moved else ""
            moves = f"{turn:.2f} ±{turn_error:.2f}", f"{shift:.1f} ±{shift_error:.1f}", f"{one.pose.pixels:.1f}"
            cells = [styled(clock, "red" * one.clock.wrong), *(styled(text, style) for text in moves)]
        rows.append([name, str(one.images), *cells])
    print_table([Column("camera"), *numbers(*titles)], rows)
    for name, one in cameras.items():
        if one.clock.wrong and one.clock.offset is not None:
            ahead = "ahead of" if one.clock.offset > 0 else "behind"
            text = f"The clock of {name} is {1e3 * abs(one.clock.offset):.0f} ms {ahead} the robot's"
            say(f"{text}: its images are compared at the robot's times.", "red")
    moved = [name for name, one in cameras.items() if one.moved]
    if moved:
        verb, them = ("has", "it is") if len(moved) == 1 else ("have", "they are")
        how = "" if written else f" --patch FILE writes where {them} into the workspace."
        say(f"{listed(moved)} {verb} moved.{how}", "red")
    blind = [name for name, one in cameras.items() if one.pose is None]
    if blind:
        it, has = ("it is", "it has") if len(blind) == 1 else ("they are", "they have")
        little = f"Images of {listed(blind)} show too little of the cell to tell where {it}"
        say(f"{little}, or {has} moved by more than can be found out.", "yellow")


def print_calibration(document: CalibrateDocument) -> None:
    """For each detector how well limits and curve agree with what was seen, and the curve."""
    say(f"Detectors of {document.workspace} in {document.images} images")
    for name, found in document.detectors.items():
        say()
        say(f"{name}: {found.looks} looks at boxes, in {100 * found.seen:.1f} % it said what was true")
        if found.curve is None or found.held_out is None or found.limits is None:
            say(f"No curve: {found.reason}.")
            continue
        judged = {"limits": found.limits, "curve, poses held out": found.held_out}
        rows = [(what, f"{100 * one.calibration_error:.1f}", f"{one.brier:.3f}") for what, one in judged.items()]
        print_table([Column(""), *numbers("calibration error [points]", "Brier score")], rows)
        say()
        bins = [(f"{100 * one.told:.1f}", f"{100 * one.seen:.1f}", str(one.looks)) for one in found.held_out.bins]
        print_table(numbers("predicted [%]", "seen [%]", "looks"), bins)
        terms = {"bias": found.curve.bias, **found.curve.terms, "most": found.curve.most}
        said = ", ".join(f"{term}: {value:g}" for term, value in terms.items())
        say(f"detectors: {name}: curve: {{{said}}}")
