"""What a message quotes of the input stays readable, however long the input is."""

from __future__ import annotations

from pathlib import Path

import pytest

from sqrp_cli.errors import InputError, Place, Problem, expected_names, nearest


def test_a_message_quotes_no_more_than_the_beginning_of_a_long_name() -> None:
    problem = Problem("unknown-skill", f"there is no skill `{'p' * 100_000}`; did you mean `pickup`?")
    assert problem.message == f"there is no skill `{'p' * 60}...`; did you mean `pickup`?"


@pytest.mark.parametrize(
    ("typed", "names", "meant"),
    [
        ("nope", ["mine", "place", "inspect"], None),
        ("tray", ["grey"], None),
        ("g9", ["g1", "table"], "g1"),
        ("pick", ["pickup", "place"], "pickup"),
        ("tabeltop", ["tabletop"], "tabletop"),
    ],
)
def test_a_name_is_proposed_where_typing_errors_may_have_made_it_another(
    typed: str, names: list[str], meant: str | None
) -> None:
    assert nearest(typed, names) == meant


def test_what_a_library_quotes_is_shortened_too() -> None:
    assert Problem("x", f'cannot parse "{"a" * 300}" here').message == f'cannot parse "{"a" * 60}..." here'


def test_a_name_is_shortened_whatever_signs_it_has() -> None:
    name = 150 * ':"'
    assert Problem("x", f"unknown key `{name}`").message == f"unknown key `{name[:60]}...`"


def test_a_command_in_a_message_stays_whole() -> None:
    command = f"`sqrp run PROGRAM --replay {'folder/' * 100}log`"
    assert Problem("no-rates", f"give it as {command}").message == f"give it as {command}"


def test_of_thousands_of_problems_the_first_are_reported_and_how_many_more_there_are() -> None:
    problems = [Problem("unknown-key", f"`key{k}` is no known key") for k in range(60_000)]
    listed = InputError(*problems).problems
    assert listed[:20] == tuple(problems[:20])
    assert [problem.message for problem in listed[20:]] == ["59,980 more problems are not listed"]
    assert InputError(*problems[:20]).problems == tuple(problems[:20])


def test_one_problem_of_a_file_that_two_entries_name_is_told_once() -> None:
    first, again, other = (
        Problem("image-size", "the image is too small", Place(Path("camera.yaml"), line)) for line in (3, 3, 4)
    )
    assert InputError(first, again, other).problems == (first, other)


def test_names_with_the_word_in_them_are_listed_first() -> None:
    known = ["against-the-plan", "camera-sees-nothing", "unknown-camera"]
    assert expected_names("camera", known).startswith("expected one of `camera-sees-nothing`, `unknown-camera`, `ag")
