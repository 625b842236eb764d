"""Where cameras go: what is asked, and the workspace file with them."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from sqrp_cli.cell.edits import with_cameras
from sqrp_cli.cell.mounts import Mounts, place_file, read_mounts
from sqrp_cli.cell.workspace_file import read_again
from sqrp_cli.checks.lint import assumptions
from sqrp_cli.errors import bad_input, bad_option, expected_names
from sqrp_cli.files.yaml_edit import patch
from sqrp_cli.score.kept import Results
from sqrp_cli.score.mount_views import cluster_verdicts, kept_verdicts
from sqrp_cli.search.goal import Goal, read_goal
from sqrp_cli.search.place import CameraPlacer
from sqrp_cli.search.placing_problem import Requirements
from sqrp_cli.search.placing_program import Watch, solver_library
from sqrp_cli.search.placing_result import FewestPossible, PlaceDocument, count_in_words
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
    texts = list(dict.fromkeys(request.tasks or [task.task for task in workspace.tasks]))
    if whole := [text for text in texts if len(split_steps(text)) > 1]:
        message = f"`{whole[0]}` has several steps, and cameras are placed for tasks of one step"
        raise bad_option(message, mend="name tasks of one step")
    requirements = _requirements(request, workspace, mounts, len(keep))
    if not texts:
        message = "the workspace lists no tasks, so it is not known what cameras are for"
        raise bad_option(message, mend="name a task, such as `pickup green`")
    question = PlaceQuestion(
        cell=cell,
        world=cell.initial_world,
        tasks=tuple(read_task(text, workspace) for text in texts),
        mounts=mounts,
        requirements=requirements,
        sampling=means.sampling,
        keep=keep,
        fastest=request.ways == "first",
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
    named = {name for task in question.tasks for one in task.candidates for name in one.binding.values()}
    found = replace(found, assumed=assumptions(workspace, named, found.cell.observer.cameras))
    file = read_again(workspace.whole_file.file, workspace.files["workspace"].digest, content)
    if not found.cameras:
        return replace(found, file=file, content=file.content)
    added = [(one.camera, one.place.lens.image, one.place.at, one.place.up) for one in found.cameras]
    patched = with_cameras(file, keep, added)
    return replace(found, file=file, content=patched, patch=patch(file, patched))


def _requirements(request: PlaceRequest, workspace: Workspace, mounts: Mounts, kept: int) -> Requirements:
    """What is asked of the cameras, of which `kept` stay. Raises InputError for fewer, or less money, than can do."""
    needs = ((target.cameras, skill.name) for skill in workspace.skills.values() for target in skill.targets.values())
    most, name = max(needs, default=(0, ""), key=lambda one: one[0])
    least, floor = most - kept, None
    if least > 0:
        reason = f"`{name}` needs {count_in_words(most)} at once"
        if request.cameras is not None and request.cameras < least:
            mend = f"{request.given('cameras', least)}, or leave the skill out of the workspace's `skills`"
            message = f"{reason}, and `sqrp check` refuses a cell with fewer; "
            message += f"{request.called('cameras')} is {request.cameras}"
            raise bad_option(message + (f", and {kept} stay" if kept else ""), mend=mend)
        floor = FewestPossible(cameras=least, reason=reason)
    count = max(least, 1 + request.survive - kept, 0)
    lens = min(one.price for one in mounts.lenses.values())
    price = sum(sorted(site.entry.price + lens for site in mounts.sites)[:count])
    if request.budget is not None and price > request.budget + 1e-9:
        cameras = "the cheapest camera costs" if count == 1 else f"the cheapest {count_in_words(count)} cameras cost"
        message = f"{cameras} {price:g}, {request.called('budget')} is {request.budget:g}"
        raise bad_option(message, mend=request.given("budget", f"{price:.15g}"))
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
