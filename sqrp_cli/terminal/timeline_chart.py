"""The coverage of a candidate as rows of signs over time, one per literal and camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.knowledge.camera.camera import assumed_latency
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import Study
from sqrp_cli.programming.coverage.blind_spans import CauseTotal, cause_totals, first_failures
from sqrp_cli.programming.coverage.in_the_way import hidden_views, in_the_way, to_move
from sqrp_cli.programming.coverage.robustness import without_each_camera
from sqrp_cli.programming.coverage.sampling import Sampling
from sqrp_cli.programming.pipeline import Explained, sampling_done
from sqrp_cli.programming.result import CandidateResult
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.whole_study import StepShown
from sqrp_cli.report.sentences import accuracy, part_shares_in_words, what_to_move
from sqrp_cli.terminal.console import Column, Styled, joined, plain, print_table, say, terminal_width, unbroken

MOST_SIGNS = 50
"""Signs in a row if the terminal is wide enough; each stands for an equal share of the motion's time."""

LEAST_SIGNS = 10
"""Least number of signs in a row, even in a narrow terminal."""

FIGURES = 12
"""Width of the figures behind the rows."""

LABEL = 18
"""Width of the names in front of the rows."""

SIGNS: dict[Cause, tuple[str, str]] = {
    Cause.NONE: ("█", "green"),
    Cause.BEHIND: ("l", "yellow"),
    Cause.TOO_NEAR: ("n", "yellow"),
    Cause.TOO_FAR: ("f", "yellow"),
    Cause.OUT_OF_IMAGE: ("o", "blue"),
    Cause.DETECTOR_NEAR: ("n", "yellow"),
    Cause.DETECTOR_FAR: ("f", "yellow"),
    Cause.OBLIQUE: ("a", "magenta"),
    Cause.TOO_SMALL: ("s", "magenta"),
    Cause.HIDDEN: ("h", "red"),
    Cause.SAME_COLOUR: ("c", "red"),
    Cause.TOO_DARK: ("d", "red"),
    Cause.TOO_BRIGHT: ("b", "red"),
}
"""Sign and colour of each cause."""

NOT_REQUIRED = ("·", "dim")
"""Sign where no formula requires a literal."""

LEGEND = (
    *("█ covered", "h hidden", "o out of image", "f too far", "n too near", "a angle", "s too small"),
    *("- not covered", "· not required"),
)
SELDOM = {
    Cause.BEHIND: "l looks away",
    Cause.SAME_COLOUR: "c same colour behind",
    Cause.TOO_DARK: "d too dark",
    Cause.TOO_BRIGHT: "b too bright",
}
"""Added to it where a camera cannot see something for that."""


def print_study(cell: Cell, explained: Explained, sampling: Sampling, step: StepShown | None = None) -> None:
    """The timeline of a candidate, the totals of its causes, the verdict and its accuracy.

    For an infeasible candidate, the reasons. step: that it is, of a task of several or of a program.
    """
    ranked, study = explained.result, explained.study
    assessment = ranked
    if study is None:
        say(f"{_title(assessment, step)} is infeasible:")
        for reason in assessment.reasons:
            say(f"- {reason}")
        return
    _print_head(ranked, step)
    for row in _Chart(study, study.motion.time).rows(cell):
        say(row)
    totals = cause_totals(cell, study)
    seldom = [words for cause, words in SELDOM.items() if any(total.cause is cause for total in totals)]
    say(plain(_doings(study), "dim"))
    say(plain(unbroken([*LEGEND, *seldom], "  "), "dim"))
    _print_faults(assessment)
    if assessment.faults and (assumed := assumed_latency(cell.observer.cameras)):
        say(f"Delays: {assumed}.")
    say(f"\n{_camera_failures(cell, study, assessment)}")
    if totals:
        say()
        print_table(
            [Column("literal"), Column("camera"), Column("seconds", right=True), Column("does not see it because")],
            ((str(t.atom), t.camera, f"{t.duration:.2f}", _because(t)) for t in totals),
        )
    in_the_way_of = _print_occluders(cell, study)
    say(f"\n{assessment.verdict}{in_the_way_of}")
    say(plain(accuracy(sampling_done(sampling, [ranked]), [ranked]), "dim"))


def _doings(study: Study) -> Styled:
    """What each primitive action does."""
    return unbroken(f"{one.name} {one.words}" for one in study.candidate.skill.primitives)


def _print_head(ranked: CandidateResult, step: StepShown | None) -> None:
    """The name of a feasible candidate, its place and figures."""
    assessment = ranked
    figures = [] if step is not None else [_rank_of(ranked)]
    if assessment.has_choice:
        figures.append(f"way {assessment.choice}")
    figures.append(f"time {assessment.time:.2f} s")
    for label, quality in (("Q_eoi", assessment.q_eoi), ("Q_avg", assessment.q_avg)):
        figures.append(f"{label} {'-' if quality is None else f'{100 * quality:.1f} %'}")
    if step is None:
        say(joined([(_title(assessment, step), "bold"), ": ", unbroken(figures), "\n"]))
        return
    of = "" if step.whole is None else f"; the whole, {step.whole.candidate.name}, is {_rank_of(step.whole)}"
    say(joined([(_title(assessment, step), "bold"), of]))
    say(joined([unbroken(figures), "\n"]))


def _title(assessment: CandidateResult, step: StepShown | None) -> str:
    """What a study is about: a candidate, or a step."""
    return assessment.candidate.name if step is None else f"Step {step.number} of {step.steps}, {step.task}"


def _rank_of(ranked: CandidateResult) -> str:
    """The place in a ranking."""
    return "infeasible" if ranked.rank is None else f"rank {ranked.rank}" + ", Pareto-optimal" * ranked.pareto


def _print_faults(assessment: CandidateResult) -> None:
    """When each fault is noticed."""
    for name, fault in assessment.faults.items():
        retried = name in assessment.candidate.skill.retried_faults and fault.expected_time is not None
        done = f"; done after one retry at {fault.expected_time:.1f} s" if retried else ""
        mean = "" if fault.delay_mean is None else f"noticed after {fault.delay_mean:.2f} s on average, "
        worst = f"{fault.delay_worst:.2f} s at worst" if fault.delay_worst is not None else ""
        never = f"never in {100 * fault.unseen:.3g} % of cases, as no image is sure to show it"
        say(f"\n{name}: {mean}{worst or never}; longest blind stretch {fault.blind_longest:.2f} s{done}")


def _print_occluders(cell: Cell, study: Study) -> str:
    """Which parts hide how much; and a sentence about what to move first, after a blank, where that helps."""
    views = hidden_views(cell, study)
    found = in_the_way(cell, study, views)
    if not found:
        return ""
    say()
    columns = [Column("literal"), Column("camera"), Column("hidden", right=True)]
    print_table(
        [*columns, Column("of which first on the ray", shrink=True)],
        ((str(one.atom), one.camera, f"{100 * one.hidden:.1f} %", part_shares_in_words(one.parts)) for one in found),
    )
    sentence = what_to_move(to_move(cell, study, views))
    return f" {sentence}" if sentence else ""


def print_comparison(explained: Sequence[Explained], sampling: Sampling) -> None:
    """The coverage of every candidate on one time scale, a row each, and the verdicts."""
    pairs = [(one.result, one.study) for one in explained]
    longest = max((study.motion.time for _, study in pairs if study is not None), default=0.0)
    say(plain(" " * LABEL + _axis(longest)))
    for ranked, study in pairs:
        name = ranked.candidate.name
        if study is None:
            say(joined([*_label(name, ""), (f"infeasible: {ranked.reasons[0]}", "red")]))
            continue
        chart = _Chart(study, longest)
        figures = f" {_percent(ranked.q_eoi)} {_percent(ranked.q_avg)}"
        say(joined([*_label(name), *chart.state_signs(), figures]))
        say(plain(" " * LABEL + chart.primitives_row()))
    say(
        plain(
            "On the right Q_eoi and Q_avg [%]. █ covered  - not covered  ! not covered in an event of interest", "dim"
        )
    )
    if shown := next((study for _, study in pairs if study is not None), None):
        say(plain(_doings(shown), "dim"))
    for ranked, study in pairs:
        if study is not None:
            say(f"\n{ranked.candidate.name}: {ranked.verdict}")
    if feasible := [ranked for ranked, study in pairs if study is not None]:
        say(plain(f"\n{accuracy(sampling_done(sampling, feasible), feasible)}", "dim"))


def _label(name: str, style: str = "bold") -> list[Styled | tuple[str, str]]:
    """A name in front of a row; a long one gets its own line."""
    return [(name.ljust(LABEL), style), *(["\n" + " " * LABEL] if len(name) >= LABEL else [])]


def _percent(quality: float | None) -> str:
    return "    -" if quality is None else f"{100 * quality:5.1f}"


def _width() -> int:
    """Signs in a row that fit the terminal."""
    return max(LEAST_SIGNS, min(MOST_SIGNS, terminal_width() - LABEL - FIGURES))


def _axis(time: float) -> str:
    end = f"{time:.1f} s"
    return "0".ljust(_width() - len(end)) + end


def _camera_failures(cell: Cell, study: Study, assessment: CandidateResult) -> str:
    """One sentence about the cost of each camera's failure."""
    needed, spare = [], []
    if assessment.q_avg == 0.0:
        return "All that has to be seen is never seen at once, so that no camera is missed if it fails."
    for name, without in without_each_camera(cell, study).items():
        losses = [
            f"{label} to {100 * left:.1f} %"
            for label, left, now in (
                ("Q_eoi", without.q_eoi, assessment.q_eoi),
                ("Q_avg", without.q_avg, assessment.q_avg),
            )
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


def _because(total: CauseTotal) -> str:
    words = total.cause.by(total.by)
    return words if total.box is None else f"box {total.box} is {words}"


class _Chart:
    """Rows over the time of one study, on a scale of `longest` seconds."""

    def __init__(self, study: Study, longest: float) -> None:
        self._study, self._scale = study, _width() / max(longest, 1e-9)
        samples = study.timeline.samples
        moments = (np.arange(round(study.motion.time * self._scale)) + 0.5) / self._scale
        before = np.clip(np.searchsorted(samples.t, moments, side="right") - 1, 0, len(samples) - 2)
        later = samples.t[before + 1] - moments < moments - samples.t[before]
        self._row: NDArray[np.int64] = before + later

    def rows(self, cell: Cell) -> list[Styled]:
        """Axis, primitives, events of interest, the state, and every literal with its cameras."""
        study, timeline = self._study, self._study.timeline
        interesting = "".join("◆" if flag else " " for flag in timeline.interesting[self._row])
        rows: list[Styled] = [plain(" " * LABEL + _axis(study.motion.time)), plain(" " * LABEL + self.primitives_row())]
        if interesting.strip():
            rows.append(plain("event of interest".ljust(LABEL) + interesting))
        rows.append(self._coverage("all literals", timeline.covered, timeline.monitored))
        observation = timeline.observation
        for column, (target, boxes) in enumerate(zip(study.targets, observation.full_matrix, strict=True)):
            required = observation.required[:, column]
            rows += ["", self._coverage(str(target.atom), observation.covered[:, column], required)]
            for index, camera in enumerate(cell.observer.cameras):
                causes = [failure.cause for failure in first_failures(boxes, np.arange(len(required)), index)]
                signs = [SIGNS[causes[row]] if required[row] else NOT_REQUIRED for row in self._row]
                seen = np.array([cause is Cause.NONE for cause in causes])
                share = self._share(seen & required, required)
                rows.append(joined([*_label(f"  {camera.name}", ""), *signs, share]))
        return rows

    def state_signs(self) -> list[tuple[str, str]]:
        """The coverage of the state; gaps in an event of interest are marked."""
        timeline = self._study.timeline
        missed = np.where(timeline.interesting, "!", "-")
        return self._signs(timeline.covered, timeline.monitored, missed)

    def primitives_row(self) -> str:
        """The name of each primitive at its beginning, as far as there is room before the next."""
        primitives = self._study.motion.primitives
        starts = [round(primitive.start * self._scale) for primitive in primitives]
        row = [" "] * len(self._row)
        for primitive, start, end in zip(primitives, starts, [*starts[1:], len(row)], strict=True):
            name = f"|{primitive.name}"[: max(end - start, 0)]
            row[start : start + len(name)] = name
        return "".join(row)

    def _coverage(self, label: str, covered: NDArray[np.bool_], required: NDArray[np.bool_]) -> Styled:
        signs = self._signs(covered, required, np.full(len(required), "-"))
        return joined([*_label(label), *signs, self._share(covered, required)])

    def _signs(
        self, covered: NDArray[np.bool_], required: NDArray[np.bool_], missed: NDArray[np.str_]
    ) -> list[tuple[str, str]]:
        return [
            NOT_REQUIRED if not required[row] else ("█", "green") if covered[row] else (str(missed[row]), "red")
            for row in self._row
        ]

    def _share(self, covered: NDArray[np.bool_], required: NDArray[np.bool_]) -> str:
        """Share of the time between neighbouring samples that are both covered, as Q counts it."""
        steps = np.nan_to_num(self._study.timeline.steps)
        total = float(steps[required[:-1] & required[1:]].sum())
        seen = covered & required
        return f" {100 * float(steps[seen[:-1] & seen[1:]].sum()) / total:5.1f} %" if total else ""
