"""The output of `sqrp show` and `sqrp init`."""

from __future__ import annotations

import shlex

import numpy as np

from sqrp_cli.camera.detector import marker_ranges
from sqrp_cli.cell.workspace import Workspace
from sqrp_cli.motion.cell import Cell
from sqrp_cli.motion.collision import SAMPLES
from sqrp_cli.robot.robot import Robot
from sqrp_cli.show.documents.scene import NewCell
from sqrp_cli.show.terminal.console import Column, numbers, print_table, say, say_command


def print_scene(cell: Cell) -> None:
    """Robot, cameras, objects, skills and state."""
    workspace, model = cell.workspace, cell.model
    robot = workspace.robot
    say(
        f"{workspace.name}: {robot.urdf.path.name} with {len(model.arm)} arm joints, tool frame {robot.tool_frame}\n",
        "bold",
    )
    joints = [
        (name, *(f"{np.degrees(value):z.0f}" if turns else f"{1000 * value:z.0f} mm" for value in values))
        for name, turns, *values in zip(
            model.arm, model.turns, model.lower, model.upper, model.velocity, model.acceleration, model.jerk,
            model.home, strict=True,
        )
    ]  # fmt: skip
    print_table([Column("joint [deg, s]"), *numbers("min", "max", "v", "a", "j", "home")], joints)
    if robot.angle_tolerance:
        say(f"\ntool may be turned by {np.degrees(robot.angle_tolerance):g} deg from a pose")
    _print_hand(robot)
    say(_checked_pairs(cell))
    _print_cameras(workspace)
    _print_ranges(workspace)
    for camera in cell.workspace.cameras.values():
        files = {"lens": camera.lens_file, "pose": camera.pose_file}
        known = [f"{what} from {file}" for what, file in files.items() if file is not None]
        if known:
            say(f"{camera.name}: {', '.join(known)}")
    say()
    _print_objects(cell)
    _print_lights(workspace)
    say(f"\nskills  {', '.join(workspace.skills)}")
    say(f"state   {', '.join(sorted(map(str, workspace.state))) or 'nothing holds'}")
    say(f"tasks   {', '.join(expected.task for expected in workspace.tasks) or 'none'}")


def _print_cameras(workspace: Workspace) -> None:
    cameras = [
        (
            camera.name, camera.frame, _numbers(camera.X_FC[:3, 3]), f"{camera.width}x{camera.height}",
            f"{np.degrees(2 * np.arctan(camera.width / 2 / camera.matrix[0, 0])):.0f}", camera.distortion_model,
            f"{camera.near:g}-{camera.far:g}", f"{camera.rate:g}", f"{1000 * camera.lag:.0f}",
        )
        for camera in workspace.cameras.values()
    ]  # fmt: skip
    titles = ("at [m]", "pixels", "fov", "lens", "range [m]", "Hz", "ms")
    print_table([Column("camera"), Column("frame"), *(Column(title) for title in titles)], cameras)


def _print_ranges(workspace: Workspace) -> None:
    """From where to where each camera reads each marker that faces it, if there are any."""
    if workspace.markers:
        rows = [
            (name, *(f"{one.near:.2f}-{one.far:.2f}" for one in ranges.values()))
            for name, ranges in marker_ranges(workspace.cameras, workspace.markers).items()
        ]
        say()
        print_table([Column("reads [m]"), *numbers(*workspace.markers)], rows)


def _print_objects(cell: Cell) -> None:
    X_WO = cell.initial_world.X_WO
    objects = [
        (obj.name, " ".join(filter(None, (obj.color, obj.type, *obj.attributes))), _numbers(obj.size),
         _numbers(X_WO[obj.name][:3, 3]) if obj.name in X_WO else "unknown",
         "fixed" if obj.fixed else "movable", "tool" if obj.X_TO is not None else obj.on or "")
        for obj in cell.workspace.objects.values()
    ]  # fmt: skip
    print_table(
        [Column("object"), Column("what"), Column("size [m]"), Column("at [m]"), Column(""), Column("on")], objects
    )


def _print_lights(workspace: Workspace) -> None:
    if workspace.lights:
        rows = [
            (
                name,
                f"{light.intensity:g}",
                "everywhere" if light.is_ambient else _numbers(light.heading),
                "" if light.position is None else _numbers(np.array(light.position)),
                "" if light.position is None else f"{np.degrees(2 * light.half_beam):.0f}",
            )
            for name, light in workspace.lights.items()
        ]
        say()
        print_table([Column("light"), *map(Column, ("intensity", "direction", "at [m]", "beam [deg]"))], rows)


def print_new_cell(made: NewCell) -> None:
    """The new workspace, and how to go on."""
    where, run = shlex.quote(made.path), made.run
    say(f"{where} is a new workspace: workspace.yaml says what is in the cell, skills/pickup how a task is done.")
    if made.own_arm:
        guessed = f"The tool is fixed to `{made.tool_link}`. Lines marked `check:` were guessed; compare with:"
        say_command(guessed, f"sqrp show {where}")
    if run is not None and run.outcome == "done":
        seen = f", and {run.seen} of {run.promised} promised images showed what they should" if run.promised else ""
        say(f"`{made.task}` was run once in the simulated cell: done after {run.time:.1f} s{seen}.")
    elif run is not None:
        say(f"`{made.task}` was run once in the simulated cell: {run.outcome} at {run.time:.2f} s, {run.reason}")
    if made.task is not None:
        say_command("Try:", f'sqrp rank {where} "{made.task}"')


def _print_hand(robot: Robot) -> None:
    """The fingers and the markers on links, if there are any."""
    if robot.fingers is not None:
        joints = (
            f"{name} {1000 * opened:.0f} mm open, {1000 * robot.fingers.closed[name]:.0f} mm closed"
            for name, opened in robot.fingers.open.items()
        )
        say(f"\nfingers  {'; '.join(joints)}")
    if robot.markers:
        markers = (f"{link} (id {m.id} of {m.dictionary}, {1000 * m.side:.0f} mm)" for link, m in robot.markers.items())
        say(f"markers  {', '.join(markers)}")


def _checked_pairs(cell: Cell) -> str:
    """Which pairs of links are checked for contact, and which are not."""
    checked = len(cell.collision.self_pairs)
    contacts = cell.self_contacts
    if contacts is None:
        robot = cell.workspace.robot
        named = "the SRDF" if robot.srdf is None else robot.srdf.name
        return (
            f"\n{checked} pairs of parts are checked for contact; "
            f"{named} leaves out {len(robot.disabled_pairs)} pairs of links.\n"
        )
    names = ", ".join(f"{a}-{b}" for a, b in sorted(contacts.unchecked)) or "none"
    return (
        f"\n{checked} pairs of parts are checked for contact. There is no SRDF: left out are neighbours, and links "
        f"that touch at home or always: {names}. {len(contacts.never)} pairs of links touched at none of {SAMPLES} "
        "positions tried, and are checked all the same.\n"
    )


def _numbers(values: object) -> str:
    """Numbers [m] to 1 mm."""
    return " ".join(f"{value:z.3f}" for value in values)  # type: ignore[attr-defined]
