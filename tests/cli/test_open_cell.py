"""The Python interface answers what the commands answer, figure by figure and line by line."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from sqrp_cli import new_cell, open_cell, open_program, read_run
from sqrp_cli.errors import InputError
from sqrp_cli.study.robustness import Calibration
from sqrp_cli.study.sampling import Adaptive, FixedCount

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


@pytest.fixture(scope="module")
def scores(cell):
    return cell.score()


def test_a_ranking_is_the_table_and_the_document_of_rank(asked, cell):
    fastest = cell.rank("pickup green", ways="fastest")
    assert str(fastest) == printed(asked, "rank", TABLETOP, "pickup green", "--ways", "fastest")
    ranking = cell.rank("pickup green")
    assert ranking.to_json() == printed(asked, "rank", TABLETOP, "pickup green", "--json")
    assert [one.parameters["object"] for one in ranking.candidates] == ["g2", "g4", "g5", "g1", "g3", "g6"]


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (
            lambda cell: cell.explain("pickup green", None, ways="fastest"),
            ("explain", "pickup green", "--all", "--ways", "fastest"),
        ),
        (lambda cell: cell.check(), ("check",)),
        (lambda cell: cell.check("pickup green"), ("check", "pickup green")),
        (lambda cell: cell.scene(), ("show",)),
    ],
    ids=["explain", "check", "check a task", "show"],
)
def test_an_answer_is_the_table_and_the_document_of_its_command(sqrp, cell, answer, words):
    command, found = (words[0], TABLETOP, *words[1:]), answer(cell)
    assert str(found) == printed(sqrp, *command)
    assert found.to_json() == printed(sqrp, *command, "--json")


def test_scores_are_those_of_score(sqrp, scores, tmp_path):
    command = ("score", TABLETOP, "--out", tmp_path)
    assert scores.passed
    assert str(scores) == printed(sqrp, *command)
    assert scores.to_json() == printed(sqrp, *command, "--json")


def test_a_notebook_shows_the_table_with_colours(cell):
    html = cell.rank("pickup g2")._repr_html_()
    assert html.startswith("<pre")
    assert "Q_eoi" in html
    assert "color:" in html


def test_a_workspace_with_errors_is_not_opened(tmp_path):
    (tmp_path / "workspace.yaml").write_text("robot: 1\n")
    with pytest.raises(InputError, match=r"workspace\.yaml:1"):
        open_cell(tmp_path)


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (lambda cell: cell.rank(None), "task is None, expected a skill and what to do it with"),
        (lambda cell: cell.rank("pickup g2", sampling=0.01), "sampling is 0.01, expected Adaptive(tolerance)"),
        (lambda cell: cell.rank("pickup g2", sampling=FixedCount(1)), "sampling is FixedCount(samples=1), expected"),
        (lambda cell: cell.rank("pickup g2", sampling=Adaptive(float("nan"))), "sampling is Adaptive(tolerance=nan)"),
        (lambda cell: cell.rank("pickup g2", calibration="5 mm"), "calibration is '5 mm', expected Calibration("),
        (lambda cell: cell.rank("pickup g2", calibration=Calibration(5, 0.5, 0)), "up to 1 m and up to 1 rad"),
        (
            lambda cell: cell.rank("pickup g2", by="speed"),
            "by is `speed`; expected one of `delay`, `expected_time`, `q_avg`",
        ),
        (lambda cell: cell.rank("pickup g2", jobs=0), "jobs is 0, expected a whole number from 1 on"),
        (lambda cell: cell.explain("pickup g2", 2), "choose is 2, expected the name of a candidate"),
        (lambda cell: cell.explain("pickup g2", jobs=1.5), "jobs is 1.5"),
        (lambda cell: cell.explain("pickup g2", choose=""), "choose is empty, expected the name of a candidate"),
        (lambda cell: cell.explain("pickup g2", step=2), "step is 2, but `pickup g2` is a task of one step"),
        (lambda cell: cell.place(budget=10), ", budget is 10"),
        (lambda cell: cell.place(cameras=1), "a cell with fewer; cameras is 1"),
        (lambda cell: cell.rank("pickup g2", sampling={"dt": "x"}), "sampling is {'dt': 'x'}, expected Adaptive("),
        (
            lambda cell: cell.rank("pickup g2", calibration={"calibration": "5 mm", "seed": -1}),
            "calibration is {'calibration': '5 mm', 'seed': -1}, expected Calibration(",
        ),
        (lambda cell: cell.advise("pickup g2", kinds=[]), "kinds is empty, expected kinds of changes"),
        (lambda cell: cell.rank("pickup g2", by=3), "by is 3, expected one of q_eoi, q_avg"),
        (lambda cell: cell.rank("pickup g2", progress=3), "progress is 3, expected a function"),
        (lambda cell: cell.rank("pickup g2").write("program.yaml", 3), "choose is 3, expected the name of a candidate"),
        (lambda cell: cell.check("pickup g2", plan="x"), "plan is 'x', expected True, False, or None"),
        (lambda cell: cell.check("pickup g2", planner="x"), "there is no planner `x`; expected one of"),
        (lambda _: new_cell("folder", progress=3), "progress is 3, expected a function"),
        (lambda cell: cell.check("pickup g2", jobs=True), "jobs is True"),
        (lambda cell: cell.check(7), "task is 7"),
        (lambda cell: cell.check("pickup g2", after=7), "after is 7, expected a path"),
        (lambda cell: cell.score(jobs=-1), "jobs is -1"),
        (lambda _: open_cell(None), "path is None, expected a path"),
        (lambda _: open_cell(TABLETOP, seed=-1), "seed is -1, expected a whole number from 0 on"),
        (lambda _: open_program(7), "path is 7"),
        (lambda _: read_run(None), "log is None"),
        (lambda _: new_cell(""), "folder is '', expected a path"),
    ],
)
def test_an_argument_that_cannot_be_used_is_refused_with_what_was_expected(cell, question, said):
    with pytest.raises(InputError) as refused:
        question(cell)
    assert said in str(refused.value)
    assert "--" not in str(refused.value)


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (
            lambda cell: cell.rank("pickup g2", "time"),
            "rank() takes task by place; give the rest by name, such as by=...",
        ),
        (lambda cell: cell.score("x"), "score() takes nothing by place; give the rest by name, such as sampling=..."),
        (lambda cell: cell.advise("pickup g2", cluster=1), "advise() has no argument `cluster`; expected one of `"),
        (lambda cell: cell.place(camera=2), "place() has no argument `camera`; did you mean `cameras`?"),
        (lambda cell: cell.rank(), "rank() lacks `task`"),
        (lambda cell: cell.rank("pickup g2", task="pickup g3"), "rank() takes `task` once, by place or by name"),
        (
            lambda _: new_cell("folder", tpi="x"),
            "new_cell() has no argument `tpi`; expected one of `arguments`, `folder`",
        ),
    ],
)
def test_a_call_that_does_not_fit_is_refused_as_python_does(cell, question, said):
    with pytest.raises(TypeError) as refused:
        question(cell)
    assert str(refused.value).startswith(said)


def test_a_prompt_shows_an_answer_as_one_short_line(cell, scores):
    answers = [
        cell.rank("pickup green", ways="fastest"),
        cell.explain("pickup object=g1,g6", "g1", ways="fastest"),
        cell.explain("pickup object=g1,g6", "g6", ways="fastest"),
        cell.explain("pickup g2", None, ways="fastest"),
        cell.check(),
        cell.check("pickup green"),
        cell.scene(),
        scores,
    ]
    assert [repr(answer) for answer in answers] == [
        "Ranking(pickup green in tabletop: 6 candidates, best g2, Q_eoi 100.0 %)",
        "Explanation(pickup object=g1,g6 in tabletop: g1, Q_eoi 0.0 %)",
        "Explanation(pickup object=g1,g6 in tabletop: g6, infeasible)",
        "ExplainedAll(pickup g2 in tabletop: 1 candidate)",
        "Check(tabletop: valid, 0 problems)",
        "Check(pickup green in tabletop: 5 of 6 candidates feasible, valid, 0 problems)",
        "ShowDocument(tabletop: 6 cameras, 11 objects)",
        "Scorecard(1 of 1 task passed)",
    ]


@pytest.mark.slow
def test_a_new_cell_is_that_of_init_and_can_be_opened(sqrp, started, tmp_path):
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
    with pytest.raises(InputError, match=r"g6 is infeasible .*, so .*three.yaml was not written"):
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
    for fault in (7, ["sli@a1"]):
        with pytest.raises(InputError):
            program.run(fault)


def test_a_run_never_writes_over_what_it_reads(quick_cell, tmp_path):
    program = open_program(quick_cell.program)
    before = {file: file.read_bytes() for file in program.files}
    for file in program.files:
        link = tmp_path / f"{file.name}.mp4"
        link.symlink_to(file)
        for output in ({"log": str(file)}, {"film": link}):
            with pytest.raises(InputError, match="this file is read by the same command, so it is not overwritten"):
                program.run(**output)
    assert before == {file: file.read_bytes() for file in program.files}


def test_a_run_never_writes_two_outputs_with_one_name(quick_cell, tmp_path):
    one = tmp_path / "one.mp4"
    for names in (("film", "log"), ("log", "frames")):
        with pytest.raises(InputError, match=" and ".join(names) + " both name this file"):
            open_program(quick_cell.program).run(**dict.fromkeys(names, one))
    assert not one.exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"film": "film.avi"}, "film is `film.avi`; expected a name that ends in .mp4"),
        ({"film": "\udcff.mp4"}, "which is not UTF-8 text"),
        ({"faults": ["foo"]}, "faults foo: there is no fault `foo`"),
        ({"faults": "slip@a4"}, "faults is 'slip@a4', expected texts"),
        ({"listeners": 3}, "listeners is 3, expected functions of an event"),
        ({"listeners": [3]}, "listeners is [3], expected functions of an event"),
    ],
)
def test_a_run_refuses_what_it_cannot_use_by_the_name_of_the_argument(quick_cell, arguments, said):
    with pytest.raises(InputError) as refused:
        open_program(quick_cell.program).run(**arguments)
    assert said in str(refused.value)


def test_a_sweep_refuses_a_slip_by_the_name_of_the_argument(quick_cell):
    with pytest.raises(InputError, match=r"slip foo@a4: expected `slip@`"):
        open_program(quick_cell.program).sweep("foo@a4")


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
