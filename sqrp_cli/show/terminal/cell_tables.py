"""The output of `sqrp check`, `rules`, `show`, `init` and `program`: what there is, what can be done, and why not."""

from __future__ import annotations

import shlex
from collections.abc import Collection, Iterable, Sequence
from itertools import groupby
from math import atan, degrees, inf
from pathlib import Path
from typing import TYPE_CHECKING

from sqrp_cli.show.sentences import in_cases
from sqrp_cli.show.terminal.console import (
    SEVERITY_STYLES,
    Column,
    Styled,
    TableCell,
    delay,
    joined,
    numbers,
    print_table,
    say,
    say_command,
    say_line,
    styled,
)
from sqrp_cli.show.terminal.rank_table import MOST_ROWS, first_of_each, print_infeasible

if TYPE_CHECKING:
    from sqrp_cli.document import Pose
    from sqrp_cli.figures import FaultMetrics
    from sqrp_cli.search.planned_step import PlannedStep
    from sqrp_cli.show.documents.checks import Check, RulesDocument
    from sqrp_cli.show.documents.programs import NewCell, ProgramDocument
    from sqrp_cli.show.documents.scene import ShowDocument


def print_check(found: Check) -> None:
    """What of a task can be done, or what first, and why not; without one that the cell is valid. Silent on errors."""
    if not found.valid:
        return
    if found.task is None:
        count = len(found.problems)
        said = f"{count} warning{'s' if count > 1 else ''}" if count else "nothing to complain about"
        say(f"{found.workspace} is valid: {said}.")
        if found.example is not None and all(problem.code != "no-skills" for problem in found.problems):
            say_command("Try:", f"sqrp rank {shlex.quote(found.path)} {shlex.quote(found.example)}")
        return
    feasible = [one for one in found.candidates if one.feasible]
    if found.suggested and not feasible:
        *first, last = (f"`{step.task}`" for step in found.suggested)
        say(f"First do {', then '.join(first)}; then {last} can be done.\n", "bold")
    able = f"{len(feasible)} of {len(found.candidates)} candidates can be done"
    at_once = " at once" if found.suggested and not feasible else ""
    say(joined([(found.task, "bold"), f" in {found.workspace}: {able}{at_once}\n"]))
    shown = feasible
    if len(feasible) > MOST_ROWS:  # the fastest for each choice of objects, the first of them
        fastest = first_of_each(sorted(feasible, key=lambda one: one.time or 0.0))
        shown = [one for one in feasible if one.name in fastest]
    if feasible:
        rows = [(one.name, f"{one.time:.2f}" if one.time is not None else "") for one in shown]
        print_table([Column("candidate"), Column("takes at least [s]", right=True)], rows)
        if len(shown) < len(feasible):
            say(f"... and {len(feasible) - len(shown)} more (--json)", "dim")
    elif found.suggested:
        print_suggested(found.suggested)
        say()
    print_infeasible(
        (one.name, one.objects, "; ".join(filter(None, [*one.reasons, one.advice])))
        for one in found.candidates
        if not one.feasible
    )
    if remarks := [f"{one.name}: {', '.join(one.remarks)}" for one in shown if one.remarks]:
        say()
    for line in remarks:
        say(line)
    if feasible:
        say()
        say_command("Which of them is seen best:", f"sqrp rank {shlex.quote(found.path)} {shlex.quote(found.task)}")


def print_suggested(suggested: Sequence[PlannedStep]) -> None:
    """The steps that lead to a task, a row each, in its best way; all are feasible."""
    columns = [Column("#"), Column("step"), *numbers("critical time\nseen [%]", "time seen\n[%]", "takes\n[s]")]
    rows = [
        (str(number), step.task, step.q_eoi, step.q_avg, f"{step.time:.2f}") for number, step in enumerate(suggested, 1)
    ]
    print_table(columns, rows)


def print_rules(found: RulesDocument) -> None:
    """A row for each finding, a table for each subject; of a single one all that is known."""
    if len(found.rules) > 1:
        for number, (subject, group) in enumerate(groupby(found.rules, key=lambda rule: rule.subject)):
            if number:
                say()
            rows = []
            for rule in group:
                *both, last = rule.severity
                rows.append((rule.code, styled("either" if both else last, SEVERITY_STYLES[last]), rule.meaning))
            print_table([Column(subject), Column("severity"), Column("looks for", shrink=True)], rows)
        say("\nOne of them in full, with examples: sqrp rules CODE")
        return
    (rule,) = found.rules
    say_line(f"{rule.code} ({' or '.join(rule.severity)}): {rule.subject}", "bold")
    say(rule.meaning)
    say(rule.why)
    of = f" in {rule.file}" if rule.file else ""
    for title, example in (("Passes", rule.passes), ("Fails", rule.fails)):
        say(f"\n{title}{of}:")
        for line in example.splitlines():
            say_line(f"  {line}")


def _numbered(values: Iterable[float]) -> str:
    """Numbers [m] to 1 mm."""
    return " ".join(f"{value:z.3f}" for value in values)


def _position(pose: Pose | None) -> str:
    return "unknown" if pose is None else _numbered(row[3] for row in pose[:3])


def print_scene(found: ShowDocument) -> None:
    """Robot, cameras, objects, skills and state."""
    robot = found.robot
    arm = f"{Path(robot.urdf).name} with {len(robot.arm)} arm joints, tool frame {robot.tool_frame}"
    say(f"{found.workspace}: {arm}\n", "bold")
    joints = []
    for name in robot.arm:
        one = robot.joints[name]
        lower, upper = -inf if one.lower is None else one.lower, inf if one.upper is None else one.upper
        values = (lower, upper, one.velocity, one.acceleration, one.jerk, robot.home[name])
        joints.append((name, *(f"{1000 * v:z.0f} mm" if one.slides else f"{degrees(v):z.0f}" for v in values)))
    print_table([Column("joint [deg, s]"), *numbers("min", "max", "speed", "acceleration", "jerk", "home")], joints)
    if robot.angle_tolerance:
        say(f"\nposes of the tool may be missed by {degrees(robot.angle_tolerance):g} deg (angle_tolerance)")
    if (fingers := robot.fingers) is not None:
        moves = []
        for name, opened in fingers.open.items():
            ends, slides = (opened, fingers.closed[name]), robot.joints[name].slides
            opened_at, closed_at = (f"{1000 * v:z.4g} mm" if slides else f"{degrees(v):z.4g} deg" for v in ends)
            moves.append(f"{name} {opened_at} open, {closed_at} closed")
        width = "" if fingers.width is None else f"; open, they are {1000 * fingers.width:.3g} mm apart"
        say(f"\nfingers  {'; '.join(moves)}{width}")
    if robot.markers:
        markers = (f"{link} (id {m.id} of {m.dictionary}, {1000 * m.side:.0f} mm)" for link, m in robot.markers.items())
        say(f"markers  {', '.join(markers)}")
    say(f"\n{robot.contact}\n")
    _print_cameras(found)
    say()
    objects, lights = [], []
    for name, thing in found.objects.items():
        what = " ".join(filter(None, (thing.color, thing.type, *thing.attributes)))
        at = "from the recording" if name in (found.recorded or ()) else _position(thing.pose)
        on = "tool" if name == robot.held else thing.on or ""
        objects.append((name, what, _numbered(thing.size), at, "fixed" if thing.fixed else "movable", on))
    print_table(list(map(Column, ("object", "what", "size [m]", "at [m]", "", "on"))), objects)
    for name, light in (found.lights or {}).items():
        way = "everywhere" if light.direction is None else _numbered(light.direction)
        beam = "" if light.beam is None else f"{degrees(light.beam):.0f}"
        lights.append((name, f"{light.intensity:g}", way, _numbered(light.position or ()), beam))
    if lights:
        say()
        print_table(list(map(Column, ("light", "intensity", "direction", "at [m]", "beam [deg]"))), lights)
    say(f"\nskills  {', '.join(found.skills)}")
    derived, states = found.derived or {}, list[str]()
    for why in dict.fromkeys(derived.values()):
        states.append(f"{', '.join(fact for fact, of in derived.items() if of == why)} (follows from {why})")
    if stated := [fact for fact in found.state if fact not in derived]:
        states.insert(0, ", ".join(stated))
    say(f"state   {'; '.join(states) or 'nothing holds'}", indent=8)
    say(f"tasks   {', '.join(found.tasks) or 'none'}")


def _print_cameras(found: ShowDocument) -> None:
    """What each camera sees, from where it reads markers, and the files that say so."""
    cameras = []
    for name, one in found.cameras.items():
        view, lens = degrees(2 * atan(one.width / 2 / one.K[0][0])), one.distortion_model if any(one.D) else "ideal"
        seen = f"{one.width}x{one.height}", f"{view:.0f}", lens, f"{one.near:g}-{inf if one.far is None else one.far:g}"
        cameras.append((name, one.frame, _position(one.pose), *seen, f"{one.rate:g}", f"{1000 * one.latency:.0f}"))
    titles = ("camera", "frame", "at [m]", "pixels", "view\n[deg]", "lens", "range\n[m]", "rate\n[Hz]", "latency\n[ms]")
    print_table(list(map(Column, titles)), cameras)
    ranges = next((one.ranges for one in found.detectors.values() if one.ranges), {})
    if ranges:  # from where to where each camera reads each marker that faces it
        reads = [(name, *(f"{near:.2f}-{far:.2f}" for near, far in own.values())) for name, own in ranges.items()]
        say()
        print_table([Column("reads [m]"), *numbers(*next(iter(ranges.values())))], reads)
    for name, camera in found.cameras.items():
        files = {"lens": camera.lens_file, "pose": camera.pose_file}
        if known := [f"{what} from {file}" for what, file in files.items() if file is not None]:
            say(f"{name}: {', '.join(known)}")


def print_new_cell(made: NewCell) -> None:
    """The new workspace, and how to go on."""
    where, run = shlex.quote(made.path), made.run
    more = ", and what becomes of the recording" if made.told else ", skills/pickup how a task is done"
    say(f"{where} is a new workspace: workspace.yaml says what is in the cell{more}.")
    if made.own_arm and made.width is not None:
        opens = "open" if len(made.fingers) > 1 else "opens"
        joints = " and ".join(f"`{name}`" for name in made.fingers)
        say(f"{joints} {opens} to {1000 * made.width:.3g} mm: used as the gripper, on `{made.tool_link}`.")
    elif made.own_arm:
        at = f"A suction cup stands for your tool at `{made.tool_link}`"
        say(f"{at}; `--gripper NAME`, or the URDF of yours, puts a gripper there.")
    if made.own_arm:
        say_command("Lines marked `check:` were guessed; compare with:", f"sqrp show {where}")
    for sentence in made.told:
        say(f"- {sentence}")
    if run is not None and run.outcome == "done":
        seen = f", and {run.seen} of {run.promised} predicted images showed what they should" if run.promised else ""
        say(f"`{made.task}` was run once in the simulated cell: done after {run.time:.1f} s{seen}.")
    elif run is not None:
        say(f"`{made.task}` was run once in the simulated cell: {run.outcome} at {run.time:.2f} s, {run.reason}")
    if made.task is not None:
        say_command("Try:", f'sqrp rank {where} "{made.task}"')


def print_program(found: ProgramDocument) -> None:
    """How late a fault is noticed, a row per step, the totals, the tool's actions with their times, and what next."""
    count, total = len(found.steps), found.total
    length = f", {total.time:.2f} s" if count else ""
    title = f" for {found.workspace}: {count} step{'s' * (count != 1)}{length}"
    say(joined([(Path(found.program).name, "bold"), title]))
    where = [f", in step {n}, {step.label}" if count > 1 else "" for n, step in enumerate(found.steps, 1)]
    for number, step in enumerate(found.steps, 1):
        for name, fault in step.faults.items():
            if fault.unseen:
                said = f"Never noticed{in_cases(fault.unseen)} if {step.happens[name]}{where[number - 1]}"
                say(f"{said}: no image is sure to show it.", "red")
    if total.step is not None and total.delay_worst is not None:
        which = f"{found.steps[total.step - 1].happens[total.fault or '']}{where[total.step - 1]}"
        say(f"Noticed at the latest after {total.delay_worst:.2f} s if {which}.")
    say()
    if count:
        titles = (
            "start\n[s]", "noticed\nat the\nlatest [s]", "critical time\nseen [%]", "time seen\n[%]", "takes\n[s]"
        )  # fmt: skip
        rows: list[list[TableCell]] = []
        for number, step in enumerate(found.steps, 1):
            figures = [_latest(step.faults.values()), step.q_eoi, step.q_avg, f"{step.time:.2f}"]
            rows.append([str(number), step.label, f"{step.start:.2f}", *figures])
        faults = _latest([fault for step in found.steps for fault in step.faults.values()])
        rows.append(["", "in all", "", faults, total.q_eoi, total.q_avg, f"{total.time:.2f}"])
        print_table([Column("#"), Column("step", shrink=True), *numbers(*titles)], rows)
        if found.tool:
            say("\nWhat the tool has to do:\n")
            columns = [Column("step"), Column("tool"), *numbers("from [s]", "to [s]")]
            print_table(columns, [(str(c.step), str(c), f"{c.start:.2f}", f"{c.end:.2f}") for c in found.tool])
            say()
    if found.held is not None:
        say(f"It leaves {found.held} in the tool.")
    if found.add is not None:
        say_command("To add a step:", found.add, "dim")


def _latest(faults: Collection[FaultMetrics]) -> Styled:
    """The longest time until a fault is noticed; never where no image is sure to show one."""
    worst = max((fault.delay_worst or 0.0 for fault in faults), default=None)
    return delay(worst, sum(fault.unseen for fault in faults))
