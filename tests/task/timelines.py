"""Random time lines that no cameras were asked for: any samples, covered or not as it comes."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from hypothesis import strategies as st

from sqrp_cli.geometry import Array
from sqrp_cli.logic.formula_time import GroundOperator, TimeInterval
from sqrp_cli.logic.literal import Atom, Literal
from sqrp_cli.study.observation import Observation
from sqrp_cli.study.stage import Samples, Stage
from sqrp_cli.study.timeline import ObservationRequest, Timeline
from sqrp_cli.task.pieces import cut_into_pieces, monitored_times
from tests.task.studies import always, eventually

ATOMS = (Atom("hold"), Atom("placed"))
RESPONSES = (0.09, 0.15, 0.3)


@dataclass(frozen=True, eq=False)
class Story:
    """A time line with the formulas behind it; `interval` is that of the fault `slip`. total: of the motion [s]."""

    timeline: Timeline
    formulas: tuple[GroundOperator, ...]
    interval: TimeInterval
    total: float


def make_story(
    durations: list[float], formulas: tuple[GroundOperator, ...], counts: list[int], seed: int, seen: float
) -> Story:
    """Samples at random instants, each covered with probability `seen`; the last formula is that of the fault."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(durations)
    pieces = cut_into_pieces(list(zip(ends - durations, ends, strict=True)), formulas)
    number, t = [], []
    for index, piece in enumerate(pieces):
        inner = np.sort(rng.uniform(piece.start, piece.end, counts[index % len(counts)]))
        instants = [piece.start, *inner, piece.end] if piece.end > piece.start else [piece.start]
        number += [index] * len(instants)
        t += instants
    samples = Samples(np.array(number), np.array(t))
    required = np.array([[any(lit.atom == a for lit in piece.literals) for a in ATOMS] for piece in pieces])[number]
    covered = required & (rng.random(required.shape) < seen)
    response = np.where(covered, rng.choice(RESPONSES, required.shape), np.nan)
    operator = formulas[-1]
    columns = tuple(ATOMS.index(literal.atom) for literal in operator.literals)
    T, T_eoi = monitored_times(formulas)
    primitives = [SimpleNamespace(held=None)] * len(durations)
    stage = Stage(None, SimpleNamespace(primitives=primitives), pieces, {})  # type: ignore[arg-type]
    timeline = Timeline(
        request=ObservationRequest(stage=stage, targets=(), faults={"slip": columns}, T=T, T_eoi=T_eoi),
        samples=samples,
        observation=Observation(
            looked=np.ones(len(required), dtype=bool),
            required=required,
            known=required,
            covered=covered,
            response=response,
            matrix=None,
        ),
    )
    return Story(timeline, formulas, TimeInterval(operator.start, operator.end), float(ends[-1]))


@st.composite
def stories(draw: st.DrawFn) -> Story:
    """Motions of one to four primitives with up to four formulas, some at an instant, some touching, some apart."""
    durations = draw(st.lists(st.sampled_from([0.5, 1.0, 1.7]), min_size=1, max_size=4))
    total = sum(durations)
    edge = st.sampled_from([0.0, 0.25, 0.5, 0.6, 1.0, 1.5, 2.0, 2.2, total]).map(lambda t: min(t, total))
    literals = st.sampled_from(
        [(Literal(ATOMS[0]),), (Literal(ATOMS[1], positive=False),), (Literal(ATOMS[0]), Literal(ATOMS[1]))]
    )
    formulas = []
    for kind in draw(st.lists(st.sampled_from([always, eventually]), max_size=3)):
        start, end = sorted((draw(edge), draw(edge)))
        formulas.append(kind(start, end, *draw(literals)))
    start, end = sorted((draw(edge), draw(edge)))
    formulas.append(eventually(start, end, *draw(literals), fault="slip"))
    counts = draw(st.lists(st.integers(0, 6), min_size=1, max_size=5))
    seed, seen = draw(st.integers(0, 2**32 - 1)), draw(st.sampled_from([0.0, 0.3, 0.6, 0.9, 1.0]))
    return make_story(durations, tuple(formulas), counts, seed, seen)


def stretches(formulas: tuple[GroundOperator, ...], kinds: tuple[str, ...]) -> list[tuple[float, float]]:
    """The union of the intervals of some operators, as intervals in order."""
    intervals = sorted((f.start, f.end) for f in formulas if f.operator in kinds)
    union: list[tuple[float, float]] = []
    for start, end in intervals:
        if union and start <= union[-1][1] + 1e-9:
            union[-1] = (union[-1][0], max(union[-1][1], end))
        else:
            union.append((start, end))
    return union


def fault_response(timeline: Timeline, fault: str) -> Array:
    """Time from a fault until images show it [s], NaN where it is not covered, shape (m,)."""
    response: Array = timeline.observation.response[:, list(timeline.request.faults[fault])].max(axis=1)
    return response


def moments(story: Story) -> list[tuple[float, bool, float]]:
    """Time, whether the fault is covered, and the response then, of every sample in order."""
    timeline = story.timeline
    t: Array = timeline.samples.t
    response = fault_response(timeline, "slip")
    return list(zip(t.tolist(), ~np.isnan(response), response, strict=True))
