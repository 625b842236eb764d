"""Q_avg and Q_eoi against their definition, walked sample by sample."""

from __future__ import annotations

import pytest
from hypothesis import given

from sqrp_cli.logic.literal import Literal
from sqrp_cli.task.pieces import Piece
from tests.task.studies import ATOMS, Story, always, eventually, make_story, stories, stretches

BOTH = ("always", "eventually")


def defined_quality(story: Story, kinds: tuple[str, ...]) -> float | None:
    """Runs of consecutive covered samples inside one stretch, last minus first, over the length of all stretches."""
    union = stretches(story.formulas, kinds)
    length = sum(end - start for start, end in union)
    if length <= 0:
        return None

    def stretch_of(piece: Piece) -> int | None:
        middle = (piece.start + piece.end) / 2
        return next((k for k, (start, end) in enumerate(union) if start - 1e-9 <= middle <= end + 1e-9), None)

    timeline, total = story.timeline, 0.0
    run: list[float] = []
    inside: int | None = None
    samples, seen = timeline.samples, timeline.observation
    for t, number, required, covered in zip(samples.t, samples.piece, seen.required, seen.covered, strict=True):
        stretch = stretch_of(timeline.planned.stage.pieces[number])
        good = stretch is not None and required.any() and all(c for c, r in zip(covered, required, strict=True) if r)
        if run and (not good or stretch != inside):
            total += run[-1] - run[0]
            run = []
        if good:
            run.append(t)
        inside = stretch
    return (total + (run[-1] - run[0] if run else 0.0)) / length


@given(story=stories())
def test_quality_is_the_length_of_the_covered_runs_over_formula_time_or_within_the_events(story: Story) -> None:
    found = story.timeline.qualities
    assert found.q_avg == pytest.approx(defined_quality(story, BOTH))
    assert found.q_eoi == pytest.approx(defined_quality(story, ("eventually",)))
    assert all(quality is None or 0.0 <= quality <= 1.0 + 1e-12 for quality in (found.q_avg, found.q_eoi))


@given(story=stories())
def test_covered_is_null_exactly_where_no_formula_applies(story: Story) -> None:
    timeline = story.timeline
    applies = [
        any(start - 1e-9 <= piece.start and piece.end <= end + 1e-9 for start, end in stretches(story.formulas, BOTH))
        for piece in timeline.planned.stage.pieces
    ]
    assert timeline.monitored.tolist() == [applies[number] for number in timeline.samples.piece]
    assert not (timeline.covered & ~timeline.monitored).any()


HOLD = Literal(ATOMS[0])
TOUCHING = (always(0.0, 1.0, HOLD), always(1.0, 2.0, HOLD.negated()), eventually(1.5, 2.0, HOLD))


@pytest.mark.parametrize(
    ("durations", "formulas", "qualities", "T"),
    [
        # All is covered, even where primitives and formulas touch; the time between two stretches counts neither way.
        ([0.7, 1.3], TOUCHING, (1.0, 1.0), 2.0),
        ([1.0, 1.0, 1.0], (always(0, 1, HOLD), always(2, 3, HOLD)), (1.0, None), 2.0),
        ([1.0], (eventually(0.4, 0.4, HOLD),), (None, None), 0.0),  # at an instant there is no quality
    ],
)
def test_qualities_worked_out_by_hand(durations, formulas, qualities, T):
    story = make_story(durations, formulas, [4], seed=0, seen=1.0)
    found = story.timeline.qualities
    assert (found.q_avg, found.q_eoi) == tuple(one and pytest.approx(one) for one in qualities)
    assert pytest.approx(T) == story.timeline.planned.T
    assert T or story.timeline.monitored.sum() == 1
