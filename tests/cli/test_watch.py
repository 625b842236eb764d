"""`--watch`: again whenever a file of the cell is saved, old and new side by side."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from sqrp_cli.cli import watch
from sqrp_cli.cli.watch import AnswerView, print_changes

Save = Callable[[], object]


@pytest.fixture
def saving(monkeypatch):
    """Has files saved while a command waits, one after the other; then Ctrl-C."""

    def begin(*saves: Save) -> None:
        waiting = iter([step for save in saves for step in (save, lambda: None)])

        def sleep(_: float) -> None:
            save = next(waiting, None)
            if save is None:
                raise KeyboardInterrupt
            save()

        monkeypatch.setattr(watch, "time", SimpleNamespace(sleep=sleep))

    return begin


@pytest.fixture
def replaced(own_watch):
    """Saves a file of the cell with one text instead of another, as an editor does: a new file takes its name."""

    def change(old: str, new: str, name: str = "workspace.yaml") -> Save:
        def save() -> None:
            file = own_watch / name
            text = file.read_text(encoding="utf-8")
            assert old in text
            (own_watch / "new").write_text(text.replace(old, new), encoding="utf-8")
            (own_watch / "new").replace(file)

        return save

    return change


AIM = ("look_at: [1, 0, 1]", "look_at: [1, 5, 1]")
BACK = AIM[::-1]
BROKEN = ("robot:", "robot: [")


def rows(out: str, name: str) -> list[list[str]]:
    """The rows of all tables that begin with a name, by their cells."""
    return [line.split("  ") for line in out.splitlines() if line.startswith(name)]


@pytest.mark.parametrize(
    ("command", "edit", "row", "shown"),
    [
        (["rank", "watch green"], AIM, "seen", "100.0 → 0.0"),
        (["explain", "watch seen"], AIM, "in_place(seen), eye [%]", "100.0 → 0.0"),
        (["explain", "watch green", "--all"], AIM, "seen", "100.0 → 0.0"),
        (["score"], AIM, "watch: watch green", "passed → failed"),
        (["check", "watch green"], ("state: [in_place(seen), ", "state: ["), "seen", "can be done → `watch` needs"),
    ],
)
def test_each_command_shows_old_beside_new_once_a_file_is_saved(
    sqrp, own_watch, saving, replaced, command, edit, row, shown
):
    name, *task = command
    before = sqrp(name, own_watch, *task, "--jobs", 1, columns=120)
    saving(replaced(*edit))
    found = sqrp(name, own_watch, *task, "--watch", "--jobs", 1, columns=120)
    assert found.code == 130
    first, _, second = found.out.partition("workspace.yaml saved")
    assert first.strip() == before.out.strip()
    assert any(line.startswith(row) and shown in line for line in second.splitlines()), second
    assert "watching" in found.err
    assert found.err.endswith("interrupted\n")


def test_the_figures_beside_the_arrow_are_those_of_the_command_itself(sqrp, own_watch, saving, replaced):
    before = sqrp("rank", own_watch, "watch green", "--json").document["candidates"][0]
    saving(replaced(*AIM))
    out = sqrp("rank", own_watch, "watch green", "--watch", columns=120).out
    after = sqrp("rank", own_watch, "watch green", "--json").document["candidates"][0]
    assert before["q_avg"] != after["q_avg"]
    assert f"{100 * before['q_avg']:.1f} → {100 * after['q_avg']:.1f}" in out
    assert f"was: {before['verdict']}" in " ".join(out.split())
    assert f"now: {after['verdict']}" in " ".join(out.split())


def test_an_error_while_editing_is_told_and_recovered_from(sqrp, own_watch, saving, replaced):
    saving(replaced(*BROKEN), replaced(*BROKEN[::-1]), replaced(*AIM))
    found = sqrp("rank", own_watch, "watch seen", "--watch", columns=120)
    assert found.code == 130
    assert "workspace.yaml:2" in found.err
    assert found.out.count("No figure has changed.") == 1, "compared with the last state without errors"
    assert "100.0 → 0.0" in found.out


def test_a_workspace_that_begins_with_an_error_is_watched_with_every_file_that_it_refers_to(
    sqrp, own_watch, saving, replaced
):
    # A workspace that begins with an error is watched too.
    replaced(*BROKEN)()
    saving(replaced(*BROKEN[::-1]))
    found = sqrp("check", own_watch, "--watch")
    assert found.code == 130
    assert "error: " in found.err
    assert "watch" in found.out
    # Every file that the workspace refers to is watched.
    saving(replaced("wait: 2 s", "wait: 3 s", "watch/skill.yaml"), replaced("arm", "arm", "arm.urdf"))
    out = sqrp("rank", own_watch, "watch seen", "--watch", columns=120).out
    assert "skill.yaml saved" in out
    assert "4.00 → 5.00" in out
    assert "arm.urdf saved" in out


def test_rows_that_come_and_go_stand_beside_nothing_and_long_tables_show_what_differs(capsys):
    same = {f"c{i}": ("1",) for i in range(30)}
    print_changes(AnswerView(("", "n"), {"old": ("2",), **same}), AnswerView(("", "n"), {"new": ("3",), **same}))
    out = capsys.readouterr().out
    assert [cells for name in ("old", "new") for cells in rows(out, name)] == [["old", "2 → –"], ["new", "– → 3"]]
    assert "... and 30 as before" in out
