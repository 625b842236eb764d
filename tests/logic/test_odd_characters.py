"""Characters that cannot be seen, and odd ones, in PDDL and MTL texts: read, or refused with their place."""

from __future__ import annotations

import sys
import unicodedata
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.errors import InputError, Place
from sqrp_cli.logic.mtl_parser import parse_formula
from sqrp_cli.logic.pddl_parser import parse_domain

FILE = Path("odd.txt")
DOMAIN = "(define (domain d)\n  (:predicates (hold ?x))\n  (:action go :parameters (?x) :effect (hold ?x)))"
FORMULA = "always[a1.start, a2.end] (hold and\n  not free)"
CONTROL = [chr(code) for code in (*range(0x20), 0x7F, *range(0x80, 0xA0))]
ODD = [chr(code) for code in range(0xA0, sys.maxunicode, 997)]
ODD += list(
    "\u00a0\u00ad\u200b\u200e\u202e\u2028\u2029\u2066\u3000\ufeff\uffff\u0660\u00b2\u0130\u1e9e\U0001f916\U000e0001"
)

Read = Callable[[str], object]


def read_domain(text: str) -> object:
    return parse_domain(text, FILE)


def read_formula(text: str) -> object:
    return parse_formula(text, Place(FILE, 1, 1))


TEXTS = pytest.mark.parametrize(("read", "text"), [(read_domain, DOMAIN), (read_formula, FORMULA)])


def refusal(read: Read, text: str) -> InputError | None:
    """What a text is refused with, none if it is read; any other exception is an error of ours."""
    try:
        read(text)
    except InputError as error:
        return error
    return None


@TEXTS
@pytest.mark.parametrize("place", [0, 2])
def test_a_control_character_is_space_or_refused_where_it_stands(read: Read, text: str, place: int) -> None:
    before, after = text[: text.index("hold") + place], text[text.index("hold") + place :]
    for character in CONTROL:
        error = refusal(read, before + character + after)
        if character in "\t\n\f\r":
            continue  # where that breaks a word, what is wrong is said of the words
        assert error is not None, ascii(character)
        problem = error.problems[0]
        assert problem.place is not None
        place_of = before.count("\n") + 1, len(before) - before.rfind("\n")
        assert (problem.place.line, problem.place.column) == place_of
        assert f"U+{ord(character):04X}" in problem.message
        assert all(unicodedata.category(sign) != "Cc" or sign == "\n" for sign in f"{problem}{problem.excerpt}")


@TEXTS
def test_an_odd_character_is_read_or_refused_with_its_place(read: Read, text: str) -> None:
    for character in ODD:
        for offset in (0, text.index("hold") + 2, len(text)):
            error = refusal(read, text[:offset] + character + text[offset:])
            assert error is None or all(problem.place and problem.place.column for problem in error.problems)
            said = "" if error is None else "".join(f"{problem}{problem.excerpt}" for problem in error.problems)
            assert not {unicodedata.category(sign) for sign in said} & {"Cf", "Zl", "Zp", "Co", "Cn"}


@TEXTS
@given(st.text(alphabet=st.characters(codec="utf-8"), max_size=4), st.integers(0, 200))
def test_whatever_is_put_in_is_read_or_refused(read: Read, text: str, inserted: str, offset: int) -> None:
    refusal(read, text[:offset] + inserted + text[offset:])
    assert refusal(read_domain, f"; \x00\x1b\u200b\n{DOMAIN}") is None  # a comment may have any
