"""Tasks that a workspace lists and that cannot be done, or not as it is expected of them, whatever the motions are."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace

from sqrp_cli.errors import InputError, Problem, expected_names
from sqrp_cli.knowledge.workspace.workspace import Thresholds, Workspace
from sqrp_cli.programming.task import read_task


def impossible_tasks(workspace: Workspace) -> Iterator[Problem]:
    """What `rank` would say of tasks that cannot be read, and warnings about expectations that cannot be met."""
    for index, expected in enumerate(workspace.tasks):
        path, thresholds = f"tasks.{index}", expected.thresholds
        try:
            task = read_task(expected.task, workspace)
        except InputError as error:
            place = workspace.places.get(f"{path}.task")
            yield from (replace(problem, place=place) for problem in error.problems)
            continue
        usable = dict.fromkeys(name for candidate in task.candidates for name in candidate.objects.values())
        winner = thresholds.winner
        if winner is not None and winner not in usable:
            expected_winner = expected_names(winner, usable)
            message = f"`{path}.winner`: no candidate of `{task.text}` uses `{winner}`; {expected_winner}"
            mend = "name an object that the task can use, or correct `task`"
            place = workspace.places.get(f"{path}.winner")
            yield Problem("impossible-winner", message, place, severity="warning", mend=mend)
        if thresholds.feasible is False:
            yield from _against_infeasible(workspace, path, thresholds)


def _against_infeasible(workspace: Workspace, path: str, thresholds: Thresholds) -> Iterator[Problem]:
    """What is expected of the best candidate of a task of which no candidate is to be feasible."""
    names = [field.name for field in fields(thresholds) if field.name != "feasible"]
    stated = [name for name in names if getattr(thresholds, name) is not None]
    if stated:
        keys = ", ".join(f"`{name}`" for name in stated)
        message = f"`{path}`: {keys} expected of the best candidate, but `feasible: false` expects that there is none"
        place = workspace.places.get(f"{path}.{stated[0]}")
        mend = f"remove `feasible: false`, or {keys}"
        yield Problem("contradictory-expectations", message, place, severity="warning", mend=mend)
