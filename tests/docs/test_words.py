"""The screens of shipped cells use the words of the page of words: those that golden files and pages have."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from sqrp_cli import read_result
from tests.docs.page import PAGES, ROOT, blocks
from tests.docs.words import EXPLAINED, MOST_WORDS, PAGE, TASKS, unexplained

GOLDEN = ROOT / "tests" / "cli" / "golden"
COMMAND = re.compile(
    rf"^(?:COLUMNS=\d+ )?sqrp (?:check|rank|explain|advise|score|diff) \S*workspaces/({'|'.join(TASKS)})\b"
    r"|^sqrp (?:run|program|audit) pick\.yaml"
)


def shown() -> Iterator[tuple[str, str, str]]:
    """Commands with the shipped cell that each is about, and what it prints."""
    for cell in TASKS:
        for command in ("check", "rank"):
            yield f"{command} {cell}", cell, str(read_result(GOLDEN / f"{command}-{cell}.json"))
    transcripts = [path.read_text(encoding="utf-8") for path in sorted(GOLDEN.glob("*.txt"))]
    told = [re.sub(r"^\| ?", "", text, flags=re.MULTILINE).split("\n$ ") for text in transcripts]
    pages = [block.body.removeprefix("$ ") for page in PAGES for block in blocks(page.read_text("utf-8"))]
    for text in (*(one for parts in told for one in parts), *pages):
        command, _, printed = text.partition("\n")
        if (match := COMMAND.match(command)) and not re.search(r"^!", printed, re.MULTILINE):
            yield command, match[1] or "tabletop", printed.partition("\n== ")[0]


SCREENS = {command: (cell, printed) for command, cell, printed in shown()}


@pytest.mark.parametrize("command", SCREENS)
def test_a_screen_has_no_technical_word_that_the_page_does_not_explain(command: str) -> None:
    cell, printed = SCREENS[command]
    assert [*dict.fromkeys(unexplained(printed, cell))] == []


def test_the_page_has_few_words_and_the_screens_are_those_of_every_command() -> None:
    assert 8 <= len(EXPLAINED.findall(PAGE.read_text(encoding="utf-8"))) <= MOST_WORDS
    assert {re.sub(r"COLUMNS=\d+ |sqrp ", "", one).split()[0] for one in SCREENS} == {
        "check", "rank", "explain", "advise", "run", "score",
    }  # fmt: skip


def test_technical_words_are_found() -> None:
    said = "Q_avg, hold(g1), `t_f`: Pareto-optimal in left_finger, events of interest in cam1, no TCP at max_range"
    found = [*unexplained(said, "tabletop")]
    assert found == ["Q_avg", "Pareto", "optimal", "events of interest", "Q_avg", "left_finger", "TCP", "max_range"]
