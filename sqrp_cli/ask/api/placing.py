"""Where cameras go: what is asked, and the workspace file with them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from sqrp_cli.cell.edits import with_cameras
from sqrp_cli.cell.mounts import Mounts, place_file, read_mounts
from sqrp_cli.cell.workspace_file import read_again
from sqrp_cli.errors import bad_input, bad_option, expected_names
from sqrp_cli.files.yaml_edit import patch
from sqrp_cli.score.kept import Results
from sqrp_cli.score.looks import cluster_verdicts, kept_verdicts
from sqrp_cli.search.goal import FewestPossible, Goal, read_goal
from sqrp_cli.search.place import CameraPlacer
from sqrp_cli.search.placing_problem import Requirements
from sqrp_cli.search.placing_program import Watch, solver_library
from sqrp_cli.search.placing_result import PlaceDocument, in_words
from sqrp_cli.search.sites import Verdicts, local_verdicts
from sqrp_cli.search.visibility_table import PlaceQuestion
from sqrp_cli.task.candidate import split_steps
from sqrp_cli.task.task import read_task

if TYPE_CHECKING:
    from sqrp_cli.ask.requests import PlaceRequest
    from sqrp_cli.cell.workspace import Workspace
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.score.compute import Means


def find_placement(
    cell: Cell, request: PlaceRequest, means: Means, watch: Watch | None, content: bytes | None
) -> PlaceDocument:
    """The best cameras for some tasks; at Ctrl-C the best so far, if verdicts are complete.

    watch: told what is sought, the best value so far and the bound. content: of the workspace file, where it is not
    that on the disk. Raises InputError for a request that cannot be read, and a folder that cannot be used.
    """
    solver_library()  # says at once that it is missing
    workspace = cell.workspace
    mounts = read_mounts(place_file(workspace, request.mounts), workspace, tuple(cell.model.links))
    for name in request.keep:
        if name not in workspace.cameras:
            message = f"there is no camera `{name}` to keep; {expected_names('', workspace.cameras)}"
            several = [part.strip() for part in name.split(",")]
            listed = len(several) > 1 and all(part in workspace.cameras for part in several)
            mend = " ".join(f"--keep {part}" for part in several) if listed else None
            raise bad_input("unknown-camera", message, mend=mend)
    keep = tuple(dict.fromkeys(request.keep))
    floor = _floor(request, workspace, len(keep))
    _check_budget(request, mounts, max(0 if floor is None else floor.cameras, 1 + request.survive - len(keep), 0))
    question = PlaceQuestion(
        cell=cell,
        world=cell.initial_world,
        tasks=tuple(read_task(text, workspace) for text in _tasks(request, workspace)),
        mounts=mounts,
        requirements=_requirements(request, floor, len(keep)),
        sampling=means.sampling,
        keep=keep,
        fastest=request.ways == "fastest",
    )
    with closing(Results(means.out)) as results:
        verdicts: Verdicts = partial(local_verdicts, cell, means.jobs)
        if means.cluster is not None:
            verdicts = partial(cluster_verdicts, means.cluster, workspace, cell.seed)
        if results.folder is not None:
            verdicts = partial(kept_verdicts, results, workspace, cell.seed, verdicts)
        seconds = inf if request.time is None else request.time
        asked = replace(question, verdicts=verdicts)
        placer = CameraPlacer(asked, request.progress, watch, seconds=seconds, gap=0.01 * request.gap)
        found = placer.place()
    file = read_again(workspace.whole_file.file, workspace.files["workspace"].digest, content)
    if not found.cameras:
        return replace(found, file=file, content=file.content)
    added = [(one.camera, one.place.lens.image, one.place.at, one.place.up) for one in found.cameras]
    patched = with_cameras(file, keep, added)
    return replace(found, file=file, content=patched, patch=patch(file, patched))


def _floor(request: PlaceRequest, workspace: Workspace, kept: int) -> FewestPossible | None:
    """What the skills of a workspace need at once, and who: with fewer cameras it has errors.

    Raises InputError for fewer cameras than that.
    """
    needs = ((target.cameras, skill.name) for skill in workspace.skills.values() for target in skill.targets.values())
    cameras, name = max(needs, default=(0, ""), key=lambda one: one[0])
    if cameras <= kept:
        return None
    reason = f"`{name}` needs {in_words(cameras)} at once"
    if request.cameras is not None and request.cameras < cameras - kept:
        mend = f"{request.given('cameras', cameras - kept)}, or leave the skill out of the workspace's `skills`"
        message = f"{reason}, and `sqrp check` refuses a cell with fewer; "
        message += f"{request.called('cameras')} is {request.cameras}"
        raise bad_option(message + (f", and {kept} stay" if kept else ""), mend=mend)
    return FewestPossible(cameras=cameras - kept, reason=reason)


def _check_budget(request: PlaceRequest, mounts: Mounts, count: int) -> None:
    """Raises InputError for a budget below the price of so many cameras, wherever they are."""
    lens = min(one.price for one in mounts.lenses)
    least = sum(sorted(spot.entry.price + lens for spot in mounts.spots)[:count])
    if request.budget is not None and least > request.budget + 1e-9:
        cameras = "the cheapest camera costs" if count == 1 else f"the cheapest {in_words(count)} cameras cost"
        message = f"{cameras} {least:g}, {request.called('budget')} is {request.budget:g}"
        raise bad_option(message, mend=request.given("budget", f"{least:.15g}"))


def _requirements(request: PlaceRequest, floor: FewestPossible | None, kept: int) -> Requirements:
    if request.cameras is not None and request.cameras + kept <= request.survive:
        message = f"of a single camera nothing is left if it fails, so that {request.given('survive', 1)} needs two"
        raise bad_option(message, mend=request.given("cameras", 2))
    goal = None if request.want is None else read_goal(request.want)
    if goal is None and request.cameras is None:
        goal = Goal(q_eoi=1.0)
    return Requirements(
        goal=goal,
        most=request.cameras,
        floor=floor,
        objective=request.objective,
        failure_tolerance=request.survive,
        budget=request.budget,
    )


def _tasks(request: PlaceRequest, workspace: Workspace) -> Sequence[str]:
    texts = list(dict.fromkeys(request.tasks or [task.task for task in workspace.tasks]))
    whole = [text for text in texts if len(split_steps(text)) > 1]
    if whole:
        message = f"`{whole[0]}` has several steps, and cameras are placed for tasks of one step"
        raise bad_option(message, mend="name tasks of one step")
    if not texts:
        message = "the workspace lists no tasks, so it is not known what cameras are for"
        raise bad_option(message, mend="name a task, such as `pickup green`")
    return texts
