"""SQRP computes how well the cameras of a robot cell will see what matters, before the robot moves."""

from sqrp_cli.ask.api.calibration import calibrate as calibrate
from sqrp_cli.ask.api.cell import OpenCell as OpenCell
from sqrp_cli.ask.api.cell import open_cell as open_cell
from sqrp_cli.ask.api.new_cell import new_cell as new_cell
from sqrp_cli.ask.api.program import OpenProgram as OpenProgram
from sqrp_cli.ask.api.program import open_program as open_program
from sqrp_cli.ask.api.program import read_run as read_run
from sqrp_cli.ask.api.results import read_result as read_result
from sqrp_cli.version import __version__ as __version__
