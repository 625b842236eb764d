"""What the cameras see of a candidate, as rows of signs over time, one per literal and camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from sqrp_cli.figures import FIGURE_NAMES, named_figures, shown_figure
from sqrp_cli.show import sentences
from sqrp_cli.show.documents.explanation import ExplainedAll, ExplainedCandidate, Explanation, Sample
from sqrp_cli.show.terminal.console import (
    Column,
    Styled,
    joined,
    numbers,
    output,
    print_table,
    say,
    say_assumed,
    styled,
    unbroken,
)
from sqrp_cli.show.terminal.progress_lines import Verbosity, verbosity
from sqrp_cli.study.result import CandidateResult, SamplingDone

MOST_SIGNS = 50  # signs in a row if the terminal is wide enough; each stands for an equal share of the motion's time
LEAST_SIGNS = 10  # least number of signs in a row, even in a narrow terminal
FIGURES_WIDTH = 12  # width of the figures behind the rows
LABEL_WIDTH = 18  # width of the names in front of the rows

SIGNS: Mapping[str | None, tuple[str, str, str]] = {
    None: ("█", "green", "seen"),
    "hidden": ("h", "red", "hidden"),
    "out_of_image": ("o", "blue", "outside its image"),
    "too_far": ("f", "yellow", "too far"),
    "detector_far": ("f", "yellow", "too far"),
    "too_near": ("n", "yellow", "too near"),
    "detector_near": ("n", "yellow", "too near"),
    "oblique": ("a", "magenta", "seen too flat"),
    "too_small": ("s", "magenta", "too small"),
    "behind": ("l", "yellow", "behind the camera"),
    "same_colour": ("c", "red", "same colour behind"),
    "too_dark": ("d", "red", "too dark"),
    "too_bright": ("b", "red", "too bright"),
}
"""Sign, colour and words of each cause, in the order of the legend; None: seen."""
SELDOM = ("behind", "same_colour", "too_dark", "too_bright")  # in the legend only where a camera does not see for that
NOT_REQUIRED = ("·", "dim")  # sign where no formula requires a literal


def print_explanation(found: Explanation) -> None:
    """What a candidate means and where it is not seen: timeline, causes, accuracy; of an infeasible one the reasons."""
    title = found.name if found.step is None else f"Step {found.step} of {found.of_steps}, {found.task}"
    if found.sampling is None:
        say(f"{title} cannot be done:")
        for reason in found.why:
            say(f"- {reason}")
        return
    say(f"{title}: {sentences.what_it_means(found)}", "bold")
    for sentence in sentences.never_noticed([found]):
        say(sentence, "red")
    for sentence in sentences.noticed_late(found):
        say(sentence)
    say(" ".join(filter(None, (found.verdict, sentences.what_to_move(found.to_move)))))
    rank = "cannot be done" if found.rank is None else f"rank {found.rank}"
    figures = [rank] if found.step is None else []
    figures += [found.choice] if found.has_choice else []
    say(joined(["\n", unbroken([*figures, *named_figures(found, "q_eoi", "q_avg", "time")])]))
    if found.step is not None and found.whole:
        say(f"The whole, {found.whole}, {rank if found.rank is None else f'is {rank}'}.")
    say()
    for row in _rows(found):
        say(row)
    seen = {one.cause for one in found.unseen_times}
    legend = dict.fromkeys(f"{s} {words}" for cause, (s, _, words) in SIGNS.items() if cause not in {*SELDOM} - seen)
    if not found.phases:
        _say_pieces([found])
    say(styled(unbroken([*legend, "- not seen", "· need not be seen"], "  "), "dim"))
    if len(found.faults) > 1 or any(fault.blind_longest > 0.0 for fault in found.faults.values()):
        say()
        for name, fault in found.faults.items():
            longest = f"; no image shows it for up to {fault.blind_longest:.2f} s" if fault.blind_longest > 0.0 else ""
            said = sentences.noticed(found, name)
            say(f"{said[0].upper()}{said[1:]}{longest}.")
    say_assumed(found.assumed if found.faults else "")
    say(f"\n{_camera_failures(found)}")
    if found.coverage:
        why = {(one.literal, one.camera, one.phase): SIGNS[one.cause][0] for one in found.coverage_causes}
        phases, rows = [one.name for one in found.phases], list[tuple[str, ...]]()
        for atom, cameras in found.coverage.items():
            for camera, share in ((one, share) for one, share in cameras.items() if any(share.values())):
                signs = {phase: why.get((atom, camera, phase), "█") for phase in phases}
                told = (f"{100 * share[one]:.1f} {signs[one]}" if one in share else "" for one in phases)
                rows.append((found.says[atom], camera, *told))
        columns = [Column("seen in each phase\n[%]", shrink=True), Column("camera"), *numbers(*phases)]
        say()
        print_table(columns, _said_once(rows))
    _print_unseen(found)
    if found.free_views is not None:
        say(f"\n{found.free_views.words}", "bold")
        if found.windows:
            times = [(one.cameras[0], one.start, one.end, one.end - one.start) for one in found.windows]
            columns = [Column("camera"), *numbers("from [s]", "to [s]", "lasts [s]")]
            print_table(columns, [(camera, *(f"{t:.2f}" for t in some)) for camera, *some in times])
        longest = ", ".join(f"{name} {length:.2f} s" for name, length in found.free_views.longest.items())
        say(f"Longest free view of all that must be seen: {longest}.")
    if found.hidden:
        say()
        columns = [Column("fact", shrink=True), Column("camera"), *numbers("hidden"), Column("by", shrink=True)]
        parts = sentences.part_shares_in_words
        rows = [(found.says[o.literal], o.camera, f"{100 * o.hidden:.1f} %", parts(o.parts)) for o in found.hidden]
        print_table(columns, _said_once(rows))
    say(styled(f"\n{_accuracy(found.sampling, [found])}", "dim"))


def _accuracy(done: SamplingDone, found: Sequence[CandidateResult]) -> str:
    return sentences.accuracy(done, found, short=verbosity.get() is not Verbosity.VERBOSE)


def _print_unseen(found: Explanation) -> None:
    """For how long each camera does not see each fact, and why; cameras that never see it share a row."""
    rows: list[tuple[str, str, str, str]] = []
    for atom, facts in groupby(found.unseen_times, key=lambda one: one.literal):
        lost, kinds = dict[str, Counter[str]](), dict[str, dict[str, None]]()
        asked, fact = found.found_of(atom), found.says[atom]
        for one in facts:
            kinds.setdefault(one.camera, {})[one.limit.by(None)] = None
            lost.setdefault(one.camera, Counter())[one.words] += one.seconds  # type: ignore[assignment]
        able = [camera for camera in lost if any(one is not None and one.cameras[camera].covered for one in asked)]
        for camera in able:
            why = [f"{words} {seconds:.2f}" for words, seconds in lost[camera].most_common()]
            because = next(iter(lost[camera])) if len(why) == 1 else sentences.first_few(why)
            rows.append((fact, camera, f"{lost[camera].total():.2f}", because))
        if never := [camera for camera in lost if camera not in able]:
            reasons = ", ".join(dict.fromkeys(words for camera in never for words in kinds[camera]))
            rows.append((fact, ", ".join(never), f"{lost[never[0]].total():.2f}", f"never seen: {reasons}"))
    if rows:
        say()
        columns = [Column("fact", shrink=True), Column("camera", shrink=True), Column("not seen\n[s]", right=True)]
        print_table([*columns, Column("because it is (for [s])", shrink=True)], _said_once(rows))


def _said_once(rows: Sequence[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """Rows of which the first cell is empty where it is that of the row before."""
    before = ["", *(first for first, *_ in rows)]
    return [("" if first == last else first, *others) for last, (first, *others) in zip(before, rows, strict=False)]


def print_comparison(found: ExplainedAll) -> None:
    """The coverage of every candidate on one time scale, a row each, and the verdicts."""
    feasible = [one for one in found.candidates if one.sampling is not None]
    if feasible:
        say(f"{sentences.first_answer(feasible[0])}\n", "bold")
    longest = max((one.time or 0.0 for one in feasible), default=0.0)
    say(f"{'':{LABEL_WIDTH}}0{f'{longest:.1f} s':>{_width() - 1}}")
    for one in found.candidates:
        if one.sampling is None:
            say(joined([*_label(one.name, ""), (f"cannot be done: {one.why[0]}", "red")]))
            continue
        shown, primitives = _placed(one, longest)
        signs = _signs([(sample.covered, "!" if sample.event else "-") for sample in (one.samples[i] for i in shown)])
        figures = "".join(" " + ("    -" if q is None else f"{100 * q:5.1f}") for q in (one.q_eoi, one.q_avg))
        say(joined([*_label(one.name), *signs, figures]))
        say(styled(" " * LABEL_WIDTH + primitives))
    legend = "On the right, critical time seen and time seen [%]. █ seen  - not seen  ! not seen in critical time"
    say(styled(legend, "dim"))
    _say_pieces(feasible)
    for one in feasible:
        say(f"\n{one.name}: {one.verdict}")
    if done := [one.sampling for one in feasible if one.sampling is not None]:
        error = max((one.error for one in done if one.error is not None), default=None)
        gap = max((one.max_gap for one in done if one.max_gap is not None), default=None)
        say(styled(f"\n{_accuracy(replace(done[0], error=error, max_gap=gap), feasible)}", "dim"))


def _say_pieces(found: Sequence[ExplainedCandidate]) -> None:
    """What primitives do whose names stand above a chart, as there is no room for the words."""
    scale = _width() / (max((one.time or 0.0 for one in found), default=0.0) or 1.0)
    spans = [
        one for each in found for one in each.primitives if (one.end - one.start) * scale < len(one.does or "") + 2
    ]
    if named := dict.fromkeys(f"{one.name} {one.does}" for one in spans if one.does):
        say(styled(unbroken(named), "dim"))


def _label(name: str, style: str = "bold") -> list[Styled | tuple[str, str]]:
    """A name in front of a row; a long one gets its own line."""
    return [(name.ljust(LABEL_WIDTH), style), *(["\n" + " " * LABEL_WIDTH] if len(name) >= LABEL_WIDTH else [])]


def _width() -> int:
    """Signs in a row that fit the terminal."""
    return max(LEAST_SIGNS, min(MOST_SIGNS, output().width - LABEL_WIDTH - FIGURES_WIDTH))


def _camera_failures(found: ExplainedCandidate) -> str:
    """One sentence about the cost of each camera's failure."""
    needed, spare = [], []
    if found.q_avg == 0.0:
        return "No camera is missed if it fails: all that must be seen is never seen at the same time."
    for name, without in found.without_camera.items():
        losses = [
            f"{FIGURE_NAMES[name]} falls to {shown_figure(name, left)}"
            for name, left, now in (("q_eoi", without.q_eoi, found.q_eoi), ("q_avg", without.q_avg, found.q_avg))
            if left is not None and now is not None and round(left, 3) < round(now, 3)
        ]
        if losses:
            needed.append(f"if {name} fails, {' and '.join(losses)}")
        else:
            spare.append(name)
    parts = [f"I{'; '.join(needed)[1:]}." if needed else "No single camera is needed."]
    if spare and needed:
        parts.append(f"Not needed here: {', '.join(spare)}.")
    return " ".join(parts)


# The chart

State = bool | None  # whether something is covered in a sample; None where nothing requires it


def covered_share(samples: Sequence[Sample], states: Sequence[State]) -> float | None:
    """Share of the time between neighbouring samples that are both covered, as Q counts it; None where none counts."""
    total = covered = 0.0
    for first, then, one, after in zip(samples, samples[1:], states, states[1:], strict=False):
        if one is not None and after is not None:
            total += then.t - first.t
            covered += then.t - first.t if one and after else 0.0
    return covered / total if total else None


def _placed(found: ExplainedCandidate, longest: float) -> tuple[list[int], str]:
    """The sample nearest to the middle of each sign, in a row of `longest` seconds, and what primitives do in it."""
    scale, t = _width() / max(longest, 1e-9), np.array([sample.t for sample in found.samples])
    moments = (np.arange(round((found.time or 0.0) * scale)) + 0.5) / scale
    before = np.clip(np.searchsorted(t, moments, side="right") - 1, 0, len(t) - 2)
    later = t[before + 1] - moments < moments - t[before]
    starts = [round(primitive.start * scale) for primitive in found.primitives]
    row = [" "] * len(moments)  # with the names of primitives where there is no room for what they do
    for primitive, start, end in zip(found.primitives, starts, [*starts[1:], len(moments)], strict=True):
        room, words = max(end - start, 0), f"|{primitive.does or primitive.name}"
        name = words if len(words) <= room else f"|{primitive.name}"[:room]
        row[start : start + len(name)] = name
    return (before + later).tolist(), "".join(row)


def _rows(found: ExplainedCandidate) -> list[Styled]:
    """Axis, primitives, critical time, the state, and every literal with its cameras."""
    time, samples = found.time or 0.0, found.samples
    shown, primitives = _placed(found, time)

    def row(label: str, states: Sequence[State], signs: Sequence[tuple[str, str]] | None = None) -> Styled:
        share = covered_share(samples, states)
        signs = _signs([(states[i], "-") for i in shown]) if signs is None else signs
        style = "" if label.startswith(" ") else "bold"
        return joined([*_label(label, style), *signs, "" if share is None else f" {100 * share:5.1f} %"])

    rows: list[Styled] = [
        f"{'':{LABEL_WIDTH}}0{f'{time:.1f} s':>{_width() - 1}}",
        styled(" " * LABEL_WIDTH + primitives),
    ]
    if interesting := "".join("◆" if samples[i].event else " " for i in shown).rstrip():
        rows.append(styled("critical time".ljust(LABEL_WIDTH) + interesting.ljust(len(shown))))
    rows.append(row("everything", [sample.covered for sample in samples]))
    for atom, says in found.says.items():
        literals = found.found_of(atom)
        rows += ["", row(says, [None if one is None else one.covered for one in literals])]
        for camera in found.cameras:
            verdicts = [None if one is None else one.cameras[camera] for one in literals]
            signs = [NOT_REQUIRED if (one := verdicts[i]) is None else SIGNS[one.cause][:2] for i in shown]
            rows.append(row(f"  {camera}", [None if one is None else one.covered for one in verdicts], signs))
    return rows


def _signs(states: Iterable[tuple[State, str]]) -> list[tuple[str, str]]:
    """A sign for each state, with what stands for one that is not covered."""
    return [NOT_REQUIRED if one is None else SIGNS[None][:2] if one else (missed, "red") for one, missed in states]
