"""What a page carries: nothing lost but what follows from the rest, and nothing hidden in names."""

from __future__ import annotations

import base64
import json
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sqrp_cli.show.pages.assembly import packed, tidy, visible


def unpacked(text: str) -> object:
    return json.loads(zlib.decompress(base64.b64decode(text)))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(-1e6, 1e6) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@given(json_values)
def test_a_page_carries_a_document_as_it_was_tidied(value):
    assert unpacked(packed(value)) == tidy(value)


@given(st.text())
def test_packed_text_is_no_markup(text):
    assert not set(packed({text: text})) & set("<>&\"'")


@given(st.floats(-1e3, 1e3))
def test_figures_are_kept_to_a_millionth(figure):
    assert tidy(figure) == pytest.approx(figure, abs=5.1e-7)


@pytest.mark.parametrize("mark", ["\u202e", "\u2066", "\u200f", "\u200b", "\0", "\n", "\ufeff", "\u2028"])
def test_what_cannot_be_seen_is_spelled_out(mark):
    assert visible(f"cam{mark}1") == f"cam\\u{{{ord(mark):x}}}1"


@pytest.mark.parametrize("text", ["hold(g1)", "Kamera süd", "מצלמה", "相机 2", "<b>&amp;'\""])
def test_what_can_be_seen_stays(text):
    assert visible(text) == text
