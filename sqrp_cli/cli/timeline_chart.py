"""The coverage of a candidate as rows of signs over time, one per literal and camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sqrp_cli.cli.console import Column, Styled, joined, plain, print_table, say
from sqrp_cli.programming.assessment import Study
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.explanation import CauseTotal, cause_totals, first_failures, sample_weights
from sqrp_cli.programming.ranking import Ranked
from sqrp_cli.programming.sensing.cause import Cause

WIDTH = 50
"""Signs in a row; each stands for an equal share of the motion's time."""

LABEL = 20
"""Width of the names in front of the rows."""

SIGNS: dict[Cause, tuple[str, str]] = {
    Cause.NONE: ("█", "green"),
    Cause.TOO_NEAR: ("n", "yellow"),
    Cause.TOO_FAR: ("f", "yellow"),
    Cause.OUT_OF_IMAGE: ("o", "blue"),
    Cause.DETECTOR_NEAR: ("n", "yellow"),
    Cause.DETECTOR_FAR: ("f", "yellow"),
    Cause.OBLIQUE: ("a", "magenta"),
    Cause.TOO_SMALL: ("s", "magenta"),
    Cause.HIDDEN: ("h", "red"),
}
"""Sign and colour of each cause."""

LEGEND = "█ covered  h hidden  o out of image  f too far  n too near  a angle  s too small  - not covered  · not asked"


def print_study(cell: Cell, study: Study, ranked: Ranked) -> None:
    """The timeline of a feasible candidate, the totals of its causes and the verdict."""
    assessment = ranked.assessment
    figures = [f"time {assessment.time:.2f} s"]
    for label, quality in (("Q_eoi", assessment.q_eoi), ("Q_avg", assessment.q_avg)):
        figures.append(f"{label} {'-' if quality is None else f'{100 * quality:.1f} %'}")
    place = f"rank {ranked.rank}" + (", Pareto-optimal" if ranked.pareto else "")
    say(joined([(assessment.candidate.name, "bold"), f": {place}, {', '.join(figures)}\n"]))
    chart = _Chart(cell, study)
    for row in chart.rows():
        say(row)
    say(plain(LEGEND, "dim"))
    for name, fault in assessment.faults.items():
        unseen = f", in {100 * fault.unseen:.0f} % of cases only at the end" if fault.unseen else ""
        say(
            f"\n{name}: noticed after {fault.delay_mean:.2f} s on average, {fault.delay_worst:.2f} s at worst{unseen};"
            f" longest blind stretch {fault.blind_longest:.2f} s; done after one retry at {fault.expected_time:.1f} s"
        )
    totals = cause_totals(cell, study)
    if totals:
        say()
        print_table(
            [Column("literal"), Column("camera"), Column("seconds", right=True), Column("does not see it because")],
            ((str(t.atom), t.camera, f"{t.duration:.2f}", _because(t)) for t in totals),
        )
    say(f"\n{assessment.verdict}")


def _because(total: CauseTotal) -> str:
    words = str(total.cause.label).replace("_", " ")
    match total.cause:
        case Cause.HIDDEN:
            return f"{words} by {total.by}"
        case Cause.OUT_OF_IMAGE:
            return f"{words} ({total.by})"
        case _:
            return words


class _Chart:
    """Rows over the time of one study."""

    def __init__(self, cell: Cell, study: Study) -> None:
        self._cell, self._study = cell, study
        self._time = study.motion.time
        self._moments = (np.arange(WIDTH) + 0.5) / WIDTH * self._time
        samples = study.timeline.samples
        before = np.clip(np.searchsorted(samples.t, self._moments, side="right") - 1, 0, len(samples) - 2)
        later = samples.t[before + 1] - self._moments < self._moments - samples.t[before]
        self._row: NDArray[np.int64] = before + later
        self._weights = sample_weights(study)

    def rows(self) -> list[Styled]:
        """Axis, primitives, events of interest, the state, and every literal with its cameras."""
        study, timeline = self._study, self._study.timeline
        interesting = "".join("◆" if flag else " " for flag in timeline.interesting[self._row])
        rows: list[Styled] = [self._labelled("", self._axis()), self._labelled("", self._primitives())]
        if interesting.strip():
            rows.append(self._labelled("event of interest", interesting))
        covered, monitored = timeline.covered, timeline.monitored
        rows.append(self._coverage("all literals", covered, monitored, bold=True))
        observation = timeline.observation
        for column, (target, boxes) in enumerate(zip(study.targets, observation.full_matrix, strict=True)):
            required = observation.required[:, column]
            rows.append("")
            rows.append(self._coverage(str(target.atom), observation.covered[:, column], required, bold=True))
            for index, camera in enumerate(self._cell.observer.cameras):
                causes = [failure.cause for failure in first_failures(boxes, np.arange(len(required)), index)]
                signs = [SIGNS[causes[row]] if required[row] else ("·", "dim") for row in self._row]
                seen = np.array([cause is Cause.NONE for cause in causes])
                rows.append(joined([f"  {camera.name}".ljust(LABEL), *signs, self._share(seen & required, required)]))
        return rows

    def _coverage(self, label: str, covered: NDArray[np.bool_], asked: NDArray[np.bool_], *, bold: bool) -> Styled:
        signs = [
            (("█", "green") if covered[row] else ("-", "red")) if asked[row] else ("·", "dim") for row in self._row
        ]
        return joined([(label.ljust(LABEL)[:LABEL], "bold" if bold else ""), *signs, self._share(covered, asked)])

    def _share(self, covered: NDArray[np.bool_], asked: NDArray[np.bool_]) -> str:
        total = float(self._weights[asked].sum())
        return f" {100 * float(self._weights[covered & asked].sum()) / total:5.1f} %" if total else ""

    def _labelled(self, label: str, row: str) -> Styled:
        return plain(label.ljust(LABEL) + row)

    def _axis(self) -> str:
        end = f"{self._time:.1f} s"
        return "0".ljust(WIDTH - len(end)) + end

    def _primitives(self) -> str:
        """Where each primitive begins: its name, as far as there is room until the next one."""
        row = [" "] * WIDTH
        starts = [round(p.start / self._time * WIDTH) for p in self._study.motion.primitives]
        for primitive, start, end in zip(self._study.motion.primitives, starts, [*starts[1:], WIDTH], strict=True):
            name = f"|{primitive.name}"[: max(end - start, 0)]
            row[start : start + len(name)] = name
        return "".join(row)
