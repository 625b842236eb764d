"""Whatever others wrote into files is shown as it is: it moves no cursor, begins no line and commands no server."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from rich.console import Console

from sqrp_cli.document import WorkspaceDocument
from sqrp_cli.errors import Place, Problem
from sqrp_cli.program.file import load_program, save_program
from sqrp_cli.run.record.events import VERSION, ShownAtom, event
from sqrp_cli.run.record.log import read_log, written_log
from sqrp_cli.score.ci_files import _text as in_markdown
from sqrp_cli.show.terminal import console
from sqrp_cli.show.terminal.run_view import live_view
from sqrp_cli.shown import one_line
from tests.cells import command_lines
from tests.cli.hostile import EVIL, IN_PATH, TASK, hostile_cell, is_harmless
from tests.cli.test_run_view import log_of

Command = Callable[..., Any]

BEGINNINGS = [*"\n #:a\r\u2028\x85\ud800é", "日本", "::error::", "##[error]", "##vso[", "\x1b[2J"]
texts = st.text(max_size=40) | st.lists(st.sampled_from(BEGINNINGS), max_size=9).map("".join)
"""Texts of any characters, and such as begin commands."""


def printed(width: int, show: Callable[[], None], color: bool = False) -> str:
    """All that is written to stdout and stderr in a terminal of a width, without what sets its own styles."""
    out = io.StringIO()
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR")}
    chosen = {"FORCE_COLOR": "1", "TERM": "xterm"} if color else {"NO_COLOR": "1"}
    with (
        mock.patch.dict(os.environ, {**kept, **chosen, "COLUMNS": str(width)}, clear=True),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
    ):
        show()
    return re.sub(r"\x1b\[[0-9;]*m", "", out.getvalue())


@given(texts, st.integers(20, 60), st.booleans())
def test_no_text_controls_a_terminal_or_commands_a_server(text, width, color):
    def show() -> None:
        console.say(text)
        console.say(f"some words before {text}", "bold")
        console.say(console.joined(["\n", (text, "red"), f" {text}", text]))
        console.say_command(text, text)
        console.note(text)
        place = Place(Path(text.replace("\0", "")), 1, 2)
        console.print_problems([Problem("code", text, place, mend=text, excerpt=f"{text}\n^")])
        for columns in ([console.Column(text, shrink=True)] * 2, [console.Column(text)] * 2):
            console.print_table(columns, [(text, console.styled(text, "red")), ("", text)])

    assert is_harmless(printed(width, show, color))


def test_what_changes_in_place_controls_no_terminal_either(monkeypatch):
    out = io.StringIO()
    monkeypatch.setattr(console, "diagnostics", lambda: Console(file=out, force_terminal=True, width=200))
    with console.progress(EVIL, 3) as advance:
        advance()
    with live_view([EVIL]) as view:
        view(event("primitive", 0.0, name=EVIL))
        atom = ShownAtom(value="true", asked=True, predicted=True, cameras={EVIL: "true"})
        view(event("evidence", 0.1, exposed=0.0, literals={EVIL: atom}))
        view(event("happened", 0.2, fault=EVIL))
    own = re.sub(r"\r|\x1b\[[0-9;?]*[A-Za-z]", "\n", out.getvalue())
    assert "has happened" in own
    assert all(line.isprintable() for line in own.split("\n"))  # no server is sent what only a terminal is shown


@given(texts)
def test_a_name_begins_no_line(text):
    shown = printed(10_000, lambda: console.say(f"camera {text} sees"))
    assert shown.count("\n") == 1
    shown = printed(10_000, lambda: console.print_table([console.Column("a"), console.Column("b")], [(text, "x")]))
    assert shown.count("\n") == 2


@pytest.mark.parametrize("name", ["é", "日本", "Kamera süd", "מצלמה", "🤖", "a::b", "# 1", "::"])
def test_names_in_any_script_stay_readable(name):
    assert one_line(name) == name
    assert printed(80, lambda: console.say(f"camera {name} sees")) == f"camera {name} sees\n"


def test_what_is_asked_and_answered_is_harmless_too(monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{EVIL.splitlines()[0]}\n"))
    assert is_harmless(printed(80, lambda: print(console.ask(f"{EVIL} [yes]: ") and "")))


@given(st.recursive(texts, lambda inner: st.dictionaries(texts, inner, max_size=3) | st.lists(inner, max_size=3)))
def test_json_is_exact_and_yet_harmless(value):
    shown = WorkspaceDocument(workspace=value).to_json()
    assert json.loads(shown)["workspace"] == value
    assert shown.isascii()
    assert is_harmless(shown)


@given(texts)
def test_markdown_shows_a_text_as_it_is(text):
    (row,) = [line for line in ("| " + in_markdown(text) + " | end |").split("\n") if line]
    tokens = MarkdownIt("commonmark").enable(["table", "strikethrough"]).parse(f"| a | b |\n|---|---|\n{row}\n")
    cell, end = [token for token in tokens if token.type == "inline"][2:]
    assert end.content == "end"
    assert {child.type for child in cell.children or ()} <= {"text", "text_special"}
    assert "".join(child.content for child in cell.children or ()) == " ".join(one_line(text).split())


@given(texts)
def test_a_log_is_read_as_it_was_written(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("log") / "log"
    with written_log(path, event("run", 0.0, sqrp_log=VERSION, workspace=text, cameras=[], digest="")):
        pass
    (header,) = read_log(path)
    assert header.workspace == text


# The commands


@pytest.fixture(scope="module")
def evil(watch, tmp_path_factory):
    """A cell whose files are as hostile as they can be."""
    return hostile_cell(watch, tmp_path_factory.mktemp("evil"))


@pytest.fixture(scope="module")
def program(sqrp, evil):
    """A program of that cell, in a hostile file."""
    path = evil / f"{IN_PATH[:60]}.yaml"
    assert sqrp("rank", evil, TASK, "--program", path).code == 0
    return path


@pytest.mark.parametrize("columns", [80, 20])
@pytest.mark.parametrize("words", command_lines("hostile"), ids=lambda words: " ".join(Path(w).name for w in words))
def test_no_command_prints_what_commands(sqrp, evil, program, tmp_path, words, columns):
    log = log_of(tmp_path / "log")
    hostile = log.read_text(encoding="utf-8")
    for name in ("it was seen", "pickup g", "slip", "cell"):
        hostile = hostile.replace(f'"{name}"', json.dumps(f"{name}{EVIL}"))
    log.write_text(hostile.replace('"stopped"', '"done"'), encoding="utf-8")
    code, *filled = words
    for sign, meant in {"EVIL": evil, "PROGRAM": program, "LOG": log, "TASK": TASK, "TEXT": EVIL}.items():
        filled = [word.replace(sign, str(meant)) for word in filled]
    outcome = sqrp(*filled, columns=columns)
    assert is_harmless(outcome.out)
    assert is_harmless(outcome.err)
    assert outcome.code == int(code), outcome.err


def test_the_files_of_a_score_are_harmless(sqrp, evil, watch, tmp_path):
    junit, summary, baseline = tmp_path / "junit.xml", tmp_path / "summary.md", tmp_path / "baseline.json"
    broken = Path(shutil.copytree(watch, evil / f"broken{IN_PATH[:60]}"))
    (broken / "workspace.yaml").write_text(f"robot: {json.dumps(EVIL)}\n", encoding="utf-8")
    scored = sqrp("score", evil, broken, "--junit", junit, "--summary", summary, "--save-baseline", baseline)
    assert scored.code == 2
    root = ElementTree.parse(junit).getroot()  # noqa: S314 - our own file
    said = [*(value for element in root.iter() for value in element.attrib.values()), *root.itertext()]
    assert all(line.isprintable() for text in said for line in text.split("\n"))
    assert {case.attrib["name"] for case in root.iter("testcase")} == {one_line(TASK), "workspace"}
    tokens = MarkdownIt("commonmark").enable(["table", "strikethrough"]).parse(summary.read_text(encoding="utf-8"))
    kinds = {child.type for token in tokens for child in token.children or ()}
    assert kinds <= {"text", "text_special", "softbreak", "strong_open", "strong_close"}
    assert "html_block" not in {token.type for token in tokens}
    assert sum(token.type == "tr_open" for token in tokens) == 3
    known = json.loads(baseline.read_text(encoding="utf-8"))["workspaces"]
    assert [list(found["tasks"]) for found in known.values()] == [[TASK]]
    text = baseline.read_text(encoding="utf-8")
    baseline.write_text(text.replace('"turned', json.dumps(f"turned{IN_PATH}")[:-1]), encoding="utf-8")
    for cell, words in ((watch, "is only in the baseline"), (evil, "there is no such way any more")):
        compared = sqrp("score", cell, "--baseline", baseline)
        assert is_harmless(compared.out)
        assert words in " ".join(compared.out.split())


def test_a_program_that_others_wrote_is_listed_harmlessly(sqrp, program):
    original = load_program(program)
    (step,) = original.steps
    faults = {f"moved{IN_PATH}": step.faults["moved"]}
    changed = step.model_copy(update={"task": TASK, "verdict": IN_PATH, "faults": faults})
    path = program.parent / "changed.yaml"
    save_program(original.model_copy(update={"steps": (changed,)}), path)
    for code, *command in ((0, "program", path), (0, "program", path, "--json"), (2, "run", path)):
        outcome = sqrp(*command)
        assert is_harmless(outcome.out)
        assert is_harmless(outcome.err)
        assert outcome.code == code, outcome.err
    assert f"at the latest after 0.15 s if `moved{one_line(IN_PATH)[:5]}" in " ".join(sqrp("program", path).out.split())
