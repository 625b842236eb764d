"""What a message quotes of the input stays readable, however long the input is."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError, Place, Problem, expected_names, nearest

_SIGNS, _COMMAND = 150 * ':"', f"`sqrp run PROGRAM --replay {'folder/' * 100}log`"


@pytest.mark.parametrize(("message", "shown"), [
    (f"no skill `{'p' * 100_000}`; did you mean `pickup`?", f"no skill `{'p' * 60}...`; did you mean `pickup`?"),
    (f'cannot parse "{"a" * 300}" here', f'cannot parse "{"a" * 60}..." here'),
    (f"unknown key `{_SIGNS}`", f"unknown key `{_SIGNS[:60]}...`"),
    (f"give it as {_COMMAND}", f"give it as {_COMMAND}"),  # users type it
])  # fmt: skip
def test_a_message_quotes_no_more_than_the_beginning_of_a_long_name(message: str, shown: str) -> None:
    assert Problem("x", message).message == shown


@pytest.mark.parametrize(("typed", "names", "meant"), [
    ("nope", ["mine", "place", "inspect"], None), ("tray", ["grey"], None), ("g9", ["g1", "table"], "g1"),
    ("pick", ["pickup", "place"], "pickup"), ("tabeltop", ["tabletop"], "tabletop"),
])  # fmt: skip
def test_a_name_is_proposed_where_typing_errors_may_have_made_it_another(
    typed: str, names: list[str], meant: str | None
) -> None:
    assert nearest(typed, names) == meant


def test_of_thousands_of_problems_the_first_are_reported_and_how_many_more_there_are() -> None:
    problems = [Problem("unknown-key", f"`key{k}` is no known key") for k in range(6_000)]
    listed = InputError(*problems).problems
    assert listed[:20] == tuple(problems[:20])
    assert [problem.message for problem in listed[20:]] == ["5,980 more problems are not listed"]
    assert InputError(*problems[:20]).problems == tuple(problems[:20])


def test_one_problem_of_a_file_that_two_entries_name_is_told_once() -> None:
    first, again, other = (
        Problem("image-size", "the image is too small", Place(Path("camera.yaml"), line)) for line in (3, 3, 4)
    )
    assert InputError(first, again, other).problems == (first, other)


def test_names_with_the_word_in_them_are_listed_first() -> None:
    known = ["against-the-plan", "camera-sees-nothing", "unknown-camera"]
    assert expected_names("camera", known).startswith("expected one of `camera-sees-nothing`, `unknown-camera`, `ag")
