"""Pages can be read aloud: their sentences have fewer than 18 words on average."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.page import BLOCK, PAGES, ROOT

PARTS = re.compile(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.)\s)|\n(?=[#|])")
"""Where a paragraph, an item, a heading or a row of a table begins."""
MOST = 18


def sentences(text: str) -> list[str]:
    """Those of paragraphs and items. A piece of code is one word; a colon or semicolon ends no sentence."""
    text = re.sub(r"`[^`]*`", "code", re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", BLOCK.sub("\n\n", text)))
    prose = [part.strip() for part in PARTS.split(text) if not part.strip().startswith(("#", "|", "!"))]
    return [one for part in prose for one in re.split(r"(?<=[.!?])[\"')*_]*\s+", part) if one]


@pytest.mark.parametrize("page", PAGES, ids=[str(page.relative_to(ROOT)) for page in PAGES])
def test_sentences_of_a_page_are_short(page: Path) -> None:
    lengths = [len(sentence.split()) for sentence in sentences(page.read_text(encoding="utf-8"))]
    assert sum(lengths) / len(lengths) < MOST, max(sentences(page.read_text(encoding="utf-8")), key=len)


def test_a_sentence_is_counted() -> None:
    assert sentences("# Title\n\nOne `a b c` two; three.\n- Four: [five six](seven.md)?\n\n| eight |") == [
        "One code two; three.",
        "- Four: five six?",
    ]
