"""The coverage of a candidate as rows of signs over time, one per literal and camera."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from sqrp_cli.figures import FIGURE_NAMES, shown_figure
from sqrp_cli.show.documents.explanation import ExplainedAll, ExplainedCandidate, Explanation, Sample
from sqrp_cli.show.sentences import accuracy, part_shares_in_words, what_to_move
from sqrp_cli.show.terminal.console import (
    Column,
    Styled,
    joined,
    output,
    print_table,
    say,
    say_assumed,
    styled,
    unbroken,
)
from sqrp_cli.study.result import CandidateResult

MOST_SIGNS = 50  # signs in a row if the terminal is wide enough; each stands for an equal share of the motion's time
LEAST_SIGNS = 10  # least number of signs in a row, even in a narrow terminal
FIGURES_WIDTH = 12  # width of the figures behind the rows
LABEL_WIDTH = 18  # width of the names in front of the rows

SIGNS: Mapping[str | None, tuple[str, str, str]] = {
    None: ("█", "green", "covered"),
    "hidden": ("h", "red", "hidden"),
    "out_of_image": ("o", "blue", "out of image"),
    "too_far": ("f", "yellow", "too far"),
    "detector_far": ("f", "yellow", "too far"),
    "too_near": ("n", "yellow", "too near"),
    "detector_near": ("n", "yellow", "too near"),
    "oblique": ("a", "magenta", "angle"),
    "too_small": ("s", "magenta", "too small"),
    "behind": ("l", "yellow", "looks away"),
    "same_colour": ("c", "red", "same colour behind"),
    "too_dark": ("d", "red", "too dark"),
    "too_bright": ("b", "red", "too bright"),
}
"""Sign, colour and words of each cause, in the order of the legend; None: covered."""

SELDOM = ("behind", "same_colour", "too_dark", "too_bright")  # in the legend only where a camera does not see for that
NOT_REQUIRED = ("·", "dim")  # sign where no formula requires a literal


def print_explanation(found: Explanation) -> None:
    """The timeline of a candidate, the totals of its causes, the verdict and its accuracy.

    For an infeasible candidate, the reasons.
    """
    title = found.name if found.step is None else f"Step {found.step} of {found.of_steps}, {found.task}"
    if found.sampling is None:
        say(f"{title} is infeasible:")
        for reason in found.reasons:
            say(f"- {reason}")
        return
    rank = "infeasible" if found.rank is None else f"rank {found.rank}" + ", Pareto-optimal" * found.pareto
    figures = [] if found.step is not None else [rank]
    figures += [f"way {found.choice}"] if found.has_choice else []
    figures.append(f"time {found.time:.2f} s")
    figures += [f"{FIGURE_NAMES[name]} {shown_figure(name, getattr(found, name))}" for name in ("q_eoi", "q_avg")]
    if found.step is None:
        say(joined([(title, "bold"), ": ", unbroken(figures), "\n"]))
    else:
        say(joined([(title, "bold"), "" if found.whole is None else f"; the whole, {found.whole}, is {rank}"]))
        say(joined([unbroken(figures), "\n"]))
    for row in _rows(found):
        say(row)
    seen = {one.cause for one in found.unseen_times}
    legend = dict.fromkeys(f"{s} {words}" for cause, (s, _, words) in SIGNS.items() if cause not in {*SELDOM} - seen)
    say(styled(unbroken(f"{one.name} {one.does}" for one in found.primitives), "dim"))
    say(styled(unbroken([*legend, "- not covered", "· not required"], "  "), "dim"))
    _print_faults(found)
    say_assumed(found.assumed if found.faults else "")
    say(f"\n{_camera_failures(found)}")
    if found.unseen_times:
        say()
        rows = []
        for one in found.unseen_times:
            because = one.words if one.box is None else f"box {one.box} is {one.words}"
            rows.append((one.literal, one.camera, f"{one.seconds:.2f}", because))
        columns = [Column("literal"), Column("camera"), Column("seconds", right=True)]
        print_table([*columns, Column("does not see it because")], rows)
    if found.hidden:
        say()
        columns = [Column("literal"), Column("camera"), Column("hidden", right=True)]
        print_table(
            [*columns, Column("of which first on the ray", shrink=True)],
            [(o.literal, o.camera, f"{100 * o.hidden:.1f} %", part_shares_in_words(o.parts)) for o in found.hidden],
        )
    say(f"\n{' '.join(filter(None, (found.verdict, what_to_move(found.to_move))))}")
    say(styled(accuracy(found.sampling, [found]), "dim"))


def _print_faults(found: CandidateResult) -> None:
    """When each fault is noticed."""
    for name, fault in found.faults.items():
        retried = name in found.retried and fault.expected_time is not None
        done = f"; done after one retry at {fault.expected_time:.1f} s" if retried else ""
        mean = "" if fault.delay_mean is None else f"noticed after {fault.delay_mean:.2f} s on average, "
        worst = f"{fault.delay_worst:.2f} s at worst" if fault.delay_worst is not None else ""
        never = f"never in {100 * fault.unseen:.3g} % of cases, as no image is sure to show it"
        say(f"\n{name}: {mean}{worst or never}; longest blind stretch {fault.blind_longest:.2f} s{done}")


def print_comparison(found: ExplainedAll) -> None:
    """The coverage of every candidate on one time scale, a row each, and the verdicts."""
    feasible = [one for one in found.candidates if one.sampling is not None]
    longest = max((one.time or 0.0 for one in feasible), default=0.0)
    say(f"{'':{LABEL_WIDTH}}0{f'{longest:.1f} s':>{_width() - 1}}")
    for one in found.candidates:
        if one.sampling is None:
            say(joined([*_label(one.name, ""), (f"infeasible: {one.reasons[0]}", "red")]))
            continue
        shown, primitives = _placed(one, longest)
        signs = _signs([(sample.covered, "!" if sample.event else "-") for sample in (one.samples[i] for i in shown)])
        figures = "".join(" " + ("    -" if q is None else f"{100 * q:5.1f}") for q in (one.q_eoi, one.q_avg))
        say(joined([*_label(one.name), *signs, figures]))
        say(styled(" " * LABEL_WIDTH + primitives))
    legend = "On the right Q_eoi and Q_avg [%]. █ covered  - not covered  ! not covered in an event of interest"
    say(styled(legend, "dim"))
    if feasible:
        say(styled(unbroken(f"{one.name} {one.does}" for one in feasible[0].primitives), "dim"))
    for one in feasible:
        say(f"\n{one.name}: {one.verdict}")
    if done := [one.sampling for one in feasible if one.sampling is not None]:
        error = max((one.error for one in done if one.error is not None), default=None)
        gap = max((one.max_gap for one in done if one.max_gap is not None), default=None)
        say(styled(f"\n{accuracy(replace(done[0], error=error, max_gap=gap), feasible)}", "dim"))


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
        return "All that has to be seen is never seen at once, so that no camera is missed if it fails."
    for name, without in found.without_camera.items():
        losses = [
            f"{FIGURE_NAMES[name]} to {shown_figure(name, left)}"
            for name, left, now in (("q_eoi", without.q_eoi, found.q_eoi), ("q_avg", without.q_avg, found.q_avg))
            if left is not None and now is not None and round(left, 3) < round(now, 3)
        ]
        if losses:
            needed.append(f"without {name} {' and '.join(losses)}")
        else:
            spare.append(name)
    parts = [f"If a camera fails: {'; '.join(needed)}." if needed else "No single camera is needed."]
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
    """The sample that each sign of a row stands for, on a scale of `longest` seconds: the nearest to its middle.

    With the name of each primitive at its beginning, as far as there is room before the next.
    """
    scale, t = _width() / max(longest, 1e-9), np.array([sample.t for sample in found.samples])
    moments = (np.arange(round((found.time or 0.0) * scale)) + 0.5) / scale
    before = np.clip(np.searchsorted(t, moments, side="right") - 1, 0, len(t) - 2)
    later = t[before + 1] - moments < moments - t[before]
    starts = [round(primitive.start * scale) for primitive in found.primitives]
    row = [" "] * len(moments)
    for primitive, start, end in zip(found.primitives, starts, [*starts[1:], len(moments)], strict=True):
        name = f"|{primitive.name}"[: max(end - start, 0)]
        row[start : start + len(name)] = name
    return (before + later).tolist(), "".join(row)


def _rows(found: ExplainedCandidate) -> list[Styled]:
    """Axis, primitives, events of interest, the state, and every literal with its cameras."""
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
        rows.append(styled("event of interest".ljust(LABEL_WIDTH) + interesting.ljust(len(shown))))
    rows.append(row("all literals", [sample.covered for sample in samples]))
    for atom in dict.fromkeys(name.removeprefix("not ") for name in found.targets):
        literals = [one.literals.get(atom) or one.literals.get(f"not {atom}") for one in samples]
        rows += ["", row(atom, [None if one is None else one.covered for one in literals])]
        for camera in found.cameras:
            verdicts = [None if one is None else one.cameras[camera] for one in literals]
            signs = [NOT_REQUIRED if (one := verdicts[i]) is None else SIGNS[one.cause][:2] for i in shown]
            rows.append(row(f"  {camera}", [None if one is None else one.covered for one in verdicts], signs))
    return rows


def _signs(states: Iterable[tuple[State, str]]) -> list[tuple[str, str]]:
    """A sign for each state, with what stands for one that is not covered."""
    return [NOT_REQUIRED if one is None else SIGNS[None][:2] if one else (missed, "red") for one, missed in states]
