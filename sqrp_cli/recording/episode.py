"""What a recording is, and what becomes of clocks that jitter, repeat, step back or pause."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from sqrp_cli.errors import Place, bad_input
from sqrp_cli.geometry import Array, Indices
from sqrp_cli.records import dataclass

MOST_NUMBERS, MOST_NAMES = 20_000_000, 1000
"""Most numbers that are in memory at once, those of 20 joints at 100 Hz for nearly three hours; most names."""
STEP_BACK, LONGEST = 0.1, 12 * 3600.0
"""A clock that goes back by more [s] is not that of one motion, nor is one that spans more [s]."""
GAP, GAP_STEPS = 0.5, 5.0  # A pause between states is told from this on [s], if it is as many usual steps, too
SLOW, FEW = 1.0, 10
"""States that are usually farther apart [s] are told, unless they are so few, as points that somebody taught are."""
HELD = "held"  # A name of programs and logs beside their joints: 1 while the tool holds something, else 0


@dataclass(frozen=True, eq=False)
class Episode:
    """One motion; between two times its values are linear.

    times: strictly rising from 0, shape (T,) [s]. values: as they are stored, shape (T, N), a column for each name of
    the recording. frames: the number of each state in its file, (T,), from 0 unless that numbers them. told: what was
    done to its clock or is doubtful in it, in sentences; empty for a clean one.
    """

    times: Array
    values: Array
    frames: Indices
    told: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording that can be read, episode by episode, as often as asked for.

    read: gives an episode by its index, keeping the last one in memory; raises InputError for damage.
    units: of names that have one: `rad` (or m, of joints that slide), `deg`, `mm`, `percent`. episodes: their names.
    Raises InputError without joints or episodes, and for names that are given twice or too many.
    """

    path: Path
    kind: str
    names: tuple[str, ...]
    read: Callable[[int], Episode]
    units: Mapping[str, str]
    episodes: tuple[str, ...] = ("0",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "read", lru_cache(maxsize=1)(self.read))
        if not self.names or not self.episodes:
            message = f"this {self.kind} has no {'episodes' if self.names else 'joints'}"
            raise bad_input("empty-recording", message, Place(self.path))
        if (count := len({*self.names})) < len(self.names) or count > MOST_NAMES:
            message = f"this {self.kind} has {count:,} names of {len(self.names):,} columns; expected one each"
            raise bad_input("wrong-columns", f"{message}, {MOST_NAMES:,} at most", Place(self.path))

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of its episodes, in order: their names, if these are different whole numbers, else from 0 on."""
        own = tuple(int(name) for name in self.episodes if name.isdecimal())
        return own if len({*own}) == len(self.episodes) else tuple(range(len(self.episodes)))


def pauses(times: Array) -> tuple[str, ...]:
    """What is told of pauses in rising times, (n,) [s]: at most one sentence."""
    steps = np.diff(times)
    if not len(steps) or not (count := np.count_nonzero(steps > max(GAP, GAP_STEPS * np.median(steps)))):
        return ()
    longest = int(np.argmax(steps))
    begin = times[longest] - times[0]
    return (f"{count:,} pauses without states, the longest of {steps[longest]:.2f} s from {begin:.2f} s on",)


def episode_of(
    states: Array, names: Sequence[str], place: Place, what: str, rate: float | None, frames: Indices | None = None
) -> Episode:
    """An episode of states as a file has them, in its order; what: how messages call it.

    states: times on any clock [s], then values, shape (T, 1 + N). rate: if one is stated [Hz], times do not count.
    frames: numbers of the states, (T,); by default from 0 on.

    Jitter stays: each state counts at its own time. Of states at one time the first one counts; those that are up to
    `STEP_BACK` before an earlier one are put in order. Pauses are told. Raises InputError without states, for numbers
    that are not finite, for a clock that goes back, repeats more than half of its times or spans more than `LONGEST`.
    """
    if not len(states):
        raise bad_input("empty-recording", f"{what} has no states", place)
    if rate is not None:
        states = np.column_stack([np.arange(len(states)) / rate, states[:, 1:]])
    if len(wrong := np.argwhere(~np.isfinite(states))):
        name = ("its time", *(f"`{name}`" for name in names))[wrong[0, 1]]
        message = f"{what}: of state {wrong[0, 0] + 1:,}, {name} is no finite number, the first of {len(wrong):,}"
        raise bad_input("not-finite", message, place, mend="leave out the states that are not known")
    times = states[:, 0]
    back = np.maximum.accumulate(times) - times
    rising, first = np.unique(times, return_index=True)
    twice, late = len(times) - len(rising), np.count_nonzero(back)
    wrong_clock = [
        (back.max() > STEP_BACK, f"goes back by {back.max():.3g} s at state {np.argmax(back) + 1:,}"),
        (2 * twice > len(times), f"gives {twice:,} of {len(times):,} states the time of another one"),
        (rising[-1] - rising[0] > LONGEST, f"spans {(rising[-1] - rising[0]) / 3600:,.0f} hours"),
    ]
    for said in (said for holds, said in wrong_clock if holds):
        message = f"{what}: its clock {said}; expected that of one motion"
        mend = "cut the recording, or state its rate, so that its times do not count"
        raise bad_input("wrong-clock", message, place, mend=mend)
    told = [f"{twice:,} states have the time of another one and are left out"] if twice else []
    told += [f"{late:,} states came late and are put in order"] if late else []
    if len(rising) > FEW and (step := float(np.median(np.diff(rising)))) >= SLOW:
        told += [f"its states are usually {step:.4g} s apart: check that its times are in seconds"]
    numbers = first if frames is None else frames[first]
    return Episode(rising - rising[0], states[first, 1:], numbers, (*told, *pauses(rising)))


def alone(path: Path, kind: str, names: Sequence[str], states: Array, rate: float | None, *told: str) -> Recording:
    """A recording of one episode in SI, see `episode_of`; told: what is doubtful beside its clock."""
    found = episode_of(states, names, Place(path), f"this {kind}", rate)
    episode, units = replace(found, told=(*found.told, *told)), {name: "rad" for name in names if name != HELD}
    return Recording(path, kind, tuple(names), lambda _: episode, units)
