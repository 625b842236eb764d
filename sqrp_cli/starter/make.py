"""Making a new workspace: in a draft folder, which is renamed when everything works."""

from __future__ import annotations

import json
import os
import shutil
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, permutations
from pathlib import Path

from sqrp_cli.checks.lint import lint
from sqrp_cli.errors import Infeasible, InputError, Place, Problem, bad_input
from sqrp_cli.knowledge.robot.urdf import UrdfJoint
from sqrp_cli.knowledge.workspace.load import load_workspace
from sqrp_cli.knowledge.workspace.workspace_file import WORKSPACE_FILE
from sqrp_cli.platform.files import naming, no_folder
from sqrp_cli.programming.cell import Cell
from sqrp_cli.programming.coverage.assessment import study
from sqrp_cli.programming.coverage.blind_spans import cause_totals
from sqrp_cli.programming.coverage.sampling import Adaptive
from sqrp_cli.programming.sensing.limits import Cause
from sqrp_cli.programming.task import read_task
from sqrp_cli.starter import search
from sqrp_cli.starter.arm_guess import ArmGuess, guess_arm
from sqrp_cli.starter.description import Description, OwnRobot, describe_robot
from sqrp_cli.starter.layout import TASK, Cube, Layout, Position, workspace_text
from sqrp_cli.starter.stands import DownPlaces, Stand, before_table, lowest_point, on_table

SHIPPED = Path(__file__).parent
"""Folder of the shipped skills and robots."""

OWN_ARM = "robots/six_axis_arm.urdf"
SUCTION_CUP = "robots/suction_cup.urdf"
SKILL = "skills/pickup"

LARGEST_CUBE, SMALLEST_CUBE = 0.05, 0.02
"""Side of a cube [m]; between these a twentieth of the arm's reach."""

LARGEST_TABLE = 100.0
"""Side of the largest table, for arms on long rails [m]."""

HOMES = ("home", "ready", "default", "start")
"""Words in the names of states from which work begins, the likeliest first."""

LIFT = 0.1
"""How far the skill lifts a cube [m]."""


@dataclass(frozen=True)
class Starter:
    """A workspace that was made."""

    folder: Path
    """Its path."""
    layout: Layout
    """What is in it."""
    warnings: tuple[Problem, ...]
    """About what could not be guessed."""

    @property
    def tip(self) -> str:
        """The link that carries the tool."""
        return self.layout.tip

    @property
    def cubes(self) -> tuple[str, ...]:
        """The cubes within reach, by name."""
        return tuple(cube.name for cube in self.layout.cubes)

    @property
    def task(self) -> str | None:
        """A task to rank; None if nothing is within reach."""
        return self.layout.tasks[0] if self.layout.cubes else None


def make_starter(
    folder: Path,
    robot: OwnRobot | str | None,
    tip: str | None = None,
    advance: Callable[[int], object] = lambda _: None,
) -> Starter:
    """Make a workspace in a folder that does not exist or is empty.

    robot: the user's arm, or just its URDF, a path or `package://...`; None for a shipped arm.
    tip: the link at the end of the arm, of a robot that has several; None to guess. advance: called with 1 for each of
    at most `MOST_STANDS` that was tried.
    Raises InputError, and writes nothing, if the folder cannot be made or the robot cannot be used.
    """
    _check_free(folder)
    folder = folder.absolute()
    draft = folder.with_name(f".{folder.name}.{os.getpid()}")  # beside it, so that relative paths stay true
    try:
        with naming(folder, "this folder cannot be made"):
            _copy_shipped(draft, own_arm=robot is None)
            own = robot if isinstance(robot, OwnRobot) else OwnRobot(robot or str(draft / OWN_ARM))
            description = describe_robot(own, draft)
            layout, warnings = _fill(draft, description, tip, advance, guessed=robot is not None)
            _move(draft, folder)
    except InputError as error:
        raise InputError(*(_moved(problem, draft, folder) for problem in error.problems)) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    told = tuple(_moved(problem, draft, folder) for problem in (*description.warnings, *warnings))
    return Starter(folder, layout, told)


def _moved(problem: Problem, draft: Path, folder: Path) -> Problem:
    """A problem of the draft as one of the finished folder."""
    place = problem.place
    if place is not None and place.file.is_relative_to(draft):
        place = replace(place, file=folder / place.file.relative_to(draft))
    message, mend = (text and text.replace(str(draft), str(folder)) for text in (problem.message, problem.mend))
    return replace(problem, message=message or "", place=place, mend=mend)


def _check_free(folder: Path) -> None:
    """Raises InputError if the folder cannot be made, or is not empty."""
    parent = folder.parent
    if folder.is_dir():
        if any(folder.iterdir()):
            message = "this folder is not empty, and nothing is ever overwritten; expected the name of a new folder"
            raise bad_input("not-empty", message, Place(folder))
    elif folder.exists() or folder.is_symlink():
        raise bad_input("cannot-write", "this is a file; expected the name of a new folder", Place(folder))
    if not parent.is_dir():
        raise InputError(no_folder(parent, folder))
    if not os.access(parent, os.W_OK):
        raise bad_input("cannot-write", f"the folder {parent} cannot be written to", Place(folder))


def _copy_shipped(draft: Path, *, own_arm: bool) -> None:
    """The skill and the robots that a workspace needs."""
    shutil.copytree(SHIPPED / SKILL, draft / SKILL)
    (draft / "robots").mkdir()
    for file in (SUCTION_CUP, *([OWN_ARM] if own_arm else [])):
        shutil.copyfile(SHIPPED / file, draft / file)


def _move(draft: Path, folder: Path) -> None:
    """Rename the draft; if the folder exists already, move the workspace file last."""
    if not folder.exists():
        draft.replace(folder)
        return
    for entry in sorted(draft.iterdir(), key=lambda entry: entry.name == WORKSPACE_FILE):
        entry.replace(folder / entry.name)


def _fill(
    draft: Path, description: Description, tip: str | None, advance: Callable[[int], object], *, guessed: bool
) -> tuple[Layout, tuple[Problem, ...]]:
    """Determine the contents of the workspace file step by step, and write it."""
    arm = guess_arm(description.urdf, tip or description.tip)
    tried = _tried(draft, _bare_layout(description, arm, guessed=guessed), arm, advance)
    best = max(tried, key=lambda trial: len(trial.layout.cubes)).layout  # the first of equals: the least lifted
    best = _told_apart(draft, _with_named_home(draft, best, description))
    _write(draft, best)
    others = [_other_arms(arm)] if arm.others else []
    if not best.cubes:
        return best, (*others, _nothing_in_reach(tried))
    workspace = load_workspace(draft)
    return best, (*others, *workspace.warnings, *lint(workspace))


def _bare_layout(description: Description, arm: ArmGuess, *, guessed: bool) -> Layout:
    """The arm alone, as its files describe it."""
    return Layout(
        urdf=description.reference,
        srdf=description.srdf,
        package_roots=description.package_roots,
        guessed=guessed,
        limits=limits_text(description),
        tip=arm.tip,
        home={joint.name: _resting(joint) for joint in arm.joints},
    )


def _tried(draft: Path, layout: Layout, arm: ArmGuess, advance: Callable[[int], object]) -> list[_Trial]:
    """What the arm can do with a tool from one stand after the other, until there is enough."""
    bare = _load(draft, layout)
    layout = replace(layout, X_LT=search.tool_seat(bare, arm))
    seated = _load(draft, layout)
    reach = search.arm_reach(seated.model)
    side = min(round(2.4 * reach, 1), LARGEST_TABLE)
    cube = min(max(round(reach / 20, 2), SMALLEST_CUBE), LARGEST_CUBE)
    layout = replace(layout, table_side=side, cube_size=cube)
    floor = max(0.0, -round(lowest_point(bare), 3))
    down = DownPlaces(seated.model)
    tried: list[_Trial] = []
    for stand in chain(on_table(floor, reach, side), before_table(seated, reach, down)):
        tried.append(_with_work(draft, layout, reach, stand, down))
        advance(1)
        if len(tried[-1].layout.cubes) == len(search.COLORS):
            break
    return tried


def _with_named_home(draft: Path, layout: Layout, description: Description) -> Layout:
    """The layout with a state of the SRDF that is called home, if it has all joints of the arm and loses no cube."""
    states = description.semantics.states if description.semantics else {}
    whole = [name for name, positions in states.items() if layout.home.keys() <= positions.keys()]
    for name in (name for word in HOMES for name in whole if word in name.lower()):
        named = replace(layout, home_state=name)
        try:
            found = search.cubes_in_reach(_load(draft, named), layout.cubes)
        except InputError:  # outside the limits
            continue
        if 0 < sum(cube.color in TASK for cube in layout.cubes) == len(found.cubes):
            return named
    return layout


def _told_apart(draft: Path, layout: Layout) -> Layout:
    """The layout with the colours of its cubes changed round so that the fewest stand behind another of their colour.

    With all of them green, what each camera loses for another cube is known of every pair; pairs of two colours lose
    nothing.
    """
    names = [f"c{index + 1}" for index in range(len(layout.cubes))]
    green = [replace(cube, name=name, color="green") for name, cube in zip(names, layout.cubes, strict=True)]
    cell, lost = _load(draft, replace(layout, cubes=green)), defaultdict[tuple[str, str], float](float)
    for candidate in read_task(TASK, cell.workspace).candidates if green else ():
        found = study(cell, candidate, cell.initial_world, Adaptive(), full=True)
        if not isinstance(found, Infeasible):
            (own,) = candidate.binding.values()
            for total in cause_totals(cell, found):
                if total.cause is Cause.SAME_COLOUR:
                    lost[own, total.by or ""] += total.duration

    def loss(colors: Sequence[str]) -> float:
        pairs = permutations(zip(names, colors, strict=True), 2)
        return sum(lost[first, other] for (first, color), (other, same) in pairs if color == same)

    usual = [cube.color for cube in layout.cubes]
    colors = min(dict.fromkeys(permutations(usual)), key=loss, default=())
    numbers = [colors[: index + 1].count(color) for index, color in enumerate(colors)]
    painted = zip(layout.cubes, colors, numbers, strict=True)
    return replace(
        layout, cubes=[replace(cube, name=f"{color[0]}{number}", color=color) for cube, color, number in painted]
    )


def _other_arms(arm: ArmGuess) -> Problem:
    names = " or ".join(f"`--tip {name}`" for name in arm.others)
    message = f"the robot has several arms, and the one that carries `{arm.tip}` is taken"
    return Problem("several-arms", message, severity="warning", mend=f"another one: {names}")


def _nothing_in_reach(tried: Sequence[_Trial]) -> Problem:
    message = f"no place was found from which the arm can pick something up from above: {tried[0].reason}"
    if len(tried) > 1:
        message += f"; {len(tried) - 1} other heights and places of the table are no better"
    mend = "check `robot.base`, `robot.tool` and `robot.home`, then add cameras, objects and `skills: [skills/pickup]`"
    return Problem("nothing-in-reach", message, severity="warning", mend=mend)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A layout with a home position, reachable cubes and cameras, as far as they are found; and why not further."""

    layout: Layout
    reason: str


def _with_work(draft: Path, layout: Layout, reach: float, stand: Stand, down: DownPlaces) -> _Trial:
    layout = replace(layout, lift=stand.lift, table_side=stand.side, table_at=stand.at)
    cell = _load(draft, layout)
    home = search.find_home(cell, reach, stand, down)
    if isinstance(home, search.NoHome):
        return _Trial(layout, str(home))
    layout = replace(layout, home=home.positions)
    size = layout.cube_size
    found = _reachable(draft, layout, search.places_to_try(cell.model, reach, home.direction, size, stand))
    if len(found.cubes) < len(search.COLORS):
        others = _reachable(draft, layout, search.other_places(cell.model, reach, size, stand, down))
        found = max(found, others, key=lambda one: len(one.cubes))
    views = search.views_of(cell, home, found.cubes, LIFT) if found.cubes else ()
    return _Trial(replace(layout, cubes=found.cubes, views=views), found.reason)


def _reachable(draft: Path, layout: Layout, places: Iterator[Cube]) -> search.Reachable:
    """The cubes of those at some places that the arm can pick up."""
    trial = [*places]
    if not trial:
        return search.Reachable((), "there is no place on the table for anything")
    return search.cubes_in_reach(_load(draft, replace(layout, cubes=trial)), trial)


def _load(draft: Path, layout: Layout) -> Cell:
    _write(draft, layout)
    return Cell.load(load_workspace(draft))


def _write(draft: Path, layout: Layout) -> None:
    (draft / WORKSPACE_FILE).write_text(workspace_text(layout), encoding="utf-8")


def _resting(joint: UrdfJoint) -> Position:
    """Where a joint is until a home position is found: at 0, or in the middle of limits that exclude it."""
    within = joint.lower <= 0.0 <= joint.upper
    return Position(0.0 if within else 0.5 * (joint.lower + joint.upper), turns=joint.type != "prismatic")


ASSUMED = {"acceleration": 2, "jerk": 20}
"""Limits that a URDF cannot state: gentle ones [rad/s^2, rad/s^3, or m for a sliding joint]."""


def limits_text(description: Description) -> str:
    """The value of `robot.limits`: MoveIt's file where there is one, and what it leaves open."""
    if description.limits is None or description.limits_file is None:
        assumed = ", ".join(f"{kind}: {value}" for kind, value in ASSUMED.items())
        return f"{{{assumed}}}  # rad/s^2 and rad/s^3, which a URDF cannot say; velocity is the URDF's"
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
