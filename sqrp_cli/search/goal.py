"""The goal of a candidate: least qualities and longest times; and the kinds of changes that may lead to it."""

from __future__ import annotations

from collections.abc import Iterator
from math import degrees, inf
from typing import TYPE_CHECKING, Literal

from sqrp_cli.document import Record
from sqrp_cli.errors import bad_option, expected_names
from sqrp_cli.figures import FIGURE_NAMES, Qualities, falls_short, shown_figure
from sqrp_cli.files.units import SHARE, TIME, read_quantity
from sqrp_cli.records import dataclass
from sqrp_cli.study.result import CandidateResult

if TYPE_CHECKING:
    from sqrp_cli.cell.workspace import ExpectedTask

Kind = Literal["way", "path", "object", "aim", "position", "lens", "camera"]
Unit = Literal["m", "rad", "camera", ""]  # Of the size of a change; empty where there is nothing to measure
KINDS: tuple[Kind, ...] = ("way", "path", "object", "aim", "position", "lens", "camera")
"""In the order in which they are thought of: the motion first, then what it handles, cameras last."""
MOTION: tuple[Kind, ...] = ("way", "path")  # Those that change nothing in the cell
Objective = Literal["least", "mean"]  # Which quality of all candidates counts
QUALITIES = ("q_eoi", "q_avg")
TIMES = ("time", "delay")
NAMES = (*QUALITIES, *TIMES)  # The figures that a goal may be about
_NEVER = 1e3  # A fault that is never noticed misses the delay of a goal as if it took so many times as long


def shown_size(size: float, unit: str) -> str:
    """A size as people say it: centimetres or degrees."""
    match unit:
        case "m":
            return f"{100 * size:.1f} cm" if size < 1 else f"{size:.2f} m"
        case "rad":
            return f"{degrees(size):.1f} deg"
        case _:
            return ""


@dataclass(frozen=True, kw_only=True)
class Goal(Record):
    """Least qualities and longest times; null where anything will do."""

    q_eoi: float | None = None
    """Least Q_eoi, in 0..1."""
    q_avg: float | None = None
    """Least Q_avg, in 0..1."""
    time: float | None = None
    """Longest duration of the motion [s]."""
    delay: float | None = None
    """Longest time until a fault is noticed [s]."""

    def __str__(self) -> str:
        parts = [f"{FIGURE_NAMES[name]} {100 * value:.4g} %" for name, value, _ in self._stated(QUALITIES)]
        return ", ".join([*parts, *(f"{FIGURE_NAMES[name]} {value:.4g} s" for name, value, _ in self._stated(TIMES))])

    def missed(self, found: CandidateResult) -> tuple[str, ...]:
        """One short text for each part that a candidate does not meet, such as `time seen 0.0 %, not 100 %`."""
        if not found.feasible:
            return (f"it cannot be done: {found.reasons[0]}",)
        missed = []
        for name, least, quality in self._stated(QUALITIES, found):
            if quality is None:
                missed.append(f"{FIGURE_NAMES[name]} is undefined")
            elif falls_short(quality, least):
                missed.append(f"{FIGURE_NAMES[name]} {shown_figure(name, quality)}, not {100 * least:.4g} %")
        for name, most, time in self._stated(TIMES, found):
            if time == inf:
                share = f"{100 * (found.unseen or 0.0):.3g} % of cases"
                missed.append(f"a fault may never be noticed ({share}), not after {most:.4g} s")
            elif time is not None and time > most:
                missed.append(f"{FIGURE_NAMES[name]} {shown_figure(name, time)}, not {most:.4g} s")
        return tuple(missed)

    def met(self, found: CandidateResult) -> bool:
        """Whether a candidate meets all of it."""
        return not self.missed(found)

    def may_be_met(self, seen: Qualities) -> bool:
        """Whether qualities meet it; nothing is known of times yet."""
        known = self._stated(QUALITIES, seen)
        return not any(quality is None or falls_short(quality, least) for _, least, quality in known)

    def shortfall(self, found: CandidateResult | None) -> float:
        """By how much a candidate misses it: qualities and shares of times, added up; infinite if infeasible."""
        if found is None or not found.feasible:
            return inf
        missing = sum(max(0.0, least - (quality or 0.0)) for _, least, quality in self._stated(QUALITIES, found))
        times = self._stated(TIMES, found)
        missing += sum(max(0.0, min(time or 0.0, most * _NEVER) / most - 1.0) for _, most, time in times)
        return missing + (0.0 if self.delay is None else found.unseen or 0.0)

    def is_nearer(self, found: CandidateResult | None, start: CandidateResult) -> bool:
        """Whether a candidate misses it by less than another one, so that the figures show it."""
        shown = found is not None and self.missed(found) != self.missed(start)
        return shown and self.shortfall(found) < self.shortfall(start)

    def _stated(self, names: tuple[str, ...], found: object = None) -> Iterator[tuple[str, float, float | None]]:
        """Its parts that are stated: name, value, and figure of a candidate; a delay is infinite if it may be never."""
        for name in names:
            if (value := getattr(self, name)) is not None:
                yield name, value, getattr(found, "latest" if name == "delay" else name, None)


def read_goal(text: str) -> Goal:
    """A goal such as `q_eoi 100 %, time 20 s`, or as texts say it; a plain quality is in 0..1.

    Raises InputError for anything else.
    """
    found: dict[str, float] = {}
    for part in map(str.strip, text.split(",")):
        said = next((name for name in NAMES if part.lower().startswith(f"{FIGURE_NAMES[name]} ")), None)
        part = part if said is None else said + part[len(FIGURE_NAMES[said]) :]
        named, _, value = part.replace("=", " ").partition(" ")
        name, why = named.lower(), ""
        dimension, quantity = SHARE if name in QUALITIES else TIME, read_quantity(value.strip())
        if name not in NAMES:
            why = expected_names(named, NAMES) if named else "one part is empty"
        elif quantity is None or quantity.dimension not in (None, dimension) or quantity.value < 0:
            example = "100 %" if dimension is SHARE else "20 s"
            why = f"expected {dimension.name} after `{named}`, such as `{named} {example}`"
        elif dimension is SHARE and quantity.value > 1:
            why = f"`{named}` is at most 100 %, which is 1 without a unit"
        elif dimension is TIME and quantity.value == 0:
            why = f"`{named}` takes more than 0 s"
        elif name in found:
            why = f"`{named}` is stated twice"
        if why or quantity is None:
            raise bad_option(f"the goal is `{text}`: {why}", mend='write parts such as "q_eoi 100 %, time 20 s"')
        found[name] = quantity.value
    return Goal(**found)


def goal_of(expected: ExpectedTask | None) -> Goal:
    """The thresholds of a task that a workspace lists; Q_eoi 100 % where there are none."""
    if expected is None:
        return Goal(q_eoi=1.0)
    stated = Goal(q_eoi=expected.min_q_eoi, q_avg=expected.min_q_avg, time=expected.max_time, delay=expected.max_delay)
    return stated if str(stated) else Goal(q_eoi=1.0)
