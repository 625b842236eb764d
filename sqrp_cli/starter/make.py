"""Make a starter workspace: find out what an arm can do, and write a cell around it."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil, floor, radians
from pathlib import Path

import numpy as np

from sqrp_cli.cell.load import load_workspace
from sqrp_cli.cell.workspace_file import WORKSPACE_FILE
from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Infeasible, InputError, Place, Problem, bad_input, bad_option
from sqrp_cli.geometry import Array
from sqrp_cli.motion.cell import Cell
from sqrp_cli.platform.files import naming, no_folder
from sqrp_cli.starter import search
from sqrp_cli.starter.arm_guess import ArmGuess, guess_arm
from sqrp_cli.starter.description import Description, OwnRobot, describe_robot
from sqrp_cli.starter.from_recording import FIRST_EPISODES, with_recording
from sqrp_cli.starter.hand import Grip, driven_joints, find_grip
from sqrp_cli.starter.layout import RECORDED, SCHEMA, TASK, Cube, Layout, mounts_text, workspace_text
from sqrp_cli.task.feasibility import feasible_motion
from sqrp_cli.task.task import read_task

SHIPPED = Path(__file__).parent  # folder of the shipped skills and robots
OWN_ARM = "robots/six_axis_arm.urdf"
SUCTION_CUP = "robots/suction_cup.urdf"
SKILL = "skills/pickup"
LARGEST_CUBE, SMALLEST_CUBE = 0.05, 0.02  # side of a cube [m]; between these a twentieth of the arm's reach
COMMON_PART = 0.05  # width of parts that a hand with one moving jaw is opened for, at least [m]
HOMES = ("home", "ready", "default", "start")
"""Words in the names of states from which work begins, the likeliest first."""
BESIDE = "beside: 3 mm"  # of the jaw that stands still, until the other one pushes the part to it
LIFT = 0.1  # how far the skill lifts a cube [m]
SMALL, CLOSER = 0.5, {"lift: 10 cm": "lift: 5 cm", "retreat: 6 cm": "retreat: 4 cm"}
"""Reach of arms that lift and approach less [m], and what their skill states instead."""
_MEND_GRIPPER = "leave `--gripper` out, then state it as `robot.tool`, with `boxes` or its `urdf`, and `robot.fingers`"
TOLERANT = "\n  angle_tolerance: 0.5 deg  # check: a limit of the wrist leaves the tool that far from straight down"
ASSUMED = {"acceleration": 2, "jerk": 20}
"""Limits that a URDF cannot state: gentle ones [rad/s^2, rad/s^3, or m for a sliding joint]."""


def make_starter(
    folder: Path,
    robot: OwnRobot | str | None,
    tip: str | None = None,
    advance: Callable[[int], object] = lambda _: None,
    schema: str = "{}",
    recording: Path | None = None,
) -> Layout:
    """Make a workspace in a folder that does not exist or is empty.

    robot: the user's arm, or just its URDF, a path or `package://...`; None for a shipped arm.
    tip: the link at the end of the arm, of a robot that has several; None to guess. advance: called with 1 for each of
    at most `MOST_STANDS` that was tried. schema: of its file, for editors. recording: whose episodes are the task,
    instead of cubes that the arm can pick up.
    Raises InputError, and writes nothing, if the folder cannot be made or the robot cannot be used.
    """
    if folder.is_dir():
        if any(folder.iterdir()):
            message = "this folder is not empty, and nothing is ever overwritten; expected the name of a new folder"
            raise bad_input("not-empty", message, Place(folder))
    elif folder.exists() or folder.is_symlink():
        raise bad_input("cannot-write", "this is a file; expected the name of a new folder", Place(folder))
    if not folder.parent.is_dir():
        raise InputError(no_folder(folder.parent, folder))
    if not os.access(folder.parent, os.W_OK):
        raise bad_input("cannot-write", f"the folder {folder.parent} cannot be written to", Place(folder))
    folder = folder.absolute()
    draft = folder.with_name(f".{folder.name}.{os.getpid()}")  # beside it, so that relative paths stay true

    def of_folder(problems: Iterable[Problem]) -> Iterator[Problem]:
        """Problems of the draft as ones of the finished folder."""
        for problem in problems:
            message, mend, place = problem.message.replace(str(draft), str(folder)), problem.mend, problem.place
            if place is not None and place.file.is_relative_to(draft):
                place = replace(place, file=folder / place.file.relative_to(draft))
            yield replace(problem, message=message, place=place, mend=mend and mend.replace(str(draft), str(folder)))

    try:
        with naming(folder, "this folder cannot be made"):
            if recording is None:
                shutil.copytree(SHIPPED / SKILL, draft / SKILL)
            (draft / SCHEMA).parent.mkdir(parents=True)
            (draft / SCHEMA).write_text(schema, encoding="utf-8")
            own = robot if isinstance(robot, OwnRobot) else OwnRobot(robot or str(_shipped(OWN_ARM, draft)))
            described = describe_robot(own, draft)
            layout = _filled(draft, described, tip, advance, guessed=robot is not None, recording=recording)
            if not folder.exists():
                draft.replace(folder)
            else:  # the workspace file comes last
                for entry in sorted(draft.iterdir(), key=lambda entry: entry.name == WORKSPACE_FILE):
                    entry.replace(folder / entry.name)
    except InputError as error:
        raise InputError(*of_folder(error.problems)) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return replace(layout, folder=folder, warnings=tuple(of_folder(layout.warnings)))


def _filled(
    draft: Path,
    description: Description,
    tip: str | None,
    advance: Callable[[int], object],
    *,
    guessed: bool,
    recording: Path | None,
) -> Layout:
    """Determine the contents of the workspace file step by step, and write it."""
    arm = guess_arm(description.urdf, tip or description.tip)
    layout = Layout(
        folder=draft,
        robot=description,
        guessed=guessed,
        limits=_limits_text(description),
        tip=arm.tip,
        # At 0, or in the middle of limits that exclude it, until a home position is found.
        home={one.name: 0.0 if one.lower <= 0.0 <= one.upper else 0.5 * (one.lower + one.upper) for one in arm.joints},
        slides=frozenset(joint.name for joint in arm.joints if joint.type == "prismatic"),
    )
    if recording is not None:
        layout = _with_hand(layout, arm, _load(layout))
        file_name = json.dumps(os.path.relpath(recording, draft.parent / "any"), ensure_ascii=False)
        best = with_recording(layout, _load(layout), recording, file_name)
        (draft / "place.yaml").write_text(mounts_text(best), encoding="utf-8")
        told, cell = [*best.told], _load(best)
        for candidate in read_task(RECORDED, workspace := cell.workspace).candidates[:FIRST_EPISODES]:
            motion = feasible_motion(cell, candidate, cell.initial_world)
            doubts = motion.reasons if isinstance(motion, Infeasible) else motion.doubts
            told += [f"{candidate.name}: {one}" for one in doubts]
        return replace(best, told=tuple(told), warnings=(*description.warnings, *workspace.warnings, *lint(workspace)))
    tried = _tried(layout, arm, advance)
    best = max((layout for layout, _ in tried), key=lambda layout: len(layout.cubes))  # of equals the least lifted
    states = description.srdf.states if description.srdf else {}
    whole = [name for name, positions in states.items() if best.home.keys() <= positions.keys()]
    for name in (name for word in HOMES for name in whole if word in name.lower()):
        named = replace(best, home_state=name)
        with suppress(InputError):  # outside the limits
            cubes, _ = search.cubes_in_reach(_load(named), best.cubes)
            if 0 < sum(cube.color in TASK for cube in best.cubes) == len(cubes):  # it loses none
                best = named
                break
    warnings = [*description.warnings]
    if arm.others:
        message = f"the robot has several arms, and the one that carries `{arm.tip}` is taken"
        mend = "another one: " + " or ".join(f"`--tip {name}`" for name in arm.others)
        warnings.append(Problem("several-arms", message, severity="warning", mend=mend))
    (draft / WORKSPACE_FILE).write_text(workspace_text(best), encoding="utf-8")
    if best.cubes:
        workspace = load_workspace(draft)
        return replace(best, warnings=(*warnings, *workspace.warnings, *lint(workspace)))
    message = f"no place was found from which the arm can pick something up from above: {tried[0][1]}"
    if len(tried) > 1:
        message += f"; {len(tried) - 1} other heights and places of the table are no better"
    mend = "check `robot.base`, `robot.tool` and `robot.home`, then add cameras, objects and `skills: [skills/pickup]`"
    return replace(best, warnings=(*warnings, Problem("nothing-in-reach", message, severity="warning", mend=mend)))


def _cube_size(reach: float, grip: Grip | None) -> float:
    """Side of the cubes [m]: by the arm's reach, and so that the fingers can take them and stay off the table."""
    smallest, largest = (SMALLEST_CUBE, LARGEST_CUBE) if grip is None else (0.03, min(LARGEST_CUBE, 0.6 * grip.width))
    return max(min(max(round(reach / 20, 2), smallest), round(largest, 3)), SMALLEST_CUBE)


def _with_hand(layout: Layout, arm: ArmGuess, bare: Cell) -> Layout:
    """The layout with what grasps: the gripper that is named, else the hand of the robot, else a suction cup."""
    robot, gripper, seat = layout.robot.urdf, layout.robot.gripper, search.tool_seat(bare, arm)
    root, carried, out, joints = arm.tip, arm.carried, arm.out, robot.movable_joints
    if gripper is not None:
        if own := driven_joints(joints, carried):
            message = f"`{robot.name}` has a hand, which `{own[0].name}` moves; a second one does not fit on it"
            raise bad_option(message, mend="leave `--gripper` out, or name a URDF of the arm without its hand")
        root, carried, joints = gripper.root, tuple(gripper.links), gripper.movable_joints
        layout, out = replace(layout, X_LT=seat), np.array([0.0, 0.0, 1.0])
    driven, size = driven_joints(joints, carried), max(_cube_size(search.arm_reach(bare.model), None), COMMON_PART)
    if driven:
        slides = {*layout.slides, *(joint.name for joint in driven if joint.type == "prismatic")}
        lower, upper = {}, {}  # in whole tenths of degrees or millimetres, as the file has them
        for joint in driven:
            step = 1e-4 if joint.name in slides else radians(0.1)
            lower[joint.name] = ceil(joint.lower / step - 1e-6) * step
            upper[joint.name] = floor(joint.upper / step + 1e-6) * step
        layout = replace(layout, grip=Grip(lower, upper, SMALLEST_CUBE, np.eye(4)), slides=frozenset(slides))
        grip = find_grip(_load(layout), root, carried, out, size)
        if grip is not None:
            if grip.single:
                _restate(layout, {"depth: $depth}": f"depth: $depth, {BESIDE}}}"})
            return replace(layout, grip=grip)
    if gripper is not None:
        message = f"`{gripper.name}` has no fingers that SQRP understands: one or two joints that close on something"
        raise bad_input("no-gripper", message, gripper.links[gripper.root].place, mend=_MEND_GRIPPER)
    _shipped(SUCTION_CUP, layout.folder)
    return replace(layout, X_LT=seat, grip=None)


def _shipped(robot: str, folder: Path) -> Path:
    """A robot that comes with this program, copied into a workspace."""
    (folder / robot).parent.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copyfile(SHIPPED / robot, folder / robot))


def _tried(layout: Layout, arm: ArmGuess, advance: Callable[[int], object]) -> list[tuple[Layout, str]]:
    """For one stand after the other, until there is enough: home, cubes in reach and cameras; and why not more."""
    bare, ways = _load(layout), list[tuple[Layout, Cell, Array]]()
    # Where the tool never points down, its frame may be upside down, or a limit of the wrist rounded.
    for out, limits in ((arm.out, ""), (-arm.out, ""), (arm.out, TOLERANT)):
        found = _with_hand(replace(layout, limits=layout.limits + limits), replace(arm, out=out), bare)
        seated = _load(found)
        ways.append((found, seated, search.places_pointing_down(seated.model)))
        if len(ways[-1][2]):
            break
    layout, seated, down = ways[-1] if len(ways[-1][2]) else ways[0]
    reach = search.arm_reach(seated.model)
    size = _cube_size(reach, layout.grip)
    if reach < SMALL:
        _restate(layout, CLOSER)
    tried: list[tuple[Layout, str]] = []
    for there in search.stands(replace(layout, cube_size=size), seated, bare, reach, down):
        cell = _load(there)
        home = search.find_home(cell, reach, there, down)
        if isinstance(home, Infeasible):
            reason = home.reasons[0]
        else:
            cubes: Sequence[Cube] = ()
            for places in (None, down):
                trial = [*search.cube_places(cell.model, reach, home, places)]
                why = "there is no place on the table for anything"
                taken: Sequence[Cube] = ()
                if trial:
                    taken, why = search.cubes_in_reach(_load(replace(home, cubes=trial)), trial)
                if places is None or len(taken) > len(cubes):
                    cubes, reason = taken, why
                if len(cubes) == len(search.COLORS):
                    break
            there = replace(home, cubes=cubes, views=search.views_of(cell, home, cubes, LIFT) if cubes else {})
        tried.append((there, reason))
        advance(1)
        most = max(len(one.cubes) for one, _ in tried)
        if most == len(search.COLORS) or (len(there.cubes) < most and most > 1):  # what comes next is hardly better
            break
    return tried


def _restate(layout: Layout, said: Mapping[str, str]) -> None:
    """Say something else in the skills of a layout: texts by those that they replace."""
    for file in (layout.folder / SKILL).glob("**/skill.yaml"):
        text = file.read_text(encoding="utf-8")
        for old, new in said.items():
            text = text.replace(old, new)
        file.write_text(text, encoding="utf-8")


def _load(layout: Layout) -> Cell:
    """The cell of a layout, whose file is written."""
    (layout.folder / WORKSPACE_FILE).write_text(workspace_text(layout), encoding="utf-8")
    return Cell.load(load_workspace(layout.folder))


def _limits_text(description: Description) -> str:
    """The value of `robot.limits`: MoveIt's file where there is one, and what it leaves open."""
    if description.limits is None or description.limits_file is None:
        mjcf = description.urdf.is_mjcf
        assumed = "velocity: 1, " * mjcf + ", ".join(f"{kind}: {value}" for kind, value in ASSUMED.items())
        unsaid = "which an MJCF cannot say" if mjcf else "which a URDF cannot say; velocity is the URDF's"
        return f"{{{assumed}}}  # {'check: rad/s, ' if mjcf else ''}rad/s^2 and rad/s^3, {unsaid}"
    joints = [joint.name for joint in description.urdf.movable_joints]
    entries = [f"moveit: {json.dumps(description.limits_file, ensure_ascii=False)}"]
    guessed = []
    for kind, value in ASSUMED.items():
        open_joints = [name for name in joints if name not in description.limits.stated[kind]]
        if len(open_joints) == len(joints):
            entries.append(f"{kind}: {value}")
        elif open_joints:
            entries.append(f"{kind}: {{{', '.join(f'{json.dumps(name)}: {value}' for name in open_joints)}}}")
        guessed += [kind] if open_joints else []
    scaling = [f"{kind} x {factor:g}" for kind, factor in description.limits.scaling.items() if factor != 1.0]
    notes = [f"scaled as MoveIt does: {', '.join(scaling)}"] if scaling else []
    notes += [f"check: {' and '.join(guessed)} assumed, not stated there"] if guessed else []
    return f"{{{', '.join(entries)}}}" + (f"  # {'; '.join(notes)}" if notes else "")
