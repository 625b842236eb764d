"""How measured delays count against predicted ones."""

from __future__ import annotations

import pytest

from sqrp_cli.run.record.report import PROCESSING, SweepDocument, SweptRun

PERIOD = 0.1


def swept(*runs: tuple[float | None, float | None, float | None]) -> SweepDocument:
    """Delay and prediction of each run, and when the slip happened."""
    found = []
    for delay, predicted, happened in runs:
        detected = None if delay is None or happened is None else happened + delay
        known = {"happened": happened, "detected": detected, "predicted_delay": predicted}
        found.append(SweptRun(name="slip", injected=5.0, recovered=20.0, x=5.0, outcome="done", time=20.0, **known))
    asked = {"workspace": "cell", "sweep": "slip@a4", "step": 1, "steps": ["pickup g"]}
    return SweepDocument.of(found, PERIOD, count=len(runs), **asked)


def test_a_delay_is_as_predicted_up_to_the_longest_and_a_step_of_the_physics() -> None:
    off = PERIOD + PROCESSING
    pairs = [(0.15, 0.15), (0.152, 0.15), (0.17, 0.15), (0.3 - off, 0.3), (0.5, 0.15), (0.15, 0.5)]
    found = swept(*((delay, predicted, 5.0) for delay, predicted in pairs))
    assert found.tolerance == pytest.approx(off)
    assert (found.predictable, found.seen) == (6, 6)
    assert (found.as_predicted, found.sooner, found.later) == (3, 1, 2)
    assert [run.excess for run in found.runs if run.excess] == pytest.approx([0.02, 0.35])


def test_what_cannot_be_predicted_or_did_not_happen_does_not_count_and_what_was_missed_is_not_seen() -> None:
    found = swept((0.1, None, 5.0), (None, 0.2, None), (None, 0.2, 5.0), (0.2, 0.2, 5.0))
    assert (found.predictable, found.seen, found.as_predicted) == (2, 1, 1)


def first_words(*runs: tuple[float | None, float | None, float | None]) -> str:
    return " ".join(str(swept(*runs)).split("\n\n", 1)[0].split("instants", 1)[1].split())


def test_a_sweep_says_how_slips_compare_with_predictions_and_which_were_noticed_all_the_same() -> None:
    assert first_words((0.49, None, 5.0), (2.54, None, 6.0), (None, None, 7.0)) == (
        "Noticed after 1.51 s on average, at the latest after 2.54 s; done after 20.0 s on average. "
        "Not counted on, but noticed: 2 of 3 slips."
    )
    assert first_words((0.1, 0.2, 5.0), (0.5, None, 6.0)) == (
        "Noticed after 0.30 s on average, at the latest after 0.50 s; done after 20.0 s on average. "
        "1 of 1 slips that are predicted to be noticed were: 1 as predicted, 0 sooner by more than 120 ms, 0 later. "
        "Not counted on, but noticed: 1 of 1 other slips."
    )
