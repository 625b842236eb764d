"""The simulated cell served to others by messages of ROS."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from sqrp_cli.ask.api.cell import OpenCell
from sqrp_cli.ask.api.program import OpenProgram
from sqrp_cli.errors import bad_input, bad_option

if TYPE_CHECKING:
    from sqrp_cli.run.cell.robot_file import RobotFile

LOOPBACK = "127.0.0.1"  # the network on which a cell is served if nobody says otherwise: this computer alone
LISTENED = 0.7  # for how long it is listened whether another cell is served [s]: to be heard takes 0.3 s


def served_as(joints: Sequence[str], cell: OpenCell, network: str | None, domain: int | None) -> RobotFile:
    """How `run --robot` reaches a cell that is served. network: loopback by default.

    domain: of ROS 2; by default ROS_DOMAIN_ID, or the first that no participant on this computer is in, by the first
    port of each.
    """
    from sqrp_cli.field.cell_server import served_file

    named = os.environ.get("ROS_DOMAIN_ID")
    if domain is None and named is not None:
        if not named.isdigit() or int(named) > 232:
            raise bad_option(f"ROS_DOMAIN_ID is `{named}`, expected 0 to 232")
        domain = int(named)
    for free in range(100):
        if domain is not None:
            break
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.bind((LOOPBACK, 7400 + 250 * free + 10))
            domain = free
    return served_file(cell.workspace, joints, domain or 0, network or LOOPBACK)


def serve(
    cell: OpenCell,
    program: OpenProgram | None,
    file: RobotFile,
    faults: Sequence[str],
    seed: int,
    *,
    ready: Callable[[], None],
    tell: Callable[[str], None],
    factor: float = 1.0,
) -> None:
    """Serve a cell until Ctrl-C. program: where it starts and what faults are about; None: the cell's home.

    ready: called once it can be reached. tell: says what happens. factor: how fast its time passes at most.
    """
    from sqrp_cli.platform.simulator import check_simulator

    check_simulator()
    from sqrp_cli.field.cell_server import CellServer, Faults
    from sqrp_cli.motion.cell import Cell
    from sqrp_cli.run.cell.simulated_cell import SimulatedCell

    injected = [] if program is None else program.read_faults(faults, "--fault", served=True)
    steps = () if program is None else program.program.steps
    world = steps[0].before if steps else Cell.load(cell.workspace, seed).initial_world
    joints = list(file.joints or {}) if program is None else program.program.joints
    from sqrp_cli.ros.dds import DdsTransport

    transport = DdsTransport(file.domain, file.network)
    try:
        # Raises InputError where somebody else sends the time: nobody could tell two clocks, and two arms, apart.
        from sqrp_cli.run.cell.ros_cell import CLOCK

        inbox = transport.subscribe(CLOCK)
        transport.wait(LISTENED)
        if inbox.count:
            message = f"somebody else, such as another cell, sends `/clock` {file.where}"
            raise bad_input("no-network", message, mend="--domain N, with another number")
        with SimulatedCell(cell.workspace, world, seed) as simulated:
            simulated.frames(list(cell.workspace.cameras))  # the processes that draw are ready then
            server = CellServer(simulated, cell.workspace, file, transport, Faults(injected, steps, joints), tell)
            ready()
            server.serve(lambda: False, factor)
    finally:
        transport.close()
