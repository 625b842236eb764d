"""The Python interface answers what the commands answer, figure by figure; golden/python.txt has what it refuses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sqrp_cli import new_cell, open_cell, open_program, read_run
from sqrp_cli.errors import InputError

TABLETOP = Path(__file__).parents[2] / "workspaces" / "tabletop"


@pytest.fixture(scope="module")
def cell():
    return open_cell(TABLETOP)


@pytest.fixture(autouse=True)
def at_80_columns(monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("NO_COLOR", "1")


def printed(sqrp, *arguments: object) -> str:
    return sqrp(*arguments).out.rstrip("\n")


@pytest.mark.parametrize(
    ("ask", "given", "named", "words"),
    [
        ("rank", ["pickup green"], {}, ["pickup green"]),
        ("rank", ["pickup green"], {"ways": "fastest"}, ["pickup green", "--ways", "fastest"]),
        ("explain", ["pickup green", None], {"ways": "fastest"}, ["pickup green", "--all", "--ways", "fastest"]),
        ("check", [], {}, []),
        ("check", ["pickup green"], {}, ["pickup green"]),
        ("scene", [], {}, []),
        ("score", [], {}, []),
    ],
)
def test_an_answer_is_the_table_and_the_document_of_its_command(asked, cell, ask, given, named, words):
    command, found = ("show" if ask == "scene" else ask, TABLETOP, *words), getattr(cell, ask)(*given, **named)
    assert str(found) == printed(asked, *command)
    assert found.to_json() == printed(asked, *command, "--json")


def test_a_notebook_shows_the_table_with_colours(cell):
    html = cell.rank("pickup g2")._repr_html_()
    assert html.startswith("<pre")
    assert "critical" in html
    assert "color:" in html


@pytest.mark.slow
def test_a_new_cell_is_that_of_init_and_can_be_opened(sqrp, started, tmp_path, monkeypatch):
    steps, (folder, outcome) = {}, started

    @contextmanager
    def progress(title: str, total: int) -> Iterator[Callable[[int], None]]:
        done = []
        yield done.append
        steps[title] = (sum(done), total)

    made = new_cell(tmp_path / "one", run=True, progress=progress)
    looking, ranking, running = steps
    assert looking.startswith("Looking for")
    assert ranking == f"Assessing {made.task}"
    assert running.startswith("Running")
    assert "--no-run" in running
    assert steps[looking] == (1, 7)  # of four heights and three places of the table, the first was enough
    ranked = open_cell(made.path).rank(made.task)
    assert steps[ranking] == (len(ranked.candidates),) * 2
    assert steps[running] == (int(ranked.best.time),) * 2
    monkeypatch.setattr("sqrp_cli.ask.api.new_cell.first_run", lambda *_: made.run)  # it would be the same again
    assert str(made).replace("/one", "/two") == printed(sqrp, "init", tmp_path / "two")
    assert repr(made) == f"NewCell({tmp_path / 'one'}: {made.task})"
    assert made.to_json().replace(str(tmp_path / "one"), str(folder)) == outcome.out.rstrip("\n")
    assert open_cell(made.path).check().valid


def test_a_ranking_writes_the_program_that_rank_writes(sqrp, cell, tmp_path):
    ranking = cell.rank("pickup green", ways="fastest")
    ranking.write(tmp_path / "one.yaml", "g5")
    command = ("rank", TABLETOP, "pickup green", "--ways", "fastest", "--choose", "g5")
    sqrp(*command, "--program", tmp_path / "two.yaml")
    assert (tmp_path / "one.yaml").read_text() == (tmp_path / "two.yaml").read_text()
    with pytest.raises(InputError, match=r"g6 cannot be done .*, so .*three.yaml was not written"):
        ranking.write(tmp_path / "three.yaml", "g6")


@pytest.fixture(scope="module")
def ran(slip_run, tmp_path_factory):
    """The run of `slip_run` by Python, with its log and its frames."""
    folder = tmp_path_factory.mktemp("ran")
    log, frames = folder / "log", folder / "frames"
    return open_program(slip_run.cell.program).run(["slip@a4+1"], log=log, frames=frames), log, frames


def test_a_program_runs_and_its_log_and_frames_tell_the_same(sqrp, slip_run, ran):
    program, kept = open_program(slip_run.cell.program), slip_run.cell.folder
    run, log, frames = ran
    assert run.done
    assert log.read_bytes() == (kept / "run.jsonl").read_bytes()
    assert {file.name for file in frames.iterdir()} == {file.name for file in (kept / "frames").iterdir()}
    assert str(run) == printed(sqrp, "run", "--replay", kept / "run.jsonl")
    assert read_run(log).steps == run.steps
    assert repr(run).startswith(f"SimulatedRun({program.workspace.name}: done at ")
    assert len(repr(run)) < 120


def test_the_page_of_a_run_takes_a_path_as_text_and_replaces_no_file_of_the_run(quick_cell, ran, tmp_path):
    run, log, _ = ran
    run.write_page(str(tmp_path / "page.html"))
    assert (tmp_path / "page.html").read_text().startswith("<!")
    kept = log.read_bytes()
    for answer, path, said in (
        (run, None, "path is None, expected a path"),
        (run, str(log), "log and path both name this file"),
        (run, str(quick_cell.program), "so it is not overwritten"),
        (read_run(log), str(log), "so it is not overwritten"),
    ):
        with pytest.raises(InputError, match=said):
            answer.write_page(path)
    assert log.read_bytes() == kept
